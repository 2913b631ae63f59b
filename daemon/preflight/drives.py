"""Checks the drives' own reactions against the brakes of their axes.

A drive whose quick stop (605Ah 0 to 4) or whose answer to a silent master (6007h = 2) leaves the
axis without torque needs a brake. The hip carries the leg: it is refused without one. The slide
runs on a rail between springs: it must hold after a quick stop, which the service commands, and may
coast when there is no service any more; `gaitd check` warns.
"""

from typing import Final

from daemon.config.bundle import Settings
from daemon.config.strict import ConfigError, Errors
from drives.canopen.objects import Object
from drives.cia402.option_codes import in_words, without_torque
from drives.cia402.profile import DriveDescription


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


DRIVE_CHECKS: Final = (_axes_without_torque_have_a_brake,)
