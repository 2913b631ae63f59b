"""Each rule of the supervisor on a core set to one state: what changes, and what is told."""

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest
from core_bench import JUMPED, OPENED, Bench
from fresh_core import fresh, has_received, show
from gaitd_names import (
    Cause,
    EventCode,
    Failure,
    Finding,
    Lapse,
    Mode,
    Outcome,
    ProgressCode,
    RequestKind,
    Role,
    StopCategory,
    Trigger,
)
from msgspec.structs import replace as replace_fields
from safety_inputs import CATEGORIES
from step_inputs import a_core

from daemon.core.exercises.hold import Hold
from daemon.core.modes import latched_stop, table
from daemon.core.modes.persistent_state import PersistentState, StoredVerdict
from daemon.core.safety.joints import Joint
from daemon.core.safety.stop_sequence import DriveStop, Step, begin
from daemon.core.slices import Placed
from daemon.core.state import HOLD_SETTLE_CYCLES
from daemon.core.steps import exercises, single_axis, supervisor
from daemon.core.steps.single_axis import Change
from daemon.ipc.record import ModeRequest, Request, Verdict
from daemon.ipc.report import Event, Progress
from daemon.wire.causes import DOUBTFUL_FEEDBACK, LOST_DRIVE
from drives.cia402.drive import DriveGroup
from drives.signals import PowerState

HOLD, QUICK, DISABLE, NMT = Step.HOLD, Step.QUICK_STOP, Step.DISABLE, Step.NMT_STOP
ON, OFF = PowerState.OPERATION_ENABLED, PowerState.SWITCH_ON_DISABLED
HOUR_NS = 3_600_000_000_000
NOTED = StoredVerdict("S0", "encoder_jump", "right/hip", 2.5, 1.5, utc_ns=7)
ACTIVE = [mode for mode in Mode if mode.active]
SLIDE_OPENED = Verdict(StopCategory.S1, Cause.HAND_SWITCH_OPEN, "right/slide")
HELD_UP = Verdict(StopCategory.S2, Cause.GATEWAY_SILENT)
NOT_OBEYED = Verdict(StopCategory.S0, Cause.STOP_NOT_OBEYED, "right/hip")
ENABLED = Verdict(StopCategory.S0, Cause.UNEXPECTED_ENABLE, "right/slide")
SHUTDOWN = Verdict(StopCategory.S1, Cause.SHUTDOWN)

STEP = Progress(ProgressCode.SETTING_UP, "right/hip", (12, 70))


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.fixture
def ready(bench) -> Bench:
    """In READY: the drives are up, have no power and rest."""
    bench.core.mode, bench.core.drives = Mode.READY, DriveGroup([])
    bench.core.load_checked = False
    exercises.clear(bench.core)
    bench.show(PowerState.SWITCH_ON_DISABLED)
    return bench


class Run(SimpleNamespace):
    """A homing of the hip, as far as the supervisor sees one."""

    axis, by_drive, is_over, mode = "right/hip", False, False, Mode.REFERENCE

    def failed(self, why: Failure) -> "Run":
        return Run(is_over=True, why=why)

    def advance(self, sample: object) -> "Run":
        del sample
        return self


@pytest.mark.parametrize(
    ("asks", "mode", "begins"),
    [
        *((True, Mode.GAIT, True), (False, Mode.GAIT, False)),
        *((True, Mode.TORQUE, False), (True, Mode.EXCITE, False)),
    ],
)
def test_a_gait_with_a_passive_patient_begins_the_minute_of_each_leg(bench, asks, mode, begins):
    core, (leg,) = bench.core, bench.core.legs
    wanted = ModeRequest(mode, 0.25, 1.0, 80.0, scenario="friction_hip", baseline=asks)

    supervisor._execute(core, Request(1, RequestKind.MODE, 7, wanted), 7, 0)

    told = [event for event in core.events if event.code is EventCode.BASELINE_BEGUN]
    assert told == ([Event(EventCode.BASELINE_BEGUN, "right")] if begins else [])
    assert (leg.passive.strides is not None) is begins
    assert leg.passive.growing_strides == (2 if begins else 0)


def mode_changed(before, after, trigger):
    return Event(EventCode.MODE_CHANGED, "", (before, after, trigger))


def requested(kind, mode=Mode.HOLD):
    return Event(EventCode.REQUEST_RECEIVED, "", (kind, mode))


def cause_told(code, verdict, *values):
    numbers = verdict.category, verdict.cause, verdict.value, verdict.limit, verdict.finding
    return Event(code, verdict.drive, (*numbers, *values), verdict.said)


def stops(core, *steps, cycle=50):
    for axis, step in zip(core.axes, steps, strict=True):
        axis.stop = None if step is None else begin(step, axis.sensed.joint, cycle)


# --- a cycle --------------------------------------------------------------------------------------


def test_a_cycle_keeps_the_time_the_latch_the_doubts_and_the_references(bench, monkeypatch):
    bench.utc_ns, doubtful = HOUR_NS, []
    monkeypatch.setattr(supervisor.persistence, "store_sign_doubts", doubtful.append)

    bench.turn(OPENED)

    assert bench.core.utc_newest_ns == HOUR_NS
    assert bench.core.persistent.latched.cause == "hand_switch_open"
    assert bench.core.persistent.latched.utc_ns == HOUR_NS
    assert bench.core.legs[0].reference is not None
    assert doubtful == [bench.core]


def test_requests_are_answered_and_a_stop_is_latched_while_there_are_no_drives(bench):
    core = bench.core
    core.mode, core.verdict = Mode.FAULT, OPENED
    core.request = Request(1, RequestKind.ENABLE)
    refused = Request(2, RequestKind.ENABLE, 100, role=Role.UNRESTRICTED)

    supervisor.rest(core, 100, HOUR_NS)
    assert core.request is None
    has_received(core, request=refused)
    supervisor.rest(core, 100, HOUR_NS)

    assert (core.result.id, core.result.outcome) == (2, Outcome.REFUSED)
    assert core.persistent.latched.utc_ns == HOUR_NS


def test_a_request_while_there_are_no_drives_is_of_this_cycle_and_latches_at_this_time(bench):
    core = bench.core
    core.mode, core.verdict, core.drives = Mode.FAULT, OPENED, DriveGroup([])
    for cycle, outcome in ((99, Outcome.REFUSED), (100, Outcome.PENDING)):
        request = Request(cycle, RequestKind.RESET, 100, role=Role.UNRESTRICTED)
        has_received(core, request=request)
        supervisor.rest(core, cycle, 0)
        assert core.result.outcome is outcome


# --- requests -------------------------------------------------------------------------------------


def test_enabling_begins_with_nothing_of_before(ready):
    core = ready.core
    core.verdict, core.load_checked, core.load_settle_cycles = OPENED, True, 7
    core.bring_up = STEP
    for axis in core.axes:
        axis.energy.add(5.0)

    assert ready.ask(RequestKind.ENABLE) == Outcome.PENDING

    assert (core.mode, core.verdict, core.bring_up) == (Mode.HOLD, Verdict(), None)
    assert (core.load_checked, core.load_settle_cycles) == (False, 1)
    assert [axis.energy.so_far(9) for axis in core.axes] == [0.0, 0.0]
    assert core.events == [
        requested(RequestKind.ENABLE),
        mode_changed(Mode.READY, Mode.HOLD, Trigger.ENABLE),
    ]


@pytest.mark.parametrize(
    "state", [state for state in PowerState if state is not PowerState.OPERATION_ENABLED]
)
def test_disabling_enables_no_drive_in_order_to_hold(bench, state):
    show(
        bench.core.axes[0], feedback=bench.core.axes[0].sensed.feedback._replace(power_state=state)
    )

    bench.ask(RequestKind.DISABLE)

    assert bench.steps() == [QUICK, QUICK]


def test_disabling_brakes_and_holds_both_axes(bench):
    core, (leg,) = bench.core, bench.core.legs
    bench.show(PowerState.OPERATION_ENABLED, velocity_si=0.5)
    leg.exercise = None

    bench.ask(RequestKind.DISABLE)

    assert (core.mode, core.disabling) == (Mode.STOPPING, True)
    assert leg.exercise.start_velocity == (0.5, 0.5)
    for axis in core.axes:
        assert axis.stop[:3] == (Step.HOLD, bench.cycle, 0.5)
    assert core.events == [
        requested(RequestKind.DISABLE),
        mode_changed(Mode.HOLD, Mode.STOPPING, Trigger.DISABLE),
    ]


def test_disabling_during_a_homing_cancels_it_without_a_hold(bench):
    core = bench.core
    core.mode, core.single_axis = Mode.REFERENCE, Run()

    bench.ask(RequestKind.DISABLE)

    assert (core.mode, core.disabling) == (Mode.STOPPING, True)
    assert core.single_axis.why is Failure.DISABLE_REQUESTED
    assert bench.steps() == [Step.DISABLE, Step.DISABLE]


def test_a_stop_request_cancels_a_homing(bench):
    bench.core.mode, bench.core.single_axis = Mode.REFERENCE, Run()

    has_received(bench.core, stop=True)
    supervisor.rest(bench.core, 1, 0)

    assert bench.core.single_axis.why is Failure.STOP_REQUESTED


def test_a_reset_drops_drives_latch_verdict_and_homing(bench):
    core = bench.core
    core.mode, core.drives, core.single_axis = Mode.FAULT, DriveGroup([]), Run()
    core.verdict, core.persistent = OPENED, PersistentState(latched=NOTED)
    core.reset_settle_cycles = 5

    assert bench.ask(RequestKind.RESET) == Outcome.PENDING

    assert (core.mode, core.drives, core.single_axis) == (Mode.OFF, None, None)
    assert (core.verdict, core.persistent.latched) == (Verdict(), None)
    assert (core.reset_cycles_left, core.reset_settle_cycles) == (100, 0)
    assert core.events == [
        requested(RequestKind.RESET),
        mode_changed(Mode.FAULT, Mode.OFF, Trigger.RESET),
    ]


def test_a_mode_that_is_requested_begins_with_its_exercise_and_its_controller(bench):
    core = bench.core
    has_received(core, lease=7)

    bench.ask(RequestKind.MODE, ModeRequest(Mode.TORQUE))

    assert core.mode == Mode.TORQUE
    assert core.assisted.torque_lease == 7
    assert type(core.legs[0].exercise).__name__ == "Torque"
    assert core.events[-2:] == [
        mode_changed(Mode.HOLD, Mode.TORQUE, Trigger.TO_TORQUE),
        Event(EventCode.REQUEST_DONE, "", (RequestKind.MODE, Mode.TORQUE)),
    ]


def test_a_mode_that_is_requested_begins_with_its_assist(bench, monkeypatch):
    assist, assisted = object(), bench.core.assisted
    monkeypatch.setattr(supervisor.controllers, "begun", lambda *given: ((assist,), assisted))

    supervisor._execute(bench.core, Request(1, RequestKind.MODE, 7, ModeRequest(Mode.TORQUE)), 7, 0)

    assert bench.core.legs[0].assist is assist


def test_a_sign_test_that_is_requested_brings_the_drives_up_anew_with_its_limits(ready):
    core = ready.core
    core.config = replace(core.config, patient_configured=False)
    core.persistent = PersistentState(latched=NOTED)

    ready.ask(RequestKind.MODE, ModeRequest(Mode.COMMISSION, axis="right/hip"))

    assert (core.single_axis.axis, core.single_axis.requested_cycle) == ("right/hip", ready.cycle)
    assert (core.mode, core.drives) == (Mode.OFF, None)
    assert core.persistent.latched is None
    assert core.events[-1] == mode_changed(Mode.READY, Mode.OFF, Trigger.BRING_UP_RESTARTED)


# --- homing and sign test -------------------------------------------------------------------------


@pytest.fixture
def changed(monkeypatch):
    """Makes the homing of the next cycle bring about a change."""
    return lambda change: monkeypatch.setattr(single_axis, "advance", lambda core, cycle: change)


def test_a_homing_begins_when_the_drives_are_up(ready, changed):
    ready.core.single_axis = Run()
    changed(Change(Trigger.TO_REFERENCE))

    ready.turn()

    assert (ready.core.mode, ready.core.disabling) == (Mode.REFERENCE, False)
    assert ready.core.events == [
        mode_changed(Mode.READY, Mode.REFERENCE, Trigger.TO_REFERENCE),
        Event(EventCode.SINGLE_AXIS_BEGUN, "right/hip", (Mode.REFERENCE,)),
    ]
    assert ready.steps() == []


def test_a_homing_may_move_the_origin_of_its_axis_from_its_begin(ready, changed):
    hip, slide = ready.core.axes
    show(hip, followed=True)
    show(slide, followed=True)
    changed(Change(Trigger.TO_REFERENCE, homing=hip))

    ready.turn()

    assert (hip.sensed.followed, slide.sensed.followed) == (False, True)


def test_a_homing_that_is_over_switches_off_as_a_disable_does(bench, changed):
    core = bench.core
    core.mode, hip = Mode.REFERENCE, core.axes[0]
    show(hip, referenced=False)
    changed(Change(Trigger.EXERCISE_OVER, homed=hip))

    bench.turn()

    assert (core.mode, core.disabling) == (Mode.STOPPING, True)
    assert (hip.sensed.followed, hip.sensed.referenced, core.axes[1].sensed.followed) == (
        True,
        True,
        False,
    )
    assert [axis.stop for axis in core.axes] == [
        begin(Step.DISABLE, axis.sensed.joint, bench.cycle) for axis in core.axes
    ]
    assert core.events == [mode_changed(Mode.REFERENCE, Mode.STOPPING, Trigger.EXERCISE_OVER)]


def test_after_a_homing_the_drives_are_brought_up_with_their_usual_limits(ready, changed):
    core = ready.core
    changed(Change(Trigger.BRING_UP_RESTARTED))

    ready.turn()

    assert (core.mode, core.drives, core.disabling) == (Mode.OFF, None, False)
    assert core.events == [mode_changed(Mode.READY, Mode.OFF, Trigger.BRING_UP_RESTARTED)]


# --- verdicts -------------------------------------------------------------------------------------


@pytest.mark.parametrize("cause", Cause)
def test_doubtful_feedback_has_the_encoder_of_its_axis_compared_again(bench, cause):
    hip, slide = bench.core.axes
    show(hip, followed=True)
    show(slide, followed=True, sign_trusted=True)
    show(hip, sign_trusted=True)

    supervisor.stop(bench.core, Verdict(StopCategory.S0, cause, "right/hip"), 123)

    is_kept = cause not in DOUBTFUL_FEEDBACK
    assert (hip.sensed.followed, slide.sensed.followed) == (is_kept, True)
    assert (hip.sensed.sign_trusted, slide.sensed.sign_trusted) == (is_kept, True)


def test_a_command_that_is_no_number_is_the_fault_of_no_drive(bench):
    cause = Cause.COMMAND_NOT_FINITE

    supervisor.refuse_command(bench.core, 123)

    assert bench.core.verdict == Verdict(bench.core.config.categories.of(cause), cause)


@pytest.mark.parametrize("mode", [*ACTIVE, Mode.READY])
def test_the_first_verdict_stops_whatever_is_under_way(bench, mode):
    core = bench.core
    core.mode, core.disabling, core.reset_cycles_left = mode, True, 9
    core.causes_reported = {(Cause.ENCODER_JUMP, "right/hip")}
    core.legs[0].exercise = None
    bench.show(PowerState.OPERATION_ENABLED, velocity_si=0.5)

    supervisor.stop(core, OPENED, 123)

    assert (core.mode, core.verdict) == (Mode.STOPPING, OPENED)
    assert (core.disabling, core.reset_cycles_left) == (False, 0)
    assert core.causes_reported == {(Cause.HAND_SWITCH_OPEN, "right/hip")}
    assert core.legs[0].exercise.start_velocity == (0.5, 0.5)
    assert [axis.stop for axis in core.axes] == [DriveStop(Step.QUICK_STOP, 123, 0.5)] * 2
    assert core.events == [
        mode_changed(mode, Mode.STOPPING, Trigger.STOP),
        cause_told(EventCode.STOPPED, OPENED),
    ]


def test_a_stop_that_an_orderly_shutdown_has_begun_in_ready_goes_on(ready):
    stops(ready.core, NMT, DISABLE)

    supervisor.stop(ready.core, ENABLED, 123)

    assert [axis.stop[:2] for axis in ready.core.axes] == [(NMT, 50), (DISABLE, 50)]


@pytest.mark.parametrize("mode", [Mode.OFF, Mode.BRINGING_UP])
def test_a_verdict_before_the_drives_are_up_changes_no_mode(bench, mode):
    bench.core.mode = mode

    supervisor._take_verdicts(bench.core, [OPENED], 123)
    supervisor.stop(bench.core, OPENED, 123)

    assert bench.core.mode == mode


@pytest.mark.parametrize(
    ("verdict", "shown", "alone", "steps"),
    [
        (HELD_UP, (ON, ON), False, [HOLD, HOLD]),
        (HELD_UP, (ON, OFF), False, [QUICK, QUICK]),
        (HELD_UP, (OFF, ON), False, [QUICK, QUICK]),
        (HELD_UP, (ON, ON), True, [QUICK, QUICK]),
        (OPENED, (ON, ON), True, [QUICK, QUICK]),
        (JUMPED, (ON, ON), False, [DISABLE, QUICK]),
        (JUMPED, (ON, ON), True, [DISABLE, QUICK]),
        (ENABLED, (ON, ON), False, [DISABLE, DISABLE]),
    ],
)
def test_a_stop_begins_on_each_axis_with_the_step_that_its_power_allows(
    bench, verdict, shown, alone, steps
):
    core = bench.core
    core.single_axis = Run() if alone else None
    for axis, state in zip(core.axes, shown, strict=True):
        show(axis, feedback=axis.sensed.feedback._replace(power_state=state))

    supervisor.stop(core, verdict, 123)

    assert bench.steps() == steps


@pytest.mark.parametrize(
    ("latched", "verdict", "replaces"),
    [
        (HELD_UP, OPENED, True),
        (OPENED, HELD_UP, False),
        (OPENED, SLIDE_OPENED, False),
        (OPENED, JUMPED, True),
        (JUMPED, SHUTDOWN, False),
        (HELD_UP, SHUTDOWN, False),
        (Verdict(), SHUTDOWN, True),
        (HELD_UP, Verdict(StopCategory.S1, Cause.STOP_REQUESTED), True),
        (Verdict(StopCategory.S0, Cause.STOP_NOT_OBEYED, "right/slide"), JUMPED, False),
        (NOT_OBEYED, JUMPED, True),
        (NOT_OBEYED, Verdict(StopCategory.S0, Cause.ENCODER_JUMP, "right/slide"), False),
        (NOT_OBEYED, Verdict(StopCategory.S0, Cause.STO_ACTIVE, "right/hip"), False),
        (Verdict(StopCategory.S0, Cause.STO_ACTIVE, "right/hip"), JUMPED, False),
        (Verdict(StopCategory.S0, Cause.SIGN_WRONG, "right/hip"), JUMPED, False),
        (Verdict(StopCategory.S0, Cause.VELOCITY_LIMIT, "right/hip"), JUMPED, False),
        (Verdict(StopCategory.S2, Cause.STOP_REQUESTED), SHUTDOWN, False),
    ],
)
@pytest.mark.parametrize("mode", [Mode.STOPPING, Mode.FAULT])
def test_a_later_verdict_replaces_the_latched_one_only_if_it_is_harsher_or_explains_it(
    bench, mode, latched, verdict, replaces
):
    core = bench.core
    core.mode, core.verdict, core.disabling, core.causes_reported = mode, latched, True, set()
    stops(core, QUICK, QUICK)

    supervisor.stop(core, verdict, 123)
    told = cause_told(EventCode.STOPPED if replaces else EventCode.FURTHER_CAUSE, verdict)
    assert core.events == [told]
    assert core.mode == mode
    assert core.verdict == (verdict if replaces else latched)
    assert core.disabling is not replaces

    supervisor.stop(core, verdict, 124)

    assert core.causes_reported == {(verdict.cause, verdict.drive)}
    assert core.events == [told]


def test_a_later_verdict_is_told_again_if_it_is_another_drive_s(bench):
    bench.core.mode, bench.core.verdict = Mode.STOPPING, OPENED
    bench.core.causes_reported = {(OPENED.cause, OPENED.drive)}
    stops(bench.core, QUICK, QUICK)

    supervisor.stop(bench.core, OPENED, 123)
    supervisor.stop(bench.core, SLIDE_OPENED, 123)

    assert bench.core.events == [cause_told(EventCode.FURTHER_CAUSE, SLIDE_OPENED)]


@pytest.mark.parametrize("index", [0, 1])
@pytest.mark.parametrize(
    "cause", [Cause.MOVED_AGAINST_DRIVE, Cause.EFFORT_DEVIATION, Cause.TRACKING_LIMIT]
)
def test_only_a_drive_that_was_moved_against_must_slow_at_once(cause, index):
    core = a_core(mode=Mode.STOPPING, verdict=OPENED, disabling=False, causes_reported=set())
    verdict = Verdict(StopCategory.S1, cause, core.axes[index].name)

    supervisor.stop(core, verdict, 123)

    judged = [one == index and cause is Cause.MOVED_AGAINST_DRIVE for one in (0, 1)]
    assert [axis.stop.must_slow_below_si < math.inf for axis in core.axes] == judged


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ((None, None), [(DISABLE, 123), (QUICK, 123)]),
        ((HOLD, HOLD), [(DISABLE, 123), (QUICK, 123)]),
        ((NMT, None), [(NMT, 50), (QUICK, 123)]),
        ((DISABLE, NMT), [(DISABLE, 50), (NMT, 50)]),
    ],
)
def test_a_later_verdict_takes_each_stop_further_and_never_back(bench, before, after):
    core = bench.core
    core.mode, core.verdict = Mode.FAULT, OPENED
    stops(core, *before)

    supervisor.stop(core, JUMPED, 123)

    assert [axis.stop[:2] for axis in core.axes] == after


@pytest.mark.parametrize(
    ("mode", "held", "stopped"),
    [
        (Mode.HOLD, None, True),
        (Mode.STOPPING, DISABLE, True),
        (Mode.FAULT, HOLD, True),
        (Mode.FAULT, DISABLE, False),
        (Mode.READY, None, False),
    ],
)
def test_verdicts_count_while_a_drive_may_have_power(bench, mode, held, stopped):
    core = bench.core
    core.mode, core.verdict = mode, HELD_UP
    bench.show(PowerState.SWITCH_ON_DISABLED)
    core.reset_cycles_left = 9
    stops(core, held, held)

    bench.turn(OPENED, JUMPED)

    assert core.verdict == (JUMPED if stopped else HELD_UP)


@pytest.mark.parametrize("mode", [Mode.READY, Mode.FAULT])
def test_power_without_a_request_is_a_reason_to_stop_in_every_mode(bench, mode):
    bench.core.mode, bench.core.verdict = mode, HELD_UP

    bench.turn(OPENED, ENABLED)

    assert bench.core.verdict == ENABLED
    assert bench.steps() == [DISABLE, DISABLE]
    assert bench.core.mode == (Mode.STOPPING if mode is Mode.READY else Mode.FAULT)


RESTING_CAUSES = dict.fromkeys(sorted(LOST_DRIVE), Mode.OFF) | {
    Cause.BUS_DOWN: Mode.OFF,
    Cause.TRANSMIT_QUEUE_FULL: Mode.OFF,
    Cause.BUS_OFF: Mode.FAULT,
    Cause.DRIVE_FAULT: Mode.FAULT,
    Cause.VELOCITY_LIMIT: Mode.FAULT,
}


@pytest.mark.parametrize("resetting", [0, 1])
@pytest.mark.parametrize("cause", RESTING_CAUSES)
def test_a_verdict_at_rest_switches_off_or_to_fault_unless_a_reset_is_under_way(
    ready, cause, resetting
):
    core, mode = ready.core, RESTING_CAUSES[cause]
    core.single_axis, drives = Run(), core.drives
    core.reset_cycles_left = resetting
    verdict = Verdict(StopCategory.S1, cause, "right/hip")

    supervisor._take_verdicts(core, [verdict, JUMPED], 100)

    if mode is Mode.OFF:
        assert (core.drives, core.single_axis, core.reset_cycles_left) == (None, None, 0)
        trigger = Trigger.DRIVES_LOST
    elif resetting:  # a drive may show its fault until the reset is over
        assert (core.mode, core.verdict, core.events) == (Mode.READY, Verdict(), [])
        return
    else:
        assert core.drives is drives
        trigger = Trigger.DRIVE_FAULTY
    assert (core.mode, core.verdict) == (mode, verdict)
    assert core.events == [
        mode_changed(Mode.READY, mode, trigger),
        cause_told(EventCode.CAUSE_FOUND, verdict),
    ]


AT_REST = mode_changed(Mode.STOPPING, Mode.FAULT, Trigger.AT_REST_STOPPED)
LOST = {
    Mode.READY: (Mode.OFF, [mode_changed(Mode.READY, Mode.OFF, Trigger.DRIVES_LOST)]),
    Mode.STOPPING: (Mode.FAULT, [AT_REST]),
    Mode.FAULT: (Mode.FAULT, []),
    Mode.OFF: (Mode.OFF, []),
} | {
    mode: (Mode.FAULT, [mode_changed(mode, Mode.STOPPING, Trigger.STOP), AT_REST])
    for mode in ACTIVE
}


@pytest.mark.parametrize("mode", LOST)
def test_a_lost_bus_leaves_nothing_known_of_the_drives(bench, mode):
    core = bench.core
    core.mode, core.drives, core.single_axis = mode, DriveGroup([]), Run()
    core.disabling, core.reset_cycles_left = True, 9
    stops(core, QUICK, QUICK)
    show(core.axes[0], followed=True)

    supervisor.lose_bus(core, "can0 is down")

    after, told = LOST[mode]
    verdict = Verdict(StopCategory.S1, Cause.BUS_DOWN, said="can0 is down")
    assert (core.mode, core.verdict) == (after, verdict)
    assert core.events == [cause_told(EventCode.CAUSE_FOUND, verdict), *told]
    assert (core.drives, core.single_axis) == (None, None)
    assert (core.disabling, core.reset_cycles_left, bench.steps()) == (False, 0, [])
    assert core.legs[0].exercise is None
    assert [
        (axis.sensed.feedback, axis.sensed.joint, axis.sensed.followed) for axis in core.axes
    ] == [(None, Joint(), False)] * 2


def test_a_lost_bus_does_not_replace_a_harsher_verdict(bench):
    bench.core.mode, bench.core.verdict = Mode.STOPPING, JUMPED

    supervisor.lose_bus(bench.core, "can0 is down")

    assert bench.core.verdict == JUMPED


# --- a leg that was held --------------------------------------------------------------------------


def test_a_stop_keeps_the_pose_of_a_leg_that_is_held(bench):
    (leg,) = bench.core.legs
    leg.placed, held = Placed(held_cycles=HOLD_SETTLE_CYCLES + 1), leg.exercise

    supervisor.stop(bench.core, HELD_UP, bench.cycle)

    assert leg.exercise is held


def test_a_stop_does_not_keep_a_gait_that_has_begun_in_this_cycle(bench):
    """As when a drive reports an alarm after the cycle that has taken the request."""
    core, (leg,) = bench.core, bench.core.legs
    leg.placed = Placed(held_cycles=HOLD_SETTLE_CYCLES + 1)
    exercises.begin(core, ModeRequest(Mode.GAIT, 0.25, 1.0, 60.0))
    core.mode = Mode.GAIT

    supervisor.stop(core, HELD_UP, bench.cycle)

    assert core.mode == Mode.STOPPING
    assert isinstance(leg.exercise, Hold)


# --- time -----------------------------------------------------------------------------------------


def test_while_the_drives_are_enabled_the_leg_is_held_where_it_is(bench):
    core, (leg,) = bench.core, bench.core.legs
    core.load_checked, core.load_settle_cycles = False, 7
    show(core.axes[0], reached_enabled=False)
    for axis in core.axes:
        show(axis, joint=axis.sensed.joint._replace(position_si=0.3))

    bench.turn()

    assert core.load_settle_cycles == 0
    assert leg.reference.position == (0.3, 0.3)


@pytest.mark.parametrize("effort_si", [10.0, -10.0])
@pytest.mark.parametrize("before_cycles", [48, 49, 50])
def test_the_load_at_rest_is_compared_with_the_model(bench, before_cycles, effort_si):
    core = bench.core
    core.load_checked, core.load_settle_cycles = False, before_cycles
    for axis in core.axes:
        show(axis, joint=axis.sensed.joint._replace(effort_si=effort_si))
        show(axis, gravity_si=effort_si)

    bench.turn()

    assert core.load_checked is (before_cycles > 48)
    assert core.load_settle_cycles == before_cycles + 1


@pytest.mark.parametrize("checked", [True, False])
@pytest.mark.parametrize("mode", [Mode.HOLD, Mode.GAIT, Mode.STOPPING])
def test_the_load_is_compared_once_and_in_hold_alone(bench, mode, checked):
    bench.core.mode, bench.core.load_checked = mode, checked

    bench.turn()

    assert bench.core.load_settle_cycles == (mode is Mode.HOLD and not checked)


def test_assist_that_has_lapsed_ends_in_hold_from_where_the_leg_is(bench):
    core, (leg,) = bench.core, bench.core.legs
    core.mode, leg.exercise, leg.takes_over = Mode.GAIT, None, False
    leg.assist = replace_fields(leg.assist, effort_si=(2.0, 0.0), accepted=None)

    bench.turn()

    assert core.mode == Mode.HOLD
    assert leg.takes_over
    assert leg.exercise is not None
    assert (core.assisted.lapse_count, core.assisted.lapse_reason) == (1, Lapse.LEASE_ENDED)
    assert core.events == [mode_changed(Mode.GAIT, Mode.HOLD, Trigger.LEASE_LAPSED)]


def test_only_an_exercise_of_an_active_mode_ends(bench, monkeypatch):
    monkeypatch.setattr(exercises, "is_over", lambda core: True)
    bench.core.mode = Mode.STOPPING
    stops(bench.core, HOLD, HOLD)

    bench.turn()

    assert bench.core.events == []


@pytest.mark.parametrize("mode", [Mode.GAIT, Mode.TORQUE])
def test_an_exercise_advances_and_its_end_brakes_the_leg(bench, monkeypatch, mode):
    core, (leg,) = bench.core, bench.core.legs
    core.mode = mode
    bench.turn()
    before = leg.exercise
    assert before.elapsed_s == pytest.approx(core.config.period_s)
    monkeypatch.setattr(exercises, "is_over", lambda core: core.mode == mode)

    bench.turn()

    assert leg.exercise.elapsed_s == 0.0
    assert core.events == [mode_changed(mode, Mode.HOLD, Trigger.EXERCISE_OVER)]
    assert core.persistent.self_test is None


# --- stops in time --------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [Mode.STOPPING, Mode.FAULT])
def test_a_drive_that_does_not_obey_is_taken_further_and_the_other_one_with_it(bench, mode):
    core = bench.core
    core.mode, core.verdict, core.disabling = mode, HELD_UP, True
    stops(core, HOLD, HOLD)
    hip = core.axes[0]
    show(hip, joint=hip.sensed.joint._replace(velocity_si=-1.2345))

    bench.turn()

    verdict = replace_fields(NOT_OBEYED, value=1.2345, finding=Finding.NOT_HELD)
    assert (core.verdict, core.disabling) == (verdict, False)
    assert bench.steps() == [QUICK, QUICK]
    assert core.events == [cause_told(EventCode.CAUSE_FOUND, verdict)]
    assert core.mode == mode


@pytest.mark.parametrize(
    ("step", "finding"),
    [
        (HOLD, Finding.NOT_HELD),
        (QUICK, Finding.NOT_STOPPED),
        (DISABLE, Finding.NOT_DISABLED),
        (NMT, Finding.NOT_STOPPED_BY_NMT),
    ],
)
def test_a_stop_that_is_not_obeyed_names_the_step_that_failed(step, finding):
    core = a_core(verdict=Verdict(), config=SimpleNamespace(categories=CATEGORIES))

    supervisor._report_stop_not_obeyed(core, core.axes[0], step)

    assert (core.verdict.finding, core.disabling) == (finding, False)


def test_a_stop_that_is_not_obeyed_does_not_replace_a_verdict_that_is_as_harsh(bench):
    core = bench.core
    core.mode, core.verdict = Mode.STOPPING, JUMPED
    stops(core, QUICK, QUICK)

    bench.turn()

    assert bench.steps() == [DISABLE, DISABLE]
    assert core.verdict == JUMPED


def test_a_step_that_is_due_is_not_told_as_disobeyed(bench):
    core = bench.core
    core.mode, core.verdict = Mode.FAULT, OPENED
    bench.show(PowerState.QUICK_STOP_ACTIVE)
    stops(core, QUICK, QUICK)
    for axis in core.axes:
        axis.limits = axis.limits._replace(brake=True)
        axis.stop = axis.stop._replace(at_rest_cycles=1000)

    bench.turn()

    assert bench.steps() == [DISABLE, DISABLE]
    assert (core.verdict, core.events) == (OPENED, [])


def test_a_stop_that_was_disobeyed_once_is_told_once(bench):
    core = bench.core
    core.mode, core.verdict = Mode.FAULT, OPENED
    bench.show(PowerState.QUICK_STOP_ACTIVE)
    stops(core, QUICK, QUICK)
    for axis in core.axes:
        axis.stop = axis.stop._replace(disobeyed=True, at_rest_cycles=1000, has_rested=True)

    bench.turn()

    assert (core.verdict, core.events) == (OPENED, [])


def test_each_drive_has_the_time_of_its_own_fault_reaction(bench):
    core = bench.core
    core.mode, core.verdict = Mode.STOPPING, JUMPED
    bench.show(PowerState.FAULT_REACTION_ACTIVE)
    stops(core, DISABLE, DISABLE)
    hip, slide = core.axes
    hip.reaction_cycles, slide.reaction_cycles = 3, 1000
    for axis in core.axes:
        axis.stop = axis.stop._replace(unproven_cycles=10)

    bench.turn()

    assert bench.steps() == [NMT, DISABLE]


def test_an_axis_without_a_stop_or_without_a_sample_waits_for_the_other_one(bench):
    core = bench.core
    core.mode, core.verdict = Mode.FAULT, OPENED
    stops(core, None, QUICK)
    show(core.axes[1], feedback=None)

    bench.turn()

    assert core.axes[0].stop is None
    assert core.axes[1].stop == begin(QUICK, core.axes[1].sensed.joint, 50)
    bench.show(PowerState.QUICK_STOP_ACTIVE)
    bench.turn()
    assert core.axes[1].stop.at_rest_cycles == 1


@pytest.mark.parametrize(
    ("rested", "age_cycles", "elapsed_cycles", "stopped"),
    [
        (True, 0, 1, True),
        (False, 0, 1, False),
        (False, 1000, 1, True),
        (False, 0, 300, False),
        (False, 0, 301, True),
    ],
)
def test_a_stop_is_over_when_its_axis_rests_is_silent_or_has_had_its_time(
    bench, rested, age_cycles, elapsed_cycles, stopped
):
    core, cycle = bench.core, 500
    stops(core, QUICK, QUICK, cycle=cycle - elapsed_cycles)
    enough = core.config.stop_rules.standstill_cycles
    core.axes[0].stop = core.axes[0].stop._replace(at_rest_cycles=enough)
    slide = core.axes[1]
    slide.stop = slide.stop._replace(at_rest_cycles=enough if rested else enough - 1)
    show(slide, feedback=slide.sensed.feedback._replace(sample_age_cycles=age_cycles))

    assert supervisor._stopped(core, cycle) is stopped
    core.axes[1].stop = None
    assert supervisor._stopped(core, cycle)


def test_the_age_of_a_sample_after_which_its_axis_is_not_waited_for(bench):
    core = bench.core
    age_max_cycles = core.config.thresholds.sample_age_max_cycles
    stops(core, QUICK, QUICK)
    for more in (0, 1):
        for axis in core.axes:
            show(
                axis,
                feedback=axis.sensed.feedback._replace(sample_age_cycles=age_max_cycles + more),
            )
        assert supervisor._stopped(core, 51) is bool(more)


def test_at_rest_a_disable_leaves_nothing_and_a_verdict_keeps_its_stop(bench):
    core, (leg,) = bench.core, bench.core.legs
    for disabling in (False, True):
        core.mode, core.disabling = Mode.STOPPING, disabling
        stops(core, HOLD, HOLD)
        supervisor._come_to_rest(core)
        assert (leg.exercise is None, bench.steps() == []) == (disabling, disabling)
        assert core.mode == (Mode.READY if disabling else Mode.FAULT)


# --- reset ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("known", "fault", "settling", "left"),
    [
        (True, False, 0, 0),
        (True, False, 1, 0),
        (True, False, 2, 49),
        (True, False, 4, 49),
        (True, True, 0, 49),
        (False, False, 0, 49),
    ],
)
def test_a_reset_is_over_when_no_drive_has_shown_a_fault_for_a_while(
    ready, known, fault, settling, left
):
    core = ready.core
    core.reset_cycles_left, core.reset_settle_cycles = 50, settling
    slide = core.axes[1]
    show(slide, joint=slide.sensed.joint._replace(known=known))
    if fault:
        show(slide, feedback=slide.sensed.feedback._replace(power_state=PowerState.FAULT))

    ready.turn()

    assert core.reset_cycles_left == left
    expected = 20 if fault else max(settling - 1, 0)
    assert core.reset_settle_cycles == expected


def test_a_reset_without_a_sample_goes_on_and_ends_with_its_time(ready):
    core = ready.core
    for axis in core.axes:
        show(axis, feedback=None, joint=Joint())
    core.reset_cycles_left = 2

    left = []
    for _ in range(4):
        ready.turn()
        left.append(core.reset_cycles_left)

    assert left == [1, 0, 0, 0]


@pytest.mark.parametrize("mode", [Mode.HOLD, Mode.REFERENCE])
def test_only_in_ready_a_reset_is_under_way(bench, mode):
    bench.core.mode, bench.core.reset_cycles_left = mode, 9

    bench.turn()

    assert bench.core.reset_cycles_left == 9


# --- bring-up -------------------------------------------------------------------------------------


@pytest.mark.parametrize("latched", [None, NOTED])
def test_drives_that_are_up_end_in_ready_or_in_the_stop_of_before(latched):
    core = fresh(PersistentState(latched=latched)).core
    core.mode, core.verdict, core.load_checked = Mode.BRINGING_UP, OPENED, True
    core.bring_up, core.causes_reported = STEP, set()
    stops(core, QUICK, QUICK)
    drives = DriveGroup([])

    supervisor.take_drives(core, drives)

    assert core.drives is drives
    assert [axis.stop for axis in core.axes] == [None, None]
    assert (core.load_checked, core.bring_up) == (False, None)
    if latched is None:
        assert (core.mode, core.verdict, core.events) == (Mode.READY, Verdict(), [])
        return
    assert (core.mode, core.verdict) == (Mode.FAULT, latched_stop.verdict_of(latched))
    assert core.causes_reported == {(Cause.ENCODER_JUMP, "right/hip")}
    assert core.events == [cause_told(EventCode.STILL_LATCHED, core.verdict, 7 * 1e-9)]


def test_a_step_of_bring_up_is_shown_until_the_mode_changes(bench):
    core = bench.core
    core.mode = Mode.OFF
    supervisor.begin_bring_up(core)
    assert (core.mode, core.events) == (Mode.BRINGING_UP, [Event(EventCode.BRING_UP_BEGUN)])

    supervisor.show_progress(core, "right/hip", 12, 70)
    assert core.bring_up == STEP

    supervisor.wait_for_reset(core, "right/hip", ON)
    assert core.bring_up is None


@pytest.mark.parametrize(
    ("latched", "cause"),
    [
        (None, Cause.DRIVE_POWERED),
        (NOTED, Cause.ENCODER_JUMP),
        (StoredVerdict("S2", "gateway_silent"), Cause.GATEWAY_SILENT),
        (StoredVerdict("S2", "stop_requested"), Cause.STOP_REQUESTED),
        (StoredVerdict("S1", "last_end_unknown"), Cause.DRIVE_POWERED),
    ],
)
def test_a_drive_that_holds_the_leg_is_fault_until_a_reset(latched, cause):
    core = fresh(PersistentState(latched=latched)).core
    core.mode, core.single_axis, core.reset_cycles_left = Mode.BRINGING_UP, Run(), 9
    show(core.axes[0], followed=True)

    supervisor.wait_for_reset(core, "right/slide", ON)

    assert not core.axes[0].sensed.followed
    assert (core.mode, core.single_axis, core.reset_cycles_left) == (Mode.FAULT, None, 0)
    assert core.verdict.cause == cause
    assert core.events[-1] == Event(EventCode.DRIVE_HOLDS, "right/slide", ("operation_enabled",))
    if cause is Cause.DRIVE_POWERED:
        category = core.config.categories.of(cause)
        held = Verdict(category, cause, "right/slide", float(ON), finding=Finding.POWER_STATE)
        assert core.verdict == held


@pytest.mark.parametrize("mode", [Mode.OFF, Mode.BRINGING_UP])
def test_a_bring_up_that_fails_ends_in_off_and_is_told_if_it_is_new(bench, mode):
    core = bench.core
    failed = core, Cause.DRIVE_SILENT, "right/hip", "no answer"
    core.mode = mode
    for _ in range(2):
        core.single_axis, core.reset_cycles_left, core.bring_up = Run(), 9, STEP
        show(core.axes[1], followed=True)
        supervisor.fail_bring_up(*failed)
        assert (core.mode, core.single_axis, core.bring_up) == (Mode.OFF, None, None)
        assert (core.reset_cycles_left, core.axes[1].sensed.followed) == (0, False)
        assert core.verdict == Verdict(
            StopCategory.S1, Cause.DRIVE_SILENT, "right/hip", said="no answer"
        )
        (event,) = core.events
        assert event.code is EventCode.BRING_UP_FAILED
        assert (event.subject, event.said) == ("right/hip", "no answer")


def test_a_mode_without_its_row_in_the_table_is_an_error_of_the_program(bench):
    with pytest.raises(table.IllegalTransitionError):
        supervisor.begin_bring_up(bench.core)


def test_what_a_core_has_found_that_ends_by_an_exception_is_latched_for_the_next_one():
    bench = Bench()

    supervisor.latch(bench.core, [OPENED], bench.cycle, 5)

    latched = bench.core.persistent.latched
    assert (bench.core.mode, bench.core.verdict) == (Mode.STOPPING, OPENED)
    assert (latched.cause, latched.drive, latched.utc_ns) == (OPENED.cause, "right/hip", 5)
