"""Every reason to stop, at its limit, just below and just above; the bound on what is sent."""

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from safety_inputs import AXIS, CATEGORIES, FEEDBACK, JOINT, LEG, LIMITS, THRESHOLDS, WELL, harshest

from daemon.core.safety.bounds import bound, bound_position
from daemon.core.safety.checks import (
    EFFORT_MARGIN_RATIO,
    ENABLE_CYCLES,
    FREEZE_DECELERATION_RATIO,
    FROZEN_PUSH_RATIO,
    HELD_RATIO,
    NO_VERDICT,
    OBSERVER_BAD_MAX_CYCLES,
    TX_DROPPED_MAX,
    check,
    worse,
)
from daemon.core.safety.effort_monitor import EffortWatch
from daemon.core.safety.inputs import SafetyInputs
from daemon.core.safety.limits import Categories
from daemon.ipc.record import Cause, StopCategory, Verdict
from drives.signals import Emergency, Input, NmtState, PowerState

EMERGENCY = Emergency(5, 0x8611, 0x21, b"\0" * 5, "following error", 0)


def verdict_of(service=WELL, axis=AXIS, leg=LEG, *, driving=True, categories=CATEGORIES):
    return harshest(service, [axis], [leg], THRESHOLDS, categories, driving=driving)


def with_feedback(**change):
    return AXIS._replace(feedback=FEEDBACK._replace(**change))


def with_joint(**change):
    return AXIS._replace(joint=JOINT._replace(**change))


def test_nothing_wrong_gives_no_verdict():
    assert verdict_of() == NO_VERDICT
    assert verdict_of(driving=False) == NO_VERDICT


@pytest.mark.parametrize(
    ("cause", "change", "harmless"),
    [
        (Cause.STOP_REQUESTED, {"stop_requested": True}, {"stop_requested": False}),
        (Cause.SHUTDOWN, {"shutdown_requested": True}, {"shutdown_requested": False}),
        (Cause.GATEWAY_SILENT, {"gateway_age_cycles": 31}, {"gateway_age_cycles": 30}),
        (Cause.CYCLE_OVERRUN, {"overruns_in_a_row": 3}, {"overruns_in_a_row": 2}),
        (Cause.BUS_OFF, {"bus_off": True}, {"bus_off": False}),
        (Cause.BUS_DOWN, {"bus_error": "gone"}, {"bus_error": ""}),
        (
            Cause.TRANSMIT_QUEUE_FULL,
            {"tx_dropped_in_a_row": TX_DROPPED_MAX},
            {"tx_dropped_in_a_row": TX_DROPPED_MAX - 1},
        ),
    ],
)
def test_the_service_and_its_bus_stop_at_their_limits(cause, change, harmless):
    assert verdict_of(WELL._replace(**change)).cause == cause
    assert verdict_of(WELL._replace(**harmless)) == NO_VERDICT


@pytest.mark.parametrize(
    ("cause", "change"),
    [
        (Cause.HAND_SWITCH_OPEN, {"inputs": Input.STO_RELEASED}),
        (Cause.STO_ACTIVE, {"inputs": Input.HAND_SWITCH_CLOSED}),
        (Cause.DRIVE_REBOOTED, {"rebooted": True}),
        (Cause.HEARTBEAT_LOST, {"heartbeat_age_ns": 100_000_001}),
        (Cause.DRIVE_NOT_OPERATIONAL, {"nmt_state": NmtState.PRE_OPERATIONAL}),
        (Cause.DRIVE_NOT_OPERATIONAL, {"nmt_state": NmtState.STOPPED}),
        (Cause.DRIVE_SILENT, {"sample_age_cycles": 3}),
        (Cause.DRIVE_FAULT, {"power_state": PowerState.FAULT}),
        (Cause.DRIVE_FAULT, {"power_state": PowerState.FAULT_REACTION_ACTIVE}),
        (Cause.DRIVE_LEFT_ENABLED, {"power_state": PowerState.SWITCH_ON_DISABLED}),
        (Cause.TEMPERATURE_LIMIT, {"temperature_degc": 80.1}),
    ],
)
def test_what_a_drive_says_stops_and_names_the_drive(cause, change):
    verdict = verdict_of(axis=with_feedback(**change))

    assert verdict.cause == cause
    assert verdict.drive == "right/hip"


@pytest.mark.parametrize(
    "change",
    [
        {"heartbeat_age_ns": 100_000_000},
        {"sample_age_cycles": 2},
        {"temperature_degc": 80.0},
        {"temperature_degc": None},
        {"nmt_state": NmtState.UNKNOWN},
    ],
)
def test_a_drive_at_its_limit_does_not_stop(change):
    assert verdict_of(axis=with_feedback(**change)) == NO_VERDICT


def test_a_new_emergency_stops_and_names_code_and_text():
    axis = with_feedback(alarm=EMERGENCY, emergency_count=1)._replace(new_emergency=True)

    verdict = verdict_of(axis=axis)

    assert verdict.cause == Cause.EMERGENCY
    assert verdict.detail == "8611h following error"


@pytest.mark.parametrize(
    ("cause", "change"),
    [
        (Cause.POSITION_LIMIT, {"position_si": math.nextafter(LIMITS.position_max_si, 1)}),
        (Cause.POSITION_LIMIT, {"position_si": math.nextafter(LIMITS.position_min_si, -1)}),
        (Cause.VELOCITY_LIMIT, {"velocity_si": 3.01, "effort_si": 0.0}),
        (Cause.VELOCITY_LIMIT, {"velocity_si": -3.01, "effort_si": 0.0}),
        (
            Cause.EFFORT_LIMIT,
            {"effort_si": 60 * EFFORT_MARGIN_RATIO + 0.01, "velocity_si": 0.0},
        ),
        (Cause.POWER_LIMIT, {"effort_si": 40.0, "velocity_si": 2.01}),
        (Cause.ENCODER_JUMP, {"step_si": 0.0451, "velocity_si": 0.0}),
        (Cause.ENCODER_JUMP, {"step_si": -0.0451, "velocity_si": 0.0}),
    ],
)
def test_a_joint_beyond_a_limit_stops(cause, change):
    assert verdict_of(axis=with_joint(**change)).cause == cause


@pytest.mark.parametrize(
    "change",
    [
        {"position_si": LIMITS.position_max_si},
        {"position_si": LIMITS.position_min_si},
        {"velocity_si": 3.0, "effort_si": 0.0},
        {"effort_si": 60 * EFFORT_MARGIN_RATIO, "velocity_si": 0.0},
        {"effort_si": 40.0, "velocity_si": 2.0},
        {"effort_si": -60.0, "velocity_si": 2.9},
        {"step_si": 0.045},
    ],
)
def test_a_joint_at_a_limit_does_not_stop(change):
    assert verdict_of(axis=with_joint(**change)) == NO_VERDICT


@pytest.mark.parametrize("sign", [1, -1])
def test_being_far_from_the_reference_stops(sign):
    assert verdict_of(axis=AXIS._replace(tracking_si=sign * 0.2)) == NO_VERDICT
    assert verdict_of(axis=AXIS._replace(tracking_si=sign * 0.201)).cause == Cause.TRACKING_LIMIT


def test_an_axis_without_a_reference_stops():
    assert verdict_of(axis=AXIS._replace(referenced=False)).cause == Cause.UNREFERENCED


def test_an_encoder_in_error_stops_its_axis_also_while_it_is_prepared():
    preparing = AXIS._replace(referenced=False, preparing=True)
    in_error = preparing._replace(feedback=AXIS.feedback._replace(reference_lost=True))

    assert verdict_of(axis=preparing) == NO_VERDICT
    assert verdict_of(axis=in_error).cause == Cause.UNREFERENCED


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    ("field", "cause"),
    [("position_si", Cause.ENCODER_JUMP), ("effort_si", Cause.EFFORT_DEVIATION)],
)
def test_a_sample_that_is_no_number_stops_and_is_never_told_as_one(field, cause, number):
    verdicts = verdict_of(axis=with_joint(**{field: number}))

    assert verdicts.cause == cause
    assert math.isfinite(verdicts.value)


def test_speed_that_is_lost_at_once_to_the_very_same_count_is_a_frozen_encoder():
    possible = FREEZE_DECELERATION_RATIO * 20.0 * 0.01
    frozen = {"still_cycles": 5, "velocity_si": 0.0}

    assert (
        verdict_of(axis=with_joint(**frozen, speed_before_still_si=possible + 0.01)).cause
        == Cause.ENCODER_FROZEN
    )
    assert verdict_of(axis=with_joint(**frozen, speed_before_still_si=possible)) == NO_VERDICT
    early = with_joint(still_cycles=4, velocity_si=0.0, speed_before_still_si=possible + 0.01)
    assert verdict_of(axis=early) == NO_VERDICT


@pytest.mark.parametrize("sign", [1, -1])
def test_effort_that_changes_without_a_count_is_a_frozen_encoder_or_a_blocked_joint(sign):
    hidden_by_friction = FROZEN_PUSH_RATIO * LIMITS.breakaway_si
    joint = JOINT._replace(still_cycles=20, velocity_si=0.0)
    still = AXIS._replace(joint=joint)

    at_limit = still._replace(watch=EffortWatch(held_si=sign * hidden_by_friction))
    beyond = still._replace(watch=EffortWatch(held_si=sign * (hidden_by_friction + 0.1)))

    assert verdict_of(axis=at_limit) == NO_VERDICT
    assert verdict_of(axis=beyond).cause == Cause.ENCODER_FROZEN


def test_a_patient_who_leans_steadily_on_a_held_leg_is_not_a_frozen_encoder():
    joint = JOINT._replace(still_cycles=500, velocity_si=0.0, effort_si=-50.0)
    watch = EffortWatch(held_si=-50.0, held_before_still_si=-49.0)

    assert verdict_of(axis=AXIS._replace(joint=joint, watch=watch)) == NO_VERDICT


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
        axis = AXIS._replace(feedback=feedback, joint=joint, counts_sign=counts_sign)
        return verdict_of(axis=axis._replace(wanted_velocity_si=wanted_si))

    towards_si = switch * counts_sign * LIMITS.standstill_si_per_s * 1.01
    assert at(towards_si).cause == Cause.LIMIT_SWITCH
    assert at(-towards_si) == NO_VERDICT
    assert at(0.98 * towards_si) == NO_VERDICT
    assert at(0.0) == NO_VERDICT


def test_a_limit_switch_counts_while_driving_and_once_a_sample_has_come():
    feedback = FEEDBACK._replace(inputs=FEEDBACK.inputs | Input.POSITIVE_LIMIT)
    unknown = JOINT._replace(known=False)

    assert verdict_of(axis=AXIS._replace(feedback=feedback), driving=False) == NO_VERDICT
    assert verdict_of(axis=AXIS._replace(feedback=feedback, joint=unknown)) == NO_VERDICT


def leaning(**change):
    """A joint that stands still while its effort has changed by more than friction hides."""
    held_si = FROZEN_PUSH_RATIO * LIMITS.breakaway_si + 1.0
    joint = JOINT._replace(still_cycles=9, velocity_si=0.0)
    return AXIS._replace(joint=joint, watch=EffortWatch(held_si=held_si), **change)


def test_a_patient_who_leans_on_a_leg_that_the_drive_itself_holds_is_not_a_frozen_encoder():
    held_si = 0.9 * HELD_RATIO * LIMITS.tracking_max_si
    off_si = 1.1 * HELD_RATIO * LIMITS.tracking_max_si

    assert verdict_of(axis=leaning(loop_distance_si=held_si)) == NO_VERDICT
    at_si = HELD_RATIO * LIMITS.tracking_max_si
    assert verdict_of(axis=leaning(loop_distance_si=at_si)).cause == Cause.ENCODER_FROZEN
    pushed = leaning(loop_distance_si=off_si)._replace(watch=EffortWatch())
    change_si = FROZEN_PUSH_RATIO * LIMITS.breakaway_si
    for effort_si, cause in ((change_si, Cause.NONE), (change_si + 0.1, Cause.ENCODER_FROZEN)):
        axis = pushed._replace(joint=pushed.joint._replace(effort_si=effort_si))
        assert verdict_of(axis=axis).cause == cause
        assert verdict_of(axis=axis._replace(loop_distance_si=math.inf)) == NO_VERDICT
    assert verdict_of(axis=leaning(loop_distance_si=off_si)).cause == Cause.ENCODER_FROZEN
    assert verdict_of(axis=leaning()).cause == Cause.ENCODER_FROZEN


def test_doubtful_feedback_is_s0():
    assert verdict_of(axis=with_joint(step_si=1.0)).category == StopCategory.S0


@pytest.mark.parametrize(
    ("change", "cause"),
    [({"mode_display": 8}, Cause.MODE_NOT_SHOWN), ({"following": False}, Cause.NOT_FOLLOWING)],
)
def test_a_drive_may_take_its_cycles_to_show_a_mode_and_no_more(change, cause):
    within = with_feedback(**change)._replace(unready_cycles=THRESHOLDS.mode_switch_cycles)
    beyond = with_feedback(**change)._replace(unready_cycles=THRESHOLDS.mode_switch_cycles + 1)

    assert verdict_of(axis=within) == NO_VERDICT
    assert verdict_of(axis=beyond).cause == cause


def test_a_drive_that_never_becomes_enabled_stops_after_its_patience():
    starting = with_feedback(power_state=PowerState.SWITCHED_ON)._replace(
        reached_enabled=False,
        unready_cycles=ENABLE_CYCLES,
    )

    assert verdict_of(axis=starting) == NO_VERDICT
    assert (
        verdict_of(axis=starting._replace(unready_cycles=ENABLE_CYCLES + 1)).cause
        == Cause.DRIVE_LEFT_ENABLED
    )


def test_a_drive_that_nobody_asked_to_be_enabled_may_be_off():
    off = with_feedback(power_state=PowerState.SWITCH_ON_DISABLED)._replace(enable_wanted=False)

    assert verdict_of(axis=off) == NO_VERDICT


def test_a_stale_sample_is_judged_by_its_age_and_not_by_its_numbers():
    stale = AXIS._replace(
        feedback=FEEDBACK._replace(fresh=False, sample_age_cycles=1),
        joint=JOINT._replace(fresh=False, step_si=1.0),
    )

    assert verdict_of(axis=stale) == NO_VERDICT


def test_the_leg_stops_near_its_singularity():
    assert verdict_of(leg=LEG._replace(singularity_ratio=0.15)) == NO_VERDICT
    assert verdict_of(leg=LEG._replace(singularity_ratio=0.149)).cause == Cause.SINGULARITY


def test_an_observer_of_no_use_stops_after_half_a_second():
    within = LEG._replace(observer_bad_cycles=OBSERVER_BAD_MAX_CYCLES)
    beyond = LEG._replace(observer_bad_cycles=OBSERVER_BAD_MAX_CYCLES + 1)

    assert verdict_of(leg=within) == NO_VERDICT
    assert verdict_of(leg=beyond).cause == Cause.OBSERVER_INVALID


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
    service = WELL._replace(tx_dropped_in_a_row=dropped)
    unasked = with_feedback(sample_age_cycles=3)

    verdicts = check(
        SafetyInputs(service, [unasked], [LEG], THRESHOLDS, CATEGORIES, driving=driving)
    )

    assert [verdict.cause for verdict in verdicts] == causes


def test_a_drive_that_says_something_else_is_lost_also_while_our_frames_do_not_leave():
    service = WELL._replace(tx_dropped_in_a_row=TX_DROPPED_MAX)
    rebooted = with_feedback(rebooted=True)

    verdicts = check(SafetyInputs(service, [rebooted], [LEG], THRESHOLDS, CATEGORIES, driving=True))

    assert Cause.DRIVE_REBOOTED in [verdict.cause for verdict in verdicts]


@pytest.mark.parametrize("last", list(Input.HAND_SWITCH_CLOSED | Input.STO_RELEASED))
def test_hand_switch_and_sto_count_also_while_our_frames_do_not_leave(last):
    service = WELL._replace(tx_dropped_in_a_row=TX_DROPPED_MAX)
    axis = with_feedback(inputs=last, sample_age_cycles=3)
    let_go = {
        Input.HAND_SWITCH_CLOSED: Cause.STO_ACTIVE,
        Input.STO_RELEASED: Cause.HAND_SWITCH_OPEN,
    }[last]

    verdicts = check(SafetyInputs(service, [axis], [LEG], THRESHOLDS, CATEGORIES, driving=True))

    assert let_go in [verdict.cause for verdict in verdicts]


def test_of_two_axes_that_fail_in_one_cycle_the_harsher_verdict_comes_first():
    mild = with_feedback(power_state=PowerState.SWITCHED_ON)
    harsh = with_joint(step_si=1.0)._replace(name="right/slide")

    for axes in ([mild, harsh], [harsh, mild]):
        verdicts = check(SafetyInputs(WELL, axes, [LEG], THRESHOLDS, CATEGORIES, driving=True))

        assert [verdict.cause for verdict in verdicts] == [
            Cause.ENCODER_JUMP,
            Cause.DRIVE_LEFT_ENABLED,
        ]


def test_the_harshest_of_several_findings_wins():
    both = AXIS._replace(
        feedback=FEEDBACK._replace(inputs=Input.STO_RELEASED),
        joint=JOINT._replace(step_si=1.0),
    )

    assert verdict_of(axis=both).cause == Cause.ENCODER_JUMP


def test_a_plausible_observer_never_hides_another_stop():
    plausible = LEG._replace(observer_bad_cycles=0)

    for axis in (
        with_feedback(inputs=Input.NONE),
        with_joint(velocity_si=9.0),
        with_feedback(sample_age_cycles=9),
    ):
        assert verdict_of(axis=axis, leg=plausible).cause != Cause.NONE


CAUSES = st.sampled_from(list(StopCategory)).map(lambda c: Verdict(c, Cause.STOP_REQUESTED))


@settings(derandomize=True)
@given(CAUSES, CAUSES)
def test_a_milder_verdict_never_replaces_a_harsher_one(latched, found):
    assert worse(latched, found).category == max(latched.category, found.category)
    if found.category <= latched.category:
        assert worse(latched, found) is latched


def test_the_design_fixes_categories_that_a_file_cannot_weaken():
    weak = Categories({"hand_switch_open": "S2", "velocity_limit": "S2"})

    assert weak.of(Cause.HAND_SWITCH_OPEN) == StopCategory.S1
    assert weak.of(Cause.VELOCITY_LIMIT) == StopCategory.S2
    assert weak.of(Cause.TRACKING_LIMIT) == StopCategory.S1


ANY_FLOAT = st.floats(allow_nan=True, allow_infinity=True)


@settings(derandomize=True)
@given(st.lists(ANY_FLOAT, min_size=1, max_size=30))
def test_what_is_bounded_is_inside_the_limit_and_never_faster_than_the_rate(wishes):
    sent = [0.0]
    for wish in wishes:
        bounded = bound(wish, sent[-1], LIMITS, 0.01)
        if bounded is None:
            assert not math.isfinite(wish)
            break
        assert math.isfinite(wish)
        sent.append(bounded)

    steps = [abs(after - before) for before, after in pairwise(sent)]
    assert all(abs(effort) <= LIMITS.effort_max_si for effort in sent)
    assert all(step <= LIMITS.effort_rate_max_si_per_s * 0.01 * (1 + 1e-9) for step in steps)


def test_a_wish_inside_limit_and_rate_is_sent_as_it_is():
    assert bound(11.0, 10.0, LIMITS, 0.01) == 11.0


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
