"""Conversion of drive units to the joint and back: counts, speeds, per mille, mA to rad, N·m, m, N.

Written from the drive's side: the transmission and the true torque constant are hardware
(`DriveSettings`); rated torque, rated current and torque constant are configured in the drive's
objects, so a wrong object makes a wrong torque here as it does in a real drive.

    joint = sign · counts / counts_per_rev · travel + offset     travel = 2π/gear, or lead/gear
    effort = sign · k_t · current · 2π / travel
    6064h = (counts - origin) · units      units = 1, or by 608Fh, 6091h, 6092h and 607Eh bit 7

Speeds have the same units per second, and 607Eh bit 6 in place of bit 7.
"""

import math
from typing import Final, NamedTuple

from sim_drives.canopen.dictionary import ObjectDictionary
from sim_drives.canopen.objects import Object
from sim_drives.cia402.personality import PERSONALITIES, SpeedUnit
from sim_drives.settings import DriveSettings, PersonalityName

RPM_TO_REV_PER_S: Final = 1 / 60
NO_FOLLOWING_WINDOW: Final = 0xFFFF_FFFF
"""Value of 6065h that disables the following error."""
POSITION_POLARITY: Final = 1 << 7
VELOCITY_POLARITY: Final = 1 << 6
UNIT_RATIOS: Final = (Object.ENCODER_RESOLUTION, Object.GEAR_RATIO, Object.FEED_CONSTANT)
"""Encoder resolution, gear ratio, feed constant: each sub 1 over sub 2."""


def travel_si(settings: DriveSettings) -> float:
    """Joint travel of one turn of the motor: rad or m."""
    turn_si = 2 * math.pi if settings.lead_m is None else settings.lead_m
    return turn_si / settings.gear_ratio


def effort_per_a(settings: DriveSettings) -> float:
    """Magnitude of the joint effort per ampere, with the true torque constant: N·m/A or N/A."""
    return settings.torque_constant_nm_per_a * 2 * math.pi / travel_si(settings)


class Factors(NamedTuple):
    """Conversion factors from the drive's objects and hardware; renewed after an SDO write."""

    effort_si_per_permille: float
    """Unsigned; the motor's sign is not applied yet."""
    permille_per_a: float
    """Factor of 6077h."""
    rated_current_a: float
    """Rated current: 3001h:01 or 6075h."""
    effort_limit_si: float
    """Largest joint effort, unsigned: by 3001h:02, or 6072h and 6073h; and by the hardware."""
    following_window_si: float
    """6065h at the joint; infinity when it is disabled."""
    following_time_s: float
    interpolation_s: float
    """60C2h: sub 1 times ten to the power of sub 2."""
    velocity_limit_si: float
    """Limit of 6080h."""
    units_per_count: float
    """Factor of positions; negative with polarity bit 7."""
    speed_step_si: float
    """One unit of speed at the joint; negative with polarity bit 6."""


class Scaling:
    """Conversions of one drive; counts are the encoder's, 0 at the joint's offset."""

    def __init__(self, settings: DriveSettings, dictionary: ObjectDictionary) -> None:
        self._dictionary = dictionary
        self._epos4 = settings.personality is PersonalityName.EPOS4
        self._personality = PERSONALITIES[settings.personality]
        self._hardware_limit_a = settings.current_limit_a
        self._sign = settings.sign
        self._travel_si = travel_si(settings)
        self._counts_per_rev = settings.counts_per_rev
        self._offset_si = (settings.offset_rad or 0.0) + (settings.offset_m or 0.0)
        self._effort_per_a = effort_per_a(settings)
        self._factors: Factors | None = None
        self._revision = -1

    @property
    def factors(self) -> Factors:
        """The factors of the present objects."""
        if self._factors is None or self._revision != self._dictionary.revision:
            self._factors = self._read_factors()
            self._revision = self._dictionary.revision
        return self._factors

    def counts(self, position_si: float) -> float:
        """Return the encoder counts at a joint position, not yet quantised."""
        revolutions = self._sign * (position_si - self._offset_si) / self._travel_si
        return revolutions * self._counts_per_rev

    def position_si(self, counts: float) -> float:
        """Return the joint position at encoder counts."""
        revolutions = counts / self._counts_per_rev
        return self._sign * revolutions * self._travel_si + self._offset_si

    def position_units(self, counts: int) -> int:
        """Return 6064h of counts since the origin."""
        units = self.factors.units_per_count
        return counts if units == 1.0 else round(counts * units)

    def units_counts(self, position_units: int) -> float:
        """Return the counts since the origin of a position in the drive's units."""
        return position_units / self.factors.units_per_count

    def speed_raw(self, velocity_si: float) -> float:
        """Return 606Ch: signed, in the drive's unit."""
        return self._sign * velocity_si / self.factors.speed_step_si

    def velocity_si(self, speed_raw: int) -> float:
        """Return the joint velocity of a signed speed."""
        return self._sign * speed_raw * self.factors.speed_step_si

    def counts_per_s(self, speed_raw: int) -> float:
        """Return the magnitude of a speed at the encoder."""
        return self.speed_si(speed_raw) / self._travel_si * self._counts_per_rev

    def current_si(self, current_ma: int) -> float:
        """Return the magnitude of the joint effort of a motor current."""
        return current_ma * 1e-3 * self._effort_per_a

    def speed_si(self, speed_raw: int) -> float:
        """Return the magnitude of a speed or, per second, of a deceleration at the joint."""
        return speed_raw * abs(self.factors.speed_step_si)

    def motor_current_a(self, current_a: float) -> float:
        """Return the motor current in the motor's sign, from the joint's sign."""
        return self._sign * current_a

    def effort_si(self, torque_permille: int) -> float:
        """Return the joint effort that the current loop produces for a target of 6071h."""
        return self._sign * torque_permille * self.factors.effort_si_per_permille

    def _read_factors(self) -> Factors:
        value = self._dictionary.value
        rated_torque_nm = value(Object.RATED_TORQUE) * self._personality.torque_base_nm
        rated = (Object.EPOS4_MOTOR_DATA, 1) if self._epos4 else (Object.RATED_CURRENT, 0)
        rated_current_a = value(*rated) * 1e-3
        constant = self._believed_constant(rated_torque_nm, rated_current_a)
        current_per_permille = rated_torque_nm / constant * 1e-3 if constant else 0.0
        if self._personality.torque_counts_current:
            current_per_permille = rated_current_a * 1e-3
        limit_a = min(self._object_limit_a(rated_current_a), self._hardware_limit_a)
        units_per_count = self._units_per_count()
        speed_step_si = self._speed_step_si(units_per_count)
        return Factors(
            effort_si_per_permille=current_per_permille * self._effort_per_a,
            permille_per_a=1 / current_per_permille if current_per_permille else 0.0,
            rated_current_a=rated_current_a,
            effort_limit_si=limit_a * self._effort_per_a,
            following_window_si=self._following_window_si(units_per_count),
            following_time_s=value(Object.FOLLOWING_TIME) * 1e-3,
            interpolation_s=self._interpolation_s(),
            velocity_limit_si=value(Object.SPEED_LIMIT) * abs(speed_step_si),
            units_per_count=units_per_count * self._polarity(POSITION_POLARITY),
            speed_step_si=speed_step_si * self._polarity(VELOCITY_POLARITY),
        )

    def _interpolation_s(self) -> float:
        value = self._dictionary.value
        exponent = value(Object.INTERPOLATION_TIME, 2)
        interpolation_s = value(Object.INTERPOLATION_TIME, 1) * 10.0**exponent
        return max(float(interpolation_s), self._personality.smallest_interpolation_s)

    def _units_per_count(self) -> float:
        """CiA 402-2: feed constant / (encoder resolution · gear ratio)."""
        encoder, gear, feed = (self._ratio(index) for index in UNIT_RATIOS)
        return feed / (encoder * gear)

    def _ratio(self, index: int) -> float:
        value_or = self._dictionary.value_or
        return value_or(index, 1, 1) / value_or(index, 2, 1)

    def _polarity(self, bit: int) -> int:
        return -1 if self._dictionary.value_or(Object.POLARITY, 0, 0) & bit else 1

    def _speed_step_si(self, units_per_count: float) -> float:
        if self._personality.speed_unit is SpeedUnit.RPM:
            return RPM_TO_REV_PER_S * self._travel_si
        return self._travel_si / self._counts_per_rev / units_per_count

    def _believed_constant(self, rated_torque_nm: float, rated_current_a: float) -> float:
        """Torque constant set in the drive, N·m/A: 3001h:05, or 6076h / 6075h; 0 if none."""
        if self._epos4:
            return self._dictionary.value(Object.EPOS4_MOTOR_DATA, 5) * 1e-6
        return rated_torque_nm / rated_current_a if rated_current_a else 0.0

    def _object_limit_a(self, rated_current_a: float) -> float:
        if self._epos4:
            return self._dictionary.value(Object.EPOS4_MOTOR_DATA, 2) * 1e-3
        permille = min(map(self._dictionary.value, (Object.TORQUE_MAX, Object.CURRENT_MAX)))
        return permille * 1e-3 * rated_current_a

    def _following_window_si(self, units_per_count: float) -> float:
        window = self._dictionary.value(Object.FOLLOWING_WINDOW)
        if window == NO_FOLLOWING_WINDOW:
            return math.inf
        return window / units_per_count / self._counts_per_rev * self._travel_si
