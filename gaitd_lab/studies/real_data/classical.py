"""Estimators of an external force that are no Kalman filters, for one axis of constant mass.

Both know the same mass and the same static friction law, eq. (13), get the same samples, and are
causal: the estimate of a row uses that row and those before it.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt

from observer.mechanism.friction import FrictionParameters, static_friction_of

Values = NDArray[np.float64]


class Axis(NamedTuple):
    """Knowledge of both estimators."""

    mass_kg: float
    law: FrictionParameters
    step_s: float

    def friction_n(self, velocity: Values) -> Values:
        """Static friction at each velocity, eq. (13)."""
        return np.array([static_friction_of(self.law, float(one)) for one in velocity])


Estimator = Callable[[Axis, Values, Values, float], Values]
"""Takes axis, positions [m], forces [N] and bandwidth [rad/s]; returns N. Arrays: shape (n,)."""


def inverse_dynamics(
    axis: Axis, position_m: Values, force_n: Values, bandwidth_rad_per_s: float
) -> Values:
    """Mass times the second difference, friction at the central one, less the drive's force.

    Smoothed by a Butterworth filter of second order. The differences are those of the row before.
    """
    count = len(position_m)
    raw = np.zeros(count)
    velocity = (position_m[2:] - position_m[:-2]) / (2.0 * axis.step_s)
    acceleration = np.diff(position_m, n=2) / axis.step_s**2
    about = 0.5 * (force_n[1:-1] + force_n[2:])
    raw[2:] = axis.mass_kg * acceleration + axis.friction_n(velocity) - about
    low_pass = butter(2, bandwidth_rad_per_s, fs=2.0 * np.pi / axis.step_s, output="sos")
    return np.asarray(sosfilt(np.asarray(low_pass), raw), dtype=np.float64)


def momentum_observer(
    axis: Axis, position_m: Values, force_n: Values, bandwidth_rad_per_s: float
) -> Values:
    """De Luca's observer of the generalised momentum p, with r = K (p - integral of what acts).

    Its gain K is the bandwidth: r follows a force with a lag of first order. Velocity is the
    difference of positions over the last row, and so is the force that belongs to it.

    Source: A. De Luca, R. Mattone, "Sensorless robot collision detection and hybrid force/motion
    control", ICRA 2005, eq. (9) to (11).
    """
    step_s = axis.step_s
    velocity = np.diff(position_m, prepend=position_m[0]) / step_s
    friction = axis.friction_n(velocity)
    residual = np.zeros(len(position_m))
    # Exact for a force that is constant over a row.
    gain_per_s = -np.expm1(-bandwidth_rad_per_s * step_s) / step_s
    integral = axis.mass_kg * velocity[1]
    for row in range(2, len(position_m)):
        # Between the middles of two rows half of either row's force and friction acts.
        acting = 0.5 * (force_n[row - 1] + force_n[row] - friction[row - 1] - friction[row])
        integral += step_s * (acting + residual[row - 1])
        residual[row] = gain_per_s * (axis.mass_kg * velocity[row] - integral)
    return residual
