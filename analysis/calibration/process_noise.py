"""Noise of the observer, from an empty machine: process noise, and how wrong the law is.

The maximum of the likelihood contains the noise of effort and friction. In the observer an effort
of standard deviation f changes the velocity by f dt / inertia in a step, and the position by half
of that times dt. The filter of the likelihood has no patient; the observer's patient adds to the
innovations that it expects. One factor on all of this noise makes up for that: with it the
observer's mean NIS over the fitted rows is the number of axes that moved, as it must be.

What the law of friction does not explain is small in steady motion and large where the axis
reverses. The estimated patient, who is not there, shows it: where his error exceeds the observer's
sigma near reversals, the law is uncertain by the rest (`law_variance`).

The noise of the patient stays the file's: an empty machine says nothing about it.
"""

import math
from typing import Any, Final

import numpy as np
from scipy.optimize import minimize_scalar, root_scalar

from analysis.calibration.motion import Motion
from analysis.calibration.quantities import NOISE, Vector
from analysis.calibration.start import extent
from analysis.recording import RecordingError
from analysis.replay import filter_setup
from daemon.config.edits import replaced
from daemon.config.robot import friction_parameters, leg_parameters
from daemon.config.settings import Robot
from observer.filter.leg_model import STEP_S
from observer.filter.status import Status, Validity
from observer.mechanism.friction import law_variance
from observer.mechanism.linkage import dynamics
from observer.offline.batch import Columns, run

KEYS: Final = (
    (
        "hip.process_angle_rad",
        "hip.process_velocity_rad_per_s",
        "hip.process_friction_nm",
    ),
    (
        "slide.process_position_m",
        "slide.process_velocity_m_per_s",
        "slide.process_friction_n",
    ),
)
"""Keys of [observer], by axis."""
LAW_KEYS: Final = ("hip.law_nm", "slide.law_n")
LAW_ROWS_MIN: Final = 30
"""Rows near reversals; with fewer the uncertainty of the law stays the file's."""
FACTOR_MAX: Final = 30.0
FACTOR_TOLERANCE: Final = 1e-3


def process_noise(robot: Robot, motion: Motion, natural: Vector) -> dict[str, float]:
    """Return the process noise of each axis that moves, by key of [observer].

    Args:
        robot: with the calibrated values.
        motion: the recording that was fitted; the rows held out of it are not used.
        natural: the calibrated values with the noise of effort and friction.

    Raises:
        RecordingError: no axis moves, or the noise of 30 times the likelihood's is not enough.
    """
    axes = _moved(motion)
    if not axes:
        raise RecordingError("no axis moved enough to estimate the observer's process noise")
    position = motion.position.copy()
    for axis in range(2):
        if axis not in axes:  # its innovations are 0, so that NIS is that of the other axis
            position[:, axis] = np.nanmean(position[:, axis])
    columns = Columns(motion.time_s, position, motion.effort)
    likely = _likely(robot, motion, natural, axes)

    def surplus(log_factor: float) -> float:
        scaled = {key: math.exp(log_factor) * std for key, std in likely.items()}
        made = run(filter_setup(with_process_noise(robot, scaled)), columns)
        rows = ~motion.held_out & motion.settled & np.isfinite(made.nis)
        return float(np.mean(made.nis[rows & ((made.status & Status.GATED) == 0)])) - len(axes)

    most = math.log(FACTOR_MAX)
    if surplus(most) > 0.0:
        raise RecordingError(
            f"with {FACTOR_MAX:g} times the process noise of the likelihood the observer's mean "
            f"NIS is still above {len(axes)}: something else than noise acts in this recording"
        )
    if surplus(-most) < 0.0:
        factor = 1.0  # the patient's own noise exceeds it by far
    else:
        found = root_scalar(surplus, bracket=(-most, most), xtol=FACTOR_TOLERANCE)
        factor = math.exp(found.root)
    return {key: factor * std for key, std in likely.items()}


def law_uncertainty(robot: Robot, motion: Motion) -> dict[str, float]:
    """Return the uncertainty of the friction law of each axis that moves, by key of [observer].

    Args:
        robot: with the calibrated values and process noise.
        motion: the recording that was fitted; the rows held out of it are not used.
    """
    certain = with_process_noise(robot, dict.fromkeys(LAW_KEYS, 0.0))
    columns = Columns(motion.time_s, motion.position, motion.effort)
    made = run(filter_setup(certain), columns)
    found: dict[str, float] = {}
    for axis in _moved(motion):
        law, patient = friction_parameters(robot)[axis], 6 + axis
        share = np.array([law_variance(law, 1.0, float(v)) for v in motion.velocity[:, axis]])
        rows = ~motion.held_out & motion.settled & (share > 0.25)
        rows &= made.validity[:, axis] == Validity.OK
        if np.count_nonzero(rows) >= LAW_ROWS_MIN:
            error, std = made.state[rows, patient], made.std[rows, patient]
            likeliest = _likeliest(error, std, share[rows], law.stribeck)
            # Errors of one reversal are one sample: a deviation found from n of them is itself
            # uncertain by this ratio.
            count = int(np.count_nonzero(np.diff(np.flatnonzero(rows)) > 1)) + 1
            found[LAW_KEYS[axis]] = likeliest * (1.0 + 1.0 / math.sqrt(2.0 * count))
    return found


def _likeliest(error: Vector, std: Vector, share: Vector, most: float) -> float:
    """Return the u in 0..most with which errors of variance std^2 + share u^2 are most likely."""

    def loss(uncertainty: float) -> float:
        variance = std**2 + share * uncertainty**2
        return float(np.sum(np.log(variance) + error**2 / variance))

    made: Any = minimize_scalar(loss, bounds=(0.0, most), method="bounded")
    return float(made.x) if made.fun < loss(0.0) else 0.0


def _moved(motion: Motion) -> list[int]:
    return [axis for axis in range(2) if extent(motion, axis).enough(axis)]


def _likely(robot: Robot, motion: Motion, natural: Vector, axes: list[int]) -> dict[str, float]:
    """Noise of the likelihood's maximum as that of the observer's states, per STEP_S."""
    hip_rad, slide_m = np.mean(motion.smooth[:, :2], axis=0).tolist()
    matrix = dynamics(leg_parameters(robot), hip_rad, slide_m, 0.0, 0.0, 0.0)
    made: dict[str, float] = {}
    for axis in axes:
        effort, friction = natural[NOISE + 2 + axis], natural[NOISE + 4 + axis]
        velocity = float(effort) * STEP_S / (matrix.m11 if axis == 0 else matrix.m22)
        values = (0.5 * velocity * STEP_S, velocity, float(friction))
        made |= dict(zip(KEYS[axis], values, strict=True))
    return made


def with_process_noise(robot: Robot, noise: dict[str, float]) -> Robot:
    """Return the robot with other process noise, by key of [observer]."""
    return replaced(robot, {f"observer.{key}": std for key, std in noise.items()})
