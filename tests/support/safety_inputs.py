"""Situations in which nothing is wrong, for tests that make one thing wrong."""

import cmath
import math

from gaitd_names import Mode

from daemon.core.exercises.guards import GuardInputs
from daemon.core.safety.checks import NO_VERDICT, check_estimate, check_raw, harshest_of_each
from daemon.core.safety.effort_monitor import EffortWatch
from daemon.core.safety.inputs import (
    AxisEstimateInputs,
    AxisInputs,
    LegEstimateInputs,
    LegInputs,
    SafetyInputs,
    ServiceInputs,
)
from daemon.core.safety.joints import Joint
from daemon.core.safety.limits import AxisLimits, Categories, Thresholds
from daemon.wire.causes import CHOSEN_CATEGORY
from drives.signals import (
    DriveFeedback,
    Input,
    NmtState,
    OperationMode,
    PowerState,
)

ALL_WELL = GuardInputs(
    mode=Mode.READY,
    gateway_alive=True,
    at_rest=True,
    hand_switch_closed=True,
    hand_switch_known=True,
    sto_released=True,
    unreferenced=(),
    outside=(),
    drives_powered=True,
    cadence_max_hz=0.5,
    scenarios={"paper": 30.0, "friction": 60.0},
    artificial=frozenset({"paper"}),
    patient_configured=False,
    guidance="impedance",
)
"""Inputs of the guards of requests."""
LIMITS = AxisLimits(
    position_min_si=-0.3,
    position_max_si=0.7,
    soft_margin_si=0.05,
    velocity_max_si=3.0,
    hand_guiding_speed_max_si=1.0,
    effort_max_si=60.0,
    effort_rate_max_si_per_s=600.0,
    power_max_w=80.0,
    stride_energy_max_j=60.0,
    effort_deviation_max_si=5.0,
    load_deviation_max_si=8.0,
    sign_mismatch_effort_min_si=20.0,
    patient_effort_max_si=80.0,
    soft_damping_si=40.0,
    spasm_rise_si=10.0,
    clonus_swing_si=5.0,
    tracking_max_si=0.2,
    hold_distance_max_si=0.05,
    temperature_max_degc=80.0,
    quick_stop_deceleration_si_per_s2=20.0,
    static_load_tolerance_si=15.0,
    standstill_si_per_s=0.02,
    breakaway_si=7.0,
    brake=False,
    assist_max_si=20.0,
    assist_rate_max_si_per_s=200.0,
    assist_power_max_w=40.0,
)
THRESHOLDS = Thresholds(
    sample_age_max_cycles=2,
    heartbeat_timeout_ns=100_000_000,
    gateway_silence_cycles=30,
    overruns_in_a_row=3,
    encoder_frozen_cycles=5,
    encoder_jump_ratio=1.5,
    singularity_stop_ratio=0.15,
    singularity_soft_ratio=0.3,
    deviation_cycles=3,
    sign_mismatch_cycles=3,
    energy_window_cycles=400,
    spasm_patience_cycles=30,
    clonus_patience_cycles=120,
    mode_switch_cycles=5,
)
CATEGORIES = Categories(dict.fromkeys(CHOSEN_CATEGORY, "S1"))
WELL = ServiceInputs(
    stop_requested=False,
    shutdown_requested=False,
    gateway_age_cycles=1,
    overruns_in_a_row=0,
    bus_off=False,
    bus_error="",
    tx_dropped_in_a_row=0,
)
LEG = LegInputs(
    name="right",
    singularity_ratio=0.8,
    stopping_ratio=0.75,
    seeks_home=False,
)
FEEDBACK = DriveFeedback(
    node_id=5,
    nmt_state=NmtState.OPERATIONAL,
    power_state=PowerState.OPERATION_ENABLED,
    statusword=0x1237,
    following=True,
    warning=False,
    mode_display=OperationMode.CYCLIC_SYNC_TORQUE,
    position_counts=100,
    torque_raw=0,
    inputs=Input.HAND_SWITCH_CLOSED | Input.STO_RELEASED,
    temperature_degc=30.0,
    fresh=True,
    sample_age_cycles=0,
    late_count=0,
    heartbeat_age_ns=5_000_000,
    rebooted=False,
    emergency=None,
    emergency_count=0,
    protocol_error_count=0,
)
JOINT = Joint(
    known=True,
    fresh=True,
    position_si=0.2,
    velocity_si=0.5,
    effort_si=10.0,
    step_si=0.005,
    elapsed_s=0.01,
    sample_ns=1_000_000_000,
    counts=100,
)
AXIS = AxisInputs(
    name="right/hip",
    feedback=FEEDBACK,
    joint=JOINT,
    limits=LIMITS,
    referenced=True,
    preparing=False,
    homing=False,
    tracking_si=0.01,
    held=False,
    wanted_velocity_si=0.0,
    counts_sign=1,
    loop_distance_si=math.inf,
    enable_wanted=True,
    reached_enabled=True,
    unready_cycles=0,
    unexpected_enable_cycles=0,
    shown_unpowered=False,
    reaction_cycles=50,
    mode_wanted=OperationMode.CYCLIC_SYNC_TORQUE,
    new_emergency=False,
    sign_trusted=True,
    watch=EffortWatch(held_si=10.0, held_before_still_si=10.0),
    stride_energy_j=20.0,
    stride_drift_si=1.0,
    stopping_end_si=0.22,
)
PATIENT = AxisEstimateInputs(
    name="right/hip",
    limits=LIMITS,
    spasm_cycles=0,
    spasm_rise_si=0.0,
    clonus_cycles=0,
    clonus_swing_si=0.0,
)
ESTIMATE = LegEstimateInputs(name="right", axes=(PATIENT,), observer_bad_cycles=0, seeks_home=False)


def harshest(service, axes, legs, thresholds, categories, *, driving, estimates=(ESTIMATE,)):
    """The verdict of a cycle that is told."""
    raw = check_raw(SafetyInputs(service, axes, legs, thresholds, categories, driving))
    estimated = check_estimate(estimates, thresholds, categories) if driving else ()
    found = harshest_of_each([*raw, *estimated])
    return found[0] if found else NO_VERDICT


def slide_ends(leg, hip_rad, ratio):
    """Nearest and farthest slide position beyond the knee with this singularity ratio, m."""
    knee = cmath.rect(leg.thigh_length_m, leg.thigh_angle_rad + hip_rad)
    on_rail = (knee - complex(leg.rail_x_m, leg.rail_y_m)) / complex(leg.rail_cos, leg.rail_sin)
    u, w = leg.shank_length_m, leg.shoe_length_m
    swing = 2.0 * u * w * math.sqrt(1.0 - ratio * ratio)
    return tuple(
        on_rail.real + math.sqrt(max(u * u + w * w + side * swing - on_rail.imag**2, 0.0))
        for side in (-1, 1)
    )
