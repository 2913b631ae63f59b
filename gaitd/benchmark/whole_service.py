"""The service as processes: start to ready, memory, and how long a sample takes to a subscriber.

Delivery is from the last TPDO of a cycle, as the core's record times it, to the callback of a Zenoh
subscriber in this process; less the cycle's own work it is compared with a bare put to the same
kind of subscriber, of a message as long, over the same kind of connection, in the same minute.
"""

import json
import socket
import statistics
import time
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import zenoh

from daemon import wire
from daemon.record import CycleRecord, Mode
from gaitd.demonstration.script import ActError
from gaitd.remote import client_settings
from gaitd.soaking.machinery import Machinery, RecordTail, machinery
from gaitd.soaking.memory import sample

WARM_WITHIN_S: Final = 300.0
READY_WITHIN_S: Final = 60.0
FILLED_S: Final = 31.0
"""The ring has been written once, so all of its pages are there."""
BARE_COUNT: Final = 500
BARE_PAUSE_S: Final = 0.004
NS_PER_US: Final = 1000
POLL_S: Final = 0.01


class Service(NamedTuple):
    """What was found."""

    ready_s: float
    """From the start of the core's process to mode ready."""
    core_mb: float
    """Resident, without the ring, once that has been written whole."""
    gateway_mb: float
    ring_mb: float
    delivery_us: float
    """Median, last TPDO to callback."""
    work_us: float
    """Median work of a cycle: decode to frames sent."""
    bare_us: float
    """Median, put to callback."""
    delivery_ratio: float
    """(delivery - work) / bare."""


def measure(configs: Path, seconds: float) -> Service:
    """Start everything twice: the first start warms the caches.

    Raises:
        ActError: a process ended, or the service was not ready in time.
    """
    with machinery(configs) as made:
        _until_ready(made, WARM_WITHIN_S)
    with machinery(configs) as made:
        ready_s = _until_ready(made, READY_WITHIN_S)
        filled_s = time.monotonic() + FILLED_S
        delivery_us, work_us, size = _delivery(made, seconds)
        bare_us = _bare_us(size)
        time.sleep(max(filled_s - time.monotonic(), 0.0))
        core, gateway = (sample(made.pid(part), 0.0) for part in ("core", "gateway"))
    if core is None or gateway is None:
        raise ActError("core or gateway has ended")
    return Service(
        ready_s,
        core.rss_mb,
        gateway.rss_mb,
        core.ring_mb,
        delivery_us,
        work_us,
        bare_us,
        (delivery_us - work_us) / bare_us,
    )


def _until_ready(made: Machinery, within_s: float) -> float:
    """Seconds from the core's start, which was just now; the virtual drives may be there later."""
    begun_s = time.monotonic()
    tail = RecordTail(made.ring)
    while time.monotonic() < begun_s + within_s:
        for part in ("sim", "core", "gateway"):
            made.check(part)
        if any(record.mode == Mode.READY for record in tail.read()):
            return time.monotonic() - begun_s
        time.sleep(POLL_S)
    raise ActError(f"not ready within {within_s:g} s: {made.words('core')}")


class _Came(NamedTuple):
    """One message at a subscriber."""

    time_ns: int
    payload: bytes


def _delivery(made: Machinery, seconds: float) -> tuple[float, float, int]:
    """Median µs from last TPDO to callback, of the cycle's work, and the bytes of a message."""
    came: list[_Came] = []
    records: list[CycleRecord] = []
    tail = RecordTail(made.ring)
    tail.read()
    with zenoh.open(_settings(made.target.endpoints)) as session:
        key = wire.key(made.target.trainer, made.leg, "estimate")
        _subscribe(session, key, came)
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            time.sleep(0.5)
            records += tail.read()
    sampled = {record.cycle: record for record in records}
    delays_us: list[float] = []
    for one in came:
        record = sampled.get(msgspec.json.decode(one.payload)["cycle"])
        if record is not None:
            last_tpdo_ns = record.sync_mono_ns + record.timing.collect_ns
            delays_us.append((one.time_ns - last_tpdo_ns) / NS_PER_US)
    if not delays_us:
        raise ActError(f"none of {len(came)} messages belongs to one of {len(records)} records")
    work_us = statistics.median(record.timing.work_ns for record in records) / NS_PER_US
    return statistics.median(delays_us), work_us, len(came[-1].payload)


def _subscribe(session: zenoh.Session, key: str, came: list[_Came]) -> None:
    def hear(sample: zenoh.Sample) -> None:
        came.append(_Came(time.monotonic_ns(), sample.payload.to_bytes()))

    session.declare_subscriber(key, hear)


def _settings(endpoints: tuple[str, ...]) -> zenoh.Config:
    config = zenoh.Config()
    for key, value in client_settings(endpoints).items():
        config.insert_json5(key, json.dumps(value))
    return config


def _bare_us(size: int) -> float:
    """Median of put to callback between two sessions, with nothing else."""
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{holder.getsockname()[1]}"
    listening = zenoh.Config()
    listening.insert_json5("listen/endpoints", json.dumps([endpoint]))
    listening.insert_json5("scouting/multicast/enabled", "false")
    came: list[_Came] = []
    sent_ns: list[int] = []
    with zenoh.open(listening) as putting, zenoh.open(_settings((endpoint,))) as session:
        _subscribe(session, "bench", came)
        time.sleep(0.5)
        for number in range(BARE_COUNT):
            sent_ns.append(time.monotonic_ns())
            putting.put("bench", number.to_bytes(8, "little") + bytes(max(size - 8, 0)))
            time.sleep(BARE_PAUSE_S)
        time.sleep(0.5)
    delays = [one.time_ns - sent_ns[int.from_bytes(one.payload[:8], "little")] for one in came]
    return statistics.median(delays) / NS_PER_US
