"""Mode torque: a controller moves the leg under a lease, and whatever ends that ends in hold."""

from dataclasses import replace
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from controllers import Controller, constant, towards
from gaitd_names import Cause, Lapse, Mode, Outcome, RequestKind, SetpointRefusal
from records import both
from sessions import new_session, two_legs
from wire import target_torques

from daemon.ipc.record import AxisSetpoint, ModeRequest

TORQUE = ModeRequest(Mode.TORQUE)
FADE_CYCLES = 20
AGE_CYCLES = 10
STEP_NM, STEP_N = 2.6, 20.0
"""In one cycle: the rate of assist, and what the pose changes in g(q)."""
BRAKE_STEP_NM, BRAKE_STEP_N = 6.0, 75.0
"""In one cycle: the damper of hold, while the speed it wants falls by 15 rad/s^2 and 20 m/s^2."""


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
    session.run(0.8)

    after_nm = session.record.drives[0].target_effort
    assert abs(after_nm - before_nm) > 3
    hip_nm, slide_n = steps_of_torque(session, begun)
    assert hip_nm < 0.15 * abs(after_nm - before_nm)
    assert slide_n < STEP_N


def test_a_controller_that_hangs_leaves_a_leg_that_is_braked_and_held_until_a_request(session):
    start_rad = session.record.drives[0].position
    controller = in_torque(session, towards(start_rad + 0.15, stiffness_nm_per_rad=150.0))
    session.run(0.3)
    cycle = session.record.cycle

    controller.running = False
    held = session.run_until(lambda record: record.mode == Mode.HOLD, within_s=1)
    session.run(1)

    assert held.cycle - cycle <= AGE_CYCLES + 2
    assert held.verdict.cause == Cause.NONE
    record = session.record
    assert (record.mode, record.verdict.cause) == (Mode.HOLD, Cause.NONE)
    assert record.assist.lapse_count == 1
    assert record.assist.lapse_reason is Lapse.STALE
    assist = [one.legs[0].hip.assist for one in records_since(session, held.cycle)]
    assert assist[FADE_CYCLES:] == [0.0] * len(assist[FADE_CYCLES:])
    assert np.all(np.diff(np.abs(assist)) <= 0)
    assert abs(record.drives[0].velocity) < 0.02
    assert abs(record.drives[0].position - held.drives[0].position) < 0.05
    controller.running = True
    session.run(0.3)
    assert session.record.mode == Mode.HOLD
    assert both(session.record.legs[0], "assist") == (0.0, 0.0)


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
    session.gateway.controller = lambda record: (
        spoiled(controller(record)[0], record, {"hip": AxisSetpoint(20.01)}),
    )
    held = session.run_until(lambda record: record.mode == Mode.HOLD, within_s=1)
    assert held.assist.lapse_reason is Lapse.STALE


def test_each_leg_has_its_own_assist_and_setpoints_of_one_that_stop_end_that_of_both(
    warm_two_legs,
):
    controller = in_torque(warm_two_legs, constant(hip_nm=4.0), legs=("left",))
    warm_two_legs.run(0.3)

    right, left = warm_two_legs.record.legs
    assert warm_two_legs.record.mode == Mode.TORQUE
    assert (both(right, "assist"), both(left, "assist")) == ((0.0, 0.0), (pytest.approx(4.0), 0.0))

    controller.legs = ("right", "left")
    warm_two_legs.run(0.3)
    controller.legs = ("right",)

    held = warm_two_legs.run_until(lambda record: record.mode == Mode.HOLD, within_s=1)

    assert held.assist.lapse_reason is Lapse.STALE
    warm_two_legs.run(0.3)
    assert {both(leg, "assist") for leg in warm_two_legs.record.legs} == {(0.0, 0.0)}


def test_a_controller_that_drives_on_to_an_end_does_not_pass_it(session):
    in_torque(session, constant(0.0, -150.0))
    torque_cycle = session.record.cycle

    session.run_until(lambda record: not record.mode.active, within_s=10)
    session.run(0.5)

    assert session.record.verdict.cause == Cause.STOPPING_PATH
    at_m = [record.drives[1].position for record in records_since(session, torque_cycle)]
    assert min(at_m) > 0.0


def creeping(record):
    """A controller that moves the slide down at 0.15 m/s, by a push within its limit."""
    wanted_n = -90.0 + 500.0 * (-0.15 - (record.drives[1].velocity or 0.0))
    return 0.0, min(max(wanted_n, -105.0), 105.0), 1.0


def test_a_controller_that_creeps_to_an_end_comes_to_rest_in_the_soft_margin(session):
    """It never pushes less; at this speed nothing but the margin would slow the leg."""
    limits = session.settings.limits.slide
    margin_m = limits.position_min_m + limits.soft_margin_m
    in_torque(session, creeping)

    session.run_until(lambda record: record.drives[1].position < margin_m, within_s=5)
    session.run(0.5)

    record = session.record
    assert (record.mode, record.verdict.cause) == (Mode.TORQUE, Cause.NONE)
    assert abs(record.drives[1].velocity) < 0.05
