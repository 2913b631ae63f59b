"""Every limit that a joint or a leg can pass: nothing just below and at it, a stop just above.

One table over all causes. What it leaves out has no number to be at: a proof that nothing is
forgotten is the last test.
"""

import math

import pytest
from gaitd_names import Cause, Finding
from msgspec.structs import replace
from safety_inputs import (
    AXIS,
    CATEGORIES,
    ESTIMATE,
    FEEDBACK,
    JOINT,
    LEG,
    LIMITS,
    PATIENT,
    THRESHOLDS,
    WELL,
    harshest,
)

from daemon.core.safety.checks import (
    AGAINST_DRIVE_MAX_CYCLES,
    EFFORT_MARGIN_RATIO,
    ENABLE_CYCLES,
    FREEZE_DECELERATION_RATIO,
    FROZEN_PUSH_RATIO,
    NO_VERDICT,
    OBSERVER_BAD_MAX_CYCLES,
    TX_DROPPED_MAX,
)
from daemon.core.safety.effort_monitor import EffortWatch
from drives.signals import Input, PowerState

STANDING = replace(AXIS, joint=JOINT._replace(velocity_si=0.0, effort_si=0.0))


def joint(**change):
    return lambda value: replace(
        STANDING,
        joint=STANDING.joint._replace(**{key: sign * value for key, sign in change.items()}),
    )


def axis(name, sign=1):
    return lambda value: replace(STANDING, **{name: sign * value})


def feedback(name):
    return lambda value: replace(AXIS, feedback=FEEDBACK._replace(**{name: value}))


def service(name):
    return lambda value: replace(WELL, **{name: value})


def leg(name):
    return lambda value: replace(LEG, **{name: value})


def estimate(name):
    return lambda value: replace(ESTIMATE, **{name: value})


def patient(name):
    return lambda value: replace(ESTIMATE, axes=(replace(PATIENT, **{name: value}),))


def power(value):
    return replace(AXIS, joint=JOINT._replace(effort_si=40.0, velocity_si=value / 40.0))


def speed_lost(value):
    still = JOINT._replace(
        still_cycles=THRESHOLDS.encoder_frozen_cycles, speed_before_still_si=value
    )
    return replace(AXIS, joint=still._replace(velocity_si=0.0))


def held(sign):
    def with_change(value):
        still = JOINT._replace(still_cycles=20, velocity_si=0.0)
        return replace(AXIS, joint=still, watch=EffortWatch(held_si=sign * value))

    return with_change


def opposed(cycles):
    return replace(AXIS, watch=EffortWatch(sign_mismatch_si=25.0, sign_mismatch_cycles=cycles))


def against_its_drive(cycles):
    shown = EffortWatch(sign_mismatch_si=25.0, sign_mismatch_cycles=cycles, response_ratio=0.1)
    return replace(AXIS, watch=shown)


def unmet(cycles):
    return replace(AXIS, watch=EffortWatch(gap_si=9.0, gap_cycles=cycles))


def unready(**change):
    fed = replace(AXIS, feedback=FEEDBACK._replace(**change))
    return lambda value: replace(fed, unready_cycles=value)


def starting(value):
    off = replace(AXIS, feedback=FEEDBACK._replace(power_state=PowerState.SWITCHED_ON))
    return replace(off, reached_enabled=False, unready_cycles=value)


def on_switch(value):
    inputs = FEEDBACK.inputs | Input.POSITIVE_LIMIT
    towards = STANDING.joint._replace(velocity_si=value)
    return replace(AXIS, feedback=FEEDBACK._replace(inputs=inputs), joint=towards)


L, T = LIMITS, THRESHOLDS
REACH_SI = T.encoder_jump_ratio * L.velocity_max_si * JOINT.elapsed_s
FREEZE_SI = FREEZE_DECELERATION_RATIO * L.quick_stop_deceleration_si_per_s2 * JOINT.elapsed_s
PUSH_SI = FROZEN_PUSH_RATIO * L.breakaway_si
EFFORT_SI = L.effort_max_si * EFFORT_MARGIN_RATIO
UP, DOWN = 1, -1
ONE = 1
"""A limit that is counted: the next number is one more."""

TABLE = [
    # cause, what is made of a value, the last value that is well, which way is worse, by how much
    (Cause.GATEWAY_SILENT, service("gateway_age_cycles"), T.gateway_silence_cycles, UP, ONE),
    (Cause.CYCLE_OVERRUN, service("overruns_in_a_row"), T.overruns_in_a_row - 1, UP, ONE),
    (Cause.TRANSMIT_QUEUE_FULL, service("tx_dropped_in_a_row"), TX_DROPPED_MAX - 1, UP, ONE),
    (Cause.DRIVE_SILENT, feedback("sample_age_cycles"), T.sample_age_max_cycles, UP, ONE),
    (Cause.HEARTBEAT_LOST, feedback("heartbeat_age_ns"), T.heartbeat_timeout_ns, UP, ONE),
    (Cause.DRIVE_LEFT_ENABLED, starting, ENABLE_CYCLES, UP, ONE),
    (Cause.UNEXPECTED_ENABLE, axis("unexpected_enable_cycles"), ENABLE_CYCLES, UP, ONE),
    (Cause.MODE_NOT_SHOWN, unready(mode_display=8), T.mode_switch_cycles, UP, ONE),
    (Cause.NOT_FOLLOWING, unready(following=False), T.mode_switch_cycles, UP, ONE),
    (Cause.ENCODER_JUMP, joint(step_si=1), REACH_SI, UP, None),
    (Cause.ENCODER_JUMP, joint(step_si=-1), REACH_SI, UP, None),
    (Cause.ENCODER_FROZEN, speed_lost, FREEZE_SI, UP, None),
    (Cause.ENCODER_FROZEN, held(1), PUSH_SI, UP, None),
    (Cause.ENCODER_FROZEN, held(-1), PUSH_SI, UP, None),
    (Cause.SIGN_WRONG, opposed, T.sign_mismatch_cycles - 1, UP, ONE),
    (Cause.MOVED_AGAINST_DRIVE, against_its_drive, AGAINST_DRIVE_MAX_CYCLES, UP, ONE),
    (Cause.EFFORT_DEVIATION, unmet, T.deviation_cycles - 1, UP, ONE),
    (Cause.EFFORT_DEVIATION, axis("stride_drift_si"), L.load_deviation_max_si, UP, None),
    (Cause.EFFORT_DEVIATION, axis("stride_drift_si", -1), L.load_deviation_max_si, UP, None),
    (Cause.POSITION_LIMIT, joint(position_si=1), L.position_max_si, UP, None),
    (Cause.POSITION_LIMIT, joint(position_si=1), L.position_min_si, DOWN, None),
    (Cause.STOPPING_PATH, axis("stopping_end_si"), L.position_max_si, UP, None),
    (Cause.STOPPING_PATH, axis("stopping_end_si"), L.position_min_si, DOWN, None),
    (Cause.STOPPING_PATH, leg("stopping_ratio"), T.singularity_stop_ratio, DOWN, None),
    (Cause.SINGULARITY, leg("singularity_ratio"), T.singularity_stop_ratio, DOWN, None),
    (Cause.VELOCITY_LIMIT, joint(velocity_si=1), L.velocity_max_si, UP, None),
    (Cause.VELOCITY_LIMIT, joint(velocity_si=-1), L.velocity_max_si, UP, None),
    (Cause.EFFORT_LIMIT, joint(effort_si=1), EFFORT_SI, UP, None),
    (Cause.EFFORT_LIMIT, joint(effort_si=-1), EFFORT_SI, UP, None),
    (Cause.POWER_LIMIT, power, L.power_max_w, UP, None),
    (Cause.ENERGY_LIMIT, axis("stride_energy_j"), L.stride_energy_max_j, UP, None),
    (Cause.TRACKING_LIMIT, axis("tracking_si"), L.tracking_max_si, UP, None),
    (Cause.TRACKING_LIMIT, axis("tracking_si", -1), L.tracking_max_si, UP, None),
    (Cause.TEMPERATURE_LIMIT, feedback("temperature_degc"), L.temperature_max_degc, UP, None),
    (Cause.LIMIT_SWITCH, on_switch, L.standstill_si_per_s, UP, None),
    (Cause.OBSERVER_INVALID, estimate("observer_bad_cycles"), OBSERVER_BAD_MAX_CYCLES, UP, ONE),
    (Cause.SPASM, patient("spasm_cycles"), T.spasm_patience_cycles, UP, ONE),
    (Cause.CLONUS, patient("clonus_cycles"), T.clonus_patience_cycles, UP, ONE),
]
WITHOUT_A_NUMBER = {
    # a request, a switch, a drive's own message
    Cause.STOP_REQUESTED,
    Cause.SHUTDOWN,
    Cause.COMMAND_NOT_FINITE,
    Cause.HAND_SWITCH_OPEN,
    Cause.STO_ACTIVE,
    Cause.INPUTS_IMPOSSIBLE,
    Cause.BUS_DOWN,
    Cause.BUS_OFF,
    Cause.DRIVE_REBOOTED,
    Cause.DRIVE_NOT_OPERATIONAL,
    Cause.DRIVE_FAULT,
    Cause.EMERGENCY,
    Cause.UNREFERENCED,
}
JUDGED_ELSEWHERE = {
    # before anything is driven, and after a stop was asked for
    Cause.NONE,
    Cause.BRING_UP_FAILED,
    Cause.DRIVE_POWERED,
    Cause.LAST_END_UNKNOWN,
    Cause.STATIC_LOAD_WRONG,
    Cause.SELF_TEST_FAILED,
    Cause.STOP_NOT_OBEYED,
}


def cause_of(situation):
    given = {"service": WELL, "axis": AXIS, "leg": LEG, "legestimate": ESTIMATE}
    given[type(situation).__name__.removesuffix("Inputs").lower()] = situation
    verdicts = harshest(
        *(given["service"], [given["axis"]], [given["leg"]], THRESHOLDS, CATEGORIES),
        driving=True,
        estimates=[given["legestimate"]],
    )
    assert verdicts.cause != Cause.NONE or verdicts == NO_VERDICT
    return verdicts.cause


NAMES = [f"{row[0]}-{number}" for number, row in enumerate(TABLE)]


def beside(value, way, step):
    return value + way * step if step else math.nextafter(value, way * math.inf)


@pytest.mark.parametrize(("cause", "made_of", "limit", "worse", "step"), TABLE, ids=NAMES)
def test_a_value_at_its_limit_or_just_below_does_not_stop(cause, made_of, limit, worse, step):
    assert cause_of(made_of(limit)) == Cause.NONE
    assert cause_of(made_of(beside(limit, -worse, step))) == Cause.NONE


@pytest.mark.parametrize(("cause", "made_of", "limit", "worse", "step"), TABLE, ids=NAMES)
def test_a_value_just_above_its_limit_stops_and_says_which(cause, made_of, limit, worse, step):
    above = beside(limit, worse, step)
    if step is None:  # of two numbers the product may round: the second next is beyond
        above = beside(above, worse, step)

    assert cause_of(made_of(above)) == cause


def test_no_cause_is_left_out_of_the_table():
    in_table = {row[0] for row in TABLE}

    assert in_table | WITHOUT_A_NUMBER | JUDGED_ELSEWHERE == set(Cause)
    assert not in_table & (WITHOUT_A_NUMBER | JUDGED_ELSEWHERE)


def test_a_leg_that_is_out_of_its_range_is_not_called_too_fast_as_well():
    out = STANDING.joint._replace(position_si=L.position_max_si + 0.01)

    assert cause_of(replace(AXIS, joint=out, stopping_end_si=9.0)) == Cause.POSITION_LIMIT


def test_an_axis_that_does_not_know_where_it_is_has_no_stopping_path():
    lost = replace(AXIS, homing=True, stopping_end_si=9.0)

    assert cause_of(lost) == Cause.NONE


def test_a_drive_that_shows_torque_without_power_stops_also_at_rest():
    showing = replace(
        AXIS, watch=EffortWatch(gap_si=9.0, gap_cycles=T.deviation_cycles, unpowered_cycles=20)
    )

    verdicts = harshest(WELL, [showing], [LEG], THRESHOLDS, CATEGORIES, driving=False)

    assert (verdicts.cause, verdicts.finding) == (
        Cause.EFFORT_DEVIATION,
        Finding.EFFORT_WITHOUT_POWER,
    )
