"""The service as processes: time from start to ready, memory, and delivery time to a subscriber.

Delivery is from the last TPDO of a cycle, by its time in the core's record, to the callback of a
Zenoh subscriber in this process. Without the cycle's own work it is compared with bare Zenoh in the
same minute: a process that does nothing but put (`bare_put.py`) to the same kind of subscriber,
with the same message length, rate, session and publisher as the gateway's. It is a process, because
the service's put comes from another one, too. It has the same rate, because a process that slept 10
ms begins with cold caches. The service keeps running beside it, because other load delays both.

The virtual drives give up their real-time priority for both measurements: real drives run their
firmware on their own processors. With two processors the gateway waited 0.4 ms for the virtual
drives, just after the core had sent the commands.

Zenoh's own stamp of the put, in wall-clock time, divides the time beyond the work.
"""

import os
import statistics
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import zenoh
from gaitd_client import wire
from gaitd_client.connection import Target, open_session

from daemon.ipc.record import CycleRecord
from gaitd_lab.benchmark import bare_put
from gaitd_lab.process_memory import sample
from gaitd_lab.processes import ServiceError, Tempo, free_port, tied
from gaitd_lab.timed_service import (
    RecordTail,
    TimedService,
    timed_service,
    until_ready,
    warm_up,
)

READY_WITHIN_S: Final = 60.0
FILLED_S: Final = 31.0
"""Time until the ring has been written once, so that all of its pages are resident."""
CONNECT_S: Final = 1.0
HIGH_RATIO: Final = 0.99
NS_PER_US: Final = 1000


class Service(NamedTuple):
    """Results of the measurement."""

    ready_s: float
    """Time from the start of the core's process to mode ready."""
    core_mb: float
    """Resident memory, without the ring, once that has been written whole."""
    gateway_mb: float
    ring_mb: float
    delivery: "Delivery"
    bare: "Spread"
    """Time from put to callback."""
    delivery_ratio: float
    """Ratio of the delivery time beyond the cycle's work to bare Zenoh; medians."""


class Spread(NamedTuple):
    """Median and 99 % of one time."""

    median_us: float
    high_us: float
    """99 % are not longer."""


class Delivery(NamedTuple):
    """Time from the last TPDO to the callback, and its parts in order."""

    whole: Spread
    work: Spread
    """Work of the core's cycle: decode to frames sent."""
    beyond: Spread
    """All time after the work."""
    ipc: Spread
    """Record into the ring, the gateway's wake-up, and the encoding of the message."""
    gateway_us: float
    """From the gateway's wake-up to the message, as in `health`; median."""
    zenoh: Spread
    """Time from put to callback."""


def measure(configs: Path, seconds: float) -> Service:
    """Start everything twice: the first start warms the caches.

    Raises:
        ServiceError: a process ended, or the service was not ready in time.
    """
    warm_up(configs)
    with timed_service(configs, Tempo(wall_clock=True)) as made:
        ready_s = until_ready(made, READY_WITHIN_S)
        filled_s = time.monotonic() + FILLED_S
        _step_back(made.parts["sim"].pid)
        delivery, size = _delivery(made, seconds)
        bare = bare_puts(size, seconds)
        time.sleep(max(filled_s - time.monotonic(), 0.0))
        core, gateway = (sample(made.parts[part].pid, 0.0) for part in ("core", "gateway"))
    if core is None or gateway is None:
        raise ServiceError("core or gateway has ended")
    ratio = delivery.beyond.median_us / bare.median_us
    return Service(ready_s, core.rss_mb, gateway.rss_mb, core.ring_mb, delivery, bare, ratio)


def _step_back(pid: int) -> None:
    """Remove the real-time priority from all threads of a process."""
    for task in Path(f"/proc/{pid}/task").iterdir():
        number = int(task.name)
        # Only root may clear this flag.
        flag = os.sched_getscheduler(number) & os.SCHED_RESET_ON_FORK
        os.sched_setscheduler(number, os.SCHED_OTHER | flag, os.sched_param(0))


class ReceivedMessage(NamedTuple):
    """One message at a subscriber."""

    time_ns: int
    payload: bytes
    zenoh_ns: int
    """Time since the put, by the wall clock; 0 without a stamp."""


def _delivery(made: TimedService, seconds: float) -> tuple[Delivery, int]:
    """Measure the estimates of one leg; return also the size of one in bytes."""
    came: list[ReceivedMessage] = []
    health: list[ReceivedMessage] = []
    records: list[CycleRecord] = []
    tail = RecordTail(made.ring_path)
    tail.read()
    with open_session(made.target) as session:
        trainer = made.target.trainer
        _subscribe(session, wire.key(trainer, made.leg, "estimate"), came)
        _subscribe(session, wire.key(trainer, wire.HEALTH), health)
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            time.sleep(0.5)
            records += tail.read()
    gateways_us = [
        message.gateway_estimate_p50_us
        for message in (msgspec.json.decode(one.payload, type=wire.Health) for one in health)
        if message.gateway_estimate_p50_us is not None
    ]
    if not gateways_us:
        raise ServiceError(
            f"none of {len(health)} messages of health says how long an estimate took"
        )
    return divide(came, records, statistics.median(gateways_us)), len(came[-1].payload)


def divide(
    came: Sequence[ReceivedMessage], records: Sequence[CycleRecord], gateway_us: float
) -> Delivery:
    """Match messages with the records they were made from, by cycle.

    Raises:
        ServiceError: they have no cycle in common.
    """
    # A record contains the work of the previous cycle.
    works_ns = {record.cycle - 1: record.timing.work_ns for record in records}
    sampled = {record.cycle: record for record in records if record.cycle in works_ns}
    rows: list[tuple[int, int, int, int]] = []
    for one in came:
        record = sampled.get(msgspec.json.decode(one.payload)["cycle"])
        if record is not None:
            whole_ns = one.time_ns - record.sync_mono_ns - record.timing.collect_ns
            work_ns = works_ns[record.cycle]
            rows.append((whole_ns, work_ns, whole_ns - work_ns, one.zenoh_ns))
    if not rows:
        raise ServiceError(f"none of {len(came)} messages belongs to one of {len(records)} records")
    ipc_ns = [beyond - zenoh_ns - gateway_us * NS_PER_US for *_, beyond, zenoh_ns in rows]
    whole, work, beyond, zenoh_part = map(spread, zip(*rows, strict=True))
    return Delivery(whole, work, beyond, spread(ipc_ns), gateway_us, zenoh_part)


def spread(times_ns: Sequence[float]) -> Spread:
    """Return median and 99 %."""
    ordered = sorted(times_ns)
    high_ns = ordered[int(HIGH_RATIO * (len(ordered) - 1))]
    return Spread(statistics.median(ordered) / NS_PER_US, high_ns / NS_PER_US)


def _subscribe(session: zenoh.Session, key: str, came: list[ReceivedMessage]) -> None:
    def receive(sample: zenoh.Sample) -> None:
        time_ns, utc_ns = time.monotonic_ns(), time.time_ns()
        stamp = sample.timestamp
        zenoh_ns = utc_ns - round(stamp.get_time().timestamp() * 1e9) if stamp else 0
        came.append(ReceivedMessage(time_ns, sample.payload.to_bytes(), zenoh_ns))

    session.declare_subscriber(key, receive)


def bare_puts(size: int, seconds: float) -> Spread:
    """Measure put to callback of a process that does nothing else.

    Raises:
        ServiceError: no message came.
    """
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    words = ("-m", bare_put.__name__, endpoint, str(size), str(seconds + CONNECT_S))
    came: list[ReceivedMessage] = []
    with subprocess.Popen(tied(*words)) as putting:
        time.sleep(CONNECT_S)
        with open_session(Target((endpoint,), bare_put.TRAINER)) as session:
            _subscribe(session, bare_put.KEY, came)
            putting.wait()
    if not came:
        raise ServiceError(
            f"a process that only puts ended with {putting.returncode}: nothing came"
        )
    return spread([one.time_ns - bare_put.stamp_of(one.payload) for one in came])
