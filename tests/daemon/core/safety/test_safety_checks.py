"""What a verdict tells, which of several is told, and who is exempt from what and why."""

import math

import msgspec
import pytest
from gaitd_names import Cause, Finding, StopCategory
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

from daemon.core.safety.bounds import bound, bound_assist, bound_position
from daemon.core.safety.checks import (
    AGAINST_DRIVE_MAX_CYCLES,
    NO_VERDICT,
    OBSERVER_BAD_MAX_CYCLES,
)
from daemon.core.safety.effort_monitor import EffortWatch
from daemon.core.safety.limits import Categories
from daemon.core.safety.sign_response import RIGHT_MAX_RATIO, UNCLEAR_MAX_RATIO
from daemon.wire.causes import CHOSEN_CATEGORY
from drives.signals import Emergency, Input, NmtState, OperationMode, PowerState

EMERGENCY = Emergency(5, 0x8611, 0x21, b"\0" * 5, "following error", 0)
LOW_CODE = Emergency(5, 0x0100, 0x21, b"\0" * 5, "something", 0)


def verdict_of(
    service=WELL,
    axes=(AXIS,),
    legs=(LEG,),
    *,
    driving=True,
    categories=CATEGORIES,
    estimates=(ESTIMATE,),
):
    inputs = service, axes, legs, THRESHOLDS, categories
    return harshest(*inputs, driving=driving, estimates=estimates)


def told(*, driving=True, **where):
    verdict = verdict_of(**where, driving=driving)
    return verdict.cause, verdict.drive, verdict.value, verdict.limit, verdict.finding


def emcy_of(axis):
    """Code and text of the drive's message by which a verdict was found."""
    verdict = verdict_of(axes=[axis])
    assert verdict.finding is Finding.EMCY
    return verdict.value, verdict.said


def against_its_drive(cycles, response_ratio=0.1, patient_si=60.0):
    watch = EffortWatch(
        sign_mismatch_si=25.5,
        sign_mismatch_cycles=cycles,
        patient_si=patient_si,
        response_ratio=response_ratio,
    )
    return replace(AXIS, watch=watch)


def fed(axis=AXIS, **change):
    return replace(axis, feedback=axis.feedback._replace(**change))


def moved(axis=AXIS, **change):
    return replace(axis, joint=axis.joint._replace(**change))


# --- what a verdict tells -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"stop_requested": True}, (Cause.STOP_REQUESTED, 0, 0, Finding.NONE)),
        ({"shutdown_requested": True}, (Cause.SHUTDOWN, 0, 0, Finding.NONE)),
        ({"gateway_age_cycles": 31}, (Cause.GATEWAY_SILENT, 31, 30, Finding.CYCLES)),
        ({"overruns_in_a_row": 4}, (Cause.CYCLE_OVERRUN, 4, 3, Finding.MISSED_CYCLES)),
        ({"bus_error": "can0: gone"}, (Cause.BUS_DOWN, 0, 0, Finding.NONE)),
        ({"bus_off": True}, (Cause.BUS_OFF, 0, 0, Finding.CONTROLLER_OFF)),
        (
            {"tx_dropped_in_a_row": 4},
            (Cause.TRANSMIT_QUEUE_FULL, 4, 3, Finding.CYCLES_NOT_ALL_SENT),
        ),
    ],
)
def test_a_stop_of_the_service_is_told_with_value_limit_and_unit_and_blames_no_drive(
    change, expected
):
    cause, *numbers = expected

    assert told(service=replace(WELL, **change)) == (cause, "", *numbers)


def test_an_error_of_the_bus_is_told_as_the_kernel_says_it():
    assert verdict_of(service=replace(WELL, bus_error="can0: gone")).said == "can0: gone"
    assert verdict_of(service=replace(WELL, bus_off=True)).said == ""


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"inputs": Input.STO_RELEASED}, (Cause.HAND_SWITCH_OPEN, 0, 1, Finding.NONE)),
        ({"inputs": Input.HAND_SWITCH_CLOSED}, (Cause.STO_ACTIVE, 0, 1, Finding.NONE)),
        ({"rebooted": True}, (Cause.DRIVE_REBOOTED, 0, 0, Finding.BOOT_UP_MESSAGE)),
        (
            {"heartbeat_age_ns": 250_000_000},
            (Cause.HEARTBEAT_LOST, 250, 100, Finding.HEARTBEAT_AGE_MS),
        ),
        (
            {"nmt_state": NmtState.STOPPED},
            (Cause.DRIVE_NOT_OPERATIONAL, NmtState.STOPPED, 0, Finding.NMT_STATE),
        ),
        (
            {"nmt_state": NmtState.PRE_OPERATIONAL},
            (Cause.DRIVE_NOT_OPERATIONAL, NmtState.PRE_OPERATIONAL, 0, Finding.NMT_STATE),
        ),
        (
            {"sample_age_cycles": 4},
            (Cause.DRIVE_SILENT, 4, 2, Finding.CYCLES_WITHOUT_SAMPLE),
        ),
        ({"power_state": PowerState.FAULT}, (Cause.DRIVE_FAULT, 0, 0, Finding.NO_EMCY)),
        (
            {"power_state": PowerState.FAULT, "emergency": EMERGENCY},
            (Cause.DRIVE_FAULT, 0x8611, 0, Finding.EMCY),
        ),
        (
            {"power_state": PowerState.FAULT, "emergency": LOW_CODE},
            (Cause.DRIVE_FAULT, 0x0100, 0, Finding.EMCY),
        ),
        (
            {"power_state": PowerState.FAULT, "error_code": 0x2310},
            (Cause.DRIVE_FAULT, 0x2310, 0, Finding.ERROR_CODE),
        ),
        (
            {"power_state": PowerState.FAULT, "error_code": 0x2310, "emergency": EMERGENCY},
            (Cause.DRIVE_FAULT, 0x8611, 0, Finding.EMCY),
        ),
        (
            {"power_state": PowerState.SWITCHED_ON},
            (Cause.DRIVE_LEFT_ENABLED, PowerState.SWITCHED_ON, 0, Finding.POWER_STATE),
        ),
        ({"temperature_degc": 91.5}, (Cause.TEMPERATURE_LIMIT, 91.5, 80, Finding.TEMPERATURE_DEGC)),
    ],
)
def test_what_a_drive_says_is_told_with_value_limit_and_unit(change, expected):
    cause, value, limit, finding = expected

    got = told(axes=[fed(**change)])

    assert got[:2] == (cause, "right/hip")
    assert got[2] == pytest.approx(value)
    assert got[3] == pytest.approx(limit)
    assert got[4] == finding


def test_a_fault_without_an_emcy_is_told_as_bring_up_found_it():
    axis = replace(fed(power_state=PowerState.FAULT), bring_up_error=(0x2310, "overcurrent"))

    found = verdict_of(axes=[axis])
    assert (found.finding, found.value, found.said) == (Finding.ERROR_CODE, 0x2310, "overcurrent")
    silent = verdict_of(axes=[fed(power_state=PowerState.FAULT)])
    assert (silent.finding, silent.value, silent.said) == (Finding.NO_EMCY, 0, "")
    assert emcy_of(fed(axis, emergency=EMERGENCY)) == (0x8611, "following error")


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (
            {"position_si": 0.75},
            (Cause.POSITION_LIMIT, 0.75, LIMITS.position_max_si, Finding.ABOVE),
        ),
        (
            {"position_si": -0.35},
            (Cause.POSITION_LIMIT, -0.35, LIMITS.position_min_si, Finding.BELOW),
        ),
        ({"velocity_si": -3.5, "effort_si": 0.0}, (Cause.VELOCITY_LIMIT, 3.5, 3.0, Finding.NONE)),
        ({"effort_si": -70.0, "velocity_si": 0.0}, (Cause.EFFORT_LIMIT, 70.0, 66.0, Finding.NONE)),
        ({"effort_si": -50.0, "velocity_si": -2.0}, (Cause.POWER_LIMIT, 100.0, 80.0, Finding.NONE)),
        ({"step_si": -0.06}, (Cause.ENCODER_JUMP, 0.06, 0.045, Finding.STEP_BETWEEN_SAMPLES)),
    ],
)
def test_what_a_joint_does_is_told_with_value_limit_and_unit(change, expected):
    cause, value, limit, finding = expected

    got = told(axes=[moved(**change)])

    assert got[:2] == (cause, "right/hip")
    assert got[2] == pytest.approx(value)
    assert got[3] == pytest.approx(limit)
    assert got[4] == finding


def test_each_other_cause_is_told_with_its_value_and_its_limit():
    tracking = replace(AXIS, tracking_si=-0.25)
    unreferenced = replace(AXIS, referenced=False)
    unasked = replace(AXIS, enable_wanted=False, unexpected_enable_cycles=26)
    mode = fed(replace(AXIS, unready_cycles=6), mode_display=OperationMode.CYCLIC_SYNC_POSITION)
    ignoring = fed(replace(AXIS, unready_cycles=6), following=False)
    emergency = replace(fed(emergency=EMERGENCY, alarm=EMERGENCY), new_emergency=True)
    stretched = replace(LEG, singularity_ratio=0.1)
    blind = replace(ESTIMATE, observer_bad_cycles=51)

    hip = "right/hip"
    assert told(axes=[tracking]) == (Cause.TRACKING_LIMIT, hip, 0.25, 0.2, Finding.NONE)
    assert told(axes=[unreferenced]) == (Cause.UNREFERENCED, hip, 0.0, 1.0, Finding.NONE)
    assert told(axes=[unasked]) == (Cause.UNEXPECTED_ENABLE, hip, 26.0, 25.0, Finding.CYCLES)
    assert told(axes=[mode]) == (
        *(Cause.MODE_NOT_SHOWN, hip),
        *(float(OperationMode.CYCLIC_SYNC_POSITION), float(OperationMode.CYCLIC_SYNC_TORQUE)),
        Finding.MODE_DISPLAY,
    )
    assert told(axes=[ignoring]) == (Cause.NOT_FOLLOWING, hip, 0.0, 1.0, Finding.NOT_FOLLOWING_BIT)
    assert told(axes=[emergency]) == (Cause.EMERGENCY, hip, 0x8611, 0.0, Finding.EMCY)
    angle, cycles = Finding.ANGLE_OF_SHOE, Finding.CYCLES_WITHOUT_ESTIMATE
    assert told(legs=[stretched]) == (Cause.SINGULARITY, "right", 0.1, 0.15, angle)
    assert told(estimates=[blind]) == (Cause.OBSERVER_INVALID, "right", 51.0, 50.0, cycles)


def test_an_emergency_is_told_with_its_code_and_what_the_drive_calls_it():
    assert emcy_of(replace(fed(alarm=LOW_CODE), new_emergency=True)) == (0x0100, "something")


@pytest.mark.parametrize(
    ("switch", "sign", "finding"),
    [
        (Input.NEGATIVE_LIMIT, -1, Finding.NEGATIVE_SWITCH),
        (Input.POSITIVE_LIMIT, 1, Finding.POSITIVE_SWITCH),
    ],
)
def test_a_limit_switch_is_told_with_the_speed_towards_it(switch, sign, finding):
    axis = fed(moved(velocity_si=0.5 * sign), inputs=FEEDBACK.inputs | switch)

    assert told(axes=[axis]) == (
        Cause.LIMIT_SWITCH,
        "right/hip",
        0.5,
        LIMITS.standstill_si_per_s,
        finding,
    )


def test_at_the_speed_of_standstill_a_joint_stands_on_its_limit_switch():
    axis = fed(moved(velocity_si=LIMITS.standstill_si_per_s), inputs=FEEDBACK.inputs | SWITCH)

    assert verdict_of(axes=[axis]) == NO_VERDICT


SWITCH = Input.POSITIVE_LIMIT


def test_speed_lost_at_once_is_told_with_what_a_joint_could_have_lost():
    axis = moved(still_cycles=5, velocity_si=0.0, speed_before_still_si=0.7)
    cause, _, value, limit, finding = told(axes=[axis])

    assert (cause, value, finding) == (Cause.ENCODER_FROZEN, 0.7, Finding.SPEED_LOST)
    assert limit == pytest.approx(0.6)  # three quick stops of 20 rad/s² for 10 ms


def standing(**change):
    """A joint without a count for long, under an effort that was 0 when it came to stand."""
    watch = EffortWatch(**{"effort_before_still_si": 10.0, **change})
    return moved(replace(AXIS, watch=watch), still_cycles=20, velocity_si=0.0)


@pytest.mark.parametrize("still_cycles", [0, 1, 4])
def test_a_joint_that_has_given_a_count_lately_may_have_any_effort(still_cycles):
    moving = replace(standing(held_si=-30.0), joint=JOINT._replace(still_cycles=still_cycles))

    assert verdict_of(axes=[moving]) == NO_VERDICT


def test_a_homing_that_meets_its_stop_loses_its_speed_at_once():
    assert (
        verdict_of(axes=[moved(HOMING, still_cycles=5, velocity_si=0.0, speed_before_still_si=9.0)])
        == NO_VERDICT
    )


def test_effort_without_a_count_is_told_with_what_friction_could_have_held():
    assert told(axes=[standing(held_si=-30.0)]) == (
        Cause.ENCODER_FROZEN,
        "right/hip",
        30.0,
        3.0 * LIMITS.breakaway_si,
        Finding.EFFORT_WITHOUT_MOTION,
    )


def test_without_a_sample_no_encoder_counts_as_frozen():
    missing = moved(standing(held_si=-30.0), fresh=False)
    first = moved(standing(held_si=-30.0), elapsed_s=0.0)

    assert verdict_of(axes=[missing]) == verdict_of(axes=[first]) == NO_VERDICT


def test_the_whole_effort_of_a_drive_that_has_lost_its_joint_counts_and_of_no_other():
    """Where effort is what we command, the load may change it as it likes."""
    loaded = moved(standing(effort_before_still_si=-20.0), effort_si=12.0)
    held_off = replace(loaded, loop_distance_si=LIMITS.tracking_max_si / 2)
    held_near = replace(loaded, loop_distance_si=LIMITS.tracking_max_si / 20)

    assert verdict_of(axes=[loaded]) == NO_VERDICT
    assert verdict_of(axes=[held_near]) == NO_VERDICT
    assert told(axes=[held_off])[:3] == (Cause.ENCODER_FROZEN, "right/hip", 32.0)
    both = replace(held_off, watch=replace(held_off.watch, held_si=40.0))
    assert told(axes=[both])[2] == 40.0


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    ("key", "cause", "finding"),
    [
        ("position_si", Cause.ENCODER_JUMP, Finding.POSITION_NOT_FINITE),
        ("effort_si", Cause.EFFORT_DEVIATION, Finding.EFFORT_NOT_FINITE),
    ],
)
def test_what_is_no_number_is_a_finding_by_itself(key, cause, finding, number):
    """It would pass every comparison as if it were inside."""
    verdicts = told(axes=[moved(**{key: number})])

    assert verdicts == (cause, "right/hip", 0.0, 0.0, finding)


def test_an_encoder_that_lost_its_reference_is_doubted_also_while_it_is_prepared():
    lost = fed(replace(AXIS, preparing=True), reference_lost=True)

    assert verdict_of(axes=[lost]).cause == Cause.UNREFERENCED
    assert verdict_of(axes=[fed(lost, rebooted=True)]).cause == Cause.DRIVE_REBOOTED


# --- which of several is told ---------------------------------------------------------------------


def test_of_equal_stops_the_one_that_a_person_made_is_told():
    axis = fed(moved(velocity_si=9.0), inputs=Input.STO_RELEASED)

    assert verdict_of(axes=[axis]).cause == Cause.HAND_SWITCH_OPEN


def test_of_equal_stops_that_of_the_service_is_told_before_that_of_an_axis():
    requested = replace(WELL, stop_requested=True)

    assert verdict_of(requested, axes=[moved(velocity_si=9.0)]).cause == Cause.STOP_REQUESTED


def test_of_equal_stops_that_of_the_first_axis_is_told_and_that_of_a_leg_last():
    first = replace(moved(velocity_si=9.0), name="right/hip")
    second = replace(moved(velocity_si=9.0), name="right/slide")
    stretched = replace(LEG, singularity_ratio=0.0)

    assert verdict_of(axes=[first, second]).drive == "right/hip"
    assert verdict_of(axes=[second, first], legs=[stretched]).drive == "right/slide"


def test_a_finding_of_the_second_axis_or_leg_alone_is_found():
    second = replace(moved(velocity_si=9.0), name="left/hip")
    stretched = replace(LEG, name="left", singularity_ratio=0.0)

    assert verdict_of(axes=[AXIS, second]).drive == "left/hip"
    assert verdict_of(legs=[LEG, stretched]).drive == "left"


@pytest.mark.parametrize(
    ("worse_one", "milder", "cause"),
    [
        ({"rebooted": True}, {"heartbeat_age_ns": 10**9}, Cause.DRIVE_REBOOTED),
        ({"heartbeat_age_ns": 10**9}, {"nmt_state": NmtState.STOPPED}, Cause.HEARTBEAT_LOST),
        ({"nmt_state": NmtState.STOPPED}, {"sample_age_cycles": 9}, Cause.DRIVE_NOT_OPERATIONAL),
    ],
)
def test_a_drive_is_lost_for_the_first_of_its_reasons(worse_one, milder, cause):
    """Each explains those behind it: who has rebooted beats no more, and sends no samples."""
    assert verdict_of(axes=[fed(**worse_one, **milder)]).cause == cause


# --- when what counts -----------------------------------------------------------------------------


@pytest.mark.parametrize("change", [{"bus_error": "gone"}, {"bus_off": True}])
def test_a_bus_that_is_gone_counts_at_rest_too(change):
    assert verdict_of(replace(WELL, **change), driving=False) != NO_VERDICT


def test_frames_that_cannot_be_sent_count_from_the_third_cycle_on_also_at_rest():
    assert verdict_of(replace(WELL, tx_dropped_in_a_row=3), driving=False) != NO_VERDICT
    assert verdict_of(replace(WELL, tx_dropped_in_a_row=2), driving=False) == NO_VERDICT


@pytest.mark.parametrize(
    "change",
    [
        {"stop_requested": True},
        {"shutdown_requested": True},
        {"gateway_age_cycles": 99},
        {"overruns_in_a_row": 99},
    ],
)
def test_where_nothing_moves_there_is_nothing_of_the_service_to_stop(change):
    assert verdict_of(replace(WELL, **change), driving=False) == NO_VERDICT


@pytest.mark.parametrize(
    "axis",
    [
        fed(power_state=PowerState.FAULT),
        fed(rebooted=True),
        fed(nmt_state=NmtState.STOPPED),
        fed(heartbeat_age_ns=10**9),
        replace(fed(emergency=EMERGENCY, alarm=EMERGENCY), new_emergency=True),
        replace(AXIS, enable_wanted=False, unexpected_enable_cycles=26),
    ],
)
def test_a_drive_that_is_lost_faulty_or_enabled_by_others_counts_at_rest_too(axis):
    assert verdict_of(axes=[axis], driving=False) != NO_VERDICT


def test_what_the_leg_does_at_rest_is_no_reason_to_stop():
    stretched = replace(LEG, singularity_ratio=0.0)

    assert verdict_of(axes=[moved(velocity_si=9.0)], legs=[stretched], driving=False) == NO_VERDICT


def test_an_emergency_that_was_judged_stops_nothing_more():
    assert verdict_of(axes=[fed(emergency=EMERGENCY, alarm=EMERGENCY)]) == NO_VERDICT


@pytest.mark.parametrize("driving", [True, False])
def test_a_new_alarm_stops_by_its_own_name_whatever_the_drive_said_after_it(driving):
    """It has taken it back, or a warning is what is open now."""
    for later in (None, LOW_CODE):
        axis = replace(fed(emergency=later, alarm=EMERGENCY), new_emergency=True)

        verdicts = told(axes=[axis], driving=driving)
        assert verdicts == (Cause.EMERGENCY, "right/hip", 0x8611, 0.0, Finding.EMCY)


def test_a_fault_is_named_by_the_alarm_that_came_with_it_also_after_it_was_taken_back():
    faulty = fed(alarm=EMERGENCY, emergency=LOW_CODE, power_state=PowerState.FAULT)

    assert emcy_of(faulty) == (0x8611, "following error")


def test_a_temperature_that_is_not_measured_any_more_is_judged_as_one_beyond_its_limit():
    unknown = fed(temperature_degc=None, temperature_overdue=True)

    finding = Finding.NOT_MEASURED
    assert told(axes=[unknown]) == (Cause.TEMPERATURE_LIMIT, "right/hip", 0.0, 0.0, finding)
    assert verdict_of(axes=[fed(temperature_degc=None)]) == NO_VERDICT


@pytest.mark.parametrize("driving", [True, False])
def test_inputs_that_cannot_be_are_told_with_power_and_without_and_hide_no_open_switch(driving):
    odd = fed(inputs=Input.IMPOSSIBLE)

    told_ = told(axes=[odd], driving=driving)

    assert told_ == (
        *(Cause.INPUTS_IMPOSSIBLE, "right/hip", 0.0, 0.0),
        Finding.IMPOSSIBLE_BITS,
    )


@pytest.mark.parametrize("inputs", [Input.IMPOSSIBLE, Input.STO_RELEASED])
def test_what_the_last_frame_of_a_drive_showed_does_not_hide_that_it_is_lost(inputs):
    assert told(axes=[fed(inputs=inputs, sample_age_cycles=3)])[0] == Cause.DRIVE_SILENT
    assert told(axes=[fed(inputs=inputs)])[0] != Cause.DRIVE_SILENT


def test_an_effort_that_no_drive_gives_is_told_as_one_and_accuses_no_encoder():
    most_si = 4.0 * LIMITS.effort_max_si
    odd = moved(standing(held_si=-30.0), effort_si=-1.01 * most_si)

    assert told(axes=[odd]) == (
        *(Cause.EFFORT_DEVIATION, "right/hip", 1.01 * most_si, most_si),
        Finding.EFFORT_IMPOSSIBLE,
    )
    at_most = moved(standing(held_si=-30.0), effort_si=-most_si)
    assert told(axes=[at_most])[0] == Cause.ENCODER_FROZEN


@pytest.mark.parametrize(("cycles", "found"), [(49, False), (50, True), (51, True)])
def test_an_effort_that_stays_the_same_in_half_a_second_of_motion_is_not_measured(cycles, found):
    same = replace(AXIS, watch=replace(AXIS.watch, unchanged_cycles=cycles))

    assert (verdict_of(axes=[same]) != NO_VERDICT) is found
    if found:
        assert told(axes=[same]) == (
            *(Cause.EFFORT_DEVIATION, "right/hip", cycles, 50.0),
            Finding.EFFORT_UNCHANGED,
        )


HELD = replace(AXIS, held=True, tracking_si=0.0)
HOLD_SI = LIMITS.hold_distance_max_si


@pytest.mark.parametrize("sign", [1, -1])
def test_a_held_joint_has_a_narrower_limit_of_its_distance_to_the_reference(sign):
    inside = replace(HELD, tracking_si=sign * HOLD_SI)
    outside = replace(HELD, tracking_si=sign * 1.01 * HOLD_SI)

    assert verdict_of(axes=[inside]) == NO_VERDICT
    assert told(axes=[outside])[:4] == (Cause.TRACKING_LIMIT, "right/hip", 1.01 * HOLD_SI, HOLD_SI)
    assert verdict_of(axes=[replace(outside, held=False)]) == NO_VERDICT


def test_a_drive_whose_own_loops_hold_a_joint_away_from_its_target_does_not_follow():
    away = replace(HELD, loop_distance_si=1.01 * HOLD_SI, tracking_si=1.01 * HOLD_SI)

    assert told(axes=[away]) == (
        *(Cause.NOT_FOLLOWING, "right/hip", 1.01 * HOLD_SI, HOLD_SI),
        Finding.HELD_AWAY,
    )
    for distance_si in (0.0, HOLD_SI, float("inf")):
        assert verdict_of(axes=[replace(HELD, loop_distance_si=distance_si)]) == NO_VERDICT
    moving = replace(away, held=False, tracking_si=0.0)
    assert verdict_of(axes=[moving]) == NO_VERDICT


def test_before_the_first_sample_neither_inputs_nor_joint_are_judged():
    nothing_yet = fed(
        moved(known=False, position_si=9.0, velocity_si=99.0, effort_si=999.0),
        inputs=Input.NONE,
        temperature_degc=200.0,
    )

    assert verdict_of(axes=[nothing_yet]) == NO_VERDICT


# --- enabled, in its mode, following --------------------------------------------------------------

STARTING = replace(AXIS, reached_enabled=False)


@pytest.mark.parametrize(
    "change",
    [
        {"power_state": PowerState.READY_TO_SWITCH_ON},
        {"mode_display": OperationMode.CYCLIC_SYNC_POSITION},
        {"following": False},
    ],
)
def test_a_drive_that_starts_has_a_quarter_of_a_second_to_get_there(change):
    within = fed(replace(STARTING, unready_cycles=25), **change)
    beyond = fed(replace(STARTING, unready_cycles=26), **change)

    assert verdict_of(axes=[within]) == NO_VERDICT
    found = verdict_of(axes=[beyond])
    assert found != NO_VERDICT
    assert (found.finding is Finding.NEVER_ENABLED) == (found.cause is Cause.DRIVE_LEFT_ENABLED)


@pytest.mark.parametrize("power_state", [PowerState.QUICK_STOP_ACTIVE, PowerState.SWITCHED_ON])
def test_a_drive_that_was_enabled_and_is_no_more_stops_at_once(power_state):
    axis = fed(replace(AXIS, unready_cycles=0), power_state=power_state)

    assert verdict_of(axes=[axis]).cause == Cause.DRIVE_LEFT_ENABLED


def test_a_drive_that_is_not_enabled_is_told_so_and_not_by_its_mode():
    axis = fed(
        replace(AXIS, unready_cycles=99),
        power_state=PowerState.SWITCHED_ON,
        mode_display=OperationMode.CYCLIC_SYNC_POSITION,
        following=False,
    )
    harsher = Categories(dict.fromkeys(CHOSEN_CATEGORY, "S1") | {"mode_not_shown": "S0"})

    assert verdict_of(axes=[axis]).cause == Cause.DRIVE_LEFT_ENABLED
    assert verdict_of(axes=[axis], categories=harsher).cause == Cause.DRIVE_LEFT_ENABLED


def test_a_drive_that_shows_another_mode_is_told_so_and_not_that_it_does_not_follow():
    axis = fed(
        replace(AXIS, unready_cycles=6),
        mode_display=OperationMode.CYCLIC_SYNC_POSITION,
        following=False,
    )

    assert verdict_of(axes=[axis]).cause == Cause.MODE_NOT_SHOWN


@pytest.mark.parametrize("state", [PowerState.FAULT_REACTION_ACTIVE, PowerState.FAULT])
def test_a_drive_that_fails_on_its_way_to_be_enabled_stops_by_its_fault(state):
    axis = fed(replace(STARTING, unready_cycles=1), power_state=state)
    milder = Categories(
        {cause.name.lower(): "S0" for cause in CHOSEN_CATEGORY} | {"drive_fault": "S1"}
    )

    assert verdict_of(axes=[axis], categories=milder).cause == Cause.DRIVE_FAULT


UNREQUESTED = replace(AXIS, enable_wanted=False, reached_enabled=False)


@pytest.mark.parametrize("driving", [True, False])
@pytest.mark.parametrize(
    ("state", "shown_unpowered", "patience"),
    [
        (PowerState.OPERATION_ENABLED, True, 0),
        (PowerState.QUICK_STOP_ACTIVE, True, 0),
        (PowerState.UNKNOWN, True, 25),
        (PowerState.OPERATION_ENABLED, False, 25),
        (PowerState.QUICK_STOP_ACTIVE, False, 25),
        (PowerState.UNKNOWN, False, 25),
    ],
)
def test_power_that_appears_stops_at_once_and_power_that_does_not_go_soon(
    state, shown_unpowered, patience, driving
):
    within = fed(replace(UNREQUESTED, shown_unpowered=shown_unpowered), power_state=state)
    within = replace(within, unexpected_enable_cycles=patience)
    beyond = replace(within, unexpected_enable_cycles=patience + 1)

    assert verdict_of(axes=[within], driving=driving) == NO_VERDICT
    verdicts = told(axes=[beyond], driving=driving)
    assert verdicts == (
        Cause.UNEXPECTED_ENABLE,
        AXIS.name,
        float(patience + 1),
        float(patience),
        Finding.CYCLES,
    )


def test_a_fault_reaction_without_a_request_for_power_may_last_as_long_as_its_profile_says():
    reacting = fed(UNREQUESTED, power_state=PowerState.FAULT_REACTION_ACTIVE)

    for shown_unpowered in (False, True):
        within = replace(
            reacting,
            shown_unpowered=shown_unpowered,
            unexpected_enable_cycles=reacting.reaction_cycles,
        )
        beyond = replace(within, unexpected_enable_cycles=reacting.reaction_cycles + 1)
        assert verdict_of(axes=[within]).cause == Cause.DRIVE_FAULT
        assert verdict_of(axes=[beyond]).cause == Cause.UNEXPECTED_ENABLE


def test_without_a_request_no_power_is_expected():
    axis = replace(AXIS, unready_cycles=99, enable_wanted=False)

    assert verdict_of(axes=[fed(axis, power_state=PowerState.SWITCHED_ON)]) == NO_VERDICT


@pytest.mark.parametrize("fresh", [True, False])
@pytest.mark.parametrize("power_state", set(PowerState) - {PowerState.OPERATION_ENABLED})
def test_a_state_that_the_next_controlword_follows_from_is_judged_though_no_sample_is_complete(
    power_state, fresh
):
    axis = replace(AXIS, joint=JOINT._replace(fresh=fresh))

    verdicts = told(axes=[fed(axis, fresh=fresh, power_state=power_state)])

    cause = Cause.DRIVE_FAULT if power_state.name.startswith("FAULT") else Cause.DRIVE_LEFT_ENABLED
    assert verdicts[0] == cause


@pytest.mark.parametrize("power_state", PowerState)
def test_a_drive_on_its_way_to_be_enabled_may_show_every_state_but_quick_stop(power_state):
    axis = fed(replace(STARTING, unready_cycles=1), power_state=power_state)

    stops = power_state.name.startswith("FAULT") or power_state is PowerState.QUICK_STOP_ACTIVE
    assert (verdict_of(axes=[axis]) != NO_VERDICT) == stops


@pytest.mark.parametrize(
    ("wanted", "shown"),
    [
        (OperationMode.CYCLIC_SYNC_POSITION, OperationMode.CYCLIC_SYNC_TORQUE),
        (OperationMode.CYCLIC_SYNC_TORQUE, OperationMode.CYCLIC_SYNC_POSITION),
    ],
)
def test_any_mode_but_the_one_that_was_asked_for_is_another_one(wanted, shown):
    axis = fed(replace(AXIS, unready_cycles=6, mode_wanted=wanted), mode_display=shown)

    assert verdict_of(axes=[axis]).cause == Cause.MODE_NOT_SHOWN


# --- one axis alone -------------------------------------------------------------------------------

HOMING = replace(AXIS, homing=True)


@pytest.mark.parametrize("position_si", [-9.0, 9.0])
def test_where_a_joint_is_means_nothing_while_it_homes(position_si):
    assert verdict_of(axes=[moved(HOMING, position_si=position_si)]) == NO_VERDICT


IN_DOUBT = [
    ({"singularity_ratio": 0.0}, Cause.SINGULARITY),
    ({"stopping_ratio": 0.0}, Cause.STOPPING_PATH),
]


@pytest.mark.parametrize(("doubtful", "cause"), IN_DOUBT)
def test_a_leg_whose_axis_seeks_its_home_is_not_judged_by_the_pose_in_doubt(doubtful, cause):
    seeking = replace(LEG, seeks_home=True, **doubtful)

    assert verdict_of(legs=[seeking]) == NO_VERDICT
    assert verdict_of(legs=[replace(seeking, seeks_home=False)]).cause == cause


def test_an_estimate_in_doubt_counts_once_no_axis_of_its_leg_seeks_its_home():
    blind = replace(ESTIMATE, observer_bad_cycles=OBSERVER_BAD_MAX_CYCLES + 1)
    seeking, other = replace(blind, seeks_home=True), replace(blind, name="left")

    assert verdict_of(estimates=[seeking]) == NO_VERDICT
    found = verdict_of(estimates=[seeking, other])
    assert (found.cause, found.drive) == (Cause.OBSERVER_INVALID, "left")


@pytest.mark.parametrize(("doubtful", "cause"), IN_DOUBT)
def test_the_other_leg_is_judged_while_an_axis_seeks_its_home(doubtful, cause):
    seeking = replace(LEG, seeks_home=True, **doubtful)
    other = replace(LEG, name="left", **doubtful)

    verdict = verdict_of(legs=[seeking, other])

    assert (verdict.cause, verdict.drive) == (cause, "left")


@pytest.mark.parametrize(
    ("axis", "cause"),
    [
        (fed(HOMING, sample_age_cycles=3), Cause.DRIVE_SILENT),
        (fed(HOMING, power_state=PowerState.FAULT), Cause.DRIVE_FAULT),
        (
            replace(fed(HOMING, emergency=EMERGENCY, alarm=EMERGENCY), new_emergency=True),
            Cause.EMERGENCY,
        ),
        (fed(HOMING, inputs=Input.STO_RELEASED), Cause.HAND_SWITCH_OPEN),
        (fed(HOMING, inputs=Input.HAND_SWITCH_CLOSED), Cause.STO_ACTIVE),
        (moved(HOMING, velocity_si=3.5, effort_si=0.0), Cause.VELOCITY_LIMIT),
        (moved(HOMING, effort_si=70.0, velocity_si=0.0), Cause.EFFORT_LIMIT),
        (moved(HOMING, step_si=0.06), Cause.ENCODER_JUMP),
        (replace(HOMING, watch=EffortWatch(gap_si=9.0, gap_cycles=3)), Cause.EFFORT_DEVIATION),
    ],
)
def test_an_axis_that_seeks_its_home_is_judged_by_all_that_its_drive_shows(axis, cause):
    seeking = replace(LEG, seeks_home=True)

    assert verdict_of(axes=[axis], legs=[seeking]).cause == cause


@pytest.mark.parametrize("position_si", [-9.0, 9.0])
def test_where_a_joint_is_means_nothing_before_it_is_referenced(position_si):
    lost = moved(replace(AXIS, referenced=False), position_si=position_si)

    assert verdict_of(axes=[lost]).cause == Cause.UNREFERENCED
    assert verdict_of(axes=[replace(lost, preparing=True)]) == NO_VERDICT


def test_a_homing_runs_on_to_its_switch_and_may_stand_there_at_full_torque_and_does_not_follow():
    on_switch = fed(
        moved(HOMING, still_cycles=99, velocity_si=0.0, speed_before_still_si=9.0),
        inputs=FEEDBACK.inputs | Input.POSITIVE_LIMIT,
        following=False,
    )

    assert verdict_of(axes=[replace(on_switch, unready_cycles=99)]) == NO_VERDICT
    towards = moved(on_switch, velocity_si=0.5, still_cycles=0)
    assert verdict_of(axes=[towards]) == NO_VERDICT


def test_a_homing_has_its_limits_of_speed_and_effort_all_the_same():
    assert verdict_of(axes=[moved(HOMING, velocity_si=9.0)]).cause == Cause.VELOCITY_LIMIT
    assert (
        verdict_of(axes=[moved(HOMING, effort_si=99.0, velocity_si=0.0)]).cause
        == Cause.EFFORT_LIMIT
    )


def test_a_drive_that_rebooted_is_lost_and_not_told_to_be_unreferenced():
    """It is the loss that has to be mended; S0 for its axis would let go of what still holds."""
    axis = fed(replace(AXIS, referenced=False), rebooted=True)

    assert verdict_of(axes=[axis]).cause == Cause.DRIVE_REBOOTED


# --- the encoder ----------------------------------------------------------------------------------


def test_of_a_first_sample_there_is_no_distance_to_judge():
    assert verdict_of(axes=[moved(step_si=9.0, elapsed_s=0.0)]) == NO_VERDICT


def test_a_frozen_encoder_is_no_other_axis_s_stop_category():
    frozen = moved(still_cycles=5, velocity_si=0.0, speed_before_still_si=9.0)

    assert verdict_of(axes=[frozen]).category == StopCategory.S0


@pytest.mark.parametrize("still_cycles", [4, 6])
def test_speed_lost_at_once_counts_in_one_cycle_not_before_and_not_for_ever_after(still_cycles):
    """Later only effort that changes without a count tells a frozen encoder from a rest."""
    still = moved(still_cycles=still_cycles, velocity_si=0.0, speed_before_still_si=9.0)

    assert verdict_of(axes=[still]) == NO_VERDICT


# --- bounds ---------------------------------------------------------------------------------------

STEP_SI = LIMITS.effort_rate_max_si_per_s * 0.01
MAX_SI = LIMITS.effort_max_si


@pytest.mark.parametrize(
    ("wanted_si", "last_si", "sent_si"),
    [
        (10.0, 8.0, 10.0),
        (40.0, 8.0, 8.0 + STEP_SI),
        (-40.0, 8.0, 8.0 - STEP_SI),
        (8.0 + STEP_SI, 8.0, 8.0 + STEP_SI),
        (MAX_SI, MAX_SI - 1.0, MAX_SI),
        (MAX_SI + 1.0, MAX_SI - 1.0, MAX_SI),
        (-MAX_SI - 1.0, -MAX_SI + 1.0, -MAX_SI),
        (0.0, 2 * MAX_SI, MAX_SI),
        (0.0, -2 * MAX_SI, -MAX_SI),
    ],
)
def test_effort_goes_its_way_by_steps_and_ends_at_its_limit(wanted_si, last_si, sent_si):
    assert bound(wanted_si, last_si, LIMITS, 0.01) == pytest.approx(sent_si)


def test_twice_the_time_allows_twice_the_step():
    assert bound(MAX_SI, 0.0, LIMITS, 0.02) == pytest.approx(2 * STEP_SI)


WAY_SI = LIMITS.velocity_max_si * 0.01
SOFT_MIN_SI = LIMITS.position_min_si + LIMITS.soft_margin_si
SOFT_MAX_SI = LIMITS.position_max_si - LIMITS.soft_margin_si


@pytest.mark.parametrize(
    ("wanted_si", "last_si", "sent_si"),
    [
        (0.21, 0.2, 0.21),
        (9.0, 0.2, 0.2 + WAY_SI),
        (-9.0, 0.2, 0.2 - WAY_SI),
        (9.0, SOFT_MAX_SI - 0.001, SOFT_MAX_SI),
        (-9.0, SOFT_MIN_SI + 0.001, SOFT_MIN_SI),
        (9.0, SOFT_MAX_SI + 0.02, SOFT_MAX_SI + 0.02),
        (-9.0, SOFT_MIN_SI - 0.02, SOFT_MIN_SI - 0.02),
        (0.2, SOFT_MAX_SI + 0.04, SOFT_MAX_SI + 0.04 - WAY_SI),
        (0.2, SOFT_MIN_SI - 0.04, SOFT_MIN_SI - 0.04 + WAY_SI),
    ],
)
def test_a_target_goes_its_way_by_steps_ends_at_the_soft_margin_and_may_always_come_back(
    wanted_si, last_si, sent_si
):
    assert bound_position(wanted_si, last_si, LIMITS, 0.01) == pytest.approx(sent_si)


def test_twice_the_time_allows_twice_the_way():
    assert bound_position(9.0, 0.2, LIMITS, 0.02) == pytest.approx(0.2 + 2 * WAY_SI)


def test_no_verdict_has_no_category_and_no_cause():
    assert msgspec.structs.asdict(NO_VERDICT)["category"] == StopCategory.NONE
    assert NO_VERDICT.cause == Cause.NONE


# --- efforts, strides, paths to rest --------------------------------------------------------------


@pytest.mark.parametrize(
    ("axis", "expected"),
    [
        (
            replace(AXIS, watch=EffortWatch(gap_si=9.5, gap_cycles=99)),
            (
                Cause.EFFORT_DEVIATION,
                9.5,
                LIMITS.effort_deviation_max_si,
                Finding.EFFORT_NOT_AS_SENT,
            ),
        ),
        (
            replace(AXIS, watch=EffortWatch(gap_si=9.5, gap_cycles=99, unpowered_cycles=1)),
            (
                Cause.EFFORT_DEVIATION,
                9.5,
                LIMITS.effort_deviation_max_si,
                Finding.EFFORT_WITHOUT_POWER,
            ),
        ),
        (
            replace(AXIS, watch=EffortWatch(sign_mismatch_si=25.5, sign_mismatch_cycles=99)),
            (
                *(Cause.SIGN_WRONG, 25.5, LIMITS.sign_mismatch_effort_min_si),
                Finding.EFFORT_AGAINST_MOTION,
            ),
        ),
        (
            against_its_drive(cycles=99),
            (
                *(Cause.MOVED_AGAINST_DRIVE, 25.5, LIMITS.sign_mismatch_effort_min_si),
                Finding.PUSHED_BACK,
            ),
        ),
        (
            replace(AXIS, stride_drift_si=-99.0),
            (
                *(Cause.EFFORT_DEVIATION, 99.0, LIMITS.load_deviation_max_si),
                Finding.MEAN_OF_STRIDE,
            ),
        ),
        (
            replace(AXIS, stride_energy_j=999.0),
            (Cause.ENERGY_LIMIT, 999.0, LIMITS.stride_energy_max_j, Finding.STRIDE_ENERGY_J),
        ),
        (
            replace(AXIS, stopping_end_si=0.8),
            (Cause.STOPPING_PATH, 0.8, LIMITS.position_max_si, Finding.RESTS_ABOVE),
        ),
        (
            replace(AXIS, stopping_end_si=-0.4),
            (Cause.STOPPING_PATH, -0.4, LIMITS.position_min_si, Finding.RESTS_BELOW),
        ),
    ],
)
def test_what_is_watched_over_cycles_and_strides_is_told_with_value_limit_and_meaning(
    axis, expected
):
    cause, value, limit, finding = expected

    assert told(axes=[axis]) == (cause, "right/hip", value, limit, finding)


@pytest.mark.parametrize(
    ("patient", "expected"),
    [
        (
            replace(PATIENT, spasm_cycles=99, spasm_rise_si=-33.0),
            (Cause.SPASM, 33.0, LIMITS.spasm_rise_si, Finding.RISE_AGAINST_MOTION),
        ),
        (
            replace(PATIENT, clonus_cycles=999, clonus_swing_si=7.0),
            (Cause.CLONUS, 7.0, LIMITS.clonus_swing_si, Finding.SWINGS),
        ),
    ],
)
def test_what_the_estimate_shows_of_the_patient_is_told_with_value_limit_and_meaning(
    patient, expected
):
    cause, value, limit, finding = expected
    estimates = [replace(ESTIMATE, axes=(patient,))]

    assert told(estimates=estimates) == (cause, "right/hip", value, limit, finding)
    assert told(estimates=estimates, driving=False)[0] == Cause.NONE


def test_a_raw_finding_counts_before_an_equal_one_of_the_estimate():
    spasm = replace(ESTIMATE, axes=(replace(PATIENT, spasm_cycles=99),))

    assert told(axes=[replace(AXIS, tracking_si=9.0)], estimates=[spasm])[0] == Cause.TRACKING_LIMIT


def test_a_leg_that_would_come_to_rest_too_straight_is_told_unless_it_is_so_already():
    going = replace(LEG, stopping_ratio=0.1)
    there = replace(going, singularity_ratio=0.12)

    finding = Finding.ANGLE_ON_WAY_TO_REST
    assert told(legs=[going]) == (Cause.STOPPING_PATH, "right", 0.1, 0.15, finding)
    assert told(legs=[there])[:3] == (Cause.SINGULARITY, "right", 0.12)


def test_an_axis_that_is_out_of_its_range_is_told_to_be_there_and_not_to_be_on_its_way():
    below = moved(replace(AXIS, stopping_end_si=-9.0), position_si=-0.35)

    assert told(axes=[below])[0] == Cause.POSITION_LIMIT


@pytest.mark.parametrize("stopping_end_si", [-9.0, 9.0])
@pytest.mark.parametrize("change", [{"homing": True}, {"joint": JOINT._replace(known=False)}])
def test_an_axis_without_a_place_has_no_path_to_rest(change, stopping_end_si):
    nowhere = replace(AXIS, stopping_end_si=stopping_end_si, **change)

    assert verdict_of(axes=[nowhere]) == NO_VERDICT


# --- assist ---------------------------------------------------------------------------------------

ASSIST_STEP_SI = LIMITS.assist_rate_max_si_per_s * 0.01
ASSIST_SI = LIMITS.assist_max_si
POWER_W = LIMITS.assist_power_max_w
FAST_SI = 2 * POWER_W / ASSIST_SI
"""A speed at which only half of the assist is allowed along the motion."""


@pytest.mark.parametrize(
    ("wanted_si", "last_si", "velocity_si", "sent_si"),
    [
        (9e9, ASSIST_SI - ASSIST_STEP_SI / 2, 0.0, ASSIST_SI),
        (-9e9, -ASSIST_SI + ASSIST_STEP_SI / 2, 0.0, -ASSIST_SI),
        (9e9, 0.0, 0.0, ASSIST_STEP_SI),
        (-9e9, 0.0, 0.0, -ASSIST_STEP_SI),
        (9e9, ASSIST_SI / 2, FAST_SI, ASSIST_SI / 2),
        (-9e9, -ASSIST_SI / 2, -FAST_SI, -ASSIST_SI / 2),
        (9e9, 14.0, 3.0, POWER_W / 3),
        (-9e9, -14.0, -3.0, -POWER_W / 3),
        (9e9, ASSIST_SI, -FAST_SI, ASSIST_SI),
        (-9e9, -ASSIST_SI, FAST_SI, -ASSIST_SI),
        (9e9, ASSIST_SI, FAST_SI, max(ASSIST_SI - ASSIST_STEP_SI, ASSIST_SI / 2)),
    ],
)
def test_assist_is_bounded_by_limit_by_rate_and_along_the_motion_by_power(
    wanted_si, last_si, velocity_si, sent_si
):
    sent = bound_assist(wanted_si, last_si, LIMITS, velocity_si, 0.01)

    assert sent == pytest.approx(sent_si)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_small_power_bounds_assist_along_a_slow_motion_too(sign):
    weak = LIMITS._replace(assist_power_max_w=4.0)

    sent_si = bound_assist(sign * 20.0, sign * 8.5, weak, sign * 0.5, 0.01)

    assert sent_si == pytest.approx(sign * 8.0)


@pytest.mark.parametrize("velocity_si", [0.25, -0.25])
def test_slow_motion_bounds_no_assist(velocity_si):
    assert ASSIST_SI * 0.25 < POWER_W
    for wanted_si in (ASSIST_SI, -ASSIST_SI):
        assert bound_assist(wanted_si, wanted_si, LIMITS, velocity_si, 0.01) == wanted_si


# --- motion against the drive ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("axis", "cause"),
    [
        (against_its_drive(cycles=3), None),
        (against_its_drive(cycles=AGAINST_DRIVE_MAX_CYCLES), None),
        (against_its_drive(cycles=AGAINST_DRIVE_MAX_CYCLES + 1), Cause.MOVED_AGAINST_DRIVE),
        (against_its_drive(cycles=2, response_ratio=UNCLEAR_MAX_RATIO + 1), None),
        (against_its_drive(cycles=3, response_ratio=RIGHT_MAX_RATIO), Cause.MOVED_AGAINST_DRIVE),
        (against_its_drive(cycles=3, response_ratio=UNCLEAR_MAX_RATIO), Cause.MOVED_AGAINST_DRIVE),
        (against_its_drive(cycles=3, response_ratio=UNCLEAR_MAX_RATIO + 0.1), Cause.SIGN_WRONG),
        (against_its_drive(cycles=3, patient_si=LIMITS.patient_effort_max_si), None),
        (against_its_drive(cycles=3, patient_si=-LIMITS.patient_effort_max_si), None),
        (against_its_drive(cycles=3, patient_si=80.1), Cause.SIGN_WRONG),
        (against_its_drive(cycles=3, patient_si=-80.1), Cause.SIGN_WRONG),
        (replace(against_its_drive(cycles=3), sign_trusted=False), Cause.SIGN_WRONG),
    ],
)
def test_only_a_trusted_sign_and_a_joint_that_answers_its_drive_make_a_mismatch_a_person_s(
    axis, cause
):
    verdict = verdict_of(axes=(axis,))

    assert verdict.cause == (cause or Cause.NONE)
