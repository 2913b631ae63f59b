"""The passive baseline: what a minute of gait with a passive patient says of the machine's errors.

Leg mass, springs, friction and sensors never match their file exactly. A passive patient exerts
nothing, so what the observer takes for the patient then is the error of the file. It is explained
by the considered parameters (`filter/considered.py`): a linear regression of the estimate on the
error by each of them, with the file's uncertainties as prior. So a baseline holds at other
cadences, too, and what it has found of a parameter narrows sigma.

    y = sum theta_k e_k + r          y: mean smoothed estimate in one of BINS parts of the stride,
    theta ~ N(0, I)                  e_k: mean error by parameter k, in one of its deviations
    r ~ N(0, kept^2 + s^2 / strides) s: scatter from stride to stride

What repeats cannot be told from the machine: a patient who pushes in this minute is taken for an
error of a parameter. `kept` is what sigma keeps for that, and for what no parameter explains: at
least KEPT_MIN, at most the root mean square of what the regression has left. A push that only a
parameter far from its file explains gives no baseline.

Friction follows temperature and grease at a rate that is not known, so what is known of it fades:
its uncertainty grows with time, and is that of the file again FADE_S later. Masses, springs and
angles stay until another day, or another temperature of the drives: straps, pose and motor
constants are others then, so each parameter is less sure.
"""

from collections.abc import Sequence
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.filter.considered import Known, known_of
from observer.offline.batch import BatchEstimates, Columns
from observer.strides import (
    DT,
    HIP,
    KNOWN,
    PATIENT,
    PATIENT_VARIANCE,
    UNSURE,
    Stride,
    StrideCounter,
    samples_of,
)

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

BINS: Final = 50
STRIDES_MIN: Final = 8
"""A minute at 0.15 Hz has nine."""
KEPT_MIN: Final = (0.09, 0.7)
"""N m, N: so much of a push that repeats in the minute stays in sigma. More would make sigma of a
machine that is as its file says more than a tenth larger than the filter's own."""
SCATTER_MAX: Final = (0.5, 4.0)
"""N m, N: an estimate that differs more from stride to stride is not that of a passive patient."""
THETA_MAX: Final = 4.0
"""An error of more standard deviations is not of the machine that the file describes. The largest
of 200 machines drawn from the file's uncertainties was 3.4; constant, spring-like and friction-like
pushes of 4 N m and 20 N gave 4.5 to 15. A constant one of 8 N m at the hip alone gave 3.7: the
weight of a leg explains it."""
FADE_S: Final = 400.0
"""Friction that falls by a quarter in ten minutes stays within two sigma until then."""
OTHER_GAIT_RATIO: Final = 1.1
"""A cadence, swing or guidance that differs by more than this factor is another gait."""
OTHER_KEPT_RATIO: Final = 2.0
"""What no parameter explains has another shape in another gait, and on another day."""
OTHER_DAY_STD: Final = 0.3
"""What is not known any more of each parameter on another day, in its standard deviations: so sigma
is at least three tenths of that without a baseline. Chosen; no recording shows it."""
_ROUNDS: Final = 3
"""Regressions, each with an estimate of what the last has left; a fourth changes nothing."""


class Baseline(NamedTuple):
    """What a minute with a passive patient has found, for n considered parameters."""

    theta: Vector
    """Error of each parameter in its standard deviations, (n)."""
    covariance: Matrix
    """Covariance of these errors, (n, n)."""
    kept_std: tuple[float, float]
    """N m, N: what the baseline cannot tell from the patient."""
    frictional: tuple[bool, ...]
    """The parameters that are of friction, (n)."""
    stride_count: int
    cadence_hz: float
    """Mean over the strides."""
    swing_rad: float
    """Swing of the hip, from its lowest to its highest angle."""


class Unfit(IntEnum):
    """Why a minute gives no baseline."""

    FEW_STRIDES = 1
    FEW_SAMPLES = 2
    """The patient of an axis is known in too few parts of the stride."""
    NOT_PASSIVE = 3
    """The patient's effort differs from stride to stride."""
    IMPLAUSIBLE = 4
    """Only a parameter that is far from its file explains it: a patient pushes, or the file is of
    another machine."""


class NotPassiveError(ValueError):
    """The minute gives no baseline."""

    def __init__(self, why: Unfit, axis: int, value: float, limit: float) -> None:
        """Name what is missing or too much: on the hip (0) or the slide (1)."""
        super().__init__(why.name)
        self.why, self.axis, self.value, self.limit = why, axis, value, limit


class Since(NamedTuple):
    """What is other than in the minute."""

    age_s: float = 0.0
    other_gait: bool = False
    other_day: bool = False
    """So long ago, or at such other temperatures, that nothing is as sure as it was."""


LONG_AGO: Final = Since(FADE_S, other_day=True)
"""For a baseline of an unknown time."""


def known(baseline: Baseline, since: Since) -> Known:
    """What the baseline says now, for `LegObserver.take_baseline`."""
    fade = min(max(since.age_s, 0.0) / FADE_S, 1.0) ** 2
    lost = fade * np.array(baseline.frictional, dtype=float)
    if since.other_day:
        lost = np.maximum(lost, OTHER_DAY_STD**2)
    ratio = OTHER_KEPT_RATIO if since.other_gait or since.other_day else 1.0
    covariance = baseline.covariance + np.diag(lost)
    return known_of(baseline.theta, covariance, ratio * np.array(baseline.kept_std))


def is_other_gait(baseline: Baseline, cadence_hz: float, swing_rad: float) -> bool:
    """True if a stride is not like those of the baseline."""
    return is_other(cadence_hz, baseline.cadence_hz) or is_other(swing_rad, baseline.swing_rad)


def is_other(value: float, then: float) -> bool:
    """True if what makes a gait differs by more than OTHER_GAIT_RATIO."""
    return not then <= OTHER_GAIT_RATIO * value <= OTHER_GAIT_RATIO**2 * then


def swing_of(rows: Matrix) -> float:
    """Swing of the hip in the samples of one stride, rad."""
    return float(np.ptp(rows[:, HIP]))


class PassiveStrides:
    """Sums over the strides of a passive patient, until they give a baseline."""

    def __init__(self, frictional: Sequence[bool]) -> None:
        """Begin without strides.

        Args:
            frictional: which of the considered parameters are of friction.
        """
        count = len(frictional)
        self._frictional = tuple(frictional)
        self._sums = np.zeros((2, BINS, 3 + count))
        self._counts = np.zeros((2, BINS))
        self._durations_s: list[float] = []
        self._swings_rad: list[float] = []

    @property
    def stride_count(self) -> int:
        """Number of strides so far."""
        return len(self._durations_s)

    @property
    def duration_s(self) -> float:
        """Duration of all strides so far."""
        return sum(self._durations_s)

    def add(self, stride: Stride, rows: Matrix) -> None:
        """Add a stride and its samples, as `StrideCounter.completed` has them, without baseline."""
        count = len(self._frictional)
        ends_s = np.cumsum(rows[:, DT])
        places = ((ends_s - 0.5 * rows[:, DT]) / ends_s[-1] * BINS).astype(np.intp)
        for axis in range(2):
            counted = rows[:, KNOWN + axis] > 0.0
            errors = rows[counted, UNSURE + axis : UNSURE + 2 * count : 2]
            own = rows[counted, PATIENT_VARIANCE + axis] - np.square(errors).sum(axis=1)
            columns = np.column_stack((rows[counted, PATIENT + axis], own, errors))
            filled, begins, samples = np.unique(
                places[counted], return_index=True, return_counts=True
            )
            # Sums of neighbours, as places rise: a product of matrices would start threads.
            means = np.add.reduceat(columns, begins, axis=0) / samples[:, None]
            self._sums[axis, filled, : 2 + count] += means
            self._sums[axis, filled, 2 + count] += np.square(means[:, 0])
            self._counts[axis, filled] += 1.0
        self._durations_s.append(stride.duration_s)
        self._swings_rad.append(swing_of(rows))

    def result(self) -> Baseline:
        """The baseline of the strides so far.

        Raises:
            NotPassiveError: too few strides, an axis with too few valid samples, an estimate that
                does not repeat from stride to stride, or one that no plausible error explains.
        """
        if self.stride_count < STRIDES_MIN:
            raise NotPassiveError(Unfit.FEW_STRIDES, 0, self.stride_count, STRIDES_MIN)
        axes = [self._axis(axis) for axis in range(2)]
        kept = np.array(KEPT_MIN)
        theta, covariance = _regression(axes, kept)
        for _ in range(_ROUNDS - 1):
            left = [np.sqrt(np.mean(np.square(one.patient - one.errors @ theta))) for one in axes]
            kept = np.maximum(KEPT_MIN, left)
            theta, covariance = _regression(axes, kept)
        largest = float(np.abs(theta).max(initial=0.0))
        if not largest <= THETA_MAX:  # also where it is no number
            raise NotPassiveError(
                Unfit.IMPLAUSIBLE, _most_explained(axes, theta), largest, THETA_MAX
            )
        hip_nm, slide_n = kept.tolist()
        return Baseline(
            theta,
            covariance,
            (hip_nm, slide_n),
            self._frictional,
            self.stride_count,
            self.stride_count / self.duration_s,
            float(np.mean(self._swings_rad)),
        )

    def _axis(self, axis: int) -> "_Means":
        often = self._counts[axis] >= 0.5 * self.stride_count
        if 2 * often.sum() < BINS:
            raise NotPassiveError(Unfit.FEW_SAMPLES, axis, int(often.sum()), BINS // 2)
        counts = self._counts[axis, often]
        means = self._sums[axis, often] / counts[:, None]
        patient = means[:, 0]
        scatter = np.maximum(means[:, -1] - np.square(patient), 0.0)
        scatter_std = float(np.sqrt(scatter.mean()))
        if scatter_std > SCATTER_MAX[axis]:
            raise NotPassiveError(Unfit.NOT_PASSIVE, axis, scatter_std, SCATTER_MAX[axis])
        return _Means(patient, means[:, 2:-1], np.maximum(means[:, 1], scatter) / counts)


class _Means(NamedTuple):
    """Means over the strides in the parts in which the axis is known."""

    patient: Vector
    errors: Matrix
    variance: Vector
    """Variance of `patient`, without what repeats."""


def _regression(axes: Sequence[_Means], kept: Vector) -> tuple[Vector, Matrix]:
    """Mean and covariance of the parameters' errors, given what they do not explain."""
    count = axes[0].errors.shape[1]
    information, weighted = np.eye(count), np.zeros(count)
    for one, kept_std in zip(axes, kept, strict=True):
        weights = 1.0 / (kept_std**2 + one.variance)
        information += (one.errors * weights[:, None]).T @ one.errors
        weighted += one.errors.T @ (weights * one.patient)
    covariance = np.linalg.inv(information)
    return covariance @ weighted, 0.5 * (covariance + covariance.T)


def _most_explained(axes: Sequence[_Means], theta: Vector) -> int:
    """The axis on which the errors explain most, in the standard deviations of the file."""
    hip, slide = (
        (np.square(one.errors @ theta).sum(), np.square(one.errors).sum()) for one in axes
    )
    return int(slide[0] * hip[1] > hip[0] * slide[1])


def baseline_of(smooth: BatchEstimates, columns: Columns, frictional: Sequence[bool]) -> Baseline:
    """Compute the baseline of a smoothed recording of a passive patient.

    Args:
        smooth: from `smooth_batch.run_smoothed`, without baseline.
        columns: the recording.
        frictional: which of the considered parameters are of friction.

    Raises:
        NotPassiveError: the recording gives none.
    """
    counter, strides = StrideCounter(), PassiveStrides(frictional)
    for sample in samples_of(smooth, columns):
        stride = counter.add(sample)
        if stride is not None:
            strides.add(stride, counter.completed)
    return strides.result()
