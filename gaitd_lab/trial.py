"""A trial: the inputs of an observer with the true values, and disturbances that can be added.

A trial comes from the virtual machine (`gaitd_lab.trials`) or from any simulation. The functions
here add disturbances of real machines to a recording: a ripple on the current, samples off their
time stamps, efforts a cycle late, glitches of an encoder. All take a seed and are reproducible bit
by bit.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from analysis.accuracy import moving
from analysis.recording import Recording
from daemon.config.robot import friction_parameters
from daemon.config.settings import Robot
from observer.filter.states import POSITION, VELOCITY

Values = NDArray[np.float64]
Flags = NDArray[np.bool_]
Pair = tuple[float, float]

JITTER_MAX_S: Final = 0.004
"""Largest distance of a sample from its stamp, which keeps the order of samples."""


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """n cycles; the rows of recording and truth belong together."""

    name: str
    recording: Recording
    """The observer's inputs."""
    truth: Values
    """Shape (n, 8) in the order and units of `observer.filter.states`; the patient's part holds the
    patient and any artificial disturbance, which the observer cannot tell from a patient."""
    robot: Robot
    """Robot of the service."""
    judged: Flags
    """Shape (n,): rows to compare: the motion without bring-up, approach and standstill after a
    stop; all rows of a rest."""
    ended: str
    """Why the service stopped early; empty if it did not."""

    def named(self, name: str) -> "Trial":
        """Return the trial under another name."""
        return replace(self, name=name)

    @property
    def moving(self) -> Flags:
        """True where the true gate of each axis is open, shape (n, 2)."""
        return moving(self.truth[:, VELOCITY], friction_parameters(self.robot))


def with_ripple(trial: Trial, ripple: Pair, seed: int) -> Trial:
    """Add ripple to efforts, as samples about the mean of their cycle.

    Args:
        trial: its efforts are means.
        ripple: standard deviations, N·m and N.
        seed: seed of the noise.
    """
    noise = np.random.default_rng(seed).normal(size=trial.recording.effort.shape)
    return replace(
        trial, recording=replace(trial.recording, effort=trial.recording.effort + noise * ripple)
    )


def with_late_efforts(trial: Trial, cycles: int) -> Trial:
    """Shift efforts so that they acted this many whole cycles later than their rows say.

    The last rows, for which no later effort is known, repeat the last one.
    """
    later = np.vstack(
        (trial.recording.effort[cycles:], np.repeat(trial.recording.effort[-1:], cycles, 0))
    )
    return replace(trial, recording=replace(trial.recording, effort=later))


def with_glitches(trial: Trial, interval_s: float, size: Pair, seed: int) -> Trial:
    """Add single wrong samples, alternating between the encoders.

    Args:
        trial: the trial to disturb.
        interval_s: mean time between two.
        size: smallest and largest glitch, rad; metres at the slide.
        seed: seed of times, sizes and signs.
    """
    random = np.random.default_rng(seed)
    position = trial.recording.position.copy()
    rows = np.flatnonzero(trial.judged)
    count = max(round(trial.recording.duration_s / interval_s), 1)
    hit = random.choice(rows, size=min(count, len(rows)), replace=False)
    height = np.exp(random.uniform(*np.log(size), size=len(hit))) * random.choice((-1, 1), len(hit))
    position[hit, np.arange(len(hit)) % 2] += height
    return replace(trial, recording=replace(trial.recording, position=position))


def with_jitter(trial: Trial, sigma_s: float, noise: Pair, quantum: Pair, seed: int) -> Trial:
    """Take samples off the grid, with their true times.

    Positions are those of the true motion at that time, with an encoder's noise and quanta; efforts
    are means between the new times. `on_the_grid` gives them the nominal time stamps.

    Args:
        trial: its recording is on a grid.
        sigma_s: standard deviation of a sample's time about its stamp.
        noise: standard deviations of the encoders, rad and m.
        quantum: resolution of the encoders, rad and m.
        seed: seed of times and noise.
    """
    random = np.random.default_rng(seed)
    time_s = trial.recording.time_s
    off_s = np.clip(random.normal(0.0, sigma_s, len(time_s)), -JITTER_MAX_S, JITTER_MAX_S)
    taken_s = np.clip(time_s + off_s, time_s[0], time_s[-1])
    taken_s[0], taken_s[-1] = time_s[0], time_s[-1]
    exact = CubicHermiteSpline(time_s, trial.truth[:, POSITION], trial.truth[:, VELOCITY])(taken_s)
    noisy = exact + random.normal(size=exact.shape) * noise
    recording = replace(
        trial.recording,
        time_s=taken_s,
        position=np.round(noisy / quantum) * quantum,
        effort=_means_between(trial.recording, taken_s),
    )
    truth = np.column_stack([np.interp(taken_s, time_s, column) for column in trial.truth.T])
    return replace(trial, recording=recording, truth=truth)


def on_the_grid(jittered: Trial, trial: Trial) -> Trial:
    """Replace the time stamps by those of the grid."""
    return replace(jittered, recording=replace(jittered.recording, time_s=trial.recording.time_s))


def _means_between(recording: Recording, taken_s: Values) -> Values:
    """Means of piecewise constant efforts between other times than those of the rows."""
    steps_s = np.diff(recording.time_s, prepend=recording.time_s[:1])
    means = np.empty_like(recording.effort)
    for axis in range(2):
        effort = np.nan_to_num(recording.effort[:, axis])
        impulse = np.interp(taken_s, recording.time_s, np.cumsum(effort * steps_s))
        means[1:, axis] = np.diff(impulse) / np.diff(taken_s)
    means[0] = recording.effort[0]
    return means
