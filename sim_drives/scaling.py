"""Drive units to the joint and back: counts, rpm or counts/s, per mille and mA to rad, N·m, m, N.

Written from the drive's side: the transmission and the true torque constant are hardware
(`DriveSettings`); rated torque, rated current and torque constant are what the drive has been told
(its objects), so a wrong object makes a wrong torque here as it does in a real drive.

    joint = sign · counts / counts_per_rev · travel + offset     travel = 2π/gear, or lead/gear
    effort = sign · k_t · current · 2π / travel
"""

import math
from typing import Final

from sim_drives.dictionary import ObjectDictionary
from sim_drives.personality import PERSONALITIES, SpeedUnit
from sim_drives.settings import DriveSettings, PersonalityName

RPM_TO_REV_PER_S: Final = 1 / 60
NO_FOLLOWING_WINDOW: Final = 0xFFFF_FFFF
"""6065h: the watch is off."""


def travel_si(settings: DriveSettings) -> float:
    """Joint travel of one turn of the motor: rad or m."""
    turn_si = 2 * math.pi if settings.lead_m is None else settings.lead_m
    return turn_si / settings.gear_ratio


def effort_per_a(settings: DriveSettings) -> float:
    """Size of the joint effort of one ampere, with the true torque constant: N·m/A or N/A."""
    return settings.torque_constant_nm_per_a * 2 * math.pi / travel_si(settings)


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

    def counts(self, position_si: float) -> float:
        """Encoder counts at a joint position, not yet quantised."""
        revolutions = self._sign * (position_si - self._offset_si) / self._travel_si
        return revolutions * self._counts_per_rev

    def position_si(self, counts: float) -> float:
        """Joint position at encoder counts."""
        revolutions = counts / self._counts_per_rev
        return self._sign * revolutions * self._travel_si + self._offset_si

    def distance_si(self, counts: float) -> float:
        """Size of a distance in counts at the joint."""
        return counts / self._counts_per_rev * self._travel_si

    def speed_raw(self, velocity_si: float) -> float:
        """606Ch: signed, in the drive's unit."""
        return self._sign * velocity_si / self._speed_step_si

    def speed_si(self, speed_raw: int) -> float:
        """Size of a speed or, per second, of a deceleration at the joint."""
        return speed_raw * self._speed_step_si

    @property
    def _speed_step_si(self) -> float:
        if self._personality.speed_unit is SpeedUnit.RPM:
            return RPM_TO_REV_PER_S * self._travel_si
        return self._travel_si / self._counts_per_rev

    def motor_current_a(self, current_a: float) -> float:
        """The motor's current with the motor's sign, from the joint's sign."""
        return self._sign * current_a

    @property
    def rated_torque_nm(self) -> float:
        """6076h at the motor shaft."""
        return self._dictionary.value(0x6076) * self._personality.torque_base_nm

    @property
    def rated_current_a(self) -> float:
        """3001h:01 or 6075h."""
        if self._epos4:
            return self._dictionary.value(0x3001, 1) * 1e-3
        return self._dictionary.value(0x6075) * 1e-3

    @property
    def torque_constant_nm_per_a(self) -> float:
        """What the drive believes: 3001h:05, or 6076h / 6075h; 0 while it has not been told."""
        if self._epos4:
            return self._dictionary.value(0x3001, 5) * 1e-6
        return self.rated_torque_nm / self.rated_current_a if self.rated_current_a else 0.0

    def torque_permille(self, current_a: float) -> float:
        """6077h from the motor's current."""
        rated = self.rated_torque_nm
        return current_a * self.torque_constant_nm_per_a / rated * 1e3 if rated else 0.0

    def effort_si(self, torque_permille: int) -> float:
        """Joint effort that a target of 6071h makes the current loop produce."""
        constant = self.torque_constant_nm_per_a
        current_a = torque_permille * 1e-3 * self.rated_torque_nm / constant if constant else 0.0
        return self._sign * current_a * self._effort_per_a

    def effort_limit_si(self) -> float:
        """Size of the largest joint effort: 3001h:02, or 6072h and 6073h; and the hardware's."""
        return min(self._object_limit_a(), self._hardware_limit_a) * self._effort_per_a

    def _object_limit_a(self) -> float:
        if self._epos4:
            return self._dictionary.value(0x3001, 2) * 1e-3
        permille = min(self._dictionary.value(0x6072), self._dictionary.value(0x6073))
        return permille * 1e-3 * self.rated_current_a

    def following_window_si(self) -> float:
        """6065h at the joint; infinity when the watch is off."""
        counts = self._dictionary.value(0x6065)
        return math.inf if counts == NO_FOLLOWING_WINDOW else self.distance_si(counts)

    def interpolation_s(self) -> float:
        """60C2h: sub 1 times ten to the power of sub 2; 0 where it has not been set."""
        exponent = self._dictionary.value(0x60C2, 2)
        return float(self._dictionary.value(0x60C2, 1) * 10.0**exponent)
