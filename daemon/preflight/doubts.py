"""Numbers that `gaitd check` accepts and warns of: each is allowed, and is more often a mistake."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec
from gaitd_toml import ConfigError, Errors

from daemon.config.bundle import Settings
from daemon.config.drive_plan import drive_limits, effort_per_motor_nm
from daemon.config.trainer import beside, has_real_drives, real_drives
from daemon.preflight.thresholds import idle_thresholds
from drives.cia402.profile import DecelerationUnit, DriveDescription, SpeedUnit
from drives.cia402.torque import count_nm
from drives.cia402.units import DriveLimits, axis_scaling, expected_base

COUNTS_MIN: Final = 100
COUNTS_MAX: Final = 200_000
"""Counts of a torque object at the motor's current limit; drives have 1000 to 65,000."""
TOO_WIDE: Final = 5.0
STANDSTILL_SHARE_MAX: Final = 0.1
STRONG_RATIO: Final = 8.0
"""A drive that gives this many times the limit of its joint."""
NOMINAL_RATIO: Final = 4.0
"""Current limit over nominal current."""

_PARTNER: Final = {
    DecelerationUnit.RPM_PER_S: SpeedUnit.RPM,
    DecelerationUnit.COUNTS_PER_S2: SpeedUnit.COUNTS_PER_S,
    DecelerationUnit.TEN_COUNTS_PER_S2: SpeedUnit.TENTH_COUNTS_PER_S,
}
"""The unit of speed that a drive has beside a unit of deceleration."""


def doubts(settings: Settings) -> Iterator[str]:
    """One line for each number that is probably a mistake: file, key, value, and why."""
    for check in (
        _drives,
        _standstill,
        _zero_damping,
        idle_thresholds,
        _patient_on_a_real_machine,
        _bench,
        _accepted_calibration,
    ):
        yield from map(str, check(settings))


def _drives(settings: Settings) -> Errors:
    hip_limits, slide_limits = drive_limits(settings.limits)
    for leg in settings.legs:
        yield from _drive(leg.hip, leg.hip_file, hip_limits)
        yield from _drive(leg.slide, leg.slide_file, slide_limits)


def _drive(drive: DriveDescription, file: Path, limits: DriveLimits) -> Errors:
    motor, profile, transmission = drive.axis.motor, drive.profile, drive.axis.transmission
    profile_file = beside(file, drive.axis.profile)
    motor_nm = motor.current_limit_a * motor.torque_constant_nm_per_a
    for name in ("torque_source", "torque_limit", "target_torque"):
        torque = getattr(profile, name)
        counts = motor_nm / count_nm(torque, expected_base(drive))
        if not COUNTS_MIN <= counts <= COUNTS_MAX:
            why = (
                f"at {motor.current_limit_a:g} A {torque.place} of {drive.name} would be "
                f"{counts:.3g}, and drives have {COUNTS_MIN} to {COUNTS_MAX}: off by 1000?"
            )
            yield ConfigError(profile_file, f"{name}.factor", torque.factor, why)
    wide = _speed_ratio(drive)
    if wide >= TOO_WIDE and profile.optional_objects.speed_limit:
        why = (
            f"deceleration_unit is {profile.deceleration_unit.value}: in the unit of speed beside "
            f"it, 6080h of {drive.name} would be {wide:.3g} times too wide"
        )
        yield ConfigError(profile_file, "velocity_unit", profile.velocity_unit.value, why)
    most = motor_nm * effort_per_motor_nm(drive)
    if most > STRONG_RATIO * limits.effort_max_si:
        why = (
            f"at {motor.current_limit_a:g} A {drive.name} gives {most:.4g}, "
            f"{most / limits.effort_max_si:.3g} times the limit of its joint: too large a gear?"
        )
        yield ConfigError(file, "transmission.gear_ratio", transmission.gear_ratio, why)
    if motor.peak_current_a is None and motor.current_limit_a > (
        NOMINAL_RATIO * motor.nominal_current_a
    ):
        why = (
            f"more than {NOMINAL_RATIO:g} times nominal_current_a = {motor.nominal_current_a:g}; "
            "give motor.peak_current_a of the motor's data sheet"
        )
        yield ConfigError(file, "motor.current_limit_a", motor.current_limit_a, why)


def _speed_ratio(drive: DriveDescription) -> float:
    """6080h as it is written, over what it would be in the unit beside that of deceleration."""
    profile, base = drive.profile, expected_base(drive)
    partner = _PARTNER[profile.deceleration_unit]
    other = msgspec.structs.replace(profile, velocity_unit=partner)
    beside_it = DriveDescription(drive.name, other, drive.axis, drive.eds)
    scale = axis_scaling(beside_it, base).speed_counts_per_si
    return axis_scaling(drive, base).speed_counts_per_si / scale


def _standstill(settings: Settings) -> Errors:
    stop, limits = settings.limits.stop, settings.limits
    for key, value, most in (
        (
            "hip.standstill_rad_per_s",
            stop.hip.standstill_rad_per_s,
            limits.hip.velocity_max_rad_per_s,
        ),
        (
            "slide.standstill_m_per_s",
            stop.slide.standstill_m_per_s,
            limits.slide.velocity_max_m_per_s,
        ),
    ):
        if value > STANDSTILL_SHARE_MAX * most:
            why = (
                f"above a tenth of the highest speed, {most:g}: a leg that moves counts as at rest"
            )
            yield ConfigError(settings.file.limits, f"stop.{key}", value, why)


def _zero_damping(settings: Settings) -> Errors:
    hand, soft = settings.trainer.hand_guiding, settings.limits.soft_limit
    for file, name, table in (
        (settings.file.path, "hand_guiding", hand),
        (settings.file.limits, "soft_limit", soft),
    ):
        for key, value in (
            ("hip.damping_nm_s_per_rad", table.hip.damping_nm_s_per_rad),
            ("slide.damping_n_s_per_m", table.slide.damping_n_s_per_m),
        ):
            if value == 0.0:
                why = "nothing but friction slows a leg there"
                yield ConfigError(file, f"{name}.{key}", value, why)


def _patient_on_a_real_machine(settings: Settings) -> Errors:
    trainer, file = settings.trainer, settings.file.path
    if settings.robot.patient is None or not has_real_drives(trainer.bus):
        return
    if trainer.self_test.required == "never":
        why = '"daily" where a person uses the machine'
        yield ConfigError(file, "self_test.required", trainer.self_test.required, why)
    if trainer.excite:
        why = (
            f"robot names {trainer.robot}, with a patient, and these push without guidance: "
            "name the file of the empty machine, or delete them"
        )
        yield ConfigError(file, "excite", dict(trainer.excite), why)


def _accepted_calibration(settings: Settings) -> Errors:
    """A calibration that was written although it missed a limit."""
    note = settings.robot.calibration
    if note is not None:
        missed = list(note.missed_limits)
        why = (
            "none: `gaitd calibrate --accept` wrote the file although it missed them; with a "
            "patient no leg moves before a self-test has passed; calibrate again"
        )
        yield ConfigError(settings.file.robot, "calibration.missed_limits", missed, why)


def _bench(settings: Settings) -> Errors:
    """What is right on a bench, and wrong where its file is used for a machine."""
    trainer, file = settings.trainer, settings.file.path
    undeclared = msgspec.structs.replace(trainer.bus, virtual_drives=False)
    if trainer.bus.virtual_drives is True and has_real_drives(undeclared):
        why = (
            f"no drive on {trainer.bus.channel} counts as real: signs may be assumed and any pose "
            "be believed; never with a machine on this bus"
        )
        yield ConfigError(file, "bus.virtual_drives", value=True, allowed=why)
    real = real_drives(trainer)
    reference = trainer.reference
    hip = "hip.pose_tolerance_deg", reference.hip.pose_tolerance_deg, 180.0 / math.pi
    slide = "slide.pose_tolerance_m", reference.slide.pose_tolerance_m, 1.0
    for drive in settings.drives:
        key, value, scale = hip if drive.name.endswith("/hip") else slide
        turn = scale / drive.axis.transmission.revs_per_si
        if drive.name in real and value >= turn:
            why = (
                f"less than {turn:.3g}, a turn of the motor of {drive.name}: with more, an encoder "
                "that has lost a turn is believed"
            )
            yield ConfigError(file, f"reference.{key}", value, why)
