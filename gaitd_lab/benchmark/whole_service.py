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
from gaitd_lab.benchmark.figures import Figure
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
NS_PER_US: Final = 1000


READY_MAX_S: Final = 5.0
CORE_MAX_MB: Final = 200.0
GATEWAY_MAX_MB: Final = 120.0
DELIVERY_RATIO_MAX: Final = 3.0
"""Core and gateway both slept 10 ms, where bare Zenoh has one process that did."""


class Delivery(NamedTuple):
    """Medians of the time from the last TPDO to the callback, and of its parts in order, µs."""

    whole_us: float
    work_us: float
    """Work of the core's cycle: decode to frames sent."""
    beyond_us: float
    """All time after the work."""
    ipc_us: float
    """Record into the ring, the gateway's wake-up, and the encoding of the message."""
    gateway_us: float
    """From the gateway's wake-up to the message, as in `health`."""
    zenoh_us: float
    """Time from put to callback."""


def measure(configs: Path, seconds: float) -> list[Figure]:
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
        bare_us = bare_puts(size, seconds)
        time.sleep(max(filled_s - time.monotonic(), 0.0))
        core, gateway = (sample(made.parts[part].pid, 0.0) for part in ("core", "gateway"))
    if core is None or gateway is None:
        raise ServiceError("core or gateway has ended")
    ready = Figure(what="start to ready", value=ready_s, unit="s", at_most=READY_MAX_S)
    return [ready, *_memory(core.rss_mb, gateway.rss_mb), *_figures(delivery, bare_us)]


def _memory(core_mb: float, gateway_mb: float) -> tuple[Figure, Figure]:
    """Resident memory, without the ring, once that has been written whole."""
    return (
        Figure(what="memory of the core", value=core_mb, unit="MB", at_most=CORE_MAX_MB),
        Figure(what="memory of the gateway", value=gateway_mb, unit="MB", at_most=GATEWAY_MAX_MB),
    )


def _figures(delivery: Delivery, bare_us: float) -> tuple[Figure, ...]:
    return (
        Figure(
            what="delivery to a subscriber, beyond the work of the cycle",
            value=delivery.beyond_us,
            unit="µs",
            peer="bare Zenoh",
            peer_value=bare_us,
            at_most=DELIVERY_RATIO_MAX,
        ),
        Figure(what="delivery: work of the cycle", value=delivery.work_us, unit="µs"),
        Figure(what="delivery: ring and wake-up", value=delivery.ipc_us, unit="µs"),
        Figure(what="delivery: gateway", value=delivery.gateway_us, unit="µs"),
        Figure(what="delivery: Zenoh", value=delivery.zenoh_us, unit="µs"),
        Figure(what="last TPDO to subscriber", value=delivery.whole_us, unit="µs"),
    )


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
    whole_us, work_us, beyond_us, zenoh_us = map(median_us, zip(*rows, strict=True))
    return Delivery(whole_us, work_us, beyond_us, median_us(ipc_ns), gateway_us, zenoh_us)


def median_us(times_ns: Sequence[float]) -> float:
    """Return the median in µs."""
    return statistics.median(times_ns) / NS_PER_US


def _subscribe(session: zenoh.Session, key: str, came: list[ReceivedMessage]) -> None:
    def receive(sample: zenoh.Sample) -> None:
        time_ns, utc_ns = time.monotonic_ns(), time.time_ns()
        stamp = sample.timestamp
        zenoh_ns = utc_ns - round(stamp.get_time().timestamp() * 1e9) if stamp else 0
        came.append(ReceivedMessage(time_ns, sample.payload.to_bytes(), zenoh_ns))

    session.declare_subscriber(key, receive)


def bare_puts(size: int, seconds: float) -> float:
    """Median time from put to callback of a process that does nothing else, µs.

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
    return median_us([one.time_ns - bare_put.stamp_of(one.payload) for one in came])
