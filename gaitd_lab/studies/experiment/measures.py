"""The experiment of the paper's Figs. 4 and 5: recorded signals, true values, and the figures.

The empty machine is moved by torque alone, and an artificial disturbance is subtracted from the
efforts given to the observer: seen = exerted - d_art. The observer must find +d_art as the patient,
and the plant's own friction as friction.
"""

import math
from dataclasses import dataclass, fields
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from daemon.config.settings import Excite
from observer.filter.leg_observer import Setup
from observer.filter.status import Validity
from observer.offline import batch
from observer.offline.batch import BatchEstimates, Columns

Values = NDArray[np.float64]
Flags = NDArray[np.bool_]
Number = float | None
"""None where there is none."""

START_S: Final = 0.5
"""Excluded time: torque has just begun, and the pose still depends on the approach."""
PEAK_MIN_RAD_PER_S: Final = 0.05
"""Below this speed the hip has not broken loose, and there is no peak to compare."""
LAG_MAX_SAMPLES: Final = 4
REACHED_SHARE: Final = 0.9
CROSS_S: Final = 0.3
"""Time after a step of the other axis' disturbance."""
LASTING_SAMPLES: Final = 10
"""A disturbance is found when the estimate has stayed near it for this many samples."""
ONSET_SAMPLES: Final = 5
"""Motion has begun when the gate has been open for this many samples."""


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
    """Shape (n, 2): true mean effort of the drives over the cycle."""

    @property
    def derivative(self) -> Values:
        """Shape (n, 2): differences of measured positions over time, what the paper compares."""
        steps = np.diff(self.measured, axis=0) / np.diff(self.time_s)[:, None]
        return np.vstack((np.full((1, 2), np.nan), steps))

    def between(self, begin_s: float, end_s: float) -> "Run":
        """Return the cycles of a stretch of time."""
        rows = (self.time_s >= begin_s) & (self.time_s < end_s)
        return Run(*(getattr(self, field.name)[rows] for field in fields(self)))


class Marks(NamedTuple):
    """Times of the scenario's events; NaN for absent ones."""

    step_s: float
    """Step of the hip torque, from rest."""
    step_end_s: float
    onset_s: float
    """Start of the slide's disturbance, at rest."""
    offset_s: float
    """End of the slide's disturbance, in motion."""
    sine_s: float
    """Start of the hip's disturbance."""


class Row(NamedTuple):
    """One line of the table; None where the run has no value."""

    name: str
    hip: Number
    """Value in `hip_unit`; for both axes together, or one only, the other's unit is empty."""
    slide: Number
    """Value in `slide_unit`."""
    hip_unit: str
    slide_unit: str


def marks(scenario: Excite) -> Marks:
    """Times of an excite scenario like the paper's."""
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


class Peak(NamedTuple):
    """The largest hip velocity after the step."""

    true_rad_per_s: float
    estimated_rad_per_s: float
    lag_count: float
    """Delay of the estimate in samples, from the best-fitting shift; resolution a tenth."""

    @property
    def difference_ratio(self) -> float:
        """Relative difference of the estimated peak from the true one."""
        return self.estimated_rad_per_s / self.true_rad_per_s - 1.0


def peak(run: Run, marks: Marks) -> Peak | None:
    """Find the velocity's first peak after the hip torque's step; None without one."""
    step = run.between(marks.step_s, marks.step_end_s)
    if len(step.time_s) < 4 * LAG_MAX_SAMPLES or run.time_s[-1] < marks.step_end_s:
        return None
    true, estimate = step.true_velocity[:, 0], step.state[:, 2]
    if true.max() < PEAK_MIN_RAD_PER_S:
        return None
    return Peak(float(true.max()), float(estimate.max()), lag(true, estimate))


def lag(true: Values, estimate: Values) -> float:
    """Delay of `estimate` in samples: the minimum of the squared difference."""
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
    """Times at which the slide's disturbance, applied at rest, reached the estimate; seconds."""

    onset_s: float
    """Onset of the disturbance, since the scenario began."""
    motion_s: float
    """Time from its onset to the onset of motion; 0 if the slide moved already."""
    reached_s: float
    """Time from its onset until nine tenths of it are in the estimate and stay there."""

    @property
    def after_motion_s(self) -> float:
        """Time from the onset of motion; negative if it was found before the gate was open."""
        return self.reached_s - self.motion_s


def transfer(run: Run, marks: Marks, open_gate: Flags) -> Transfer | None:
    """Transfer of the slide's disturbance; None if the run ends before it, or it is never found."""
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
    """Find where a flag rises, or is set, and stays set for `count` samples."""
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
    """Compute the largest effect of one axis' disturbance on the other's estimate: N·m and N.

    Method: the recorded motion is replayed with and without the other axis' disturbance in the
        efforts: the
    difference has no noise. The difference counts where the axis moves and both replays have a
    valid split: for the hip in CROSS_S after the slide's disturbance goes, for the slide while the
    hip's sine lasts.

    Args:
        run: as played.
        marks: times of its scenario.
        setup: the observer's arguments.
    """
    whole = _replayed(run, setup, (1.0, 1.0))
    gone = (run.time_s >= marks.offset_s) & (run.time_s < marks.offset_s + CROSS_S)
    spans = gone, run.time_s >= marks.sine_s
    hip, slide = (
        largest(_change(whole, _replayed(run, setup, kept), axis, spans[axis], 6 + axis))
        for axis, kept in enumerate(((1.0, 0.0), (0.0, 1.0)))
    )
    return hip, slide


def own_effect(run: Run, marks: Marks, setup: Setup) -> tuple[float | None, float | None]:
    """Compute how an axis' own disturbance changes its estimated friction: rms, N·m and N.

    Method and rows as in `cross_talk`, from the start of the disturbance to the end of the run.
    """
    whole = _replayed(run, setup, (1.0, 1.0))
    hip, slide = (
        rms(_change(whole, _replayed(run, setup, kept), axis, run.time_s >= begin_s, 4 + axis))
        for axis, (kept, begin_s) in enumerate(
            (((0.0, 1.0), marks.sine_s), ((1.0, 0.0), marks.onset_s))
        )
    )
    return hip, slide


def _replayed(run: Run, setup: Setup, kept: tuple[float, float]) -> BatchEstimates:
    """Run the observer over the run, with the given share of each axis' disturbance."""
    seen = run.exerted - run.artificial * np.array(kept)
    return batch.run(setup, Columns(run.time_s, run.measured, seen))


def _change(
    one: BatchEstimates, other: BatchEstimates, axis: int, span: Flags, state: int
) -> Values:
    shown = (one.validity[:, axis] == Validity.OK) & (other.validity[:, axis] == Validity.OK)
    return (one.state[:, state] - other.state[:, state])[span & shown]


def settled_s(run: Run, axis: int, open_gate: Flags, tolerance: float) -> float | None:
    """Seconds from an onset of motion until friction's error stays below; median of the onsets."""
    near = np.abs(run.state[:, 4 + axis] - run.true_friction[:, axis]) <= tolerance
    onsets = np.flatnonzero(~open_gate[:-1] & open_gate[1:]) + 1
    lasting = _lasting(near, ONSET_SAMPLES)
    settled = [
        run.time_s[lasting[lasting >= onset][0]] - run.time_s[onset]
        for onset in onsets
        if open_gate[onset : onset + ONSET_SAMPLES].all() and (lasting >= onset).any()
    ]
    return float(np.median(settled)) if settled else None


def largest(values: Values) -> float | None:
    """Largest size; None without values."""
    return float(np.abs(values).max()) if len(values) else None


def rms(values: Values) -> float | None:
    """Root mean square; None without values."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else None


def covered(error: Values, std: Values) -> float | None:
    """Share of the errors within three of their own standard deviations; None without values."""
    return float(np.mean(np.abs(error) <= 3 * std)) if len(error) else None
