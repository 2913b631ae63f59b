"""Which situations stop and which do not, beside the limits of `test_every_limit.py`; bounds."""

import math
from itertools import pairwise

import pytest
from gaitd_names import Cause, StopCategory
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from safety_inputs import AXIS, CATEGORIES, FEEDBACK, JOINT, LEG, LIMITS, THRESHOLDS, WELL, harshest

from daemon.core.safety.bounds import bound_position
from daemon.core.safety.checks import (
    FROZEN_PUSH_RATIO,
    HELD_RATIO,
    NO_VERDICT,
    TX_DROPPED_MAX,
    check_raw,
    worse,
)
from daemon.core.safety.effort_monitor import EffortWatch
from daemon.core.safety.inputs import SafetyInputs
from daemon.core.safety.limits import Categories
from daemon.ipc.record import Verdict
from drives.signals import Emergency, Input, NmtState, PowerState

EMERGENCY = Emergency(5, 0x8611, 0x21, b"\0" * 5, "following error", 0)


def verdict_of(service=WELL, axis=AXIS, leg=LEG, *, driving=True, categories=CATEGORIES):
    return harshest(service, [axis], [leg], THRESHOLDS, categories, driving=driving)


def with_feedback(**change):
    return replace(AXIS, feedback=FEEDBACK._replace(**change))


def with_joint(**change):
    return replace(AXIS, joint=JOINT._replace(**change))


def test_nothing_wrong_gives_no_verdict():
    assert verdict_of() == NO_VERDICT
    assert verdict_of(driving=False) == NO_VERDICT


def test_a_drive_whose_heartbeat_has_not_told_its_state_does_not_stop():
    assert verdict_of(axis=with_feedback(nmt_state=NmtState.UNKNOWN)) == NO_VERDICT


def test_effort_that_brakes_has_no_limit_of_power():
    assert verdict_of(axis=with_joint(effort_si=-60.0, velocity_si=2.9)) == NO_VERDICT


def test_a_patient_who_leans_steadily_on_a_held_leg_is_not_a_frozen_encoder():
    joint = JOINT._replace(still_cycles=500, velocity_si=0.0, effort_si=-50.0)
    watch = EffortWatch(held_si=-50.0, held_before_still_si=-49.0)

    assert verdict_of(axis=replace(AXIS, joint=joint, watch=watch)) == NO_VERDICT


SWITCHES = {-1: Input.NEGATIVE_LIMIT, 1: Input.POSITIVE_LIMIT}


@pytest.mark.parametrize("counts_sign", [1, -1])
@pytest.mark.parametrize("switch", [-1, 1])
@pytest.mark.parametrize("moving", ["joint", "reference"])
def test_a_joint_on_its_limit_switch_stops_towards_it_and_may_move_away(
    switch, counts_sign, moving
):
    """The switch is in the drive's direction; the joint's may be the opposite one."""
    feedback = FEEDBACK._replace(inputs=FEEDBACK.inputs | SWITCHES[switch])

    def at(speed_si):
        joint = JOINT._replace(velocity_si=speed_si if moving == "joint" else 0.0)
        wanted_si = speed_si if moving == "reference" else 0.0
        axis = replace(AXIS, feedback=feedback, joint=joint, counts_sign=counts_sign)
        return verdict_of(axis=replace(axis, wanted_velocity_si=wanted_si))

    towards_si = switch * counts_sign * LIMITS.standstill_si_per_s * 1.01
    assert at(towards_si).cause == Cause.LIMIT_SWITCH
    assert at(-towards_si) == NO_VERDICT
    assert at(0.98 * towards_si) == NO_VERDICT
    assert at(0.0) == NO_VERDICT


def test_a_limit_switch_counts_while_driving_and_once_a_sample_has_come():
    feedback = FEEDBACK._replace(inputs=FEEDBACK.inputs | Input.POSITIVE_LIMIT)
    unknown = JOINT._replace(known=False)

    assert verdict_of(axis=replace(AXIS, feedback=feedback), driving=False) == NO_VERDICT
    assert verdict_of(axis=replace(AXIS, feedback=feedback, joint=unknown)) == NO_VERDICT


def leaning(**change):
    """A joint that stands still while its effort has changed by more than friction hides."""
    held_si = FROZEN_PUSH_RATIO * LIMITS.breakaway_si + 1.0
    joint = JOINT._replace(still_cycles=9, velocity_si=0.0)
    return replace(AXIS, joint=joint, watch=EffortWatch(held_si=held_si), **change)


def test_a_patient_who_leans_on_a_leg_that_the_drive_itself_holds_is_not_a_frozen_encoder():
    held_si = 0.9 * HELD_RATIO * LIMITS.tracking_max_si
    off_si = 1.1 * HELD_RATIO * LIMITS.tracking_max_si

    assert verdict_of(axis=leaning(loop_distance_si=held_si)) == NO_VERDICT
    at_si = HELD_RATIO * LIMITS.tracking_max_si
    assert verdict_of(axis=leaning(loop_distance_si=at_si)).cause == Cause.ENCODER_FROZEN
    pushed = replace(leaning(loop_distance_si=off_si), watch=EffortWatch())
    change_si = FROZEN_PUSH_RATIO * LIMITS.breakaway_si
    for effort_si, cause in ((change_si, Cause.NONE), (change_si + 0.1, Cause.ENCODER_FROZEN)):
        axis = replace(pushed, joint=pushed.joint._replace(effort_si=effort_si))
        assert verdict_of(axis=axis).cause == cause
        assert verdict_of(axis=replace(axis, loop_distance_si=math.inf)) == NO_VERDICT
    assert verdict_of(axis=leaning(loop_distance_si=off_si)).cause == Cause.ENCODER_FROZEN
    assert verdict_of(axis=leaning()).cause == Cause.ENCODER_FROZEN


def test_doubtful_feedback_is_s0():
    assert verdict_of(axis=with_joint(step_si=1.0)).category == StopCategory.S0


def test_a_stale_sample_is_judged_by_its_age_and_not_by_its_numbers():
    stale = replace(
        AXIS,
        feedback=FEEDBACK._replace(fresh=False, sample_age_cycles=1),
        joint=JOINT._replace(fresh=False, step_si=1.0),
    )

    assert verdict_of(axis=stale) == NO_VERDICT


def test_at_rest_only_the_loss_or_the_fault_of_a_drive_counts():
    open_switch = with_feedback(inputs=Input.NONE)
    gone = with_feedback(sample_age_cycles=3)

    assert verdict_of(axis=open_switch, driving=False) == NO_VERDICT
    assert verdict_of(axis=gone, driving=False).cause == Cause.DRIVE_SILENT


@pytest.mark.parametrize(
    ("dropped", "causes"),
    [
        (TX_DROPPED_MAX - 1, [Cause.DRIVE_SILENT]),
        (TX_DROPPED_MAX, [Cause.TRANSMIT_QUEUE_FULL]),
        (TX_DROPPED_MAX + 1, [Cause.TRANSMIT_QUEUE_FULL]),
    ],
)
@pytest.mark.parametrize("driving", [False, True])
def test_a_drive_that_our_frames_do_not_reach_is_not_taken_for_lost(dropped, causes, driving):
    service = replace(WELL, tx_dropped_in_a_row=dropped)
    unasked = with_feedback(sample_age_cycles=3)

    verdicts = check_raw(
        SafetyInputs(service, [unasked], [LEG], THRESHOLDS, CATEGORIES, driving=driving)
    )

    assert [verdict.cause for verdict in verdicts] == causes


def test_a_drive_that_says_something_else_is_lost_also_while_our_frames_do_not_leave():
    service = replace(WELL, tx_dropped_in_a_row=TX_DROPPED_MAX)
    rebooted = with_feedback(rebooted=True)

    verdicts = check_raw(
        SafetyInputs(service, [rebooted], [LEG], THRESHOLDS, CATEGORIES, driving=True)
    )

    assert Cause.DRIVE_REBOOTED in [verdict.cause for verdict in verdicts]


@pytest.mark.parametrize("last", list(Input.HAND_SWITCH_CLOSED | Input.STO_RELEASED))
def test_hand_switch_and_sto_count_also_while_our_frames_do_not_leave(last):
    service = replace(WELL, tx_dropped_in_a_row=TX_DROPPED_MAX)
    axis = with_feedback(inputs=last, sample_age_cycles=3)
    let_go = {
        Input.HAND_SWITCH_CLOSED: Cause.STO_ACTIVE,
        Input.STO_RELEASED: Cause.HAND_SWITCH_OPEN,
    }[last]

    verdicts = check_raw(SafetyInputs(service, [axis], [LEG], THRESHOLDS, CATEGORIES, driving=True))

    assert let_go in [verdict.cause for verdict in verdicts]


def test_of_two_axes_that_fail_in_one_cycle_the_harsher_verdict_comes_first():
    mild = with_feedback(power_state=PowerState.SWITCHED_ON)
    harsh = replace(with_joint(step_si=1.0), name="right/slide")

    for axes in ([mild, harsh], [harsh, mild]):
        verdicts = check_raw(SafetyInputs(WELL, axes, [LEG], THRESHOLDS, CATEGORIES, driving=True))

        assert [verdict.cause for verdict in verdicts] == [
            Cause.ENCODER_JUMP,
            Cause.DRIVE_LEFT_ENABLED,
        ]


def test_the_harshest_of_several_findings_wins():
    both = replace(
        AXIS,
        feedback=FEEDBACK._replace(inputs=Input.STO_RELEASED),
        joint=JOINT._replace(step_si=1.0),
    )

    assert verdict_of(axis=both).cause == Cause.ENCODER_JUMP


def test_a_plausible_observer_never_hides_another_stop():
    for axis in (
        with_feedback(inputs=Input.NONE),
        with_joint(velocity_si=9.0),
        with_feedback(sample_age_cycles=9),
    ):
        assert verdict_of(axis=axis).cause != Cause.NONE


CAUSES = st.sampled_from(list(StopCategory)).map(lambda c: Verdict(c, Cause.STOP_REQUESTED))


@settings(derandomize=True)
@given(CAUSES, CAUSES)
def test_a_milder_verdict_never_replaces_a_harsher_one(latched, found):
    assert worse(latched, found).category == max(
        latched.category, found.category, key=lambda one: one.severity
    )
    if found.category.severity <= latched.category.severity:
        assert worse(latched, found) is latched


def test_the_design_fixes_categories_that_a_file_cannot_weaken():
    weak = Categories({"hand_switch_open": "S2", "velocity_limit": "S2"})

    assert weak.of(Cause.HAND_SWITCH_OPEN) == StopCategory.S1
    assert weak.of(Cause.VELOCITY_LIMIT) == StopCategory.S2
    assert weak.of(Cause.TRACKING_LIMIT) == StopCategory.S1


positions_si = st.floats(-2.0, 2.0)
inside_si = st.floats(LIMITS.position_min_si, LIMITS.position_max_si)


@settings(derandomize=True, deadline=None)
@given(start=inside_si, wishes=st.lists(positions_si, min_size=1, max_size=60))
def test_a_target_position_never_leaves_the_range_nor_runs_faster_than_the_axis_may(start, wishes):
    sent = [start]
    for wish in wishes:
        target_si = bound_position(wish, sent[-1], LIMITS, 0.01)
        assert target_si is not None
        sent.append(target_si)

    step_si = LIMITS.velocity_max_si * 0.01
    soft_min_si = LIMITS.position_min_si + LIMITS.soft_margin_si
    soft_max_si = LIMITS.position_max_si - LIMITS.soft_margin_si
    for before, after in pairwise(sent):
        assert abs(after - before) <= step_si * (1 + 1e-9)
        assert min(before, soft_min_si) <= after <= max(before, soft_max_si)
    assert all(LIMITS.position_min_si <= one <= LIMITS.position_max_si for one in sent)


def test_a_leg_that_stands_in_the_soft_margin_is_held_there_and_not_pulled_out_of_it():
    edge_si = LIMITS.position_max_si - 0.1 * LIMITS.soft_margin_si

    assert bound_position(edge_si, edge_si, LIMITS, 0.01) == edge_si
    assert bound_position(edge_si + 0.001, edge_si, LIMITS, 0.01) == edge_si
    assert bound_position(edge_si - 0.001, edge_si, LIMITS, 0.01) == edge_si - 0.001


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_a_position_that_is_not_finite_is_never_sent(number):
    assert bound_position(number, 0.0, LIMITS, 0.01) is None
    assert bound_position(0.0, number, LIMITS, 0.01) is None
