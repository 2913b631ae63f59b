"""The targets of one axis while its mode changes: a row of the table for each test."""

import math
from itertools import pairwise
from types import SimpleNamespace

import pytest
from safety_inputs import FEEDBACK, JOINT
from step_inputs import an_axis, now_shows, was_sent

from daemon.core.steps import targets
from drives.signals import OperationMode, PowerState

CSP, CST = OperationMode.CYCLIC_SYNC_POSITION, OperationMode.CYCLIC_SYNC_TORQUE
HOMING = OperationMode.HOMING
DT_S = 0.01
FADED = math.exp(-0.05)
"""Share of a difference that is left after a cycle."""
AT_REST = JOINT._replace(position_si=0.2, velocity_si=0.0, effort_si=6.0)


def axis_that(shows=CST, sent=CST, state=PowerState.OPERATION_ENABLED, following=True):
    """The hip, enabled and at rest at 0.2 rad with 6 N·m, its last targets as that."""
    shown = {"mode_display": shows, "power_state": state, "following": following}
    return an_axis(
        joint=AT_REST,
        feedback=FEEDBACK._replace(**shown),
        gravity_si=7.0,
        mode=sent,
        effort_si=6.0,
        effort_mean_si=6.0,
        position_si=0.2,
    )


def effort(axis, wanted_si, mode, *, pushing=True, leaving=False):
    found = targets.effort(axis, wanted_si, targets.DriveRequest(mode, pushing, leaving, DT_S))
    if found is not None:
        fade = {"effort_offset_si": found.offset_si, "effort_mean_si": found.mean_si}
        was_sent(axis, **fade)
    return found and found.sent_si


def position(axis, wanted_si, mode, *, pushing=True):
    request = targets.DriveRequest(mode, pushing, False, DT_S)
    found = targets.position(axis, wanted_si, axis.sent.position_offset_si, request)
    if found is not None:
        was_sent(axis, position_offset_si=found.offset_si)
    return found and found.sent_si


def commanded(axis, mode, target_si):
    request = targets.DriveRequest(mode, True, False, DT_S)
    effort, position = targets.Effort(0.0, 0.0, 0.0), targets.Position(target_si, 0.0)
    return targets.sent(axis, effort, position, request)


# --- effort -----------------------------------------------------------------------------------


def test_in_torque_mode_the_wish_is_sent():
    assert effort(axis_that(), 8.0, CST) == 8.0


def test_before_a_drive_pushes_its_torque_is_at_once_what_holds_the_pose():
    axis = axis_that(state=PowerState.SWITCHED_ON)
    now_shows(axis, reached_enabled=False, gravity_si=20.0)
    was_sent(axis, effort_si=0.0)

    assert axis.limits.effort_rate_max_si_per_s * DT_S < 20.0
    assert effort(axis, 20.0, CST) == 20.0


@pytest.mark.parametrize(
    ("changes", "request_", "expected"),
    [
        ({}, (CST, False, False), (0.0, 0.0, 7.0)),
        ({"shows": CSP, "sent": CSP}, (CSP, True, False), (6.0, 0.0, 5.0)),
        ({"shows": CSP, "sent": CSP}, (CST, True, False), (6.0, -4.0, 5.0)),
        ({"shows": HOMING, "sent": HOMING}, (HOMING, True, False), (6.0, 0.0, 5.0)),
        ({}, (CST, True, False), (10.0 - FADED, -FADED, 10.0 - FADED - (5.0 - FADED) * FADED)),
        ({}, (CST, True, True), (5.0, -FADED, 5.0)),
        ({}, (CST, True, False, True), (6.0, -4.0, 6.0 - FADED)),
    ],
    ids=["off", "position mode", "to torque mode", "homing", "torque", "leaving", "taking over"],
)
def test_the_effort_is_that_of_its_row_and_its_fade_goes_on(changes, request_, expected):
    """10 N·m are wanted; the last offset was -1 N·m, the mean 5 N·m."""
    axis = axis_that(**changes)
    was_sent(axis, effort_offset_si=-1.0, effort_mean_si=5.0)
    mode, pushing, leaving, *takes_over = request_
    request = targets.DriveRequest(mode, pushing, leaving, DT_S, *takes_over)

    assert targets.effort(axis, 10.0, request) == pytest.approx(expected)


@pytest.mark.parametrize("wish_nm", [-50.0, 0.0, 6.0, 50.0])
def test_torque_begins_where_it_was_and_fades_to_the_wish(wish_nm):
    axis = axis_that(shows=CSP, sent=CSP)
    sent = [effort(axis, wish_nm, CST)]
    was_sent(axis, mode=CST)
    now_shows(axis, feedback=axis.sensed.feedback._replace(mode_display=CST))

    for _ in range(300):
        was_sent(axis, effort_si=sent[-1])
        sent.append(effort(axis, wish_nm, CST))

    assert sent[0] == 6.0
    assert abs(sent[1] - sent[0]) <= abs(wish_nm - 6.0) * 0.05 + 1e-9
    rest = [abs(one - wish_nm) for one in sent]
    assert all(after <= before + 1e-9 for before, after in pairwise(rest))
    assert sent[-1] == pytest.approx(wish_nm, abs=1e-3)


def test_near_rest_what_was_sent_lately_goes_on_until_the_mode_may_change():
    axis = axis_that()
    was_sent(axis, effort_mean_si=5.0)

    assert effort(axis, 9.0, CST, leaving=True) == 5.0
    now_shows(axis, joint=AT_REST._replace(velocity_si=1.0))
    assert effort(axis, 9.0, CST, leaving=True) == 9.0
    now_shows(axis, joint=AT_REST)
    was_sent(axis, effort_mean_si=math.nan)
    assert effort(axis, 9.0, CST, leaving=True) is None


# --- position ---------------------------------------------------------------------------------


def test_in_torque_mode_the_target_position_is_where_the_joint_is():
    axis = axis_that()
    now_shows(axis, joint=AT_REST._replace(position_si=0.31))

    assert position(axis, 0.5, CST) == 0.31


def test_the_cycle_that_first_asks_for_position_mode_carries_the_position_of_its_own_sync():
    axis = axis_that(shows=CST, sent=CST)
    now_shows(axis, joint=AT_REST._replace(position_si=0.31))

    assert position(axis, 0.5, CSP) == 0.31
    was_sent(axis, mode=HOMING)
    assert position(axis, 0.5, CSP) == 0.31


def test_a_drive_in_its_own_homing_gets_its_present_position():
    axis = axis_that(shows=HOMING, sent=CST)
    now_shows(axis, joint=AT_REST._replace(position_si=0.31))

    assert position(axis, 0.5, HOMING) == 0.31
    assert targets.loop_distance(axis) == math.inf


def test_then_it_is_held_until_6061h_matches_however_the_joint_moves():
    axis = axis_that(shows=CST, sent=CSP)
    now_shows(axis, joint=AT_REST._replace(position_si=0.31))

    assert position(axis, 0.5, CSP) == 0.2


@pytest.mark.parametrize("state", [s for s in PowerState if s != PowerState.OPERATION_ENABLED])
@pytest.mark.parametrize("shows", [CSP, CST])
def test_a_drive_that_is_not_enabled_gets_its_present_position(state, shows):
    axis = axis_that(shows=shows, sent=CSP, state=state)
    now_shows(axis, joint=AT_REST._replace(position_si=0.31))

    assert position(axis, 0.31, CSP) == 0.31
    assert axis.sent.position_offset_si == 0.0


@pytest.mark.parametrize(
    ("mode", "pushing", "following"),
    [(CSP, True, False), (CSP, False, True), (CST, True, True), (HOMING, True, True)],
    ids=["not following", "being stopped", "on the way to torque mode", "on the way to homing"],
)
def test_the_last_target_is_held_while_the_drive_still_goes_by_it(mode, pushing, following):
    axis = axis_that(shows=CSP, sent=CSP, following=following)
    now_shows(axis, joint=AT_REST._replace(position_si=0.31))

    assert position(axis, 0.5, mode, pushing=pushing) == 0.2
    assert axis.sent.position_offset_si == pytest.approx(-0.3 if pushing else 0.0)


def test_a_followed_target_is_the_plan_and_the_rest_of_its_offset():
    axis = axis_that(shows=CSP, sent=CSP)
    request = targets.DriveRequest(CSP, True, False, DT_S)
    found = targets.position(axis, 0.19, 0.02, request)

    assert found == pytest.approx((0.19 + 0.02 * FADED, 0.02 * FADED))
    at_once = request._replace(dt_s=0.0)
    for negligible_si in (targets.NEGLIGIBLE_SI, -0.5 * targets.NEGLIGIBLE_SI):
        assert targets.position(axis, 0.2, negligible_si, at_once).offset_si == 0.0
    assert targets.position(axis, 0.2, 1.01 * targets.NEGLIGIBLE_SI, at_once).offset_si > 0.0


@pytest.mark.parametrize("wish_rad", [-0.2, 0.2, 0.6])
def test_position_begins_where_it_was_and_fades_to_the_wish(wish_rad):
    axis = axis_that(shows=CST, sent=CSP)
    sent = [position(axis, wish_rad, CSP)]
    now_shows(axis, feedback=axis.sensed.feedback._replace(mode_display=CSP))

    for _ in range(300):
        was_sent(axis, position_si=sent[-1])
        sent.append(position(axis, wish_rad, CSP))

    assert sent[0] == 0.2
    assert abs(sent[1] - sent[0]) <= abs(wish_rad - 0.2) * 0.05 + 1e-9
    assert sent[-1] == pytest.approx(wish_rad, abs=1e-5)


def test_a_stop_goes_on_with_the_leg_s_speed_and_then_comes_back_to_where_the_leg_was():
    """The leg is 0.05 rad behind its target and moves at 1 rad/s: the plan brakes from the leg."""
    axis = axis_that(shows=CSP, sent=CSP)
    was_sent(axis, position_si=0.25)

    assert targets.braking_offset_si(axis.sent, 0.2, 2.5, DT_S) == pytest.approx(0.075)
    offset_si = targets.braking_offset_si(axis.sent, 0.2, 1.0, DT_S)
    was_sent(axis, position_offset_si=offset_si)

    assert position(axis, 0.2, CSP) == pytest.approx(0.26, abs=0.003)
    for _ in range(300):
        was_sent(axis, position_si=position(axis, 0.2, CSP))
    assert axis.sent.position_si == pytest.approx(0.2, abs=1e-5)


def test_nothing_that_is_not_finite_is_sent():
    assert position(axis_that(shows=CSP, sent=CSP), math.nan, CSP) is None
    assert effort(axis_that(), math.nan, CST) is None


# --- what others ask --------------------------------------------------------------------------


def test_only_a_drive_that_holds_by_itself_has_a_distance_to_where_it_holds():
    held = axis_that(shows=CSP, sent=CSP)
    now_shows(held, joint=AT_REST._replace(position_si=0.21))

    assert targets.loop_distance(held) == pytest.approx(0.01)
    assert targets.loop_distance(axis_that()) == math.inf


@pytest.mark.parametrize(
    ("state", "has_rested", "distance_si"),
    [
        (PowerState.QUICK_STOP_ACTIVE, True, 0.0),
        (PowerState.QUICK_STOP_ACTIVE, False, math.inf),
        (PowerState.QUICK_STOP_ACTIVE, None, math.inf),
        (PowerState.OPERATION_ENABLED, True, math.inf),
        (PowerState.FAULT, True, math.inf),
        (None, True, math.inf),
    ],
)
def test_a_drive_that_rests_after_a_quick_stop_holds_where_it_is(state, has_rested, distance_si):
    axis = axis_that(state=state)
    axis.stop = None if has_rested is None else SimpleNamespace(has_rested=has_rested)
    if state is None:
        now_shows(axis, feedback=None)

    assert targets.loop_distance(axis) == distance_si


def test_a_refused_command_has_no_effort_and_the_last_position():
    axis = axis_that(shows=CSP, sent=CSP)
    was_sent(axis, effort_offset_si=1.0, position_offset_si=0.1, effort_mean_si=5.0)

    sent = targets.without_effort(axis, targets.DriveRequest(CST, True, False, DT_S))

    assert (sent.effort_si, sent.position_si, sent.mode) == (0.0, 0.2, CST)
    assert (sent.effort_offset_si, sent.position_offset_si, sent.effort_mean_si) == (1.0, 0.1, 5.0)


def test_after_a_bring_up_no_effort_was_sent():
    axis = axis_that()

    targets.reset(SimpleNamespace(axes=[axis]))

    assert (axis.sent.effort_si, axis.sent.position_si) == (0.0, 0.2)


def test_speed_and_acceleration_of_the_target_count_where_the_drive_goes_by_it():
    axis = axis_that(shows=CSP, sent=CSP)
    for target_si in (0.19, 0.21555):
        axis.sent = commanded(axis, CSP, target_si)

    assert axis.sent.speed_si == pytest.approx(2.555)
    assert axis.sent.acceleration_si == pytest.approx(355.5)
    now_shows(axis, feedback=axis.sensed.feedback._replace(mode_display=CST))
    axis.sent = commanded(axis, CST, 0.3)
    assert (axis.sent.speed_si, axis.sent.acceleration_si) == (0.0, 0.0)
