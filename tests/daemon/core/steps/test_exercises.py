"""Exercises of the legs, homing and sign tests of one axis, and what outlives the core."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from fresh_core import fresh, show
from gaitd_names import (
    AxisStep,
    Cause,
    EventCode,
    Failure,
    Finding,
    Mode,
    ProgressCode,
    SelfTestDue,
    Stage,
    Trigger,
)
from msgspec.structs import replace as with_fields
from safety_inputs import FEEDBACK, JOINT

from daemon.core.exercises.self_test import SelfTest, Sums, Way
from daemon.core.exercises.sign_test import SignTest
from daemon.core.exercises.single_axis import Result
from daemon.core.modes.daily_test import STORE_NS
from daemon.core.modes.persistent_state import PersistentState, prove
from daemon.core.steps import exercises, persistence, single_axis
from daemon.core.steps.single_axis import Change
from daemon.ipc.record import ModeRequest
from daemon.ipc.report import Event, Progress
from drives.signals import Input, OperationMode

NOW_NS = 1_700_000_000_000_000_000
HOUR_NS = 3_600_000_000_000


@pytest.fixture
def core():
    """A core whose axes are followed and at rest, with drives of serial numbers 11 and 12."""
    made = fresh(PersistentState(utc_newest_ns=NOW_NS)).core
    for number, axis in enumerate(made.axes, 11):
        axis.serial_number = number
        joint = JOINT._replace(position_si=0.2, velocity_si=0.0)
        show(axis, joint=joint, feedback=FEEDBACK, followed=True, watched=True)
    return made


# --- exercises ------------------------------------------------------------------------------------


def plays(stage, *, in_turn=False, elapsed_s=1.0):
    return SimpleNamespace(
        stage=stage,
        legs_in_turn=in_turn,
        progress=lambda: Progress(ProgressCode.EXERCISING, "", (elapsed_s,)),
    )


def of_legs(*played):
    return SimpleNamespace(legs=[SimpleNamespace(exercise=one) for one in played])


FIRST, SECOND = (Progress(ProgressCode.EXERCISING, "", (one,)) for one in (1.0, 2.0))


@pytest.mark.parametrize(
    ("played", "progress", "stage", "is_over"),
    [
        ((None,), None, None, False),
        ((plays(None),), None, None, False),
        ((plays(Stage.PLAYING),), FIRST, Stage.PLAYING, False),
        ((plays(Stage.OVER), plays(Stage.PLAYING)), FIRST, Stage.PLAYING, True),
        (
            (plays(Stage.OVER, in_turn=True), plays(Stage.PLAYING, in_turn=True, elapsed_s=2.0)),
            *(SECOND, Stage.PLAYING, False),
        ),
        ((plays(Stage.PREPARING, in_turn=True), None), FIRST, Stage.PREPARING, False),
        ((plays(Stage.OVER, in_turn=True), plays(Stage.OVER)), FIRST, Stage.OVER, True),
    ],
)
def test_progress_stage_and_end_are_those_of_the_leg_that_plays(played, progress, stage, is_over):
    core = of_legs(*played)

    assert (exercises.progress(core), exercises.stage(core)) == (progress, stage)
    assert exercises.is_over(core) is is_over


def test_hold_is_begun_as_the_end_of_what_was_before(core):
    (leg,) = core.legs
    exercises.begin(core, ModeRequest(Mode.HOLD))

    assert leg.exercise.start == (0.2, 0.2)
    assert leg.takes_over


def test_a_mode_without_an_exercise_is_refused_before(core):
    assert exercises.refusal(core, Mode.READY) is None
    with pytest.raises(RuntimeError, match="READY has no exercise"):
        exercises.begin(core, ModeRequest(Mode.READY))


@pytest.mark.parametrize("continues", [True, False])
def test_a_new_stage_is_told_with_its_leg_and_may_continue_the_effort(core, continues):
    (leg,) = core.legs
    core.mode = Mode.GAIT
    after = SimpleNamespace(
        stage=Stage.PLAYING, failure=Failure.NONE, continues_effort_at_stages=continues
    )
    after.advance = lambda sample, dt_s: after
    leg.exercise = SimpleNamespace(stage=Stage.PREPARING, advance=lambda sample, dt_s: after)
    for _ in range(2):
        exercises.advance(core, [None])

    values = Mode.GAIT, Stage.PLAYING, Failure.NONE
    assert core.events == [Event(EventCode.STAGE_CHANGED, "right", values)]
    assert leg.takes_over is continues
    exercises.has_taken_over(core)
    assert not leg.takes_over
    leg.exercise = None
    exercises.advance(core, [None])
    exercises.update_references(core, [None])
    assert leg.reference is None


def test_a_sample_has_what_the_legs_raw_values_say(core):
    hip, slide = core.axes
    show(hip, gravity_si=4.0)
    csp = FEEDBACK._replace(mode_display=OperationMode.CYCLIC_SYNC_POSITION)

    (sample,) = exercises.samples_of(core, mode_changing=True)

    assert (sample.position, sample.velocity, sample.excess) == ((0.2, 0.2), (0, 0), (6.0, 10.0))
    assert (sample.fresh, sample.in_torque_mode, sample.mode_changing) == ((True, True), True, True)
    for feedback in (csp, None):
        show(slide, feedback=feedback)
        assert not exercises.samples_of(core, mode_changing=False)[0].in_torque_mode


# --- one axis -------------------------------------------------------------------------------------


def sign_test(**changes):
    begun = SignTest(axis="right/hip", requested_cycle=0, rules=None, period_s=0.01)
    return replace(begun, **changes)


@pytest.mark.parametrize(
    ("mode", "run", "is_moving", "effort_si"),
    [
        (Mode.COMMISSION, sign_test(effort_si=3.0), True, 3.0),
        (Mode.READY, sign_test(effort_si=3.0), False, 0.0),
        (Mode.COMMISSION, None, False, 0.0),
    ],
)
def test_the_effort_of_a_single_axis_is_there_in_its_mode_alone(
    core, mode, run, is_moving, effort_si
):
    core.mode, core.single_axis = mode, run
    hip, slide = core.axes

    assert (single_axis.moving(core) is run) or not is_moving
    assert single_axis.target_effort_si(core, hip) == effort_si
    assert single_axis.target_effort_si(core, slide) == 0.0


def test_a_request_for_an_axis_that_is_not_there_was_refused_before(core):
    wanted = ModeRequest(Mode.COMMISSION, axis="left/hip")

    assert "right/hip, right/slide" in single_axis.refusal(core, wanted, 1).said
    with pytest.raises(RuntimeError, match="there is no axis 'left/hip'"):
        single_axis.begin(core, wanted, 1)
    for axis in ("left/hip", "right/hip"):
        with pytest.raises(RuntimeError, match="has no sign test"):
            single_axis.confirmed(core, ModeRequest(Mode.COMMISSION, axis=axis), NOW_NS)


def test_limits_of_hand_guiding_and_of_a_single_axis_are_in_force_in_their_modes(core):
    hip, slide = core.axes
    core.mode = Mode.HAND_GUIDING
    assert single_axis.active_limits(core, hip) == hip.limits._replace(
        velocity_max_si=hip.limits.hand_guiding_speed_max_si
    )
    core.mode = Mode.COMMISSION
    rules = SimpleNamespace(effort_max_si=12.0)
    core.single_axis = sign_test(rules=rules)
    assert single_axis.active_limits(core, hip).effort_max_si == 12.0
    assert single_axis.active_limits(core, slide) == slide.limits


class Run:
    """A homing or sign test that takes what it is shown, and is over when a test says so."""

    axis, mode, requested_cycle, by_drive = "right/hip", Mode.REFERENCE, 100, True
    step = AxisStep.SEARCHING

    def __init__(self, *, is_over=False, why=Failure.NONE, moved_si=None):
        self.is_over, self.why, self.shown = is_over, why, []
        self.outcome = Result(EventCode.HOMED, moved_si is None, moved_si, (1.0,))

    def advance(self, sample):
        self.shown.append(sample)
        return self

    def enabling(self):
        return "enabling"

    def failed(self, why):
        return ("failed", why)

    def result(self):
        return self.outcome

    def moves_origin(self, _feedback):
        return True


LATEST = 100 + single_axis.BEGIN_CYCLES


@pytest.mark.parametrize(
    ("cycle", "rests", "by_drive", "run", "trigger"),
    [
        (LATEST, True, True, "enabling", Trigger.TO_REFERENCE),
        (LATEST, True, False, "enabling", Trigger.TO_REFERENCE),
        (LATEST, False, True, None, None),
        (LATEST + 1, True, True, ("failed", Failure.NOT_READY), None),
    ],
)
def test_it_begins_when_all_axes_rest_and_not_later_than_it_may(
    core, cycle, rests, by_drive, run, trigger
):
    core.mode, core.single_axis = Mode.READY, Run()
    core.single_axis.by_drive = by_drive
    begun, hip = core.single_axis, core.axes[0]
    show(core.axes[1], joint=JOINT._replace(velocity_si=0.0 if rests else 1.0))

    change = single_axis.advance(core, cycle)

    assert core.single_axis == (begun if run is None else run)
    expected = Change(trigger, hip if by_drive else None)
    assert change == (None if trigger is None else expected)


@pytest.mark.parametrize(
    ("run", "event", "is_homed", "evidence"),
    [
        (Run(is_over=True), Event(EventCode.HOMED, "right/hip", (1.0,)), True, []),
        (
            Run(is_over=True, moved_si=(0.1, -0.1)),
            *(Event(EventCode.HOMED, "right/hip", (1.0,)), False, ["right/hip"]),
        ),
        (
            Run(is_over=True, why=Failure.HOME_NOT_FOUND),
            Event(EventCode.SINGLE_AXIS_FAILED, "right/hip", (Failure.HOME_NOT_FOUND,)),
            *(False, []),
        ),
    ],
)
def test_its_end_is_told_with_what_it_has_shown(core, run, event, is_homed, evidence):
    core.mode, core.single_axis = Mode.REFERENCE, run
    hip = core.axes[0]

    change = single_axis.advance(core, 1)

    assert change == Change(Trigger.EXERCISE_OVER, homed=hip if is_homed else None)
    assert core.events == [event]
    assert list(core.evidence) == evidence
    core.mode = Mode.READY
    assert single_axis.advance(core, 2) == Change(Trigger.BRING_UP_RESTARTED)
    assert core.single_axis is None
    assert single_axis.advance(core, 3) is None


def test_under_way_it_is_shown_its_axis_and_in_another_mode_it_waits(core):
    hip, slide = core.axes
    core.mode, core.single_axis = Mode.REFERENCE, Run()
    assert single_axis.advance(core, 1) is None
    assert len(core.single_axis.shown) == 1
    assert single_axis.moves_origin(core, hip, FEEDBACK)
    assert not single_axis.moves_origin(core, slide, FEEDBACK)
    assert single_axis.seeks_home(core, hip)
    assert not single_axis.seeks_home(core, slide)
    core.single_axis.step = AxisStep.DONE
    assert not single_axis.seeks_home(core, hip)

    core.mode = Mode.STOPPING
    assert single_axis.advance(core, 2) is None
    assert len(core.single_axis.shown) == 1
    assert not single_axis.moves_origin(core, hip, FEEDBACK)


@pytest.mark.parametrize(
    ("shown", "homing"),
    [({"mode_display": OperationMode.HOMING, "statusword": 0x1637}, "DONE"), ({}, "NOT_STARTED")],
)
def test_the_state_of_a_homing_counts_while_the_drive_shows_its_mode(core, shown, homing):
    hip = core.axes[0]
    show(hip, feedback=FEEDBACK._replace(**shown), reached_enabled=True)

    sample = single_axis._sample(hip)

    assert (sample.homing.name, sample.ready, sample.position_si, sample.at_rest) == (
        *(homing, True, 0.2, True),
    )


def test_a_single_axis_that_is_cancelled_is_told_once_and_dropped(core):
    core.single_axis = sign_test()
    for _ in range(2):
        single_axis.cancel(core, Failure.NOT_READY)

    assert core.events == [Event(EventCode.SINGLE_AXIS_FAILED, "right/hip", (Failure.NOT_READY,))]
    single_axis.drop(core)
    single_axis.cancel(core, Failure.NOT_READY)
    assert (core.single_axis, len(core.events)) == (None, 1)


def test_a_sign_test_of_another_drive_is_dropped(core):
    core.evidence = {axis.name: object() for axis in core.axes}
    reports = [SimpleNamespace(serial_number=11), SimpleNamespace(serial_number=99)]

    single_axis.drop_tests_of_other_drives(core, reports)

    assert list(core.evidence) == ["right/hip"]


# --- what outlives the core -----------------------------------------------------------------------


def test_the_pose_of_an_axis_that_is_followed_fresh_and_at_rest_is_stored(core):
    hip, slide = core.axes
    for changes in (
        {"followed": False},
        {"joint": slide.sensed.joint._replace(fresh=False)},
        {"joint": slide.sensed.joint._replace(velocity_si=1.0)},
    ):
        show(slide, followed=True, joint=hip.sensed.joint)
        show(slide, **changes)
        core.persistent = PersistentState()
        persistence.store_poses(core, NOW_NS)

        assert {name: one.position_si for name, one in core.persistent.axes.items()} == {
            "right/hip": 0.2
        }


def test_tests_of_a_drive_without_a_number_that_was_out_of_sight_are_forgotten_and_told(core):
    hip, slide = core.axes
    proof = prove(hip.wiring, 0, (0.04, -0.04), NOW_NS)
    for axis in core.axes:
        axis.serial_number = 0
        persistence.prove_sign(core, axis, proof)
        assert (axis.sign_proven, axis.sensed.sign_trusted) == (True, False)
    show(slide, watched=False)
    nameless, named = SimpleNamespace(serial_number=0), SimpleNamespace(serial_number=5)

    persistence.forget_other_drives(core, [nameless, named])
    assert core.events == []
    for _ in range(2):
        persistence.forget_other_drives(core, [nameless, nameless])

    assert core.events == [Event(EventCode.TESTS_FORGOTTEN, slide.name)]
    assert core.persistent.axes[hip.name].proof is not None
    assert core.persistent.axes[slide.name].proof is None


def test_a_doubt_of_a_proven_sign_is_stored_until_a_passed_self_test(core):
    hip, slide = core.axes
    proof = prove(hip.wiring, hip.serial_number, (0.04, -0.04), NOW_NS)
    persistence.prove_sign(core, hip, proof)
    persistence.store_sign_doubts(core)
    assert not core.persistent.axes[hip.name].proof.doubted
    show(hip, sign_trusted=False)

    persistence.store_sign_doubts(core)
    assert core.persistent.axes[hip.name].proof.doubted
    assert slide.name not in core.persistent.axes
    core.legs[0].exercise = of_self_test(friction_si=6.0)

    assert persistence.finish_self_test(core, NOW_NS) is None
    assert not core.persistent.axes[hip.name].proof.doubted
    assert hip.sensed.sign_trusted
    assert not slide.sensed.sign_trusted


def of_self_test(friction_si):
    """A self-test that is over, whose axes rub with so much."""
    sums = Sums(friction_si, 1, -friction_si, 1, 0.0, 0.08, -0.08)
    ways = (Way("right/hip", 0.08, 0.2, 6.0, 8.0), Way("right/slide", 0.08, 0.2, 6.0, 8.0))
    return SelfTest(start=(0.0, 0.0), ways=ways, ratios=(0.5, 1.6), wait_s=0.0, sums=(sums, sums))


def test_a_self_test_that_has_found_something_is_told_stored_and_stops(core):
    core.legs[0].exercise = of_self_test(friction_si=1.2)

    verdict = persistence.finish_self_test(core, NOW_NS)

    cause = Cause.SELF_TEST_FAILED
    assert (verdict.category, verdict.cause) == (core.config.categories.of(cause), cause)
    assert (verdict.drive, verdict.finding) == ("right/hip", Finding.FRICTION_LESS)
    assert (verdict.value, verdict.limit) == (pytest.approx(0.2), 0.5)
    codes = [(event.code, event.subject) for event in core.events]
    assert codes == [(EventCode.SELF_TEST_FAILED, name) for name in ("right/hip", "right/slide")]
    assert core.persistent.self_test is not None


def daily(core, required="daily"):
    core.config = replace(
        core.config, self_test=with_fields(core.config.self_test, required=required)
    )
    return core


@pytest.mark.parametrize(
    ("mode", "required", "shown", "sees"),
    [
        (Mode.READY, "daily", FEEDBACK, True),
        (Mode.READY, "never", FEEDBACK, True),
        (Mode.FAULT, "daily", FEEDBACK, True),
        (Mode.HOLD, "daily", FEEDBACK, False),
        (Mode.HOLD, "never", FEEDBACK, False),
        (Mode.READY, "daily", None, False),
        (Mode.READY, "daily", FEEDBACK._replace(fresh=False), False),
        (Mode.READY, "daily", FEEDBACK._replace(inputs=Input.IMPOSSIBLE), False),
    ],
)
def test_inputs_are_seen_to_act_at_rest_with_a_fresh_sample(core, mode, required, shown, sees):
    daily(core, required).mode = mode
    if shown is FEEDBACK:
        shown = FEEDBACK._replace(inputs=Input(0))
    for axis in core.axes:
        show(axis, feedback=shown)

    persistence.check_day(core, NOW_NS)

    assert bool(core.persistent.inputs) is sees
    is_due = core.self_test_due is not SelfTestDue.NONE
    assert is_due is (required == "daily")
    untested = {"daily": 2 if sees else 4, "never": 0}[required] * 2
    assert len(core.inputs_untested) == untested


@pytest.mark.parametrize("serial_number", [11, 0])
def test_the_proofs_of_the_drives_that_came_up_are_looked_up(core, serial_number):
    hip, slide = core.axes
    hip.serial_number = serial_number
    persistence.prove_sign(core, hip, prove(hip.wiring, serial_number, (0.04, -0.04), NOW_NS))
    for axis in core.axes:
        axis.sign_proven = not axis.sign_proven
        show(axis, sign_trusted=False)

    persistence.check_signs(core)

    assert (hip.sign_proven, slide.sign_proven) == (True, False)
    assert hip.sensed.sign_trusted is (serial_number != 0)


@pytest.mark.parametrize(
    ("mode", "later_ns", "stored_ns"),
    [
        (Mode.READY, STORE_NS, NOW_NS),
        (Mode.READY, STORE_NS + 1, NOW_NS + STORE_NS + 1),
        (Mode.HOLD, STORE_NS + 1, NOW_NS),
    ],
)
def test_the_time_is_stored_now_and_then_while_no_drive_is_enabled(core, mode, later_ns, stored_ns):
    core.mode = mode

    persistence.check_day(core, NOW_NS + later_ns)

    assert core.persistent.utc_newest_ns == stored_ns
    assert core.utc_newest_ns == NOW_NS + later_ns


@pytest.mark.parametrize("had_test", [True, False])
def test_a_clock_that_was_set_back_voids_the_tests_of_the_day(core, had_test):
    if had_test:
        core.legs[0].exercise = of_self_test(friction_si=6.0)
        persistence.finish_self_test(core, NOW_NS)
        core.events.clear()

    persistence.check_day(core, NOW_NS - HOUR_NS)

    assert (core.persistent.self_test, core.persistent.inputs) == (None, {})
    assert core.persistent.utc_newest_ns == NOW_NS - HOUR_NS
    told = [event.code for event in core.events]
    assert told == [EventCode.CLOCK_SET_BACK] * had_test
