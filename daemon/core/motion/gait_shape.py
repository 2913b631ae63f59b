"""The periodic shape of the gait, and the poses of a leg as joints and as hip and knee angles.

Poses are planned as hip and knee angles: the knee stays flexed on the way, while a straight line in
hip angle and slide position can cross the stretched leg. Phases are in strides.
"""

import cmath
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from daemon.config.settings import Gait
from observer.mechanism.mechanism import gravity, knee_angle, slide_position_for_knee
from observer.mechanism.parameters import LegParameters

Pair = tuple[float, float]
"""Hip and slide in joint units, or hip and knee in rad where the name says angles."""


class GaitShape(NamedTuple):
    """The periodic reference as Fourier series in rad: mean, and a - ib of a cos + b sin."""

    hip_mean_rad: float
    hip_harmonics_rad: tuple[complex, ...]
    """Highest harmonic first, in the order of Horner's rule."""
    knee_mean_rad: float
    knee_harmonics_rad: tuple[complex, ...]


def gait_shape(gait: Gait) -> GaitShape:
    """The gait shape from the settings of [gait], in rad."""
    return GaitShape(
        math.radians(gait.hip.mean_deg),
        _harmonics(gait.hip.harmonics_deg),
        math.radians(gait.knee.mean_deg),
        _harmonics(gait.knee.harmonics_deg),
    )


def _harmonics(cosines_and_sines_deg: Sequence[Sequence[float]]) -> tuple[complex, ...]:
    return tuple(
        complex(math.radians(a), -math.radians(b)) for a, b in reversed(cosines_and_sines_deg)
    )


def gait_angles(shape: GaitShape, phase: float, amplitude_ratio: float) -> Pair:
    """Hip and knee angle in rad at a phase in strides, scaled about the mean pose."""
    turn = cmath.rect(1.0, 2 * math.pi * phase)
    return (
        shape.hip_mean_rad + amplitude_ratio * _series(shape.hip_harmonics_rad, turn),
        shape.knee_mean_rad + amplitude_ratio * _series(shape.knee_harmonics_rad, turn),
    )


def _series(harmonics: tuple[complex, ...], turn: complex) -> float:
    value = 0j
    for harmonic in harmonics:
        value = (value + harmonic) * turn
    return value.real


def joints_of_angles(leg: tuple[float, ...], angles: Pair) -> Pair:
    """Hip angle and slide position for a hip and a knee angle."""
    return angles[0], slide_position_for_knee(leg, angles[0], angles[1])


def angles_of_joints(leg: LegParameters, joints: Pair) -> Pair:
    """Hip and knee angle for a hip angle and a slide position."""
    return joints[0], knee_angle(leg, np.array(joints))


def load_at(leg: LegParameters, joints: Pair) -> Pair:
    """g(q) in N·m and N: the efforts that hold a pose against weight and springs."""
    load = gravity(leg, np.array(joints))
    return float(load[0]), float(load[1])
