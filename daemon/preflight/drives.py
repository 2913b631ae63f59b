"""Checks the drives' own reactions against the brakes of their axes.

A drive whose quick stop (605Ah 0 to 4) or whose answer to a silent master (6007h = 2) leaves the
axis without torque needs a brake. The hip carries the leg: it is refused without one. The slide
runs on a rail between springs: it must hold after a quick stop, which the service commands, and may
coast when there is no service any more; `gaitd check` warns.

And compares the position limits with the 32 bits that a drive counts in.
"""

from typing import Final

from gaitd_toml import ConfigError, Errors

from daemon.config.bundle import Settings
from daemon.config.drive_plan import drive_limits
from drives.canopen.objects import Object
from drives.cia402.option_codes import in_words, without_torque
from drives.cia402.profile import DriveDescription
from drives.cia402.units import axis_scaling, expected_base

COUNTS_MAX: Final = 0x7FFFFFFF


def _axes_without_torque_have_a_brake(settings: Settings) -> Errors:
    limits = settings.limits
    for leg in settings.legs:
        for axis, drive, brake in (
            ("hip", leg.hip, limits.hip.brake),
            ("slide", leg.slide, limits.slide.brake),
        ):
            if not brake:
                yield from _check(settings, axis, drive)


def _check(settings: Settings, axis: str, drive: DriveDescription) -> Errors:
    for entry, instead in without_torque(drive.profile.written):
        if axis == "slide" and entry.index == Object.ABORT_CONNECTION:
            continue
        allowed = (
            f"true, or another value in {drive.axis.profile} (it may be {instead}): "
            f"{drive.name} would lose its torque, {in_words(entry)}"
        )
        yield ConfigError(settings.file.limits, f"{axis}.brake", False, allowed)
        return


def _positions_fit_the_counter(settings: Settings) -> Errors:
    for leg in settings.legs:
        for drive, file, limits in zip(
            (leg.hip, leg.slide),
            (leg.hip_file, leg.slide_file),
            drive_limits(settings.limits),
            strict=True,
        ):
            scaling = axis_scaling(drive, expected_base(drive))
            farthest_si = max(
                abs(position_si - scaling.offset_si)
                for position_si in (limits.position_min_si, limits.position_max_si)
            )
            counts = farthest_si * abs(scaling.counts_per_si)
            if counts > COUNTS_MAX:
                allowed = (
                    f"<= {int(drive.axis.transmission.counts_per_rev * COUNTS_MAX / counts)}: the "
                    f"position limits of {drive.name} would be {counts:.3g} counts from its zero, "
                    "and 6064h has 32 bits"
                )
                value = drive.axis.transmission.counts_per_rev
                yield ConfigError(file, "transmission.counts_per_rev", value, allowed)


DRIVE_CHECKS: Final = (_axes_without_torque_have_a_brake, _positions_fit_the_counter)
