"""The limits of limits.toml in SI units and cycles, and the stop category of every cause."""

import math
from collections.abc import Mapping
from typing import NamedTuple

from gaitd_names import Cause, StopCategory

from daemon.config.limit_settings import HipLimits, Limits, SlideLimits
from daemon.config.robot import friction_range
from daemon.config.settings import Robot
from daemon.wire.causes import FIXED_CATEGORY

NS_PER_MS = 1_000_000


class AxisLimits(NamedTuple):
    """Limits of one axis in SI units at the joint: rad and N·m, or m and N."""

    position_min_si: float
    position_max_si: float
    soft_margin_si: float
    velocity_max_si: float
    hand_guiding_speed_max_si: float
    """Speed limit in mode hand_guiding, in place of `velocity_max_si`."""
    effort_max_si: float
    effort_rate_max_si_per_s: float
    power_max_w: float
    stride_energy_max_j: float
    effort_deviation_max_si: float
    load_deviation_max_si: float
    sign_mismatch_effort_min_si: float
    patient_effort_max_si: float
    """Largest effort of a patient that explains a sign mismatch."""
    soft_damping_si: float
    """Damping of outward motion at the hard limit, N·m·s/rad or N·s/m."""
    spasm_rise_si: float
    clonus_swing_si: float
    tracking_max_si: float
    hold_distance_max_si: float
    """In place of `tracking_max_si` once a leg is held."""
    temperature_max_degc: float
    quick_stop_deceleration_si_per_s2: float
    static_load_tolerance_si: float
    standstill_si_per_s: float
    breakaway_si: float
    """Static friction of the axis, where it is greatest: a clearly larger effort must move it."""
    brake: bool
    assist_max_si: float
    assist_rate_max_si_per_s: float
    assist_power_max_w: float
    enable_max_cycles: int = 25
    """Longest time until the drive is enabled and follows, from its axis file."""


def axis_limits(limits: Limits, robot: Robot) -> tuple[AxisLimits, AxisLimits]:
    """Limits of hip and slide, with the greatest breakaway along each axis.

    Where an axis is stuck is not known: only more than the greatest friction shows a stuck one.
    """
    _, (hip, slide) = friction_range(robot, limits)
    return hip_limits(limits, hip.stribeck), slide_limits(limits, slide.stribeck)


def hip_limits(limits: Limits, breakaway_nm: float) -> AxisLimits:
    """Limits of the hip from [hip] in limits.toml, in SI units."""
    hip: HipLimits = limits.hip
    return AxisLimits(
        position_min_si=math.radians(hip.position_min_deg),
        position_max_si=math.radians(hip.position_max_deg),
        soft_margin_si=math.radians(hip.soft_margin_deg),
        velocity_max_si=hip.velocity_max_rad_per_s,
        hand_guiding_speed_max_si=hip.hand_guiding_speed_max_rad_per_s,
        effort_max_si=hip.torque_max_nm,
        effort_rate_max_si_per_s=hip.torque_rate_max_nm_per_s,
        power_max_w=hip.power_max_w,
        stride_energy_max_j=hip.stride_energy_max_j,
        effort_deviation_max_si=hip.torque_deviation_max_nm,
        load_deviation_max_si=hip.load_deviation_max_nm,
        sign_mismatch_effort_min_si=hip.sign_mismatch_torque_min_nm,
        patient_effort_max_si=hip.patient_torque_max_nm,
        soft_damping_si=limits.soft_limit.hip.damping_nm_s_per_rad,
        spasm_rise_si=limits.spasm.hip.rise_nm,
        clonus_swing_si=limits.clonus.hip.swing_nm,
        tracking_max_si=math.radians(hip.tracking_max_deg),
        hold_distance_max_si=math.radians(hip.hold_distance_max_deg),
        temperature_max_degc=hip.temperature_max_degc,
        quick_stop_deceleration_si_per_s2=hip.quick_stop_deceleration_rad_per_s2,
        static_load_tolerance_si=hip.static_load_tolerance_nm,
        standstill_si_per_s=limits.stop.hip.standstill_rad_per_s,
        breakaway_si=breakaway_nm,
        brake=hip.brake,
        assist_max_si=hip.assist_max_nm,
        assist_rate_max_si_per_s=hip.assist_rate_max_nm_per_s,
        assist_power_max_w=hip.assist_power_max_w,
    )


def slide_limits(limits: Limits, breakaway_n: float) -> AxisLimits:
    """Limits of the slide from [slide] in limits.toml, in SI units."""
    slide: SlideLimits = limits.slide
    return AxisLimits(
        position_min_si=slide.position_min_m,
        position_max_si=slide.position_max_m,
        soft_margin_si=slide.soft_margin_m,
        velocity_max_si=slide.velocity_max_m_per_s,
        hand_guiding_speed_max_si=slide.hand_guiding_speed_max_m_per_s,
        effort_max_si=slide.force_max_n,
        effort_rate_max_si_per_s=slide.force_rate_max_n_per_s,
        power_max_w=slide.power_max_w,
        stride_energy_max_j=slide.stride_energy_max_j,
        effort_deviation_max_si=slide.force_deviation_max_n,
        load_deviation_max_si=slide.load_deviation_max_n,
        sign_mismatch_effort_min_si=slide.sign_mismatch_force_min_n,
        patient_effort_max_si=slide.patient_force_max_n,
        soft_damping_si=limits.soft_limit.slide.damping_n_s_per_m,
        spasm_rise_si=limits.spasm.slide.rise_n,
        clonus_swing_si=limits.clonus.slide.swing_n,
        tracking_max_si=slide.tracking_max_m,
        hold_distance_max_si=slide.hold_distance_max_m,
        temperature_max_degc=slide.temperature_max_degc,
        quick_stop_deceleration_si_per_s2=slide.quick_stop_deceleration_m_per_s2,
        static_load_tolerance_si=slide.static_load_tolerance_n,
        standstill_si_per_s=limits.stop.slide.standstill_m_per_s,
        breakaway_si=breakaway_n,
        brake=slide.brake,
        assist_max_si=slide.assist_max_n,
        assist_rate_max_si_per_s=slide.assist_rate_max_n_per_s,
        assist_power_max_w=slide.assist_power_max_w,
    )


class Categories:
    """Stop category of every cause: fixed by the design, or else chosen in limits.toml."""

    def __init__(self, chosen: Mapping[str, str]) -> None:
        """`chosen` is `stop_category` of limits.toml, whose keys the loader has checked."""
        self._by_cause = {Cause(name): StopCategory(text) for name, text in chosen.items()}
        self._by_cause |= FIXED_CATEGORY

    def of(self, cause: Cause) -> StopCategory:
        """The category of a cause; S1 for an unlisted cause, so that every cause stops."""
        return self._by_cause.get(cause, StopCategory.S1)


class Thresholds(NamedTuple):
    """Thresholds of the safety checks beside the limits of an axis, from limits.toml."""

    sample_age_max_cycles: int
    heartbeat_timeout_ns: int
    gateway_silence_cycles: int
    overruns_in_a_row: int
    encoder_frozen_cycles: int
    encoder_jump_ratio: float
    singularity_stop_ratio: float
    singularity_soft_ratio: float
    deviation_cycles: int
    sign_mismatch_cycles: int
    energy_window_cycles: int
    spasm_patience_cycles: int
    clonus_patience_cycles: int
    mode_switch_cycles: int
    """Longest time until a drive shows a mode and follows in it."""


def thresholds(limits: Limits, period_ms: int) -> Thresholds:
    """Thresholds from limits.toml, with durations in cycles of `period_ms`."""
    communication = limits.communication
    return Thresholds(
        sample_age_max_cycles=communication.sample_age_max_cycles,
        heartbeat_timeout_ns=communication.heartbeat_timeout_ms * NS_PER_MS,
        gateway_silence_cycles=communication.gateway_silence_ms // period_ms,
        overruns_in_a_row=communication.overruns_in_a_row,
        encoder_frozen_cycles=communication.encoder_frozen_cycles,
        encoder_jump_ratio=communication.encoder_jump_ratio,
        singularity_stop_ratio=limits.singularity.stop_ratio,
        singularity_soft_ratio=limits.singularity.soft_ratio,
        deviation_cycles=limits.watch.deviation_cycles,
        sign_mismatch_cycles=limits.watch.sign_mismatch_cycles,
        energy_window_cycles=limits.watch.energy_window_ms // period_ms,
        spasm_patience_cycles=limits.spasm.patience_ms // period_ms,
        clonus_patience_cycles=limits.clonus.patience_ms // period_ms,
        mode_switch_cycles=communication.mode_switch_cycles,
    )
