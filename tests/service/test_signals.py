"""SIGTERM, SIGKILL and SIGSTOP of each process, while it holds and while it walks.

Time is simulated, so milliseconds are asserted. By the wall clock: `tests/rigs`.
"""

import itertools
import signal

import pytest
from fault_observations import MASTER_HEARTBEAT, SYNC, Watch
from gaitd_names import Cause, Mode, StopCategory
from long_service import TIMEOUT_S

from daemon.ipc.record import Verdict
from drives.signals import PowerState

NODES = (5, 6)
WHILE = {Mode.GAIT: "walking", Mode.HOLD: "holding"}
LIFE_GUARD, RPDO_TIMEOUT = 0x8130, 0x8250
DETECTION_MS = 100
"""demo.toml."""
MOVED_MAX = {Mode.GAIT: (40.0, 700.0), Mode.HOLD: (1.0, 10.0)}
"""Degrees and millimetres. A gait goes on for the 0.3 s in which the gateway may be silent."""
OVERRUNS_IN_A_ROW, GATEWAY_SILENCE_CYCLES = 5, 30
"""limits.toml."""
SYNC_DISTANCE_MIN_NS = 7_000_000
SHORT_S, LONG_S = 0.035, 2.0
SHOWN_CYCLES = 30
RESTING = {PowerState.SWITCH_ON_DISABLED, PowerState.FAULT, PowerState.QUICK_STOP_ACTIVE}


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(Mode.HOLD, id="holding", marks=pytest.mark.thorough),
        pytest.param(Mode.GAIT, id="walking"),
    ],
)
def mode(request):
    return request.param


@pytest.fixture
def service(long_service, mode):
    if mode == Mode.HOLD:  # it holds where the springs do: a quick stop begins without torque
        long_service.bring(Mode.READY)
    return long_service.bring(mode)


@pytest.fixture
def seen(service):
    with Watch(service) as watch:
        yield watch


@pytest.fixture
def hold_up(service):
    def run(part, for_s):
        with service.held():
            service.kill(part, signal.SIGSTOP)
            service.run(for_s)
            service.kill(part, signal.SIGCONT)

    return run


def cycles_later(service, count=SHOWN_CYCLES):
    first = service.newest().seq
    service.until(lambda record: record.seq >= first + count)


def within(moved, mode):
    return all(one <= most for one, most in zip(moved[:2], MOVED_MAX[mode], strict=True))


def syncs_too_close(records):
    times = [record.sync_mono_ns for record in records]
    gaps = [late - early for early, late in itertools.pairwise(times)]
    return [gap for gap in gaps if gap < SYNC_DISTANCE_MIN_NS]


def first_stopped(records):
    return next(record for record in records if not record.mode.active)


def ms_since(seen, time_ns):
    return f"{(time_ns - seen.begun_ns) * 1e-6:.0f} ms"


# --- held up for a moment ---------------------------------------------------------------------


@pytest.mark.parametrize("part", ["core", "gateway"])
def test_35_ms_without_one_process_are_survived_without_a_stop_and_without_a_burst(
    service, seen, mode, hold_up, part, fault_table
):
    missed = service.newest().timing.overrun_count
    seen.begin()
    hold_up(part, SHORT_S)
    cycles_later(service)
    records = seen.records_since()
    missed = records[-1].timing.overrun_count - missed

    assert {record.verdict for record in records} == {Verdict()}
    assert {record.mode for record in records} == {mode}
    assert not syncs_too_close(records)
    assert missed == 0 if part == "gateway" else 0 < missed <= OVERRUNS_IN_A_ROW
    seen_by = f"core: {missed} grid points left out" if part == "core" else "none"
    fault_table.add(f"{part} SIGSTOP 35 ms", WHILE[mode], seen_by, "none", None, "none", mode)


# --- held up for long -------------------------------------------------------------------------


def test_a_core_that_comes_back_after_2_s_finds_its_drives_stopped_says_so_and_enables_nothing(
    service, seen, mode, hold_up, fault_table
):
    pid = service.parts["core"].pid
    seen.begin()
    hold_up("core", LONG_S)
    moved = seen.moved()  # without power it may fall out of that pose again
    back_ns = service.clock.now_ns()
    cycles_later(service)
    records = [record for record in seen.records() if record.sync_mono_ns >= back_ns]
    seen.read_bus()

    assert set(seen.emergency_codes().values()) in ({LIFE_GUARD}, {RPDO_TIMEOUT})
    assert all(came[0].time_ns < back_ns for came in seen.emergencies().values())
    told = {Cause.CYCLE_OVERRUN, Cause.DRIVE_NOT_OPERATIONAL, Cause.EMERGENCY, Cause.DRIVE_FAULT}
    assert records[0].verdict.cause in told
    assert records[0].mode in {Mode.STOPPING, Mode.FAULT}
    assert {record.mode for record in records[5:]} == {Mode.FAULT}
    assert not seen.enabling(since_ns=back_ns)
    assert not syncs_too_close(records)
    assert len(seen.since(SYNC)) <= len(seen.records_since()) + 1
    assert within(moved, mode), moved
    assert service.runs("core")
    assert service.parts["core"].pid == pid
    codes = [event["code"] for event in service.request("status")["events"]]
    assert "core_silent" in codes
    fault_table.add(
        "core SIGSTOP 2 s",
        WHILE[mode],
        "both drives: EMCY 8130h; core, once it goes on",
        f"{seen.alarm_ms():.0f} ms: quick stop by 6007h; first cycle of the core",
        moved,
        records[-1].verdict.cause.name,
        records[-1].mode,
    )


@pytest.mark.parametrize(
    "number",
    [
        signal.SIGSTOP,
        pytest.param(signal.SIGKILL, marks=pytest.mark.thorough),
        pytest.param(signal.SIGTERM, marks=pytest.mark.thorough),
    ],
)
def test_a_gateway_that_hangs_or_ends_makes_the_core_hold_and_its_return_enables_nothing(
    service, seen, mode, number, fault_table
):
    gateway = service.parts["gateway"]
    seen.begin()
    service.kill("gateway", number)
    service.until(lambda record: record.mode == Mode.FAULT)
    records = seen.records_since()
    if number == signal.SIGSTOP:
        service.kill("gateway", signal.SIGCONT)
    else:
        assert gateway.wait(10) == (0 if number == signal.SIGTERM else -number)
        service.start_gateway()
    service.wait(lambda: service.newest().gateway_age_cycles < GATEWAY_SILENCE_CYCLES, TIMEOUT_S)
    cycles_later(service)
    seen.read_bus()

    stopped = first_stopped(records)
    index = records.index(stopped)
    assert stopped.verdict.cause == Cause.GATEWAY_SILENT
    assert stopped.verdict.category == StopCategory.S2
    assert stopped.gateway_age_cycles > GATEWAY_SILENCE_CYCLES
    assert all(r.gateway_age_cycles <= GATEWAY_SILENCE_CYCLES for r in records[:index])
    newest = service.newest()
    assert newest.mode == Mode.FAULT
    assert {drive.power_state for drive in newest.drives} == {PowerState.OPERATION_ENABLED}
    assert within(seen.until_rest(TIMEOUT_S), mode), seen.moved()
    assert not seen.emergencies()
    assert not syncs_too_close(records)
    fault_table.add(
        f"gateway {number.name}",
        WHILE[mode],
        "core: age of the gateway's word",
        f"{stopped.gateway_age_cycles} cycles ({ms_since(seen, stopped.sync_mono_ns)}): S2",
        seen.moved(),
        stopped.verdict.cause.name,
        f"{newest.mode}, held",
    )


# --- ended ------------------------------------------------------------------------------------


def test_sigterm_stops_first_then_switches_off_and_ends_with_0(service, seen, mode, fault_table):
    seen.begin()
    service.kill("core", signal.SIGTERM)
    code = service.parts["core"].wait(15)
    ended_ns = service.clock.now_ns()
    records = seen.records_since()
    seen.read_bus()
    words = seen.statuswords()

    assert code == 0
    assert {record.verdict.cause for record in records[2:]} == {Cause.SHUTDOWN}
    assert {drive.power_state for drive in records[-1].drives} == {PowerState.SWITCH_ON_DISABLED}
    assert set(words.values()) == {PowerState.SWITCH_ON_DISABLED}
    assert not seen.emergencies()
    assert within(seen.moved(), mode), seen.moved()
    fault_table.add(
        "core SIGTERM",
        WHILE[mode],
        "core",
        f"next cycle: S1, off after standstill; ended after {ms_since(seen, ended_ns)}, exit 0",
        seen.moved(),
        records[-1].verdict.cause.name,
        "ended",
    )


def test_a_core_that_is_killed_leaves_drives_that_stop_and_the_next_core_waits_for_a_request(
    service, seen, mode, fault_table
):
    cycles_later(service, 10)  # a heartbeat of the master's is heard
    seen.begin()
    service.kill("core")
    service.run(LONG_S)
    moved = seen.moved()
    killed = service.boot_id()
    service.start("core")
    service.wait(lambda: service.boot_id() != killed, TIMEOUT_S)
    again = service.until(lambda one: one.mode in {Mode.READY, Mode.FAULT}, TIMEOUT_S)
    seen.read_bus()

    assert set(seen.emergency_codes().values()) in ({LIFE_GUARD}, {RPDO_TIMEOUT})
    for node in NODES:
        noticed_ms = seen.ms_until_noticed(node, MASTER_HEARTBEAT)
        assert noticed_ms == pytest.approx(DETECTION_MS, abs=1e-3)
    assert within(moved, mode), moved
    killed_ns = seen.begun_ns + int(SHORT_S * 1e9)
    assert not seen.enabling(since_ns=killed_ns)
    assert not any(record.mode.active for record in service.records())
    assert set(seen.statuswords().values()) <= RESTING
    fault_table.add(
        "core SIGKILL",
        WHILE[mode],
        "both drives: EMCY 8130h",
        f"{seen.alarm_ms():.0f} ms: quick stop by 6007h, then no power",
        moved,
        "said by the drives; the gateway: no records",
        f"new core: {again.mode}",
    )
