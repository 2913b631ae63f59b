"""What counts of a controller's setpoints, and how its assist comes and goes; without any drive."""

import math
from dataclasses import replace

import pytest
from gaitd_names import Mode, RefusalCode, RequestKind, SetpointRefusal, Trigger
from hypothesis import given, settings
from hypothesis import strategies as st
from safety_inputs import ALL_WELL, LIMITS

from daemon.core.modes.table import MODES, TRANSITIONS, refusal, rules_of
from daemon.core.motion.assist import (
    AssistRules,
    SetpointContext,
    advance,
    check_setpoint,
    is_active,
    is_neutral,
)
from daemon.core.slices import LegAssist
from daemon.ipc.record import AxisSetpoint, ModeRequest, Setpoint

BOTH = (LIMITS, LIMITS)
RULES = AssistRules(age_max_cycles=10, start_cycles=50, fade_cycles=20, stiffness_step_ratio=0.01)
DESK = SetpointContext(lease=7, cycle=100, takes_assist=True, by_position=False)
REST = (0.0, 0.0)
DT_S = 0.01


def setpoint(**changes):
    fields = {"lease": 7, "seq": 5, "for_cycle": 99, "leg": "right"} | changes
    return Setpoint(**fields)


def in_mode(mode):
    return {"takes_assist": rules_of(mode).takes_assist}


def reason(changes, last_seq=4, **context):
    return check_setpoint(setpoint(**changes), last_seq, BOTH, DESK._replace(**context), RULES)


def test_a_setpoint_of_the_holder_that_is_new_and_small_counts():
    assert reason({"hip": AxisSetpoint(LIMITS.assist_max_si)}) is None


@pytest.mark.parametrize(
    ("changes", "desk", "refusal"),
    [
        ({}, {"lease": 0}, SetpointRefusal.UNLEASED),
        ({"lease": 8}, {}, SetpointRefusal.WRONG_LEASE),
        ({"lease": 6}, {}, SetpointRefusal.WRONG_LEASE),
        ({"seq": 4}, {}, SetpointRefusal.REPEATED),
        ({"seq": 3}, {}, SetpointRefusal.REORDERED),
        ({"for_cycle": 90}, {}, None),
        ({"for_cycle": 89}, {}, SetpointRefusal.STALE),
        ({"for_cycle": 3}, {}, SetpointRefusal.STALE),
        ({"for_cycle": 100}, {}, None),
        ({"for_cycle": 101}, {}, SetpointRefusal.AHEAD),
        ({"hip": AxisSetpoint(math.nan)}, {}, SetpointRefusal.NON_FINITE),
        ({"slide": AxisSetpoint(math.inf)}, {}, SetpointRefusal.NON_FINITE),
        ({"stiffness_ratio": math.nan}, {}, SetpointRefusal.NON_FINITE),
        ({"hip": AxisSetpoint(LIMITS.assist_max_si + 1e-9)}, {}, SetpointRefusal.OUT_OF_RANGE),
        ({"slide": AxisSetpoint(-LIMITS.assist_max_si - 1e-9)}, {}, SetpointRefusal.OUT_OF_RANGE),
        ({"stiffness_ratio": -1e-9}, {}, SetpointRefusal.OUT_OF_RANGE),
        ({"stiffness_ratio": 0.0}, {}, None),
        ({"stiffness_ratio": 1.0 + 1e-9}, {}, SetpointRefusal.OUT_OF_RANGE),
        ({"hip": AxisSetpoint(-2.0)}, {"cap_si": (2.0, math.inf)}, None),
        ({"hip": AxisSetpoint(-2.1)}, {"cap_si": (2.0, math.inf)}, SetpointRefusal.OUT_OF_RANGE),
        ({"slide": AxisSetpoint(2.1)}, {"cap_si": (math.inf, 2.0)}, SetpointRefusal.OUT_OF_RANGE),
        ({}, {"cap_si": (0.0, math.nan)}, SetpointRefusal.OUT_OF_RANGE),
        ({}, {"by_position": True}, SetpointRefusal.GUIDANCE_IS_POSITION),
        ({}, in_mode(Mode.HOLD), None),
        ({"hip": AxisSetpoint(0.1)}, in_mode(Mode.HOLD), SetpointRefusal.WRONG_MODE),
        ({"slide": AxisSetpoint(0.1)}, in_mode(Mode.EXCITE), SetpointRefusal.WRONG_MODE),
        ({"stiffness_ratio": 0.9}, in_mode(Mode.HAND_GUIDING), SetpointRefusal.WRONG_MODE),
        ({"stiffness_ratio": 0.9}, in_mode(Mode.GAIT), None),
    ],
)
def test_what_is_wrong_with_a_setpoint_is_named(changes, desk, refusal):
    assert reason(changes, **desk) is refusal


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({}, None),
        ({"lease_held": False}, RefusalCode.LEASE_NEEDED),
        ({"drives_powered": False}, RefusalCode.NOT_HOLDING_YET),
        ({"guidance": "position"}, RefusalCode.GUIDANCE_BY_POSITION),
        ({"mode": Mode.READY}, RefusalCode.NOT_IN_THIS_MODE),
        ({"mode": Mode.GAIT}, RefusalCode.NOT_IN_THIS_MODE),
    ],
)
def test_mode_torque_is_given_in_hold_under_a_lease_with_drives_that_go_by_torque(changes, code):
    well = replace(ALL_WELL, mode=Mode.HOLD, patient_configured=True, lease_held=True)

    refused = refusal(RequestKind.MODE, ModeRequest(Mode.TORQUE), replace(well, **changes))

    assert (None if refused is None else refused.code) is code


def test_only_assisted_modes_lapse_and_a_lapse_ends_in_hold():
    rows = {mode: to for (mode, event), to in TRANSITIONS.items() if event is Trigger.LEASE_LAPSED}

    assert rows == {mode: Mode.HOLD for mode, rules in MODES.items() if rules.takes_assist}


def test_a_setpoint_that_asks_for_nothing_is_neutral():
    assert is_neutral(setpoint())
    for changes in (
        *({"hip": AxisSetpoint(1.0)}, {"hip": AxisSetpoint(-1.0)}),
        *({"slide": AxisSetpoint(1.0)}, {"stiffness_ratio": 0.99}),
    ):
        assert not is_neutral(setpoint(**changes))


def test_assist_is_in_force_until_it_fades():
    pushing = LegAssist(effort_si=(1.0, 0.0))
    soft = LegAssist(stiffness_ratio=0.9)

    assert not is_active(LegAssist())
    assert not is_active(LegAssist(accepted=setpoint()))
    assert is_active(LegAssist(accepted=setpoint(slide=AxisSetpoint(1.0))))
    assert is_active(pushing)
    assert is_active(LegAssist(effort_si=(-1.0, 0.0)))
    assert is_active(soft)
    assert not is_active(LegAssist(effort_si=(1.0, 0.0), fade_si=(0.1, 0.1)))


def test_before_any_setpoint_nothing_is_in_force():
    assert LegAssist() == LegAssist(
        lease=0,
        seq=-1,
        checked=None,
        accepted=None,
        effort_si=(0.0, 0.0),
        fade_si=None,
        stiffness_ratio=1.0,
    )


def after(assist, wanted, cycles, velocity=REST):
    for _ in range(cycles):
        moved = advance(assist, wanted, BOTH, velocity, RULES, DT_S)
        assert moved is not None
        assist = moved
    return assist


@settings(max_examples=200, deadline=None, derandomize=True)
@given(hip=st.floats(-20, 20), slide=st.floats(-20, 20), stiffness=st.floats(0, 1))
def test_assist_of_any_size_is_gone_after_the_time_of_the_fade_and_only_shrinks(
    hip, slide, stiffness
):
    assist = LegAssist(effort_si=(hip, slide), stiffness_ratio=stiffness)
    for _ in range(RULES.fade_cycles):
        faded = after(assist, None, 1)
        for was, now, begun in zip(assist.effort_si, faded.effort_si, (hip, slide), strict=True):
            assert abs(now) <= abs(was)
            assert abs(was - now) <= abs(begun) / RULES.fade_cycles * (1 + 1e-5)
            assert now * was >= 0
        assert faded.stiffness_ratio >= assist.stiffness_ratio
        assist = faded

    assert assist.effort_si == REST
    assert assist.stiffness_ratio == pytest.approx(1.0)


def test_a_fade_takes_equal_steps_of_effort_and_stiffness():
    begun = LegAssist(effort_si=(10.0, -4.0), stiffness_ratio=0.5)

    faded = [after(begun, None, cycles) for cycles in (1, 2, 9, 19, 20)]

    assert [one.effort_si[0] for one in faded] == pytest.approx([9.5, 9.0, 5.5, 0.5, 0.0])
    assert [one.effort_si[1] for one in faded] == pytest.approx([-3.8, -3.6, -2.2, -0.2, 0.0])
    assert [one.fade_si for one in faded] == [(0.5, 0.2)] * 5
    assert [one.stiffness_ratio for one in faded] == pytest.approx([0.55, 0.6, 0.95, 1.0, 1.0])


def test_a_fade_that_is_broken_off_goes_on_from_where_it_is():
    assist = after(LegAssist(effort_si=(10.0, 0.0)), None, 10)
    assert assist.effort_si[0] == pytest.approx(5.0)

    again = after(assist, setpoint(hip=AxisSetpoint(10.0)), 1)

    assert again.effort_si[0] == pytest.approx(7.0)
    assert after(again, None, 1).effort_si[0] == pytest.approx(7.0 * 19 / 20)


def test_assist_and_stiffness_follow_by_their_rates():
    wanted = setpoint(hip=AxisSetpoint(5.0), slide=AxisSetpoint(-3.0), stiffness_ratio=0.95)

    steps = [after(LegAssist(), wanted, cycles) for cycles in (1, 2, 3, 10)]

    assert [one.effort_si[0] for one in steps] == pytest.approx([2.0, 4.0, 5.0, 5.0])
    assert [one.effort_si[1] for one in steps] == pytest.approx([-2.0, -3.0, -3.0, -3.0])
    assert [one.stiffness_ratio for one in steps] == pytest.approx([0.99, 0.98, 0.97, 0.95])


@pytest.mark.parametrize("velocity", [(math.nan, 0.0), (0.0, math.inf)])
def test_assist_on_a_joint_of_unknown_speed_is_no_number_once_and_then_zero(velocity):
    pushing = LegAssist(accepted=setpoint(), effort_si=(1.0, 2.0), fade_si=(0.1, 0.1))

    stopped = advance(pushing, setpoint(), BOTH, velocity, RULES, DT_S)

    assert stopped == LegAssist(is_finite=False)
    assert all(map(math.isnan, stopped.added_si))
    assert advance(stopped, None, BOTH, velocity, RULES, DT_S).added_si == REST
    assert advance(stopped, setpoint(), BOTH, REST, RULES, DT_S).is_finite


def test_assist_that_has_faded_stays_as_it_is():
    faded = after(LegAssist(effort_si=(10.0, -3.0), stiffness_ratio=0.5), None, RULES.fade_cycles)
    faded = after(faded, setpoint(), 1)
    faded = after(faded, None, 1)

    assert (faded.effort_si, faded.fade_si, faded.stiffness_ratio) == (REST, REST, 1.0)
    assert after(faded, None, 1) is faded
