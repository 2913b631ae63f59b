"""Mode torque: a controller moves the leg under a lease, and whatever ends that ends in hold."""

import math
from dataclasses import replace
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from controllers import Controller, constant, towards
from gaitd_names import Cause, Lapse, Mode, Outcome, RefusalCode, RequestKind, SetpointRefusal
from records import both
from sessions import new_session, two_legs
from wire import QUICK_STOP_WORD, target_torques, words_by_cycle

from daemon.ipc.record import AxisSetpoint, ModeRequest, Setpoint
from daemon.ipc.report import Refusal

TORQUE = ModeRequest(Mode.TORQUE)
FADE_CYCLES = 20
AGE_CYCLES = 10
START_CYCLES = 50
STEP_NM, STEP_N = 2.6, 20.0
"""In one cycle: the rate of assist, and what the pose changes in g(q)."""
BRAKE_STEP_NM, BRAKE_STEP_N = 6.0, 75.0
"""In one cycle: the damper of hold, while the speed it wants falls by 15 rad/s^2 and 20 m/s^2."""


def refused(session, reason):
    return session.record.assist.refused_count.get(reason, 0)


def in_torque(session, law, legs=("right",)):
    controller = Controller(session.gateway, law, legs)
    session.run(0.1)
    answer = session.request(RequestKind.MODE, TORQUE)
    assert answer.outcome == Outcome.DONE, answer.refusal
    return controller


@pytest.fixture
def session(warm_hold):
    return warm_hold


@pytest.fixture(scope="module")
def warm_two_legs(tmp_path_factory):
    return new_session(two_legs(tmp_path_factory.mktemp("two"))).enable()


def records_since(session, cycle):
    return [record for record in session.records if record.cycle > cycle]


def steps_over_switches(records):
    """Largest change of the target torque in the cycles in which a mode begins: N·m, N."""
    switches = [(a, b) for a, b in pairwise(records) if a.mode != b.mode]
    assert switches
    steps = [
        [abs(b.drives[k].target_effort - a.drives[k].target_effort) for k in (0, 1)]
        for a, b in switches
    ]
    return np.max(steps, axis=0)


def steps_of_torque(session, since=0):
    """Largest change of the target torque on the wire from one cycle to the next: N·m, N."""
    axes = session.core.axes
    found = []
    for axis, node in zip(axes[:2], (5, 6), strict=True):
        sent = np.array(target_torques(session.bus.sent[since:], node))
        found.append(np.abs(np.diff(sent)).max() / abs(axis.scaling.permille_per_effort_si))
    return found


def test_assist_moves_the_leg_to_where_the_controller_wants_it(session):
    start_rad = session.record.drives[0].position
    in_torque(session, towards(start_rad + 0.1, stiffness_nm_per_rad=150.0))

    session.run(2)

    record = session.record
    assert (record.mode, record.verdict.cause) == (Mode.TORQUE, Cause.NONE)
    assert record.drives[0].position > start_rad + 0.04
    assert max(record.legs[0].hip.assist for record in session.records) > 10


def test_without_assist_the_leg_is_carried_and_stays(session):
    in_torque(session, constant())
    start = both(session.record.legs[0], "measured_position")

    session.run(1)

    record = session.record
    assert record.mode == Mode.TORQUE
    carried = [axis.sensed.gravity_si for axis in session.core.axes]
    assert [drive.target_effort for drive in record.drives] == pytest.approx(carried, abs=0.01)
    assert both(record.legs[0], "measured_position") == pytest.approx(start, abs=0.01)


def test_torque_on_the_wire_has_no_step_from_hold_through_torque_to_hold(session):
    begun, cycle = len(session.bus.sent), session.record.cycle
    controller = in_torque(session, constant(hip_nm=14.0, slide_n=-110.0))
    session.run(0.25)
    answer = session.request(RequestKind.MODE, ModeRequest(Mode.HOLD))
    session.run(0.5)
    session.request(RequestKind.MODE, TORQUE)
    session.run(0.25)
    controller.running = False
    session.run(1)

    assert answer.outcome == Outcome.DONE
    records = records_since(session, cycle)
    assert [a.mode for a, b in pairwise(records) if a.mode != b.mode] == [
        Mode.HOLD,
        Mode.TORQUE,
        Mode.HOLD,
        Mode.TORQUE,
    ]
    assert session.record.mode == Mode.HOLD
    hip_nm, slide_n = steps_over_switches(records)
    assert hip_nm < STEP_NM
    assert slide_n < STEP_N
    hip_nm, slide_n = steps_of_torque(session, begun)
    assert hip_nm < BRAKE_STEP_NM
    assert slide_n < BRAKE_STEP_N


def test_what_the_impedance_gave_fades_when_torque_begins(session):
    """Held beside where it stands, the leg pulls at a spring; its pull does not end in a cycle."""
    leg = session.core.legs[0]
    hold = leg.exercise
    off = (hold.start[0] - 0.03, hold.start[1] + 0.02)
    leg.exercise = replace(hold, start=off, start_velocity=(0.0, 0.0), elapsed_s=0.0)
    session.run(0.5)
    begun = len(session.bus.sent)
    before_nm = session.record.drives[0].target_effort

    in_torque(session, constant())
    session.run(1.5)

    after_nm = session.record.drives[0].target_effort
    assert abs(after_nm - before_nm) > 3
    hip_nm, slide_n = steps_of_torque(session, begun)
    assert hip_nm < 0.15 * abs(after_nm - before_nm)
    assert slide_n < STEP_N


@pytest.mark.parametrize("how", ["it hangs", "its lease is taken", "another client holds it"])
def test_a_controller_that_is_gone_leaves_a_leg_that_is_braked_and_held(session, how):
    start_rad = session.record.drives[0].position
    controller = in_torque(session, towards(start_rad + 0.15, stiffness_nm_per_rad=150.0))
    session.run(0.3)
    cycle = session.record.cycle
    gateway = session.gateway

    if how == "it hangs":
        controller.running = False
    elif how == "its lease is taken":
        gateway.end_lease()
    else:
        gateway.lease += 1
    held = session.run_until(lambda record: record.mode == Mode.HOLD, within_s=1)
    session.run(1)

    allowed_cycles = AGE_CYCLES + 2 if how == "it hangs" else 2
    assert held.cycle - cycle <= allowed_cycles
    assert held.verdict.cause == Cause.NONE
    record = session.record
    assert (record.mode, record.verdict.cause) == (Mode.HOLD, Cause.NONE)
    assert record.assist.lapse_count == 1
    lapse = Lapse.STALE if how == "it hangs" else Lapse.LEASE_ENDED
    assert record.assist.lapse_reason is lapse
    assist = [one.legs[0].hip.assist for one in records_since(session, held.cycle)]
    assert assist[FADE_CYCLES:] == [0.0] * len(assist[FADE_CYCLES:])
    assert np.all(np.diff(np.abs(assist)) <= 0)
    assert abs(record.drives[0].velocity) < 0.02
    assert abs(record.drives[0].position - held.drives[0].position) < 0.05


def test_a_leg_that_was_let_go_is_not_taken_again_without_a_request(session):
    controller = in_torque(session, constant(hip_nm=6.0))
    controller.running = False
    session.run(0.5)
    controller.running = True
    session.run(1)

    assert session.record.mode == Mode.HOLD
    assert refused(session, SetpointRefusal.WRONG_MODE) == 0
    assert both(session.record.legs[0], "assist") == (0.0, 0.0)


def test_torque_begins_only_under_a_lease(session):
    answer = session.request(RequestKind.MODE, TORQUE)

    assert answer.outcome == Outcome.REFUSED
    assert answer.refusal == Refusal(RefusalCode.LEASE_NEEDED)
    assert session.record.mode == Mode.HOLD


def test_torque_waits_half_a_second_for_its_first_setpoint(session):
    session.gateway.grant_lease(lambda _: ())
    answer = session.request(RequestKind.MODE, TORQUE)
    cycle = session.record.cycle

    held = session.run_until(lambda record: record.mode == Mode.HOLD, within_s=2)

    assert answer.outcome == Outcome.DONE
    assert START_CYCLES <= held.cycle - cycle <= START_CYCLES + 3
    assert held.assist.lapse_reason is Lapse.NO_SETPOINT


@pytest.mark.parametrize("leased", [True, False])
def test_a_stop_works_with_and_without_a_lease_and_ends_assist(session, leased):
    if leased:
        in_torque(session, constant(hip_nm=12.0))
        session.run(0.2)
    begun = len(session.bus.sent)
    cycle = session.record.cycle

    session.gateway.stop()
    session.run_until(lambda record: record.mode == Mode.FAULT, within_s=3)

    record = session.record
    assert record.verdict.cause == Cause.STOP_REQUESTED
    assert records_since(session, cycle)[0].mode == Mode.STOPPING
    assert both(record.legs[0], "assist") == (0.0, 0.0)
    assert steps_of_torque(session, begun)[0] < BRAKE_STEP_NM


def test_a_quick_stop_in_torque_is_one_of_both_axes(session):
    in_torque(session, constant(hip_nm=10.0))
    session.run(0.1)
    session.command("hand_switch_open right/slide")

    stopped = session.run_until(lambda record: record.mode == Mode.STOPPING, within_s=0.1)
    session.run(0.1)

    assert both(stopped.legs[0], "assist") == (0.0, 0.0)
    assert session.record.verdict.cause == Cause.HAND_SWITCH_OPEN
    assert set(words_by_cycle(session.bus.sent)[-1].values()) == {QUICK_STOP_WORD}
    assert both(session.record.legs[0], "assist") == (0.0, 0.0)


def test_disable_in_torque_ends_in_ready(session):
    in_torque(session, constant(hip_nm=6.0))

    answer = session.request(RequestKind.DISABLE)

    assert answer.outcome == Outcome.DONE
    assert session.record.mode == Mode.READY


NAN, INF = float("nan"), float("inf")
WRONG = [
    (SetpointRefusal.WRONG_LEASE, {"lease": 99}),
    (SetpointRefusal.REORDERED, {"seq": 1}),
    (SetpointRefusal.REPEATED, {"seq": 0}),
    (SetpointRefusal.STALE, {"for_cycle": -AGE_CYCLES - 2}),
    (SetpointRefusal.AHEAD, {"for_cycle": 5}),
    (SetpointRefusal.NON_FINITE, {"hip": AxisSetpoint(NAN)}),
    (SetpointRefusal.NON_FINITE, {"slide": AxisSetpoint(-INF)}),
    (SetpointRefusal.NON_FINITE, {"stiffness_ratio": NAN}),
    (SetpointRefusal.OUT_OF_RANGE, {"hip": AxisSetpoint(20.01)}),
    (SetpointRefusal.OUT_OF_RANGE, {"slide": AxisSetpoint(-150.1)}),
    (SetpointRefusal.OUT_OF_RANGE, {"stiffness_ratio": 1.01}),
    (SetpointRefusal.OUT_OF_RANGE, {"stiffness_ratio": -0.01}),
    (SetpointRefusal.UNKNOWN_LEG, {"leg": "left"}),
]


def spoiled(good, record, changes):
    """A good setpoint with something wrong; seq 0: that of the last one, for_cycle: relative."""
    changes = dict(changes)
    if "for_cycle" in changes:
        changes["for_cycle"] += record.cycle
    if changes.get("seq") == 0:
        changes |= {"seq": good.seq - 1}
    return msgspec.structs.replace(good, **changes)


def test_a_setpoint_that_is_wrong_is_counted_once_and_changes_nothing(session):
    controller = in_torque(session, constant(hip_nm=5.0))
    session.run(0.3)
    script = []

    def spoil(record):
        good = controller(record)
        return (spoiled(good[0], record, script.pop()),) if script else good

    session.gateway.controller = spoil
    for reason, changes in WRONG:
        was = session.record.assist.refused_count
        script.append(changes)
        session.run(0.05)

        record = session.record
        now = record.assist.refused_count
        assert now == was | {reason: was.get(reason, 0) + 1}, changes
        assert record.mode == Mode.TORQUE
        assert record.legs[0].hip.assist == pytest.approx(5.0)


@pytest.mark.parametrize(("reason", "changes"), [WRONG[0], WRONG[3], WRONG[8]])
def test_a_controller_that_says_nothing_else_is_gone(session, reason, changes):
    controller = in_torque(session, constant(hip_nm=5.0))
    session.run(0.3)
    gateway = session.gateway
    gateway.controller = lambda record: (spoiled(controller(record)[0], record, changes),)

    held = session.run_until(lambda record: record.mode == Mode.HOLD, within_s=1)

    assert refused(session, reason) >= AGE_CYCLES - 1
    assert held.assist.lapse_reason is Lapse.STALE


def test_a_setpoint_without_a_lease_is_refused(session):
    session.gateway.controller = lambda record: (
        Setpoint(1, record.cycle, record.cycle, AxisSetpoint(5.0), leg="right"),
    )

    session.run(0.1)

    assert refused(session, SetpointRefusal.UNLEASED) == pytest.approx(10, abs=1)
    assert session.record.assist.accepted_count == 0


def test_in_hold_a_controller_may_live_but_not_push(session):
    gateway = session.gateway
    Controller(gateway, constant(hip_nm=5.0))
    session.run(0.1)
    accepted = session.record.assist.accepted_count

    gateway.controller = lambda record: (
        Setpoint(gateway.lease, 1000 + record.cycle, record.cycle, AxisSetpoint(5.0), leg="right"),
    )
    session.run(0.1)

    assert accepted == pytest.approx(10, abs=1)
    assert refused(session, SetpointRefusal.WRONG_MODE) == pytest.approx(10, abs=1)
    assert both(session.record.legs[0], "assist") == (0.0, 0.0)


def test_levels_of_another_core_move_nothing_and_a_lost_one_is_made_good_by_the_next(session):
    controller = in_torque(session, constant(hip_nm=8.0))
    session.run(0.3)
    gateway = session.gateway
    honest = gateway.receive
    gateway.receive = _losing(honest, 4)
    session.run(0.3)
    assert session.record.mode == Mode.TORQUE

    gateway.receive = lambda: [
        msgspec.structs.replace(level, core_boot_id="foreign") for level in honest()
    ]
    held = session.run_until(lambda record: record.mode == Mode.HOLD, within_s=1)

    assert controller.running
    assert held.assist.lapse_reason is Lapse.STALE


def _losing(gateway_states, count):
    left = [count]

    def some():
        made = gateway_states()
        left[0] -= 1
        return made if left[0] < 0 else []

    return some


def test_a_gateway_that_falls_silent_takes_assist_away_before_it_is_a_verdict(session):
    in_torque(session, constant(hip_nm=8.0))
    session.run(0.3)
    cycle = session.record.cycle
    session.gateway.silent = True

    stopped = session.run_until(lambda record: record.mode == Mode.FAULT, within_s=3)

    modes = [record.mode for record in records_since(session, cycle)]
    assert modes.index(Mode.HOLD) <= AGE_CYCLES + 1
    assert stopped.verdict.cause == Cause.GATEWAY_SILENT
    assert both(stopped.legs[0], "assist") == (0.0, 0.0)


def test_with_position_guidance_torque_and_setpoints_are_refused(warm_position_hold):
    Controller(warm_position_hold.gateway, constant())
    warm_position_hold.run(0.1)

    answer = warm_position_hold.request(RequestKind.MODE, TORQUE)

    assert answer.outcome == Outcome.REFUSED
    assert answer.refusal == Refusal(RefusalCode.GUIDANCE_BY_POSITION)
    assert refused(warm_position_hold, SetpointRefusal.GUIDANCE_IS_POSITION) >= 9
    assert warm_position_hold.record.assist.accepted_count == 0


def test_each_leg_has_its_own_assist_and_one_that_is_left_alone_floats(warm_two_legs):
    in_torque(warm_two_legs, constant(hip_nm=4.0), legs=("left",))

    warm_two_legs.run(0.5)

    right, left = warm_two_legs.record.legs
    assert warm_two_legs.record.mode == Mode.TORQUE
    assert (both(right, "assist"), both(left, "assist")) == ((0.0, 0.0), (pytest.approx(4.0), 0.0))


def test_a_leg_whose_setpoints_stop_ends_the_assist_of_both(warm_two_legs):
    controller = in_torque(warm_two_legs, constant(hip_nm=4.0), legs=("right", "left"))
    warm_two_legs.run(0.3)
    controller.legs = ("right",)

    held = warm_two_legs.run_until(lambda record: record.mode == Mode.HOLD, within_s=1)

    assert held.assist.lapse_reason is Lapse.STALE
    warm_two_legs.run(0.3)
    assert {both(leg, "assist") for leg in warm_two_legs.record.legs} == {(0.0, 0.0)}


@pytest.mark.parametrize("slide_n", [-150.0, pytest.param(-120.0, marks=pytest.mark.thorough)])
def test_a_controller_that_drives_on_to_an_end_does_not_pass_it(session, slide_n):
    in_torque(session, constant(0.0, slide_n))
    torque_cycle = session.record.cycle

    session.run_until(lambda record: not record.mode.active, within_s=10)
    session.run(1.0)

    assert session.record.verdict.cause == Cause.STOPPING_PATH
    at_m = [record.drives[1].position for record in records_since(session, torque_cycle)]
    assert min(at_m) > 0.0


def creeping(axis, speed_si, push_si, limit_si, gain_si):
    """A controller that moves one axis at this speed, by a push within its limit."""

    def law(record):
        wanted_si = push_si + gain_si * (speed_si - (record.drives[axis].velocity or 0.0))
        assist = [0.0, 0.0]
        assist[axis] = min(max(wanted_si, -limit_si), limit_si)
        return *assist, 1.0

    return law


@pytest.mark.parametrize(
    ("axis", "law"),
    [(0, creeping(0, 0.2, 9.0, 19.9, 40.0)), (1, creeping(1, -0.15, -90.0, 105.0, 500.0))],
    ids=["hip up", "slide down"],
)
def test_a_controller_that_creeps_to_an_end_comes_to_rest_in_the_soft_margin(session, axis, law):
    """It never pushes less; at this speed nothing but the margin would slow the leg."""
    limits = session.settings.limits
    hip_rad = math.radians(limits.hip.position_max_deg - limits.hip.soft_margin_deg)
    slide_m = limits.slide.position_min_m + limits.slide.soft_margin_m
    in_torque(session, law)

    def inside(record):
        at_si = record.drives[axis].position
        return at_si > hip_rad if axis == 0 else at_si < slide_m

    session.run_until(inside, within_s=5)
    session.run(0.5)

    record = session.record
    assert (record.mode, record.verdict.cause) == (Mode.TORQUE, Cause.NONE)
    assert abs(record.drives[axis].velocity) < 0.05
