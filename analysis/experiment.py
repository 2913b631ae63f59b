"""The experiment of the paper's Figs. 4 and 5: what was recorded, what was true, and the numbers.

The empty machine is moved by torque alone, and an artificial disturbance is taken off the efforts
that the observer sees: seen = exerted - d_art. The observer must find +d_art as the patient, and
the plant's own friction as friction.
"""

import math
from dataclasses import dataclass, fields
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from daemon.config.settings import Excite
from observer.filter.leg_observer import Setup
from observer.filter.status import Validity
from observer.mechanism.friction import STANDSTILL_GATE, FrictionParameters, gate_of
from observer.offline import batch
from observer.offline.batch import BatchEstimates, Columns

Values = NDArray[np.float64]
Flags = NDArray[np.bool_]
Number = float | None
"""None where there is none."""

START_S: Final = 0.5
"""Not judged: torque is new, and the pose of the approach is left."""
PEAK_MIN_RAD_PER_S: Final = 0.05
"""Slower, the hip has not broken loose, and there is no peak to compare."""
LAG_MAX_SAMPLES: Final = 4
REACHED_SHARE: Final = 0.9
CROSS_S: Final = 0.3
"""After a step of the other axis' disturbance."""
LASTING_SAMPLES: Final = 10
"""A disturbance is found when the estimate has stayed near it for so many."""
ONSET_SAMPLES: Final = 5
"""Motion has begun when the gate has been open for so many."""


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """n cycles of a played scenario; pairs are hip and slide: rad, N·m; m, N."""

    time_s: Values
    """Shape (n,), since the scenario began."""
    measured: Values
    """Shape (n, 2): positions given to the observer."""
    exerted: Values
    """Shape (n, 2): torque and force of the drives, as measured."""
    artificial: Values
    """Shape (n, 2): d_art; the observer sees exerted - artificial."""
    state: Values
    """Shape (n, 8), in the order of `observer.filter.states`."""
    std: Values
    """Shape (n, 8)."""
    net: Values
    """Shape (n, 2): patient minus friction."""
    net_std: Values
    """Shape (n, 2)."""
    nis: Values
    """Shape (n,)."""
    validity: NDArray[np.int64]
    """Shape (n, 2): observer.filter.status.Validity."""
    status: NDArray[np.int64]
    """Shape (n,): bits of observer.filter.status.Status."""
    true_position: Values
    """Shape (n, 2)."""
    true_velocity: Values
    """Shape (n, 2)."""
    true_friction: Values
    """Shape (n, 2)."""
    true_effort: Values
    """Shape (n, 2): mean of what the drives really exerted over the cycle."""

    @property
    def derivative(self) -> Values:
        """Shape (n, 2): differences of measured positions over time, what the paper compares."""
        steps = np.diff(self.measured, axis=0) / np.diff(self.time_s)[:, None]
        return np.vstack((np.full((1, 2), np.nan), steps))

    def between(self, begin_s: float, end_s: float) -> "Run":
        """The cycles of a stretch of time."""
        rows = (self.time_s >= begin_s) & (self.time_s < end_s)
        return Run(*(getattr(self, field.name)[rows] for field in fields(self)))


class Marks(NamedTuple):
    """When the scenario does what; NaN where it does not."""

    step_s: float
    """The hip torque's step, from rest."""
    step_end_s: float
    onset_s: float
    """The slide's disturbance comes, at rest."""
    offset_s: float
    """It goes, in motion."""
    sine_s: float
    """The hip's disturbance begins."""


class Row(NamedTuple):
    """One line of the table; None where the run does not say."""

    name: str
    hip: Number
    """In `hip_unit`."""
    slide: Number
    """In `slide_unit`."""
    hip_unit: str
    slide_unit: str
    target: str
    met: bool | None
    """None: no target, or not the kind of run that it is for."""


def marks(scenario: Excite) -> Marks:
    """Of an excite scenario like the paper's."""
    nan = math.nan
    steps = [one for one in scenario.torque if one.axis == "hip" and one.kind == "step"]
    comes = [one for one in scenario.artificial if one.axis == "slide" and one.kind == "step"]
    sines = [one for one in scenario.artificial if one.axis == "hip" and one.kind == "sine"]
    return Marks(
        steps[0].start_s if steps else nan,
        steps[0].end_s if steps else nan,
        comes[0].start_s if comes else nan,
        comes[0].end_s if comes else nan,
        sines[0].start_s if sines else nan,
    )


def moving(run: Run, frictions: tuple[FrictionParameters, FrictionParameters]) -> Flags:
    """Shape (n, 2): where the true speed opens the gate a(v) to more than a half."""
    return np.column_stack(
        [
            [gate_of(friction, float(speed)) >= STANDSTILL_GATE for speed in speeds]
            for friction, speeds in zip(frictions, run.true_velocity.T, strict=True)
        ]
    )


class Peak(NamedTuple):
    """The largest hip velocity after the step."""

    true_rad_per_s: float
    estimated_rad_per_s: float
    lag_count: float
    """Samples by which the estimate is late, from the shift that fits best; a tenth counts."""

    @property
    def difference_ratio(self) -> float:
        """Of the estimated peak to the true one."""
        return self.estimated_rad_per_s / self.true_rad_per_s - 1.0


def peak(run: Run, marks: Marks) -> Peak | None:
    """The velocity's first peak after the hip torque's step; None if the run does not have it."""
    step = run.between(marks.step_s, marks.step_end_s)
    if len(step.time_s) < 4 * LAG_MAX_SAMPLES or run.time_s[-1] < marks.step_end_s:
        return None
    true, estimate = step.true_velocity[:, 0], step.state[:, 2]
    if true.max() < PEAK_MIN_RAD_PER_S:
        return None
    return Peak(float(true.max()), float(estimate.max()), lag(true, estimate))


def lag(true: Values, estimate: Values) -> float:
    """Samples by which `estimate` is later than `true`: the bottom of the squared difference."""
    inner = slice(LAG_MAX_SAMPLES, len(true) - LAG_MAX_SAMPLES)
    shifts = range(-LAG_MAX_SAMPLES, LAG_MAX_SAMPLES + 1)
    costs = [
        float(np.sum((np.roll(true, shift)[inner] - estimate[inner]) ** 2)) for shift in shifts
    ]
    lowest = int(np.argmin(costs))
    if lowest in {0, len(costs) - 1}:
        return float(shifts[lowest])
    before, here, after = costs[lowest - 1 : lowest + 2]
    return shifts[lowest] + 0.5 * (before - after) / (before - 2 * here + after)


class Transfer(NamedTuple):
    """How the slide's disturbance, which came at rest, reached the estimate; seconds."""

    onset_s: float
    """Of the disturbance, since the scenario began."""
    motion_s: float
    """From its onset to the onset of motion; 0 if the slide moved already."""
    reached_s: float
    """From its onset until nine tenths of it are in the estimate and stay there."""

    @property
    def after_motion_s(self) -> float:
        """From the onset of motion; negative if it was seen before the gate was open."""
        return self.reached_s - self.motion_s


def transfer(run: Run, marks: Marks, open_gate: Flags) -> Transfer | None:
    """Of the slide's disturbance; None if the run does not reach it, or it is never found."""
    after = np.flatnonzero((run.time_s >= marks.onset_s - 0.05) & (run.artificial[:, 1] != 0))
    if not len(after):
        return None
    share = run.state[after, 7] / run.artificial[after, 1]
    reached = _lasting(share >= REACHED_SHARE, LASTING_SAMPLES)
    began = _lasting(open_gate[after, 1], ONSET_SAMPLES)
    if not len(reached) or not len(began):
        return None
    times = run.time_s[after]
    onset = float(times[0])
    return Transfer(onset, float(times[began[0]]) - onset, float(times[reached[0]]) - onset)


def _lasting(flags: Flags, count: int) -> NDArray[np.intp]:
    """Where a flag goes up, or is up, and stays so for `count` samples."""
    if len(flags) < count:
        return np.empty(0, dtype=np.intp)
    return np.flatnonzero(np.lib.stride_tricks.sliding_window_view(flags, count).all(axis=1))


def fall_s(run: Run, marks: Marks) -> float | None:
    """Seconds until nine tenths of the slide's disturbance have left the estimate again."""
    after = run.between(marks.offset_s, marks.offset_s + 1.0)
    before = run.between(marks.offset_s - 0.2, marks.offset_s)
    if len(after.time_s) < 50 or not len(before.time_s):
        return None
    size = float(before.artificial[-1, 1])
    gone = np.flatnonzero(after.state[:, 7] <= (1 - REACHED_SHARE) * size)
    return float(after.time_s[gone[0]] - marks.offset_s) if size > 0 and len(gone) else None


def cross_talk(run: Run, marks: Marks, setup: Setup) -> tuple[float | None, float | None]:
    """What one axis' disturbance does to the other's estimate, largest: N·m and N.

    The recorded motion is replayed with and without the other axis' disturbance in the efforts: the
    difference has no noise. It counts where the axis moves and both replays show its split: for the
    hip in CROSS_S after the slide's disturbance goes, for the slide while the hip's sine lasts.

    Args:
        run: as played.
        marks: of its scenario.
        setup: of the observer.
    """
    whole = _replayed(run, setup, (1.0, 1.0))
    gone = (run.time_s >= marks.offset_s) & (run.time_s < marks.offset_s + CROSS_S)
    spans = gone, run.time_s >= marks.sine_s
    hip, slide = (
        _largest(whole, _replayed(run, setup, kept), axis, spans[axis])
        for axis, kept in enumerate(((1.0, 0.0), (0.0, 1.0)))
    )
    return hip, slide


def _replayed(run: Run, setup: Setup, kept: tuple[float, float]) -> BatchEstimates:
    """The observer over the run, with so much of each axis' disturbance."""
    seen = run.exerted - run.artificial * np.array(kept)
    return batch.run(setup, Columns(run.time_s, run.measured, seen))


def _largest(one: BatchEstimates, other: BatchEstimates, axis: int, span: Flags) -> float | None:
    shown = (one.validity[:, axis] == Validity.OK) & (other.validity[:, axis] == Validity.OK)
    difference = np.abs(one.state[:, 6 + axis] - other.state[:, 6 + axis])[span & shown]
    return float(difference.max()) if len(difference) else None


def rms(values: Values) -> float | None:
    """Root mean square; None of nothing."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else None


def covered(error: Values, std: Values) -> float | None:
    """Share of the errors within three of their own standard deviations."""
    return float(np.mean(np.abs(error) <= 3 * std)) if len(error) else None
