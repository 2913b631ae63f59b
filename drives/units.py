"""The only conversion factors of the master: a drive's numbers to SI units at the joint and back.

    position = sign * counts / counts_per_rev * (2 pi | lead) / gear + offset         rad | m
    effort   = sign * torque at the motor * gear * (1 | 2 pi / lead)                  N·m | N
    torque at the motor = k_t * current, or per mille / 1000 * rated torque           N·m

There is no efficiency factor: what the transmission loses is friction, and the observer's.

Which base counts: the numbers that the *drive* holds (6076h, 6075h, 3001h:05), read at bring-up and
found within 1 % of the files, are used from then on. The drive computes with its own integers: a
6076h of 279 mN·m for 278.68 is what 1000 per mille means in it. Before bring-up (`gaitd check`, the
limits that bring-up writes) the files' integers stand in for them.
6076h is in mN·m by CiA 402 and in µN·m on EPOS4; a profile must say which.
"""

import math
from typing import Final, NamedTuple

from drives.errors import CommandNotFinite
from drives.profile import (
    DriveDescription,
    DriveProfile,
    RatedTorqueUnit,
    TorqueObject,
    TorqueUnit,
    VelocityUnit,
)
from drives.signals import DriveFeedback

_INT16_MAX: Final = 0x7FFF
_INT32_MAX: Final = 0x7FFFFFFF
_RPM_PER_REV_PER_S: Final = 60.0
_FLOAT_SLACK: Final = 1e-6
"""Of one count: 11999.9999999 is 12000 and a rounding error of the computation."""


class DriveBase(NamedTuple):
    """What one drive's torque numbers refer to, in SI units at the motor."""

    rated_torque_nm: float
    rated_current_a: float
    torque_constant_nm_per_a: float


class AxisScaling(NamedTuple):
    """All factors of one axis; its sign is inside `counts_per_si` and the two effort factors."""

    counts_per_si: float
    """Encoder counts per rad or m; negative where counts fall along the positive axis."""
    offset_si: float
    """Joint position at count 0."""
    effort_per_torque_count_si: float
    """N·m or N at the joint per count of the profile's torque source."""
    permille_per_effort_si: float
    """Counts of 6071h per N·m or N at the joint."""
    speed_counts_per_si: float
    """Units of 6080h per rad/s or m/s at the joint, and of 6085h per rad/s² or m/s²; positive."""


class JointSample(NamedTuple):
    """One sample at the joint: rad and N·m, or m and N."""

    position_si: float
    effort_si: float


class DriveLimits(NamedTuple):
    """What is written into one drive, in SI units at the joint (from limits.toml)."""

    position_min_si: float
    position_max_si: float
    velocity_max_si: float
    effort_max_si: float
    following_error_si: float
    quick_stop_deceleration_si_per_s2: float


class RawLimits(NamedTuple):
    """The same in the drive's own units, rounded to the careful side."""

    position_min_counts: int
    position_max_counts: int
    speed_raw: int
    """6080h."""
    torque_raw: int
    """The profile's torque limit object."""
    following_error_counts: int
    deceleration_raw: int
    """6085h; rounded up, so that the ramp is not longer than assumed."""


def expected_base(description: DriveDescription) -> DriveBase:
    """The base as the axis file's integers say, for use before the drive could be asked."""
    motor = description.axis.motor
    raw = motor.torque_constant_raw
    return base_from_raw(description, motor.rated_torque_raw, motor.rated_current_raw, raw)


def base_from_raw(
    description: DriveDescription,
    rated_torque_raw: int,
    rated_current_raw: int,
    torque_constant_raw: int | None,
) -> DriveBase:
    """The base from integers; where there is no torque constant object, the axis file's counts."""
    unit: RatedTorqueUnit = description.profile.torque_base.rated_torque_unit
    constant_nm_per_a = description.axis.motor.torque_constant_nm_per_a
    if torque_constant_raw is not None:
        constant_nm_per_a = torque_constant_raw * 1e-6
    return DriveBase(rated_torque_raw * unit.nm, rated_current_raw * 1e-3, constant_nm_per_a)


def axis_scaling(description: DriveDescription, base: DriveBase) -> AxisScaling:
    """All factors of one axis."""
    transmission = description.axis.transmission
    revs_per_si = _motor_revs_per_si(description)
    effort_per_nm_si = transmission.sign * math.tau * revs_per_si
    torque_count_nm = _torque_count_nm(description.profile.torque_source, base)
    return AxisScaling(
        counts_per_si=transmission.sign * transmission.counts_per_rev * revs_per_si,
        offset_si=transmission.offset_rad or transmission.offset_m or 0.0,
        effort_per_torque_count_si=torque_count_nm * effort_per_nm_si,
        permille_per_effort_si=1e3 / (base.rated_torque_nm * effort_per_nm_si),
        speed_counts_per_si=revs_per_si * _speed_per_rev(description),
    )


def to_joint(feedback: DriveFeedback, scaling: AxisScaling) -> JointSample:
    """Where the joint is and what the drive exerts on it, positive along the positive axis."""
    return JointSample(
        position_si(feedback.position_counts, scaling),
        feedback.torque_raw * scaling.effort_per_torque_count_si,
    )


def position_si(counts: int, scaling: AxisScaling) -> float:
    """Joint position of an encoder count, rad or m."""
    return counts / scaling.counts_per_si + scaling.offset_si


def position_to_counts(position_si: float, scaling: AxisScaling) -> int:
    """The nearest encoder count, held inside 32 bits.

    Raises:
        CommandNotFinite: for NaN and infinity.
    """
    _check_finite("position", position_si)
    return _clipped((position_si - scaling.offset_si) * scaling.counts_per_si, _INT32_MAX)


def effort_to_permille(effort_si: float, scaling: AxisScaling) -> int:
    """The nearest value of 6071h, held inside 16 bits: a large one never wraps into its opposite.

    Raises:
        CommandNotFinite: for NaN and infinity.
    """
    _check_finite("effort", effort_si)
    return _clipped(effort_si * scaling.permille_per_effort_si, _INT16_MAX)


def permille_to_effort(permille: int, scaling: AxisScaling) -> float:
    """What a value of 6071h asks for at the joint, N·m or N."""
    return permille / scaling.permille_per_effort_si


def raw_limits(limits: DriveLimits, description: DriveDescription) -> RawLimits:
    """Limits in the drive's units, never wider than asked for.

    The torque limit is the smaller of the joint's and the motor's (`current_limit_a`).
    """
    scaling = axis_scaling(description, expected_base(description))
    ends = sorted(
        (position - scaling.offset_si) * scaling.counts_per_si
        for position in (limits.position_min_si, limits.position_max_si)
    )
    following = limits.following_error_si * abs(scaling.counts_per_si)
    deceleration = limits.quick_stop_deceleration_si_per_s2 * scaling.speed_counts_per_si
    return RawLimits(
        position_min_counts=max(_up(ends[0]), -_INT32_MAX),
        position_max_counts=min(_down(ends[1]), _INT32_MAX),
        speed_raw=max(_down(limits.velocity_max_si * scaling.speed_counts_per_si), 1),
        torque_raw=_torque_limit_raw(limits, description),
        following_error_counts=max(_down(following), 1),
        deceleration_raw=_up(deceleration),
    )


def _torque_limit_raw(limits: DriveLimits, description: DriveDescription) -> int:
    base = expected_base(description)
    motor = description.axis.motor
    joint_nm = limits.effort_max_si / (math.tau * _motor_revs_per_si(description))
    limit_nm = min(joint_nm, motor.current_limit_a * base.torque_constant_nm_per_a)
    return _down(limit_nm / _torque_count_nm(description.profile.torque_limit, base))


def _motor_revs_per_si(description: DriveDescription) -> float:
    """Revolutions of the motor per rad or m of the joint."""
    transmission = description.axis.transmission
    return transmission.gear_ratio / (transmission.lead_m or math.tau)


def _torque_count_nm(source: TorqueObject, base: DriveBase) -> float:
    """Torque at the motor of one count of a torque object, N·m."""
    if source.unit is TorqueUnit.MILLIAMPERE:
        return 1e-3 * base.torque_constant_nm_per_a
    return 1e-3 * base.rated_torque_nm


def _speed_per_rev(description: DriveDescription) -> float:
    """Units of 6080h per motor revolution per second."""
    profile: DriveProfile = description.profile
    if profile.velocity_unit is VelocityUnit.RPM:
        return _RPM_PER_REV_PER_S
    return float(description.axis.transmission.counts_per_rev)


def _check_finite(quantity: str, value: float) -> None:
    if not math.isfinite(value):
        raise CommandNotFinite(quantity, value)


def _clipped(value: float, largest: int) -> int:
    # Clipped before it is rounded: a finite command may overflow to infinity in scaling.
    return round(max(-largest, min(largest, value)))


def _down(value: float) -> int:
    return math.floor(value + _FLOAT_SLACK)


def _up(value: float) -> int:
    return math.ceil(value - _FLOAT_SLACK)
