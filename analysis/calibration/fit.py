"""Maximum likelihood, intervals, and what a recording cannot tell.

A trust region walks on the likelihood with Fisher's information for its curvature. What turns out
to have too wide an interval, or to go along with another by more than CORRELATION_MAX, goes back to
the value of the file, and the rest is fitted once more. A narrow interval stands whatever it goes
along with, because it counts that already.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from analysis.calibration.likelihood import (
    Likelihood,
    Surprises,
    prior_std,
    reach,
    robust_covariance,
    scores,
)
from analysis.calibration.motion import Motion
from analysis.calibration.quantities import (
    COUNT,
    LAW_SIZE,
    NOISE,
    QUANTITIES,
    SIZE,
    SPRING_SCALE,
    SPRINGS,
    Frame,
    Quantity,
    labelled,
)
from analysis.calibration.start import guess, moved
from observer.quantities import Number

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Progress = Callable[[str, float], None]
"""Told in words where it is, and the share done."""

CORRELATION_MAX: Final = 0.98
INTERVAL_MAX_RATIO: Final = 0.5
"""Of a 95 % half interval to its value; wider is not known."""
QUANTILE: Final = 1.959964
STEPS_MAX: Final = 40
START_NOISE: Final = 0.03
"""Effort noise to begin with, of the Coulomb level: what is blurred has fewer valleys."""
START_FACTORS: Final = (0.4, 0.63, 1.0, 1.6, 2.5)
ROUNDS: Final = 4
FOLLOWS: Final = {
    1: 0,
    LAW_SIZE + 1: LAW_SIZE,
    SPRINGS + 1: SPRINGS,
    SPRINGS + 4: SPRINGS + 3,
}
"""What moves with another although it is not told itself: the peak of the law lies above its
Coulomb level, and a spring's rest keeps the effort in the middle."""
WALL: Final = 1e4
"""Stiffness of the bounds in units of the likelihood."""
TIGHT_RATIO: Final = 0.1
"""Of an interval that is narrow enough however two values go along: it counts that already."""
DECREMENT: Final = 1e-2
"""Expected gain of the likelihood below which a search ends: a seventh of a standard deviation."""


@dataclass(frozen=True, slots=True)
class Result:
    """One quantity after the calibration."""

    quantity: Quantity
    before: Number
    value: Number
    half_interval: Number
    """95 %; NaN where it was not calibrated."""
    reason: str
    """Why not; empty where it was."""

    @property
    def calibrated(self) -> bool:
        """Whether the recording told it."""
        return not self.reason


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Everything that a fit leaves behind."""

    frame: Frame
    natural: Vector
    results: tuple[Result, ...]
    loss_per_sample: Number
    step_count: int


class _Search:
    """The likelihood with its priors as scipy wants it: value, gradient, curvature."""

    def __init__(
        self, likelihood: Likelihood, about: Vector, which: NDArray[np.intp], progress: Progress
    ) -> None:
        self.likelihood, self.about, self.which = likelihood, about, which
        self.weight = 1.0 / prior_std()[which] ** 2
        self.middle = likelihood.frame.free(likelihood.frame.natural)[which]
        self.reach = reach()[which]
        self.progress = progress
        self.step_count = 0
        self._at: Vector | None = None
        self._made: tuple[float, Vector, Matrix] | None = None

    def whole(self, x: Vector) -> Vector:
        free = self.about.copy()
        free[self.which] = x
        return free

    def value(self, x: Vector) -> float:
        base = self.likelihood.surprises(self.whole(x))
        return self._with_prior(base, x)

    def _with_prior(self, base: Surprises, x: Vector) -> float:
        away = x - self.about[self.which]
        loss = base.loss + 0.5 * float(np.sum(self.weight * away**2))
        loss += 0.5 * WALL * float(np.sum(self._beyond(x) ** 2))
        return loss if np.isfinite(loss) else 1e12

    def _beyond(self, x: Vector) -> Vector:
        """How far outside of its reach each value is, with its sign."""
        away = x - self.middle
        return away - np.clip(away, -self.reach, self.reach)

    def all(self, x: Vector) -> tuple[float, Vector, Matrix]:
        if self._made is None or self._at is None or not np.array_equal(self._at, x):
            base, dz, ds = self.likelihood.derivatives(self.whole(x), self.which)
            each, fisher = scores(base, dz, ds)
            gradient = each.sum(axis=0) + self.weight * (x - self.about[self.which])
            beyond = self._beyond(x)
            gradient += WALL * beyond
            curvature = fisher + np.diag(self.weight + WALL * (beyond != 0.0))
            self._made = (self._with_prior(base, x), gradient, curvature)
            self._at = x.copy()
            self.step_count += 1
        return self._made

    def gradient(self, x: Vector) -> Vector:
        return self.all(x)[1]

    def curvature(self, x: Vector) -> Matrix:
        return self.all(x)[2]

    def ended(self, intermediate_result: object) -> None:
        x: Vector = intermediate_result.x  # pyright: ignore[reportAttributeAccessIssue]
        loss, gradient, curvature = self.all(x)
        gain = float(gradient @ np.linalg.solve(curvature, gradient))
        count = max(len(self.likelihood.row), 1)
        share = min(self.step_count / STEPS_MAX, 1.0)
        self.progress(f"misfit {loss / count:.4f}", share)
        if gain < DECREMENT:
            raise StopIteration


def fit(frame: Frame, motion: Motion, progress: Progress) -> Fit:
    """Calibrate what the rows that are not held out can tell.

    Args:
        frame: of the file to begin from.
        motion: the recording.
        progress: told the misfit (minus log likelihood per sample) after each step.
    """
    likelihood = Likelihood(frame, motion, ~motion.held_out)
    begin = best_start(likelihood, guess(frame, motion))
    file_free = frame.free(frame.natural)
    reasons = _not_moved(motion)
    steps = 0
    free = begin
    cov = np.zeros((SIZE, SIZE))
    for _ in range(ROUNDS):
        which = np.array([i for i in range(SIZE) if i not in reasons], dtype=np.intp)
        free, done = _walk(likelihood, free, which, progress)
        steps += done
        base, dz, ds = likelihood.derivatives(free, which)
        each, fisher = scores(base, dz, ds)
        found = _untold(frame, free, which, fisher)
        if not found:
            cov = np.zeros((SIZE, SIZE))
            cov[np.ix_(which, which)] = robust_covariance(each, fisher, likelihood.row)
            break
        for index, reason in found.items():
            reasons[index] = reason
            free[index] = file_free[index]
    natural = frame.from_free(free)
    for index in reasons:
        if FOLLOWS.get(index, index) in reasons:
            natural[index] = frame.natural[index]
    half = QUANTILE * np.sqrt(np.maximum(np.diag(_natural_covariance(frame, free, cov)), 0.0))
    results = tuple(
        Result(
            QUANTITIES[i],
            float(frame.natural[i]),
            float(natural[i]),
            float("nan") if i in reasons else float(half[i]),
            reasons.get(i, ""),
        )
        for i in range(COUNT)
    )
    loss = likelihood.surprises(free).loss / max(len(likelihood.row), 1)
    return Fit(frame, natural, results, loss, steps)


def best_start(likelihood: Likelihood, guessed: Vector) -> Vector:
    """Free values to begin at: the guess, with the speeds and time constants that suit best.

    The smoothing of the regression blurs what is fast. So speeds and time constants are tried on a
    grid about the guess and about the file, axis by axis, with the likelihood for the judge.
    """
    frame = likelihood.frame
    free = frame.free(guessed)
    free[NOISE + 2 : NOISE + 4] = np.log(START_NOISE * guessed[[0, LAW_SIZE]])
    free[NOISE + 4 :] = np.log(0.2 * START_NOISE * guessed[[0, LAW_SIZE]])
    file_free = frame.free(frame.natural)
    for _ in range(2):
        for axis in range(2):
            at = slice(axis * LAW_SIZE + 3, (axis + 1) * LAW_SIZE)
            tried = [free]
            for about in (free[at].copy(), file_free[at]):
                for speed, time in product(START_FACTORS, START_FACTORS):
                    trial = free.copy()
                    trial[at] = about + np.log([speed, speed, speed, time])
                    tried.append(trial)
            losses = [likelihood.surprises(trial).loss for trial in tried]
            free = tried[int(np.nanargmin(losses))]
    return free


def _walk(
    likelihood: Likelihood, free: Vector, which: NDArray[np.intp], progress: Progress
) -> tuple[Vector, int]:
    search = _Search(likelihood, free.copy(), which, progress)
    found = minimize(
        search.value,
        free[which],
        method="trust-exact",
        jac=search.gradient,
        hess=search.curvature,
        callback=search.ended,
        options={"maxiter": STEPS_MAX, "initial_trust_radius": 0.5, "gtol": 1e-3},
    )
    return search.whole(found.x), search.step_count


def _not_moved(motion: Motion) -> dict[int, str]:
    reasons: dict[int, str] = {}
    for axis in range(2):
        if not moved(motion, axis).enough(axis):
            at = SPRINGS + 3 * axis
            for index in (*range(axis * LAW_SIZE, (axis + 1) * LAW_SIZE), *range(at, at + 3)):
                reasons[index] = "the axis hardly moved"
    return reasons


def _untold(frame: Frame, free: Vector, which: NDArray[np.intp], fisher: Matrix) -> dict[int, str]:
    """What to give up, worst first, until the rest is told; with the reason."""
    found: dict[int, str] = {}
    left = list(range(len(which)))
    while left:
        cov: Matrix = np.asarray(np.linalg.pinv(fisher[np.ix_(left, left)]), dtype=np.float64)
        worst = _worst(frame, free, which[left], cov)
        if worst is None:
            break
        place, reason = worst
        found[int(which[left[place]])] = reason
        del left[place]
    return found


def _worst(
    frame: Frame, free: Vector, which: NDArray[np.intp], cov: Matrix
) -> tuple[int, str] | None:
    std = np.sqrt(np.maximum(np.diag(cov), 0.0))
    wide = QUANTILE * std / np.array([_size_of(frame, free, int(i)) for i in which])
    wide[which >= NOISE] = 0.0  # noise is always told well enough for what it is used for
    place = int(np.argmax(wide))
    if wide[place] > INTERVAL_MAX_RATIO:
        return place, f"its 95 % interval is ±{100 * min(float(wide[place]), 9.99):.0f} %"
    together = np.abs(cov) / np.maximum(np.outer(std, std), 1e-300)
    np.fill_diagonal(together, 0.0)
    together[which >= NOISE] = 0.0
    together[:, which >= NOISE] = 0.0
    together[wide < TIGHT_RATIO] = 0.0
    a, b = np.unravel_index(int(np.argmax(together)), together.shape)
    if together[a, b] > CORRELATION_MAX:
        place = int(a if wide[a] >= wide[b] else b)
        other = int(b if place == a else a)
        return place, f"it goes along with {labelled(int(which[other]))} ({together[a, b]:.3f})"
    return None


def _size_of(frame: Frame, free: Vector, index: int) -> float:
    """How large a change of a free value is one of 100 % of its quantity."""
    if index >= NOISE:
        return 1.0
    if index >= SPRINGS:
        axis, part = divmod(index - SPRINGS, 3)
        scale = SPRING_SCALE[axis][part]
        before = abs(float(frame.free(frame.natural)[index]))
        return max(before, 1.0 if part < 2 else 0.5 * scale / scale)
    axis, part = divmod(index, LAW_SIZE)
    if part == 1:  # the hump is known as well as the peak that it makes
        stribeck = frame.from_free(free)[index]
        return float(stribeck / max(np.exp(free[index]), 1e-12))
    return 1.0


def _natural_covariance(frame: Frame, free: Vector, cov: Matrix) -> Matrix:
    """By the derivative of natural values after free ones."""
    slope = np.empty((SIZE, SIZE))
    for index in range(SIZE):
        beside = free.copy()
        beside[index] += 1e-6
        slope[:, index] = (frame.from_free(beside) - frame.from_free(free)) / 1e-6
    return slope @ cov @ slope.T
