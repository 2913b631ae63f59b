"""Strides: the patient's work in each of them, from the smoothed estimate.

A stride begins where the hip's angle rises through its slow mean (towards flexion), after it has
been lower by SWING_RAD; it counts if it was higher by SWING_RAD in between, and if its duration is
that of a stride. So a leg at rest, or one that trembles, makes none.

What does not count: samples of an axis while its split is not
observable (at rest, or after a push), samples that were lost or rejected, and longer steps.
`coverage_ratio` gives the missing share.

Sigma of a figure comes from the smoothed covariance. Errors of neighbouring samples are correlated
for about CORRELATION_S; a sum over a stride then has the variance sum(sigma^2 dt) 2 CORRELATION_S.
What does not count is missing from a sum with one sign, so sigma also contains all of it: the way
of the axis meanwhile, times an effort as large as the largest of the stride, or as the estimate of
that sample, plus the sample's sigma. At rest that is close to zero.

The error of a considered parameter (`filter/considered.py`) is the same in every sample: its share
of a sum is added up with its sign, and only then squared, over both axes where it is one of both.

A stride with a BAD sample of an axis has no figures of it: numbers of a BAD axis bound nothing, and
it is the strongest efforts that make an estimate inconsistent.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.filter.considered import VARIANTS_MAX
from observer.filter.status import Status, Validity
from observer.jit import kernel
from observer.offline.batch import BatchEstimates, Columns
from observer.smoother import SMOOTH_COVARIANCE, SMOOTH_CYCLE_DATA, SMOOTH_UNSURE

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Cube = NDArray[np.float64]

SWING_RAD: Final = math.radians(3.0)
"""Least swing of the hip to either side of its mean."""
MEAN_S: Final = 4.0
"""Time constant of the slow mean."""
DURATION_MIN_S: Final = 0.7
DURATION_MAX_S: Final = 15.0
GAP_MAX_S: Final = 1.0
"""Without an estimate for this long, the stride is discarded."""
STEP_MAX_S: Final = 0.03
"""The sample of a longer step, a gap, does not count; a crossing divides it between the strides."""
SLOW_RATIO: Final = 0.1
"""Share of the highest speed of a stride below which an effort that does not count has no direction
either: the axis turns."""
CORRELATION_S: Final = 0.06
WORK_MIN_J: Final = 0.5
"""Positive work of patient and drive together; below it no share is given."""

# Notes that the smoother stores with each cycle, and columns of the buffer.
DATA_DT_S, DATA_EFFORT, DATA_STATUS, DATA_VALIDITY = 0, 1, 3, 4
DT, HIP = 0, 1
SPEED, PATIENT, EFFORT, KNOWN = 2, 4, 6, 8
"""Pairs of hip and slide, like the following ones. KNOWN: 1 counts, 0 does not, -1 is BAD."""
PATIENT_VARIANCE, SPEED_VARIANCE, SHARED = 10, 12, 14
"""SHARED: covariance of patient and speed."""
UNSURE: Final = 16
"""Error of the patient's effort by each considered parameter: hip, slide of the first, ..."""
COLUMNS: Final = UNSURE + 2 * VARIANTS_MAX
ROWS_MAX: Final = 2000
BLOCK_ROWS: Final = 10_000

# Figures of an axis as the kernel writes them; a standard deviation is two places after a work,
# one behind the others.
W_POS, W_NEG, W_POS_STD, W_NEG_STD = 0, 1, 2, 3
MEAN, MEAN_STD, PEAK, PEAK_STD, POWER_PEAK, POWER_PEAK_STD = 4, 5, 6, 7, 8, 9
DRIVE, COVERED = 10, 11
FIGURES: Final = 12
OF_POSITIVE, OF_NEGATIVE, OF_MEAN, OF_WORK = 0, 1, 2, 3
"""Sums over a stride whose error by each considered parameter is kept: both works, the mean effort,
and the sum of both works, in which an error may cancel itself."""
SUMS: Final = 4


class AxisStride(NamedTuple):
    """Figures of the patient on one axis in one stride. Efforts in N m or N.

    All but `coverage_ratio` are NaN, and shares None, if a sample of the axis was BAD.
    """

    work_positive_j: float
    """Work with the motion."""
    work_positive_j_std: float
    work_negative_j: float
    """Work against the motion; not positive."""
    work_negative_j_std: float
    assist_mean: float
    """Effort signed by the direction of motion, mean over the samples that count."""
    assist_mean_std: float
    assist_peak: float
    assist_peak_std: float
    power_mean_w: float
    power_mean_w_std: float
    power_peak_w: float
    """Largest absolute value, with its sign."""
    power_peak_w_std: float
    share_ratio: float | None
    """Patient's positive work over that of patient and drive, both over the samples that count;
    None where it is close to zero."""
    share_ratio_std: float | None
    coverage_ratio: float
    """Share of the stride's time with a known patient effort."""


class Stride(NamedTuple):
    """One stride of one leg."""

    duration_s: float
    cadence_hz: float
    sample_count: int
    hip: AxisStride
    slide: AxisStride
    work_positive_j: float
    """Sum of both axes."""
    work_positive_j_std: float
    work_negative_j: float
    work_negative_j_std: float
    share_ratio: float | None
    share_ratio_std: float | None
    status: Status
    """All status bits of its samples."""
    baseline_subtracted: bool
    """True if a passive baseline was taken off the estimate."""


class StrideCounter:
    """Divides the smoothed samples of one leg into strides."""

    def __init__(self) -> None:
        """Wait for the first stride to begin."""
        self._rows = np.zeros((ROWS_MAX, COLUMNS))
        self._last = np.zeros((ROWS_MAX, COLUMNS))
        self._figures = np.zeros((2, FIGURES))
        self._errors = np.zeros((2, SUMS, VARIANTS_MAX))
        self._restart()

    def add(self, sample: Sequence[float] | Vector) -> Stride | None:
        """Add one smoothed sample, in order of time; return the stride that it completes, or None.

        Args:
            sample: `smoother.smoothed`'s result (SMOOTH_SIZE), with the notes of `cycle_data_of`.
        """
        dt_s = step_s = sample[SMOOTH_CYCLE_DATA + DATA_DT_S]
        hip_rad = sample[0]
        if not (math.isfinite(hip_rad) and 0.0 <= dt_s <= GAP_MAX_S):
            self._restart()
            return None
        if math.isnan(self._mean_rad):
            self._mean_rad = self._last_rad = hip_rad
        self._mean_rad += (hip_rad - self._mean_rad) * min(dt_s / MEAN_S, 1.0)
        begins = self._was_low and self._last_rad <= self._mean_rad < hip_rad
        self._was_high = self._was_high or hip_rad > self._mean_rad + SWING_RAD
        if begins and dt_s > STEP_MAX_S:
            before_s = dt_s * (self._mean_rad - self._last_rad) / (hip_rad - self._last_rad)
            self._end_in_gap(sample, before_s)
            dt_s -= before_s
        self._last_rad = hip_rad
        done = self._complete() if begins else None
        if begins:
            self._rows, self._last = self._last, self._rows
            self._begin()
        self._was_low = self._was_low or hip_rad < self._mean_rad - SWING_RAD
        if self._count >= 0:
            self._add_row(sample, dt_s, counts=step_s <= STEP_MAX_S)
        return done

    @property
    def completed(self) -> Matrix:
        """Samples of the stride that `add` has just completed; columns as named above."""
        return self._last[: self._completed]

    def warm_up(self) -> None:
        """Compile, or load from the cache, the kernels of `add`; changes no state."""
        rows, figures = np.ones((2, COLUMNS)), np.zeros_like(self._figures)
        _measure(rows, figures, np.zeros_like(self._errors))

    def _restart(self) -> None:
        self._mean_rad = self._last_rad = math.nan
        self._completed = 0
        self._begin()
        self._count = -1

    def _begin(self) -> None:
        self._count, self._unsampled = 0, 0
        self._duration_s = self._blind_s = 0.0
        self._was_low = self._was_high = False
        self._status_bits = 0

    def _end_in_gap(self, sample: Sequence[float] | Vector, dt_s: float) -> None:
        """Add the part of a gap before the cut; its sample belongs to the next stride."""
        if self._count >= 0:
            self._add_row(sample, dt_s, counts=False)
            self._unsampled += 1

    def _add_row(self, sample: Sequence[float] | Vector, dt_s: float, *, counts: bool) -> None:
        data = sample[SMOOTH_CYCLE_DATA:]
        validity = data[DATA_VALIDITY : DATA_VALIDITY + 2]
        self._duration_s += dt_s
        self._blind_s = self._blind_s + dt_s if Validity.BAD in validity else 0.0
        too_long = self._duration_s > DURATION_MAX_S or self._blind_s > GAP_MAX_S
        if self._count >= ROWS_MAX or too_long:
            self._restart()
            return
        status = int(data[DATA_STATUS])
        measured = not status & Status.PREDICT_ONLY.value
        row = self._rows[self._count]
        row[DT], row[HIP] = dt_s, sample[0]
        for axis in range(2):
            speed, patient = 2 + axis, 6 + axis
            row[SPEED + axis], row[PATIENT + axis] = sample[speed], sample[patient]
            row[EFFORT + axis] = data[DATA_EFFORT + axis]
            row[KNOWN + axis] = float(counts and measured and validity[axis] == Validity.OK)
            if validity[axis] == Validity.BAD:
                row[KNOWN + axis] = -1.0
            row[PATIENT_VARIANCE + axis] = sample[_packed(patient, patient)]
            row[SPEED_VARIANCE + axis] = sample[_packed(speed, speed)]
            row[SHARED + axis] = sample[_packed(patient, speed)]
        row[UNSURE:] = sample[SMOOTH_UNSURE:]
        self._count += 1
        self._status_bits |= status

    def _complete(self) -> Stride | None:
        self._completed = max(self._count, 0)
        if self._count < 1 or not self._was_high or self._duration_s < DURATION_MIN_S:
            return None
        _measure(self._rows[: self._count], self._figures, self._errors)
        of_axes, of_both = _spread(self._errors), _spread(self._errors.sum(axis=0))
        own = self._figures[:, [W_POS_STD, W_NEG_STD]].T.tolist()
        positive_std = math.hypot(*own[0], of_both[OF_POSITIVE])
        negative_std = math.hypot(*own[1], of_both[OF_NEGATIVE])
        hip, slide = (
            _axis(row, errors_std, self._duration_s)
            for row, errors_std in zip(self._figures.tolist(), of_axes, strict=True)
        )
        share, share_std = _share(
            hip.work_positive_j + slide.work_positive_j,
            positive_std,
            float(self._figures[0, DRIVE] + self._figures[1, DRIVE]),
        )
        return Stride(
            duration_s=self._duration_s,
            cadence_hz=1.0 / self._duration_s,
            sample_count=self._count - self._unsampled,
            hip=hip,
            slide=slide,
            work_positive_j=hip.work_positive_j + slide.work_positive_j,
            work_positive_j_std=positive_std,
            work_negative_j=hip.work_negative_j + slide.work_negative_j,
            work_negative_j_std=negative_std,
            share_ratio=share,
            share_ratio_std=share_std,
            status=Status(self._status_bits),
            baseline_subtracted=bool(self._status_bits & Status.BASELINE.value),
        )


def cycle_data_of(
    dt_s: float, effort: Sequence[float], status: int, validity: Sequence[int]
) -> tuple[float, ...]:
    """Data of a cycle that a stride needs besides its estimate; for `smoother.store`."""
    return (dt_s, effort[0], effort[1], float(status), float(validity[0]), float(validity[1]))


def _packed(row: int, column: int) -> int:
    return SMOOTH_COVARIANCE + row * (row + 1) // 2 + column


def _spread(errors: Matrix) -> list[Any]:
    """Standard deviations of sums from their errors by each considered parameter, the last axis."""
    spread: list[Any] = np.sqrt(np.square(errors).sum(axis=-1)).tolist()
    return spread


def _axis(figures: Sequence[float], errors_std: Sequence[float], duration_s: float) -> AxisStride:
    """Name the figures of an axis; `errors_std` are of its sums, by considered parameters alone."""
    positive_std = math.hypot(figures[W_POS_STD], errors_std[OF_POSITIVE])
    negative_std = math.hypot(figures[W_NEG_STD], errors_std[OF_NEGATIVE])
    mean_std = math.hypot(figures[MEAN_STD], errors_std[OF_MEAN])
    share, share_std = _share(figures[W_POS], positive_std, figures[DRIVE])
    work = figures[W_POS] + figures[W_NEG]
    work_std = math.hypot(figures[W_POS_STD], figures[W_NEG_STD], errors_std[OF_WORK])
    return AxisStride(
        work_positive_j=figures[W_POS],
        work_positive_j_std=positive_std,
        work_negative_j=figures[W_NEG],
        work_negative_j_std=negative_std,
        assist_mean=figures[MEAN],
        assist_mean_std=mean_std,
        assist_peak=figures[PEAK],
        assist_peak_std=figures[PEAK_STD],
        power_mean_w=work / duration_s,
        power_mean_w_std=work_std / duration_s,
        power_peak_w=figures[POWER_PEAK],
        power_peak_w_std=figures[POWER_PEAK_STD],
        share_ratio=share,
        share_ratio_std=share_std,
        coverage_ratio=figures[COVERED],
    )


def _share(patient_j: float, patient_j_std: float, drive_j: float) -> tuple[float | None, ...]:
    whole_j = patient_j + drive_j
    if math.isnan(whole_j) or whole_j < WORK_MIN_J:
        return None, None
    return patient_j / whole_j, patient_j_std * drive_j / (whole_j * whole_j)


@kernel
def _measure(rows: Matrix, figures: Matrix, errors: Cube) -> None:
    """Compute all figures of one stride, both axes.

    Args:
        rows: of the stride, columns as named above.
        figures: result, (2, FIGURES); standard deviations of sums without considered parameters.
        errors: result, (2, SUMS, VARIANTS_MAX): error of each sum by each considered parameter.
    """
    whole_s = 0.0
    for k in range(rows.shape[0]):
        whole_s += rows[k, DT]
    for axis in range(2):
        _measure_axis(rows, axis, whole_s, figures[axis], errors[axis])


@kernel
def _measure_axis(rows: Matrix, axis: int, whole_s: float, to: Vector, errors: Matrix) -> None:
    for i in range(FIGURES):
        to[i] = 0.0
    for i in range(SUMS):
        for j in range(VARIANTS_MAX):
            errors[i, j] = 0.0
    known_s = effort_variance = 0.0
    for k in range(rows.shape[0]):
        dt_s, speed = rows[k, DT], rows[k, SPEED + axis]
        if rows[k, KNOWN + axis] <= 0.0:
            continue
        known_s += dt_s
        to[DRIVE] += max(rows[k, EFFORT + axis] * speed, 0.0) * dt_s
        patient = rows[k, PATIENT + axis]
        if k > 0 and rows[k - 1, KNOWN + axis] > 0.0:
            # The effort of a row acts until the next one; speed is that of the row's own moment.
            patient = 0.5 * (patient + rows[k - 1, PATIENT + axis])
        of_parameters = 0.0
        for i in range(VARIANTS_MAX):
            of_parameters += rows[k, UNSURE + 2 * i + axis] ** 2
        variance = max(rows[k, PATIENT_VARIANCE + axis] - of_parameters, 0.0)
        power = patient * speed
        power_variance = speed * speed * variance
        power_variance += patient * patient * rows[k, SPEED_VARIANCE + axis]
        power_variance = max(power_variance + 2.0 * power * rows[k, SHARED + axis], 0.0)
        at = W_POS if power > 0.0 else W_NEG
        to[at] += power * dt_s
        to[at + 2] += 2.0 * CORRELATION_S * power_variance * dt_s
        for i in range(VARIANTS_MAX):
            impulse = rows[k, UNSURE + 2 * i + axis] * dt_s
            errors[OF_POSITIVE if power > 0.0 else OF_NEGATIVE, i] += impulse * speed
            errors[OF_MEAN, i] += math.copysign(1.0, speed) * impulse
            errors[OF_WORK, i] += impulse * speed
        assist = math.copysign(1.0, speed) * patient
        to[MEAN] += assist * dt_s
        effort_variance += 2.0 * CORRELATION_S * variance * dt_s
        if math.fabs(assist) > math.fabs(to[PEAK]):
            to[PEAK], to[PEAK_STD] = assist, math.sqrt(variance + of_parameters)
        if math.fabs(power) > math.fabs(to[POWER_PEAK]):
            to[POWER_PEAK] = power
            to[POWER_PEAK_STD] = math.sqrt(power_variance + speed * speed * of_parameters)
    to[W_POS_STD], to[W_NEG_STD] = math.sqrt(to[W_POS_STD]), math.sqrt(to[W_NEG_STD])
    if known_s > 0.0:
        to[MEAN] /= known_s
        to[MEAN_STD] = math.sqrt(effort_variance) / known_s
        for i in range(VARIANTS_MAX):
            errors[OF_MEAN, i] /= known_s
    _add_missing(rows, axis, known_s, to)
    to[COVERED] = known_s / whole_s


@kernel
def _add_missing(rows: Matrix, axis: int, known_s: float, to: Vector) -> None:
    """Add to each sigma what may be in the samples that do not count; NaN if one of them is BAD."""
    slow = 0.0
    for k in range(rows.shape[0]):
        slow = max(slow, SLOW_RATIO * math.fabs(rows[k, SPEED + axis]))
    work = power_peak = impulse = effort_peak = missing_s = 0.0
    for k in range(rows.shape[0]):
        if rows[k, KNOWN + axis] > 0.0:
            continue
        if rows[k, KNOWN + axis] < 0.0:
            for i in range(COVERED):
                to[i] = math.nan
            return
        dt_s, speed = rows[k, DT], math.fabs(rows[k, SPEED + axis])
        effort = max(math.fabs(rows[k, PATIENT + axis]), math.fabs(to[PEAK]))
        effort += math.sqrt(max(rows[k, PATIENT_VARIANCE + axis], 0.0))
        work += effort * speed * dt_s
        power_peak = max(power_peak, effort * speed)
        if speed > slow:
            effort_peak = max(effort_peak, effort)
            impulse += effort * dt_s
            missing_s += dt_s
    to[W_POS_STD] = math.hypot(to[W_POS_STD], work)
    to[W_NEG_STD] = math.hypot(to[W_NEG_STD], work)
    effort_peak = max(effort_peak - math.fabs(to[PEAK]), 0.0)
    to[PEAK_STD] = math.hypot(to[PEAK_STD], effort_peak)
    power_peak = max(power_peak - math.fabs(to[POWER_PEAK]), 0.0)
    to[POWER_PEAK_STD] = math.hypot(to[POWER_PEAK_STD], power_peak)
    if missing_s > 0.0:
        impulse += math.fabs(to[MEAN]) * missing_s
        to[MEAN_STD] = math.hypot(to[MEAN_STD], impulse / (known_s + missing_s))


def strides_of(smooth: BatchEstimates, columns: Columns) -> list[tuple[int, Stride]]:
    """Compute the strides of a smoothed recording, each with the row of its first sample.

    Args:
        smooth: from `smooth_batch.run_smoothed`.
        columns: the recording.
    """
    counter = StrideCounter()
    found: list[tuple[int, Stride]] = []
    for row, sample in enumerate(samples_of(smooth, columns)):
        stride = counter.add(sample)
        if stride is not None:
            found.append((row - stride.sample_count, stride))
    return found


def samples_of(smooth: BatchEstimates, columns: Columns) -> Iterator[list[float]]:
    """Rows of a smoothed recording as `StrideCounter.add` needs them."""
    steps_s = np.diff(columns.time_s, prepend=columns.time_s[:1])
    effort = np.nan_to_num(columns.effort)
    cycle_data = np.column_stack((steps_s, effort, smooth.status, smooth.validity))
    parts = (
        *(smooth.state, smooth.std, smooth.covariance, smooth.net, smooth.net_std),
        *(cycle_data, smooth.unsure),
    )
    for begin in range(0, len(steps_s), BLOCK_ROWS):
        block = slice(begin, begin + BLOCK_ROWS)
        yield from np.concatenate([part[block] for part in parts], axis=1).tolist()
