"""What a calibration knows of its own values, as [uncertainty] of the robot file.

Its intervals cover the machine of the recordings. Springs, drives and the place where friction is
high are the same on another day. The level of friction and a sensor's offset are not: what the file
says of another day and temperature is in no recording, so it is only widened. A value that was not
identified keeps the file's uncertainty with the file's value.
"""

from collections.abc import Sequence
from typing import Final

from analysis.calibration.fit import QUANTILE, Result
from analysis.calibration.quantities import value_of
from daemon.config.settings import Robot

OF_MECHANISM: Final = (
    ("hip.spring_ratio", ("springs.hip.stiffness_nm_per_rad",)),
    ("hip.spring_rest_rad", ("springs.hip.rest_rad",)),
    ("slide.spring_ratio", ("springs.slide.stiffness_n_per_m",)),
    ("slide.spring_rest_m", ("springs.slide.rest_m",)),
    ("drive_inertia_ratio", ("hip.drive_inertia_kg_m2", "slide.drive_mass_kg")),
    ("hip.friction_slope_per_rad", ("friction_over_position.hip.slope_per_rad",)),
    ("slide.friction_slope_per_m", ("friction_over_position.slide.slope_per_m",)),
)
OF_THE_DAY: Final = (
    ("hip.friction_ratio", ("friction.hip.coulomb_nm", "friction.hip.stribeck_nm")),
    ("hip.viscous_ratio", ("friction.hip.viscous_nm_s_per_rad",)),
    ("slide.friction_ratio", ("friction.slide.coulomb_n", "friction.slide.stribeck_n")),
    ("slide.viscous_ratio", ("friction.slide.viscous_n_s_per_m",)),
    ("hip.torque_offset_nm", ("effort_offset.hip.torque_nm",)),
    ("slide.force_offset_n", ("effort_offset.slide.force_n",)),
)
"""Key in [uncertainty], and the quantities that it is of: the least certain one counts."""


def uncertainties(robot: Robot, results: Sequence[Result]) -> dict[str, float]:
    """Return one standard deviation for each key of [uncertainty] that changes.

    Args:
        robot: of the file to begin with.
        results: of all quantities.
    """
    known = {one.quantity.key: one for one in results if one.calibrated}
    made: dict[str, float] = {}
    for key, places in (*OF_MECHANISM, *OF_THE_DAY):
        if not known.keys() >= set(places):
            continue
        std = max(_std(known[place], ratio=key.endswith("_ratio")) for place in places)
        if (key, places) in OF_MECHANISM or std > value_of(robot, f"uncertainty.{key}"):
            made[f"uncertainty.{key}"] = std
    return made


def _std(result: Result, *, ratio: bool) -> float:
    std = result.half_interval / QUANTILE
    return std / abs(result.value) if ratio else std
