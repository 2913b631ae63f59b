"""Verdicts, requests and setpoints applied to the state of a core that has no bus."""

import math

import pytest
from core_bench import JUMPED, MANY_CYCLES, OPENED, Bench
from fresh_core import has_been_sent, has_received, show
from gaitd_names import Cause, EventCode, Finding, Mode, Outcome, RequestKind, Role, StopCategory
from msgspec.structs import replace

from daemon.core import cycle
from daemon.core.exercises.single_axis import Result
from daemon.core.safety.stop_sequence import Step
from daemon.core.slices import Assisted
from daemon.core.steps import (
    controllers,
    exercises,
    persistence,
    supervisor,
    wanted,
)
from daemon.ipc.record import ModeRequest, Request, Setpoint, Verdict
from drives.cia402.drive import DriveGroup
from drives.signals import PowerRequest, PowerState

FIRST_LEASE, NEXT_LEASE = 7, 8
NEXT_SETPOINT = Setpoint(lease=NEXT_LEASE, seq=1, for_cycle=99, leg="right")


@pytest.fixture
def bench() -> Bench:
    return Bench()


# --- verdicts while the drives are let go on request ----------------------------------------------


def test_a_disable_ends_in_ready_and_latches_nothing(bench):
    bench.ask(RequestKind.DISABLE)

    assert bench.until_stopped() == Mode.READY
    assert bench.core.persistent.latched is None
    assert bench.steps() == []


def test_a_verdict_while_disabling_is_latched_and_ends_in_fault(bench):
    bench.ask(RequestKind.DISABLE)
    bench.turn(OPENED)
    bench.show(PowerState.QUICK_STOP_ACTIVE)

    assert bench.until_stopped() == Mode.FAULT
    assert bench.core.verdict == OPENED
    assert bench.core.persistent.latched.cause == Cause.HAND_SWITCH_OPEN


def test_a_stop_after_an_earlier_disable_is_latched_and_ends_in_fault(bench):
    bench.ask(RequestKind.DISABLE)
    bench.until_stopped()
    bench.show(PowerState.SWITCH_ON_DISABLED)
    bench.turn()
    bench.ask(RequestKind.ENABLE)
    assert bench.core.mode == Mode.HOLD
    bench.turn(OPENED)
    bench.show(PowerState.QUICK_STOP_ACTIVE)

    assert bench.until_stopped() == Mode.FAULT


def test_a_disable_that_is_not_obeyed_ends_in_fault(bench):
    bench.ask(RequestKind.DISABLE)
    bench.show(PowerState.OPERATION_ENABLED, velocity_si=1.0)
    for _ in range(MANY_CYCLES):
        if Step.HOLD not in bench.steps():
            break
        bench.turn()
    bench.show(PowerState.QUICK_STOP_ACTIVE)

    assert bench.until_stopped() == Mode.FAULT
    assert bench.core.verdict.cause == Cause.STOP_NOT_OBEYED


# --- after a stop ---------------------------------------------------------------------------------


@pytest.mark.parametrize("step", [Step.HOLD, Step.QUICK_STOP])
def test_a_stop_that_holds_under_power_is_judged_and_taken_further(bench, step):
    category = StopCategory.S2 if step is Step.HOLD else StopCategory.S1
    bench.turn(Verdict(category, Cause.STOP_REQUESTED))
    if step is Step.QUICK_STOP:
        bench.show(PowerState.QUICK_STOP_ACTIVE)
    assert bench.until_stopped() == Mode.FAULT
    assert bench.steps() == [step, step]

    bench.turn(JUMPED)

    assert wanted.is_driving(bench.core)
    assert bench.core.verdict == JUMPED
    assert bench.steps() == [Step.DISABLE, Step.QUICK_STOP]


def test_power_off_is_one_step_and_never_a_milder_one(bench):
    hip, slide = bench.core.axes
    bench.turn(OPENED)
    slide.stop = slide.stop._replace(step=Step.NMT_STOP)

    supervisor.power_off(bench.core, 200)
    first = hip.stop, slide.stop
    supervisor.power_off(bench.core, 201)

    assert (hip.stop, slide.stop) == first
    assert (hip.stop.step, hip.stop.since_cycle) == (Step.DISABLE, 200)
    assert slide.stop.step == Step.NMT_STOP


# --- commands -------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_a_command_that_is_not_finite_is_a_quick_stop_without_torque(bench, number):
    for axis in bench.core.axes:
        has_been_sent(axis, effort_si=10.0, position_si=0.2)
    bench.turn()
    leg = bench.core.legs[0]
    leg.reference = leg.reference._replace(feedforward=(number, 0.0))

    commands = cycle.commands(bench.core, bench.cycle)

    assert bench.core.verdict.cause == Cause.COMMAND_NOT_FINITE
    assert [one.power for one in commands] == [PowerRequest.QUICK_STOP] * 2
    assert [one.target_torque_permille for one in commands] == [0, 0]
    assert [axis.sent.effort_si for axis in bench.core.axes] == [0.0, 0.0]
    assert [axis.sent.position_si for axis in bench.core.axes] == [0.2, 0.2]


# --- assist ---------------------------------------------------------------------------------------


def received(core, cycle):
    """The setpoint that is accepted in this cycle, and the count of them."""
    (leg,), assisted = controllers.receive(
        core.legs, core.assisted, core.inputs, core.mode, core.config, cycle
    )
    return leg.accepted, assisted.accepted_count


def test_assist_in_force_is_not_taken_over_by_the_next_holder_of_the_lease(bench):
    core, leg = bench.core, bench.core.legs[0]
    core.mode = Mode.TORQUE
    leg.assist = replace(leg.assist, lease=FIRST_LEASE, effort_si=(5.0, 0.0))
    has_received(core, lease=NEXT_LEASE, setpoints=(NEXT_SETPOINT,))

    assert received(core, 100) == (None, 0)

    leg.assist = replace(leg.assist, effort_si=(0.0, 0.0))

    assert received(core, 101) == (NEXT_SETPOINT, 1)


def test_where_nothing_is_in_force_the_next_holder_is_heard_at_once(bench):
    core, leg = bench.core, bench.core.legs[0]
    core.mode = Mode.TORQUE
    leg.assist = replace(leg.assist, lease=FIRST_LEASE)
    has_received(core, lease=NEXT_LEASE, setpoints=(NEXT_SETPOINT,))

    assert received(core, 100) == (NEXT_SETPOINT, 1)


# --- load at rest after enabling ------------------------------------------------------------------


def settled(bench, cycles):
    bench.core.load_checked = False
    for axis in bench.core.axes:
        show(axis, joint=axis.sensed.joint._replace(effort_si=axis.sensed.gravity_si))
    bench.turn()
    assert bench.core.mode == Mode.HOLD
    for _ in range(cycles - 1):
        bench.turn()


def test_the_load_is_compared_after_the_leg_has_been_held_for_its_time(bench):
    settled(bench, supervisor.LOAD_SETTLE_CYCLES - 1)
    assert not bench.core.load_checked

    bench.turn()

    assert bench.core.load_checked
    assert bench.core.mode == Mode.HOLD


def test_the_time_begins_anew_while_a_drive_is_not_enabled(bench):
    settled(bench, supervisor.LOAD_SETTLE_CYCLES - 1)
    show(bench.core.axes[1], reached_enabled=False)
    bench.turn()
    show(bench.core.axes[1], reached_enabled=True)

    settled(bench, supervisor.LOAD_SETTLE_CYCLES - 1)
    assert not bench.core.load_checked
    bench.turn()
    assert bench.core.load_checked


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("index", [0, 1])
def test_a_load_that_is_not_that_of_the_model_stops(bench, index, side):
    settled(bench, supervisor.LOAD_SETTLE_CYCLES - 1)
    axis = bench.core.axes[index]
    tolerance_si = axis.limits.static_load_tolerance_si
    wrong_si = axis.sensed.gravity_si + side * (tolerance_si + 1.0)
    show(axis, joint=axis.sensed.joint._replace(effort_si=wrong_si))

    bench.turn()

    assert bench.core.mode == Mode.STOPPING
    verdict = bench.core.verdict
    assert (verdict.cause, verdict.drive) == (Cause.STATIC_LOAD_WRONG, axis.name)
    assert verdict.category is bench.core.config.categories.of(Cause.STATIC_LOAD_WRONG)
    assert (verdict.value, verdict.limit) == (pytest.approx(tolerance_si + 1.0), tolerance_si)
    assert not bench.core.load_checked


def test_a_load_of_just_the_tolerance_is_right(bench):
    settled(bench, supervisor.LOAD_SETTLE_CYCLES - 1)
    axis = bench.core.axes[0]
    show(axis, gravity_si=0.0)
    tolerance_si = axis.limits.static_load_tolerance_si
    show(axis, joint=axis.sensed.joint._replace(effort_si=-tolerance_si))

    bench.turn()

    assert bench.core.load_checked


# --- the end of an exercise -----------------------------------------------------------------------


@pytest.fixture
def over(bench, monkeypatch):
    """A self-test that is over with the next cycle; a test says with which verdict."""
    bench.core.mode = Mode.SELF_TEST
    monkeypatch.setattr(exercises, "is_over", lambda core: core.mode == Mode.SELF_TEST)
    return lambda failed: monkeypatch.setattr(persistence, "finish_self_test", lambda *_: failed)


def test_a_self_test_that_is_passed_ends_in_hold(bench, over):
    over(None)

    bench.turn()

    assert bench.core.mode == Mode.HOLD
    assert (bench.core.verdict.cause, bench.steps()) == (Cause.NONE, [])


def test_a_self_test_that_fails_stops(bench, over):
    failed = Verdict(
        StopCategory.S2, Cause.SELF_TEST_FAILED, "right/hip", 2.0, 1.0, Finding.FRICTION_MORE
    )
    over(failed)

    bench.turn()

    assert bench.core.mode == Mode.STOPPING
    assert bench.core.verdict == failed
    assert bench.steps() == [Step.HOLD, Step.HOLD]


def test_the_end_of_another_exercise_is_no_self_test(bench, monkeypatch):
    bench.core.mode = Mode.GAIT
    monkeypatch.setattr(exercises, "is_over", lambda core: core.mode == Mode.GAIT)
    monkeypatch.setattr(persistence, "finish_self_test", lambda *_: pytest.fail("stored"))

    bench.turn()

    assert bench.core.mode == Mode.HOLD


def test_assist_that_has_lost_its_lease_ends_in_hold_where_the_leg_is(bench):
    core, leg = bench.core, bench.core.legs[0]
    core.mode, core.assisted = Mode.TORQUE, Assisted(torque_lease=FIRST_LEASE)
    has_received(core, lease=FIRST_LEASE)
    leg.exercise = leg.reference = None
    bench.turn()
    assert core.mode == Mode.TORQUE

    has_received(core, lease=NEXT_LEASE)
    bench.turn()

    assert core.mode == Mode.HOLD
    assert core.assisted.lapse_count == 1
    assert leg.exercise is not None
    assert leg.reference.position == pytest.approx((0.2, 0.2))


# --- a test of one axis ---------------------------------------------------------------------------


def test_the_confirmation_of_a_sign_test_leaves_the_drives_up(bench):
    core = bench.core
    core.mode = Mode.READY
    core.drives = drives = DriveGroup([])
    core.axes[0].serial_number = 305
    core.evidence = {
        "right/hip": Result(EventCode.SIGN_TESTED, False, (0.1, -0.1), (8.0, 0.1, -8.0, -0.1))
    }
    bench.show(PowerState.SWITCH_ON_DISABLED)
    wanted_mode = ModeRequest(Mode.COMMISSION, axis="right/hip", witnessed=True)
    request = Request(1, RequestKind.MODE, bench.cycle + 1, wanted_mode, Role.UNRESTRICTED)

    bench.utc_ns = 3_600_000_000_000
    bench.turn(request=request)

    assert core.result.outcome == Outcome.DONE, core.result.refusal
    assert core.mode == Mode.READY
    assert core.drives is drives
    assert core.axes[0].sign_proven
    proof = core.persistent.axis("right/hip").proof
    assert (proof.moved_forth_si, proof.utc_ns) == (0.1, bench.utc_ns)
