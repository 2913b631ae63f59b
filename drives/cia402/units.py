"""All conversion factors of the master: drive units to SI units at the joint and back.

    position = sign * counts / counts_per_rev * (2 pi | lead) / gear + offset         rad | m
    effort   = sign * torque at the motor * gear * (1 | 2 pi / lead)                  N·m | N
    torque at the motor: per count as the profile says (`torque.py`)                  N·m

There is no efficiency factor: losses of the transmission are friction, which the observer
estimates.

Base values: the numbers that the *drive* holds (6076h, 6075h, 3001h:05), read at bring-up and
found within 1 % of the files, are used from then on. The drive computes with its own integers: with
6076h = 279 mN·m for 278.68, 1000 per mille are 279 mN·m. Before bring-up (`gaitd check`, the limits
that bring-up writes) the files' integers are used.
"""

import math
from typing import Final, NamedTuple

from drives.cia402.homing import Homing
from drives.cia402.profile import DecelerationUnit, DriveDescription, SpeedUnit
from drives.cia402.torque import DriveBase, RatedTorqueUnit, count_nm
from drives.errors import CommandNotFinite
from drives.signals import DriveFeedback

_INT32_MAX: Final = 0x7FFFFFFF
_UNITS_PER_COUNT: Final[dict[SpeedUnit | DecelerationUnit, float]] = {
    SpeedUnit.COUNTS_PER_S: 1.0,
    SpeedUnit.TENTH_COUNTS_PER_S: 10.0,
    DecelerationUnit.COUNTS_PER_S2: 1.0,
    DecelerationUnit.TEN_COUNTS_PER_S2: 0.1,
}
"""Per count/s or count/s²; units that are not listed are rpm or rpm/s."""
_RPM_PER_REV_PER_S: Final = 60.0
_FLOAT_SLACK: Final = 1e-6
"""Part of one count: 11999.9999999 counts as 12000 with a rounding error."""


class AxisScaling(NamedTuple):
    """All factors of one axis; the sign is part of `counts_per_si` and the two effort factors."""

    counts_per_si: float
    """Encoder counts per rad or m; negative where counts fall along the positive axis."""
    offset_si: float
    """Joint position at count 0."""
    effort_per_torque_count_si: float
    """N·m or N at the joint per count of the profile's torque source."""
    permille_per_effort_si: float
    """Counts of 6071h per N·m or N at the joint: per mille, or as the profile says."""
    target_limit_count: int
    """The largest count of 6071h, which has 16 or 32 bits."""
    speed_counts_per_si: float
    """Units of 6080h per rad/s or m/s at the joint; positive."""
    deceleration_counts_per_si: float
    """Units of 6085h per rad/s² or m/s² at the joint; positive."""


class JointSample(NamedTuple):
    """One sample at the joint: rad and N·m, or m and N."""

    position_si: float
    effort_si: float


class DriveLimits(NamedTuple):
    """Limits written into one drive, in SI units at the joint (from limits.toml)."""

    position_min_si: float
    position_max_si: float
    velocity_max_si: float
    effort_max_si: float
    following_error_si: float
    quick_stop_deceleration_si_per_s2: float


class RawLimits(NamedTuple):
    """`DriveLimits` in the drive's own units, rounded to the safe side."""

    position_min_counts: int
    position_max_counts: int
    speed_raw: int
    """6080h."""
    torque_raw: int
    """The profile's torque limit object."""
    following_error_counts: int
    deceleration_raw: int
    """6085h; rounded up, so that the ramp is never longer than assumed."""


class RawHoming(NamedTuple):
    """[homing] of an axis file in the drive's own units."""

    home_raw: int
    search_speed_raw: int
    """6099h:01."""
    zero_speed_raw: int
    """6099h:02."""
    acceleration_raw: int
    """609Ah."""
    stop_current_ma: int | None


def expected_base(description: DriveDescription) -> DriveBase:
    """Base from the axis file's integers, for use before the drive has been read."""
    motor = description.axis.motor
    raw = motor.torque_constant_raw
    return base_from_raw(description, motor.rated_torque_raw, motor.rated_current_raw, raw)


def base_from_raw(
    description: DriveDescription,
    rated_torque_raw: int | None,
    rated_current_raw: int | None,
    torque_constant_raw: int | None,
) -> DriveBase:
    """Base from the drive's integers; values without an object are taken from the axis file.

    Without a rated torque, 1000 per mille of a drive are the torque at its rated current.
    """
    motor, unit = description.axis.motor, description.profile.torque_base.rated_torque_unit
    constant_nm_per_a = motor.torque_constant_nm_per_a
    if torque_constant_raw is not None:
        constant_nm_per_a = torque_constant_raw * 1e-6
    current_a = motor.nominal_current_a
    if rated_current_raw is not None:
        current_a = rated_current_raw * 1e-3
    torque_nm = current_a * constant_nm_per_a
    if rated_torque_raw is not None and unit is not None:
        torque_nm = rated_torque_raw * unit.si
        if unit is RatedTorqueUnit.MILLI_NEWTON:
            torque_nm *= description.axis.transmission.nm_per_n
    return DriveBase(torque_nm, current_a, constant_nm_per_a)


def axis_scaling(description: DriveDescription, base: DriveBase) -> AxisScaling:
    """All factors of one axis."""
    profile, transmission = description.profile, description.axis.transmission
    source, target = profile.torque_source, profile.target_torque
    revs_per_si, counts_per_rev = transmission.revs_per_si, transmission.counts_per_rev
    effort_per_nm_si = transmission.sign * math.tau * revs_per_si
    return AxisScaling(
        counts_per_si=transmission.sign * counts_per_rev * revs_per_si,
        offset_si=transmission.offset_rad or transmission.offset_m or 0.0,
        effort_per_torque_count_si=source.sign * count_nm(source, base) * effort_per_nm_si,
        permille_per_effort_si=1.0 / (count_nm(target, base) * effort_per_nm_si),
        target_limit_count=(1 << (target.bits - 1)) - 1,
        speed_counts_per_si=revs_per_si * _units_per_rev(profile.velocity_unit, counts_per_rev),
        deceleration_counts_per_si=revs_per_si
        * _units_per_rev(profile.deceleration_unit, counts_per_rev),
    )


def to_joint(feedback: DriveFeedback, scaling: AxisScaling) -> JointSample:
    """Joint position and effort of the drive, positive along the positive axis."""
    return JointSample(
        position_si(feedback.position_counts, scaling),
        feedback.torque_raw * scaling.effort_per_torque_count_si,
    )


def position_si(counts: float, scaling: AxisScaling) -> float:
    """Joint position of an encoder count, rad or m; NaN of NaN."""
    return counts / scaling.counts_per_si + scaling.offset_si


def position_to_counts(position_si: float, scaling: AxisScaling) -> int:
    """The nearest encoder count, clamped to 32 bits.

    Raises:
        CommandNotFinite: for NaN and infinity.
    """
    _check_finite("position", position_si)
    return _clipped((position_si - scaling.offset_si) * scaling.counts_per_si, _INT32_MAX)


def effort_to_permille(effort_si: float, scaling: AxisScaling) -> int:
    """The nearest value of 6071h, clamped to its width: a large value never wraps around.

    Raises:
        CommandNotFinite: for NaN and infinity.
    """
    _check_finite("effort", effort_si)
    return _clipped(effort_si * scaling.permille_per_effort_si, scaling.target_limit_count)


def permille_to_effort(permille: int, scaling: AxisScaling) -> float:
    """Effort at the joint, N·m or N, that a value of 6071h commands."""
    return permille / scaling.permille_per_effort_si


def raw_limits(limits: DriveLimits, description: DriveDescription) -> RawLimits:
    """Limits in the drive's units, never wider than given.

    The torque limit is the smaller of the joint's and the motor's (`current_limit_a`).
    """
    scaling = axis_scaling(description, expected_base(description))
    ends = sorted(
        (position - scaling.offset_si) * scaling.counts_per_si
        for position in (limits.position_min_si, limits.position_max_si)
    )
    following = limits.following_error_si * abs(scaling.counts_per_si)
    deceleration = limits.quick_stop_deceleration_si_per_s2 * scaling.deceleration_counts_per_si
    return RawLimits(
        position_min_counts=_up(max(ends[0], -_INT32_MAX)),
        position_max_counts=_down(min(ends[1], _INT32_MAX)),
        speed_raw=_unsigned(_down(limits.velocity_max_si * scaling.speed_counts_per_si), 32),
        torque_raw=_torque_limit_raw(limits, description),
        following_error_counts=_unsigned(_down(following), 32),
        deceleration_raw=_unsigned(_up(deceleration), 32),
    )


def raw_homing(homing: Homing, sign: int, description: DriveDescription) -> RawHoming:
    """Homing in the drive's units; `sign` is the profile's `home_sign`."""
    scaling = axis_scaling(description, expected_base(description))
    per_si = scaling.speed_counts_per_si
    current_a = homing.stop_current_a
    return RawHoming(
        home_raw=sign * position_to_counts(homing.home_si, scaling),
        search_speed_raw=max(_down(homing.search_speed_si_per_s * per_si), 1),
        zero_speed_raw=max(_down(homing.zero_speed_si_per_s * per_si), 1),
        acceleration_raw=max(
            _down(homing.acceleration_si_per_s2 * scaling.deceleration_counts_per_si), 1
        ),
        stop_current_ma=None if current_a is None else _down(current_a * 1e3),
    )


def _torque_limit_raw(limits: DriveLimits, description: DriveDescription) -> int:
    base, limit = expected_base(description), description.profile.torque_limit
    joint_nm = limits.effort_max_si / (math.tau * description.axis.transmission.revs_per_si)
    motor_nm = description.axis.motor.current_limit_a * base.torque_constant_nm_per_a
    count = _down(min(joint_nm, motor_nm) / count_nm(limit, base))
    return _unsigned(count, limit.bits - limit.signed)


def _units_per_rev(unit: SpeedUnit | DecelerationUnit, counts_per_rev: int) -> float:
    """Units of 6080h per motor revolution per second, or of 6085h per revolution/s²."""
    per_count = _UNITS_PER_COUNT.get(unit)
    return _RPM_PER_REV_PER_S if per_count is None else per_count * counts_per_rev


def _check_finite(quantity: str, value: float) -> None:
    if not math.isfinite(value):
        raise CommandNotFinite(quantity, value)


def _clipped(value: float, largest: int) -> int:
    # Clipped before it is rounded: a finite command may overflow to infinity in scaling.
    return round(max(-largest, min(largest, value)))


def _unsigned(value: int, bits: int) -> int:
    # Never 0: some drives take a limit of 0 as no limit.
    return max(1, min(value, (1 << bits) - 1))


def _down(value: float) -> int:
    return math.floor(value + _FLOAT_SLACK)


def _up(value: float) -> int:
    return math.ceil(value - _FLOAT_SLACK)
