"""Where a calibration of bristles (LuGre) begins, and what the observer needs for them."""

from collections.abc import Iterable
from typing import Final

import msgspec

from analysis.calibration.quantities import AXES, BRISTLE_KEYS
from daemon.config.edits import Value
from daemon.config.robot import friction_parameters
from daemon.config.settings import Robot

BREAKAWAY: Final = (2e-3, 5e-4)
"""Elastic way up to breakaway where a search begins, rad and m; its grid spans a factor of 100."""
DAMPING_S: Final = 0.01
"""Damping over stiffness where a search begins."""
SUBSTEPS: Final = 10
"""Semi-implicit ones: exact enough for a stride of 0.5 Hz, twice the time of RK4 with two."""


def with_bristles(robot: Robot, axes: Iterable[int]) -> tuple[Robot, dict[str, Value]]:
    """Return the robot with bristles, and the changed keys of [observer].

    Args:
        robot: as given.
        axes: without bristles, 0 for the hip and 1 for the slide.
    """
    table = msgspec.to_builtins(robot)
    laws = friction_parameters(robot)
    for axis in axes:
        stiffness = laws[axis].stribeck / BREAKAWAY[axis]
        for key, value in zip(BRISTLE_KEYS[axis], (stiffness, DAMPING_S * stiffness), strict=True):
            table["friction"][AXES[axis]][key.rpartition(".")[2]] = value
    tuning: dict[str, Value] = {
        "integrator": "semi_implicit",
        "substeps": max(SUBSTEPS, robot.observer.substeps),
    }
    table["observer"] |= tuning
    changed = {
        f"observer.{name}": value
        for name, value in tuning.items()
        if value != getattr(robot.observer, name)
    }
    return msgspec.convert(table, Robot), changed


def not_identified(axes: Iterable[int], calibrated: Iterable[str]) -> str:
    """Name bristles that a recording does not identify; empty if there are none.

    Args:
        axes: that this calibration gave bristles to.
        calibrated: keys of the quantities that it identified.
    """
    known = set(calibrated)
    for axis in axes:
        if not known.issuperset(BRISTLE_KEYS[axis]):
            return (
                f"the {AXES[axis]}'s bristles are not identified by this recording: record more "
                f"reversals, as in excite friction_{AXES[axis]}"
            )
    return ""
