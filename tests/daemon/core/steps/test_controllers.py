"""Setpoints of controllers in the state of the core: received, put in force, and lapsed."""

import math
from types import SimpleNamespace

import pytest
from gaitd_names import Lapse, Mode, RequestKind, Role, SetpointRefusal
from msgspec.structs import replace
from safety_inputs import LIMITS
from step_inputs import a_leg, an_axis

from daemon.core.motion.assist import AssistRules
from daemon.core.slices import Assisted, Inputs, LegAssist
from daemon.core.steps import controllers
from daemon.ipc.record import AxisPlan, AxisSetpoint, ModeRequest, Plan, Request, Setpoint

CYCLE = 1000
GOOD = Setpoint(7, 1, CYCLE, AxisSetpoint(2.0), AxisSetpoint(10.0), "right", 0.5)
OF_LEFT = replace(GOOD, leg="left", seq=3)
RULES = AssistRules(age_max_cycles=10, start_cycles=50, fade_cycles=20, stiffness_step_ratio=0.01)
CONFIG = SimpleNamespace(assist_rules=RULES, by_position=False, period_s=0.01)
SLOW = LIMITS._replace(assist_rate_max_si_per_s=0.5)
COUNTED = Assisted(
    torque_lease=7, accepted_count=3, refused_count={SetpointRefusal.REORDERED: 3}, lapse_count=3
)


def leg_of(name, **changes):
    """A leg at rest, with what its controller has under lease 7."""
    axes = an_axis(f"{name}/hip"), an_axis(f"{name}/slide")
    return a_leg(*axes, name=name, assist=LegAssist(lease=7, **changes))


def receive(*legs, setpoints=(), lease=7, mode=Mode.TORQUE):
    """Check setpoints as a cycle does; returns what has become of them."""
    inputs = Inputs(lease=lease, setpoints=setpoints)
    assists, after = controllers.receive(legs, COUNTED, inputs, mode, CONFIG, CYCLE)
    for leg, one in zip(legs, assists, strict=True):
        leg.assist = one
    return after


# --- received -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("setpoint", "refusal"),
    [
        (GOOD, None),
        (replace(GOOD, leg="other"), SetpointRefusal.UNKNOWN_LEG),
        (replace(GOOD, lease=6), SetpointRefusal.WRONG_LEASE),
        (replace(GOOD, seq=0), SetpointRefusal.REORDERED),
    ],
)
def test_a_setpoint_is_checked_once_and_counted(setpoint, refusal):
    leg = leg_of("right", seq=0 if refusal is None else 1)
    found = receive(leg, setpoints=(setpoint,))

    if refusal is None:
        assert (found.accepted_count, found.refused_count) == (4, COUNTED.refused_count)
        assert (leg.assist.accepted, leg.assist.seq) == (setpoint, 1)
    else:
        count = 4 if refusal is SetpointRefusal.REORDERED else 1
        assert found.refused_count == {**COUNTED.refused_count, refusal: count}
        assert (found.accepted_count, leg.assist.accepted, leg.assist.seq) == (3, None, 1)
    before = leg.assist
    again = receive(leg, setpoints=(setpoint,))
    assert (again == COUNTED) is (refusal is not SetpointRefusal.UNKNOWN_LEG)
    assert leg.assist == before


def test_each_leg_has_its_own_setpoint_and_none_hides_one_behind_it():
    right, left = leg_of("right"), leg_of("left")
    unknown = replace(GOOD, leg="other")

    found = receive(right, left, setpoints=(unknown, GOOD))
    assert (found.accepted_count, right.assist.accepted) == (4, GOOD)
    assert left.assist == LegAssist(lease=7)
    receive(right, left, setpoints=(GOOD, OF_LEFT))
    assert (right.assist.seq, left.assist.seq) == (1, 3)
    newer = replace(GOOD, seq=2)
    receive(right, left, setpoints=(newer, replace(OF_LEFT, seq=2)))
    assert (right.assist.accepted, left.assist.accepted) == (newer, OF_LEFT)
    assert receive(right, left) is COUNTED
    assert (right.assist.accepted, left.assist.accepted) == (newer, OF_LEFT)


@pytest.mark.parametrize("lease", [6, 8])
def test_another_lease_begins_anew_once_the_assist_of_the_last_one_has_lapsed(lease):
    right, left = leg_of("right", accepted=GOOD, seq=4, effort_si=(2.0, 0.0)), leg_of("left", seq=4)
    setpoints = (replace(GOOD, lease=lease), replace(OF_LEFT, lease=lease))

    receive(right, left, setpoints=setpoints, lease=lease)
    assert (right.assist.lease, right.assist.seq, right.assist.accepted) == (lease, -1, None)
    assert right.assist.checked is None
    assert left.assist.accepted == setpoints[1]
    right.assist = replace(right.assist, effort_si=(0.0, 0.0))
    receive(right, left, setpoints=setpoints, lease=lease)

    assert (right.assist.accepted, right.assist.seq) == (setpoints[0], 1)


def test_assist_in_force_under_the_same_lease_is_followed_on():
    leg = leg_of("right", effort_si=(2.0, 0.0))

    receive(leg, setpoints=(GOOD,))

    assert leg.assist.accepted == GOOD


@pytest.mark.parametrize("accepted", [GOOD, None])
def test_a_mode_without_assist_keeps_no_setpoint(accepted):
    leg = leg_of("right", accepted=accepted)
    before = leg.assist

    receive(leg, mode=Mode.HOLD)

    assert leg.assist == replace(before, accepted=None)
    assert (leg.assist is before) is (accepted is None)


# --- put in force ---------------------------------------------------------------------------------

OLD = CYCLE - 11


def advanced(leg, mode=Mode.TORQUE, *, enabled=True):
    """The assist of the leg in this cycle."""
    return controllers.advance(leg, mode, CONFIG, CYCLE, enabled=enabled)


@pytest.mark.parametrize(
    ("mode", "for_cycle", "is_followed", "ratio"),
    [
        (Mode.TORQUE, CYCLE, True, 1.0),
        (Mode.GAIT, CYCLE, True, 0.99),
        (Mode.GAIT, OLD + 1, True, 0.99),
        (Mode.GAIT, OLD, False, 1.0),
        (Mode.HOLD, CYCLE, False, 1.0),
    ],
)
def test_a_fresh_setpoint_is_followed_in_a_mode_that_takes_it(mode, for_cycle, is_followed, ratio):
    accepted = Setpoint(7, 1, for_cycle, AxisSetpoint(0.5), AxisSetpoint(), "right", 0.5)

    now = advanced(leg_of("right", accepted=accepted), mode)

    assert now.added_si == ((0.5, 0.0) if is_followed else (0.0, 0.0))
    assert now.stiffness_ratio == pytest.approx(ratio)


def test_in_mode_torque_a_setpoint_of_full_stiffness_is_followed_as_it_is():
    full = Setpoint(7, 1, CYCLE, AxisSetpoint(0.5), leg="right")

    assert controllers._followed(full, Mode.TORQUE, CONFIG, CYCLE) is full
    assert controllers._followed(None, Mode.TORQUE, CONFIG, CYCLE) is None


def test_where_no_drive_is_to_be_enabled_assist_is_gone_at_once():
    leg = leg_of("right", effort_si=(9.0, 9.0), fade_si=(0.5, 0.5))

    assert advanced(leg).added_si == (8.5, 8.5)
    assert advanced(leg, enabled=False).added_si == (0.0, 0.0)
    for axis in leg.axes:
        axis.limits = SLOW
    leg.assist = replace(leg.assist, accepted=GOOD)
    assert advanced(leg, enabled=False).effort_si == (0.005, 0.005)


def test_assist_that_is_not_a_number_makes_the_command_one_that_is_refused(monkeypatch):
    leg = leg_of("right", accepted=GOOD, effort_si=(2.0, 2.0))
    monkeypatch.setattr(controllers.assist.bounds, "bound_assist", lambda *_: None)

    leg.assist = advanced(leg)
    assert all(map(math.isnan, leg.assist.added_si))
    assert (leg.assist.accepted, leg.assist.effort_si) == (None, (0.0, 0.0))
    assert advanced(leg).added_si == (0.0, 0.0)


# --- begun and lapsed -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mode", "lease", "kept", "cap_si"),
    [
        (Mode.TORQUE, 9, False, (math.inf, math.inf)),
        (Mode.GAIT, 7, True, (3.0, math.inf)),
        (Mode.HOLD, 7, True, (math.inf, math.inf)),
    ],
)
def test_mode_torque_begins_under_the_lease_of_now_and_without_assist(mode, lease, kept, cap_si):
    legs = leg_of("right", accepted=GOOD, seq=2), leg_of("left", accepted=OF_LEFT, seq=3)
    plan = Plan(1.0, 1.0, 1.0, AxisPlan(3.0), AxisPlan())
    request = Request(1, RequestKind.MODE, CYCLE, ModeRequest(mode), Role.SESSION, plan)

    assists, after = controllers.begun(legs, COUNTED, request, 9)

    assert after == replace(COUNTED, torque_lease=lease, cap_si=cap_si)
    accepted = (GOOD, OF_LEFT) if kept else (None, None)
    assert tuple(one.accepted for one in assists) == accepted
    assert [one.seq for one in assists] == [2, 3]


ACTIVE = {"effort_si": (2.0, 0.0)}


@pytest.mark.parametrize(
    ("mode", "lease", "for_cycle", "changes", "elapsed_s", "reason"),
    [
        (Mode.TORQUE, 7, CYCLE, {}, 9.0, Lapse.NONE),
        (Mode.TORQUE, 7, OLD + 1, {}, 9.0, Lapse.NONE),
        (Mode.TORQUE, 6, CYCLE, {}, 9.0, Lapse.LEASE_ENDED),
        (Mode.TORQUE, 8, CYCLE, {}, 9.0, Lapse.LEASE_ENDED),
        (Mode.TORQUE, 7, OLD, {}, 9.0, Lapse.STALE),
        (Mode.TORQUE, 7, None, {}, 0.1, Lapse.NONE),
        (Mode.TORQUE, 7, None, {}, 0.5, Lapse.NONE),
        (Mode.TORQUE, 7, None, {}, 0.51, Lapse.NO_SETPOINT),
        (Mode.TORQUE, 7, None, {}, None, Lapse.NONE),
        (Mode.GAIT, 8, CYCLE, ACTIVE, 9.0, Lapse.NONE),
        (Mode.GAIT, 8, None, ACTIVE, 9.0, Lapse.LEASE_ENDED),
        (Mode.GAIT, 8, None, {}, 9.0, Lapse.NONE),
        (Mode.GAIT, 8, OLD, ACTIVE, 9.0, Lapse.STALE),
        (Mode.HOLD, 8, OLD, ACTIVE, 9.0, Lapse.NONE),
        (Mode.EXCITE, 8, OLD, ACTIVE, 9.0, Lapse.NONE),
    ],
)
def test_assist_lapses_with_its_lease_and_with_stale_or_missing_setpoints(
    mode, lease, for_cycle, changes, elapsed_s, reason
):
    accepted = None if for_cycle is None else Setpoint(7, 1, for_cycle, leg="right")
    exercise = None if elapsed_s is None else SimpleNamespace(elapsed_s=elapsed_s)
    right, left = leg_of("right", accepted=accepted, **changes), leg_of("left")
    right.exercise, left.exercise = exercise, SimpleNamespace(elapsed_s=0.0)

    found = controllers.lapse((right, left), COUNTED, lease, mode, CONFIG, CYCLE)

    lapsed = replace(COUNTED, lapse_count=4, lapse_reason=reason)
    assert found == (None if reason is Lapse.NONE else lapsed)


@pytest.mark.parametrize("mode", [Mode.TORQUE, Mode.GAIT])
def test_assist_lapses_with_the_setpoint_of_any_leg(mode):
    right = leg_of("right", accepted=GOOD)
    left = leg_of("left", accepted=replace(OF_LEFT, for_cycle=OLD))

    found = controllers.lapse((right, left), COUNTED, 7, mode, CONFIG, CYCLE)

    assert found.lapse_reason is Lapse.STALE
