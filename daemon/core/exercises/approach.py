"""Minimum-jerk motion from the present pose to mid pose, which gait and excitation begin with."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from gaitd_names import RefusalCode

from daemon.config.settings import Gait
from daemon.core.core_config import CoreConfig
from daemon.core.exercises.exercise import LegStart
from daemon.core.motion.gait_shape import Pair, angles_of_joints, gait_angles, joints_of_angles
from daemon.ipc.report import Refusal
from observer.mechanism.mechanism import WorkspaceError, singularity_ratio
from observer.mechanism.parameters import LegParameters

PEAK_OF_MINIMUM_JERK: Final = 1.875
"""Ratio of peak speed to mean speed of a minimum-jerk motion."""
APPROACH_MIN_S: Final = 0.5
WAY_POINTS: Final = 50


@dataclass(frozen=True, slots=True)
class Approach:
    """A minimum-jerk motion from one pose to another, in hip and knee angles."""

    start_angles: Pair
    end_angles: Pair
    duration_s: float

    def joints(self, leg: tuple[float, ...], elapsed_s: float) -> Pair:
        """Hip angle and slide position after a time: rad, m."""
        part = minimum_jerk(elapsed_s / self.duration_s)
        (h0, k0), (h1, k1) = self.start_angles, self.end_angles
        return joints_of_angles(leg, (h0 + part * (h1 - h0), k0 + part * (k1 - k0)))


def minimum_jerk(x: float) -> float:
    """Share of a minimum-jerk motion that is done at a share `x` of its time."""
    x = min(max(x, 0.0), 1.0)
    return x**3 * (10 + x * (6 * x - 15))


def approach(leg: LegParameters, gait: Gait, start: Pair, end_angles: Pair) -> Approach:
    """Approach from joint position `start` to hip and knee angles, within the configured speeds."""
    end = joints_of_angles(leg, end_angles)
    duration_s = PEAK_OF_MINIMUM_JERK * max(
        abs(end[0] - start[0]) / gait.hip.approach_rad_per_s,
        abs(end[1] - start[1]) / gait.slide.approach_m_per_s,
    )
    return Approach(angles_of_joints(leg, start), end_angles, max(duration_s, APPROACH_MIN_S))


def is_clear(leg: LegParameters, way: Approach, smallest_ratio: float) -> bool:
    """True if every pose on the way is reachable and above `smallest_ratio` of singularity."""
    try:
        poses = [way.joints(leg, way.duration_s * k / WAY_POINTS) for k in range(1, WAY_POINTS + 1)]
    except WorkspaceError:
        return False
    return all(singularity_ratio(leg, np.array(pose)) > smallest_ratio for pose in poses)


def to_mid_pose(legs: Sequence[LegStart], config: CoreConfig) -> list[Approach]:
    """Approaches to mid pose, with one duration for all legs.

    Legs that arrive together keep the phase offset of half a stride.
    """
    ways = [
        approach(leg.parameters, config.gait, leg.pose, gait_angles(leg.shape, 0.0, 0.0))
        for leg in legs
    ]
    duration_s = max(way.duration_s for way in ways)
    return [replace(way, duration_s=duration_s) for way in ways]


def blocked(legs: Sequence[LegStart], config: CoreConfig) -> Refusal | None:
    """The reason why the way to mid pose is not clear; None if it is."""
    smallest_ratio = config.thresholds.singularity_stop_ratio
    for leg, way in zip(legs, to_mid_pose(legs, config), strict=True):
        if not is_clear(leg.parameters, way, smallest_ratio):
            return Refusal(RefusalCode.NO_CLEAR_WAY, leg.name)
    return None
