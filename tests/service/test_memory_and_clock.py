"""No memory for the core and for the gateway, and a wall clock that steps.

The kernel's own last resort against a process is SIGKILL: test_signals.py.
"""

import contextlib
import itertools
import resource

import pytest
from fault_observations import CONTROLWORDS, Watch
from gaitd_names import Cause, Mode
from long_service import ALTERED_CORE, TIMEOUT_S

from daemon.ipc.record import Verdict
from drives.signals import PowerState

STEPS_S = (3600, -7200, 3600)
SHOWN_CYCLES = 50
WITHOUT_MEMORY_CYCLES = 200
BUG = 4
QUICK_STOP_MASK, QUICK_STOP = 0x06, 0x02


@pytest.fixture(scope="module")
def altered(long_service):
    """The long service with a core that obeys lines on stdin (altered_core.py)."""
    service = long_service
    if service.runs("core"):
        service.kill("core")
    killed = service.boot_id()
    if not service.runs("sim"):
        service.start_drives()
    service.start("core", program=ALTERED_CORE)
    service.wait(lambda: service.boot_id() not in {killed, ""}, TIMEOUT_S)
    return service


def tell(service, line):
    service.parts["core"].stdin.write(line.encode() + b"\n")
    service.parts["core"].stdin.flush()


def cycles_later(service, count=SHOWN_CYCLES):
    first = service.newest().seq
    service.until(lambda record: record.seq >= first + count)


@contextlib.contextmanager
def without_more_memory(process):
    """From now on the system gives this process no address space."""
    before = resource.prlimit(process.pid, resource.RLIMIT_AS)
    resource.prlimit(process.pid, resource.RLIMIT_AS, (1 << 20, before[1]))
    try:
        yield
    finally:
        if process.poll() is None:
            resource.prlimit(process.pid, resource.RLIMIT_AS, before)


def test_utc_that_steps_an_hour_forth_and_back_is_recorded_and_changes_nothing_else(
    altered, fault_table
):
    service = altered.bring(Mode.GAIT)
    with Watch(service) as seen:
        for seconds in STEPS_S:
            tell(service, f"utc {seconds}")
            cycles_later(service)
        records = seen.records()

    pairs = list(itertools.pairwise(records))
    steps = [
        round((b.sync_utc_ns - a.sync_utc_ns - (b.sync_mono_ns - a.sync_mono_ns)) * 1e-9)
        for a, b in pairs
    ]
    assert [step for step in steps if step] == list(STEPS_S)
    assert {record.verdict for record in records} == {Verdict()}
    assert {record.mode for record in records} == {Mode.GAIT}
    for before, after in pairs:
        assert after.dt_s == pytest.approx((after.sync_mono_ns - before.sync_mono_ns) * 1e-9)
    assert max(record.gateway_age_cycles for record in records) < 30
    fault_table.add(
        "UTC of the core steps by an hour, forth and back",
        "walking",
        "the records",
        "none",
        None,
        "none",
        "gait",
    )


def test_a_core_that_gets_no_more_memory_walks_on_and_still_stops_when_asked(altered, fault_table):
    service = altered.bring(Mode.GAIT)
    core = service.parts["core"]
    with Watch(service) as seen, without_more_memory(core):
        cycles_later(service, WITHOUT_MEMORY_CYCLES)
        records = seen.records_since()
        assert service.request("stop")["outcome"] == "done"
        stopped = service.until(lambda record: record.mode == Mode.FAULT)

    assert {record.mode for record in records} == {Mode.GAIT}
    assert core.poll() is None
    assert stopped.verdict.cause == Cause.STOP_REQUESTED
    fault_table.add(
        "core gets no more address space",
        "walking",
        "none: a cycle needs no more memory",
        f"none in {WITHOUT_MEMORY_CYCLES} cycles; a stop is obeyed",
        None,
        "none",
        "gait",
    )


@pytest.mark.thorough
def test_a_gateway_that_gets_no_more_memory_dies_or_serves_and_the_core_holds_at_the_latest(
    altered, fault_table
):
    service = altered.bring(Mode.GAIT)
    gateway = service.parts["gateway"]
    with Watch(service) as seen, without_more_memory(gateway):
        for _ in range(3):
            service.request("schema")
        ended = gateway.poll()
        if ended is not None:
            service.until(lambda record: record.mode == Mode.FAULT)
        records = seen.records_since()

    assert service.runs("core")
    causes = {record.verdict.cause for record in records}
    assert causes <= {Cause.NONE, Cause.GATEWAY_SILENT}
    assert (Cause.GATEWAY_SILENT in causes) == (ended is not None)
    fault_table.add(
        "gateway gets no more address space, and a client comes",
        "walking",
        "none" if ended is None else "core: age of the gateway's word",
        "serves on" if ended is None else f"gateway ended with {ended}; core: S2",
        seen.moved(),
        "none" if ended is None else records[-1].verdict.cause.name,
        records[-1].mode,
    )


def test_a_core_whose_python_runs_out_of_memory_stops_the_drives_and_ends_with_4(
    altered, fault_table
):
    service = altered.bring(Mode.GAIT)
    with Watch(service) as seen:
        tell(service, "memory")
        code = service.parts["core"].wait(TIMEOUT_S)
        service.wait(lambda: seen.read_bus() and len(seen.emergencies()) == 2, TIMEOUT_S)
        moved = seen.until_rest(TIMEOUT_S)
        words = seen.statuswords()
        status = service.request("status")

    assert code == BUG
    assert "MemoryError" in service.log("core")
    for can_id in CONTROLWORDS:
        last = seen.since(can_id)[-1]
        assert last.data[0] & QUICK_STOP_MASK == QUICK_STOP
    assert set(words.values()) <= {PowerState.QUICK_STOP_ACTIVE, PowerState.FAULT}
    assert not status["safety"]["valid"]
    assert service.runs("gateway")
    fault_table.add(
        "MemoryError in a cycle of the core",
        "walking",
        "core: its own exception; then the drives: EMCY 8130h",
        "same cycle: quick stops sent blindly for 50 cycles, exit 4",
        moved,
        "said by the drives; the gateway: no records",
        "ended",
    )
