"""Checks of a trainer whose bus has real drives, beyond those of any configuration.

A bus is taken as real unless it is simulated, a `vcan`, or declared by `bus.virtual_drives`; with
some virtual drives it is real, on a `vcan`, too. What the files of the virtual drives leave out is
refused there.
"""

from typing import Final

from gaitd_toml import ConfigError, Errors

from daemon.config.bundle import Settings
from daemon.config.trainer import has_real_drives


def _signs_are_proven(settings: Settings) -> Errors:
    signs = settings.trainer.commissioning.signs
    if has_real_drives(settings.trainer.bus) and signs == "assumed":
        allowed = (
            '"proven": a motor connected the wrong way round runs away from the first hold '
            f"(gaitd commission AXIS){_ON_A_BENCH}"
        )
        yield ConfigError(settings.file.path, "commissioning.signs", signs, allowed)


def _pose_tolerances_can_fail(settings: Settings) -> Errors:
    if not has_real_drives(settings.trainer.bus):
        return
    reference, limits = settings.trainer.reference, settings.limits
    for key, value, low, high in (
        (
            "hip.pose_tolerance_deg",
            reference.hip.pose_tolerance_deg,
            limits.hip.position_min_deg,
            limits.hip.position_max_deg,
        ),
        (
            "slide.pose_tolerance_m",
            reference.slide.pose_tolerance_m,
            limits.slide.position_min_m,
            limits.slide.position_max_m,
        ),
    ):
        if value >= high - low > 0:
            allowed = (
                f"< {high - low:g}, the axis's range; less than a turn of the motor is best: with "
                f"more, an encoder that has lost turns is believed{_ON_A_BENCH}"
            )
            yield ConfigError(settings.file.path, f"reference.{key}", value, allowed)


_ON_A_BENCH: Final = "; on a bench with the drives of gaitd sim, bus.virtual_drives = true"

REAL_BUS_CHECKS: Final = (_signs_are_proven, _pose_tolerances_can_fail)
