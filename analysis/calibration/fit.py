"""Maximum likelihood, intervals, and values that a recording does not identify.

A trust region method maximises the likelihood with Fisher's information as its curvature. The
likelihood has more than one optimum: the search runs from several starts, and the best end counts.
If two ends explain the recording equally well with different values, neither is trusted.

A value with too wide an interval, or a correlation with another beyond CORRELATION_MAX, returns to
the value of the file, and the rest is fitted once more. A value with a narrow interval stays
whatever its correlation, which the interval already includes. A slope of friction or an offset of
effort returns as well if its interval holds the file's value.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, minimize

from analysis.calibration.likelihood import (
    FINE_SUBSTEPS,
    PRIOR_TIMING,
    Likelihood,
    Surprises,
    bounds,
    prior_std,
    robust_covariance,
    scores,
)
from analysis.calibration.motion import Motion
from analysis.calibration.quantities import (
    BRISTLES,
    CANDIDATES,
    COUNT,
    LAW_SIZE,
    NOISE,
    OF_LAW_11,
    OFFSETS,
    OVER,
    PEAK,
    QUANTITIES,
    SIZE,
    SPRING_SCALE,
    SPRINGS,
    TIMING,
    Frame,
    Quantity,
    labelled,
)
from analysis.calibration.start import extent, regressed
from analysis.recording import RecordingError
from observer.quantities import Number

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Progress = Callable[[str, float], None]
"""Called with a text of the present step, and the share done."""

CORRELATION_MAX: Final = 0.98
INTERVAL_MAX_RATIO: Final = 0.5
"""Largest 95 % half interval over the value; a wider one counts as unknown."""
QUANTILE: Final = 1.959964
STEPS_MAX: Final = 40
START_NOISE: Final = 0.03
"""Initial effort noise over the Coulomb level: larger noise leaves fewer local optima."""
START_FACTORS: Final = (0.4, 0.63, 1.0, 1.6, 2.5)
START_LAWS: Final = tuple((v, v, v, time) for v, time in product(START_FACTORS, START_FACTORS))
"""Factors on transition, peak, edge and time constant."""
START_BRISTLES: Final = tuple(product((0.4, 1.0, 2.5), (0.1, 0.3, 1.0, 3.0, 10.0), (0.3, 1.0, 3.0)))
"""Factors on peak, stiffness and damping."""
START_ENCODERS: Final = (1.0, 30.0, 1 / 30.0)
"""Initial encoder noise over the file's: one that is far too large hides everything else."""
STARTS: Final = ((0.01, NOISE + 2), (0.2, NOISE + 2), (0.2, SIZE))
"""For each search: initial hump, in Coulomb levels, and which values from NOISE on begin where the
search of noise alone ended: those before this place."""
NOISE_STEPS_MAX: Final = 15
STALLED_STEPS: Final = 6
"""Number of steps without a gain that ends a search."""
UNIDENTIFIED_MAX: Final = 10.0
"""A search ends when it is worse than an earlier one by this many times the expected gain."""
SAME: Final = 25.0
"""Squared distance from a known end, in standard deviations, at which a search ends."""
EQUAL_PER_SAMPLE: Final = 0.01
"""Log likelihood: two ends that differ by less explain a recording equally well."""
LEVELS: Final = (
    *(axis * LAW_SIZE + at for axis in range(2) for at in (0, 2, BRISTLES.start)),
    *(SPRINGS + at for at in (0, 2, 3, 5)),
)
"""Values in which two such ends must agree: Coulomb, viscous, stiffness of bristles and spring, and
inertia of both axes."""
ROUNDS: Final = 6
NONE: Final = "the file has none"
WITH_BRISTLES: Final = "bristles replace the friction that it shapes"
AS_GIVEN: Final = "the recording does not contradict the file's value"
OF_SPRING: Final = "it cannot be told from the spring's rest, which holds the change of both"
AS_GOOD_WITHOUT: Final = "the held-out part is described as well with the file's value"
DECIDED: Final = (AS_GIVEN, OF_SPRING, AS_GOOD_WITHOUT)
"""Reasons that no other recording changes."""
SHAPED: Final = (3, 5, 6)
"""Transition, edge and time constant, within a law."""
FOLLOWS: Final = {
    1: 0,
    LAW_SIZE + 1: LAW_SIZE,
    SPRINGS + 1: SPRINGS,
    SPRINGS + 4: SPRINGS + 3,
}
"""Values that follow another one if they are not identified: the peak of the law lies above its
Coulomb level, and a spring's rest keeps the effort in the middle."""
WALL: Final = 1e4
"""Stiffness of the bounds in units of likelihood."""
TIGHT_RATIO: Final = 0.1
"""Interval that is narrow enough despite a correlation, which it already includes."""
WRONG_FILE: Final = (
    "the robot file does not fit the recording; `gaitd calibrate --check` names what explains it, "
    "such as an encoder offset, a spring or the rail"
)
DECREMENT: Final = 1e-2
"""Expected gain of the likelihood at which a search ends: a seventh of a standard deviation."""


@dataclass(frozen=True, slots=True)
class Result:
    """Result of one quantity."""

    quantity: Quantity
    before: Number
    value: Number
    half_interval: Number
    """95 % half interval; NaN where it was not calibrated."""
    reason: str
    """Why it was not calibrated; empty where it was."""

    @property
    def calibrated(self) -> bool:
        """True if the recording identified it."""
        return not self.reason

    @property
    def exists(self) -> bool:
        """True if the machine has such a part."""
        return self.reason not in (NONE, WITH_BRISTLES)


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """All results of a fit."""

    frame: Frame
    natural: Vector
    results: tuple[Result, ...]
    loss_per_sample: Number
    step_count: int
    fixed: frozenset[int]
    """Values that were not fitted, noise among them."""
    rival: Callable[[], str]
    """Searches another optimum that explains the recording equally well with other values; empty
    if there is none. It takes as long as a fit: for the law alone that is used."""


class _End(NamedTuple):
    """End of a search."""

    free: Vector
    loss: Number
    """Loss including priors; infinite where the search could not begin."""
    step_count: int
    why: str = ""
    """Why it could not begin; empty if it did."""

    def begun(self) -> "_End":
        """Itself.

        Raises:
            RecordingError: the search could not begin.
        """
        if self.why:
            raise RecordingError(self.why)
        return self


class _NoSlopeError(Exception):
    """The likelihood has no derivative; the text says where."""


class _Search:
    """The likelihood with its priors in scipy's form: value, gradient, curvature."""

    def __init__(
        self,
        likelihood: Likelihood,
        centre: Vector,
        about: Vector,
        which: NDArray[np.intp],
        progress: Progress,
        known: Sequence[_End],
    ) -> None:
        self.likelihood, self.about, self.which = likelihood, about, which
        self.weight = 1.0 / prior_std()[which] ** 2
        self.centre = centre[which]
        self.low, self.high = (bound[which] for bound in bounds(likelihood.frame))
        self.progress, self.known = progress, known
        self.losses: list[float] = []
        self.step_count = 0
        self.newest: _End | None = None
        """Where the likelihood was differentiated last."""
        self._made: dict[bytes, tuple[float, Vector, Matrix]] = {}

    def whole(self, x: Vector) -> Vector:
        free = self.about.copy()
        free[self.which] = x
        return free

    def value(self, x: Vector) -> float:
        base = self.likelihood.surprises(self.whole(x))
        return self._with_prior(base, x)

    def _with_prior(self, base: Surprises, x: Vector) -> float:
        loss = base.loss + 0.5 * float(np.sum(self.weight * (x - self.centre) ** 2))
        loss += 0.5 * WALL * float(np.sum(self._beyond(x) ** 2))
        return loss if np.isfinite(loss) else 1e12

    def _beyond(self, x: Vector) -> Vector:
        """Distance of each value outside of its bounds, with its sign."""
        return x - np.clip(x, self.low, self.high)

    def all(self, x: Vector) -> tuple[float, Vector, Matrix]:
        at = x.tobytes()
        if at not in self._made:
            base, dz, ds = self.likelihood.derivatives(self.whole(x), self.which)
            sound = np.isfinite(dz) & np.isfinite(ds)
            if not np.all(sound):
                raise _NoSlopeError(self._where(base, sound, x))
            each, fisher = scores(base, dz, ds)
            beyond = self._beyond(x)
            gradient = each.sum(axis=0) + self.weight * (x - self.centre) + WALL * beyond
            curvature = fisher + np.diag(self.weight + WALL * (beyond != 0.0))
            loss = self._with_prior(base, x)
            self._made = {at: (loss, gradient, curvature)}
            self.step_count += 1
            self.newest = _End(self.whole(x), loss, self.step_count)
        return self._made[at]

    def _where(self, base: Surprises, sound: NDArray[np.bool_], x: Vector) -> str:
        """Say of what the model has no finite motion."""
        likelihood, motion = self.likelihood, self.likelihood.motion
        sources = ", ".join(motion.sources)
        lost = ~(np.isfinite(base.z) & np.isfinite(base.s))
        if np.any(lost):
            row = likelihood.row[np.argmax(lost)]
            hip_rad, slide_m = motion.smooth[row, :2].tolist()
            return (
                f"{sources}: at {motion.time_s[row]:.2f} s, hip {np.degrees(hip_rad):.1f} deg and "
                f"slide {slide_m:.3f} m, the leg of the robot file cannot move so: {WRONG_FILE}"
            )
        index = int(self.which[np.argmin(np.all(sound, axis=0))])
        value = likelihood.frame.from_free(self.whole(x))[index]
        return (
            f"{sources}: no motion can be computed with {labelled(index)} = {value:.4g}, where the "
            f"search begins: {WRONG_FILE}"
        )

    def gradient(self, x: Vector) -> Vector:
        return self.all(x)[1]

    def curvature(self, x: Vector) -> Matrix:
        return self.all(x)[2]

    def ended(self, intermediate_result: OptimizeResult) -> None:
        x = intermediate_result.x
        loss, gradient, curvature = self.all(x)
        gain = float(gradient @ np.linalg.solve(curvature, gradient))
        self.losses.append(loss)
        count = max(len(self.likelihood.row), 1)
        self.progress(f"misfit {loss / count:.4f}", min(self.step_count / STEPS_MAX, 1.0))
        recent = self.losses[-STALLED_STEPS - 1 :]
        stalled = len(recent) > STALLED_STEPS and recent[0] - loss < DECREMENT
        if gain < DECREMENT or stalled or self._adds_nothing(x, loss, gain, curvature):
            raise StopIteration

    def _adds_nothing(self, x: Vector, loss: float, gain: float, curvature: Matrix) -> bool:
        """True if the search approaches a known end, or a worse one."""
        for end in self.known:
            away = x - end.free[self.which]
            if loss - UNIDENTIFIED_MAX * gain > end.loss or float(away @ curvature @ away) < SAME:
                return True
        return False


def fit(
    frame: Frame,
    motion: Motion,
    progress: Progress,
    near: Fit | None = None,
    kept: Mapping[int, str] = MappingProxyType({}),
) -> Fit:
    """Calibrate the values that the rows that are not held out identify.

    Args:
        frame: of the initial file.
        motion: the recording.
        progress: called with the misfit (minus log likelihood per sample) after each step.
        near: a fit of another law, or of more quantities, to the same rows: the only place where
            the search begins.
        kept: quantities that keep the file's values, with the reasons.

    Raises:
        RecordingError: the model has no finite motion, wherever the search begins.
    """
    likelihood = Likelihood(frame, motion, ~motion.held_out)
    reasons = _fixed(frame, motion) | dict(kept)
    bristled = any(frame.bristled(axis) for axis in range(2))
    laws = [
        _back(frame, _with_initial_noise(frame, regressed(frame, motion, hump)), kept)
        for hump, _ in STARTS
    ]
    centre = laws[0]

    def walk(
        free: Vector,
        known: Sequence[_End] = (),
        *,
        noise: bool = False,
        within: Likelihood = likelihood,
    ) -> _End:
        values = range(NOISE, TIMING) if noise else range(SIZE)
        which = np.array([i for i in values if i not in reasons], dtype=np.intp)
        steps = NOISE_STEPS_MAX if noise else STEPS_MAX
        search = _Search(within, centre, free.copy(), which, progress, known)
        return _walk(search, free[which], steps)

    fine = Likelihood(frame, motion, ~motion.held_out, FINE_SUBSTEPS)

    def walk_fine(free: Vector) -> _End:
        return walk(free, within=fine).begun()

    ends: list[_End] = []
    if near is None:
        by_noise = [walk(_with_encoders(laws[0], factor), noise=True) for factor in START_ENCODERS]
        noise_free = min(by_noise, key=lambda end: end.loss).free
        for law, (_, known) in zip(laws, STARTS, strict=True):
            free = law.copy()
            free[NOISE:known] = noise_free[NOISE:known]
            ends.append(walk(best_start(likelihood, free, motion), ends))
    else:
        free = _back(frame, frame.free(_with_law_of(frame, near.natural)), kept)
        known_ends: list[_End] = []
        if bristled:  # of no use where they explain less than another law
            found = Likelihood(near.frame, motion, ~motion.held_out)
            free_near = near.frame.free(near.natural)
            known_ends.append(_End(free_near, found.surprises(free_near).loss, 0))
        ends.append(walk(best_start(likelihood, free, motion), known_ends))
    first = min(ends, key=lambda end: end.loss).begun()
    fixed_count = len(reasons)
    identified, cov = _identified(fine, walk_fine(first.free), reasons, walk_fine)
    free = identified.free
    natural = frame.from_free(free)
    # Bristles are too stiff for a rough solution to be one of the same law.
    rough = free if bristled else first.free
    if not bristled and len(reasons) != fixed_count:
        rough = walk(free).free
    # What another solution of the same law changes is no more certain than that.
    numerical = natural - frame.from_free(_back(frame, rough, reasons))
    for index in reasons:
        if FOLLOWS.get(index, index) in reasons:
            natural[index] = frame.natural[index]
    variance = np.maximum(np.diag(_natural_covariance(frame, free, cov)), 0.0) + numerical**2
    half = QUANTILE * np.sqrt(variance)
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
    count = max(len(likelihood.row), 1)
    margin = EQUAL_PER_SAMPLE * count

    def rival() -> str:
        for end in ends:
            other = _back(frame, end.free, reasons)
            if end.loss < first.loss + margin and _disagreement(frame, other, results):
                # With the same values fixed as in the best: a flat valley is no second optimum. A
                # search that cannot begin there is none either: its loss is infinite.
                again = walk(other, within=fine)
                if again.loss < identified.loss + margin and (
                    found := _disagreement(frame, again.free, results)
                ):
                    return found
        return ""

    loss = fine.surprises(free).loss / count
    steps = sum(end.step_count for end in ends)
    return Fit(frame, natural, results, loss, steps, frozenset(reasons), rival)


def without(made: Fit, motion: Motion, progress: Progress, index: int) -> Vector:
    """Natural values with one of them set back to the file's, and the others fitted once more."""
    free = _back(made.frame, made.frame.free(made.natural), [index])
    fine = Likelihood(made.frame, motion, ~motion.held_out, FINE_SUBSTEPS)
    return made.frame.from_free(fitted_on(made, fine, progress, free, {index}))


def fitted_on(
    made: Fit, likelihood: Likelihood, progress: Progress, free: Vector, kept: Iterable[int] = ()
) -> Vector:
    """Free values of the nearest optimum; what was not fitted before is not now."""
    which = np.array([i for i in range(SIZE) if i not in made.fixed.union(kept)], dtype=np.intp)
    search = _Search(likelihood, free, free.copy(), which, progress, ())
    return _walk(search, free[which], STEPS_MAX).begun().free


def _with_law_of(frame: Frame, natural: Vector) -> Vector:
    """Natural values of another fit, with the bristles of the frame and what these replace."""
    made = natural.copy()
    for axis in range(2):
        if frame.bristled(axis):
            places = [axis * LAW_SIZE + at for at in (*SHAPED, *range(LAW_SIZE)[BRISTLES])]
            made[places] = frame.natural[places]
    return made


def _disagreement(frame: Frame, free: Vector, results: tuple[Result, ...]) -> str:
    """List levels in which free values differ from the results; empty if none does."""
    natural = frame.from_free(free)
    return ", ".join(
        f"{one.quantity.label} {one.value:.4g} or {natural[i]:.4g} {one.quantity.unit}"
        for i, one in ((i, results[i]) for i in LEVELS)
        if one.calibrated
        and abs(natural[i] - one.value) > max(one.half_interval, TIGHT_RATIO * abs(one.value))
    )


def _back(frame: Frame, free: Vector, reasons: Iterable[int]) -> Vector:
    """Replace unidentified free values by those of the file."""
    made, given = free.copy(), list(reasons)
    made[given] = frame.free(frame.natural)[given]
    return made


def _identified(
    likelihood: Likelihood, end: _End, reasons: dict[int, str], walk: Callable[[Vector], _End]
) -> tuple[_End, Matrix]:
    """Fix unidentified values to the file's, and return that end with the covariance of the rest.

    Args:
        likelihood: of the recording.
        end: of the best search.
        reasons: why a value is not fitted; unidentified ones are added.
        walk: continues the search in the values that are not among the reasons.
    """
    cov = np.zeros((SIZE, SIZE))
    for _ in range(ROUNDS):
        which = np.array([i for i in range(SIZE) if i not in reasons], dtype=np.intp)
        base, dz, ds = likelihood.derivatives(end.free, which)
        each, fisher = scores(base, dz, ds)
        fisher += np.diag((which >= TIMING) / PRIOR_TIMING**2)
        cov[:] = 0.0
        cov[np.ix_(which, which)] = robust_covariance(each, fisher, likelihood.row)
        frame = likelihood.frame
        found = _unidentified(frame, end.free, which, fisher)
        if not found and not (found := _as_given(frame, end.free, which, cov)):
            break
        reasons.update(found)
        end = walk(_back(likelihood.frame, end.free, found))
    return end, cov


def _as_given(frame: Frame, free: Vector, which: NDArray[np.intp], cov: Matrix) -> dict[int, str]:
    """Candidates whose interval holds the file's value, with the reason."""
    change = np.abs(free - frame.free(frame.natural))
    inside = change <= QUANTILE * np.sqrt(np.maximum(np.diag(cov), 0.0))
    return {i: AS_GIVEN for i in CANDIDATES if i in which and inside[i]}


def best_start(likelihood: Likelihood, free: Vector, motion: Motion) -> Vector:
    """Return free values with the best-fitting speeds and time constants.

    A regression does not identify them or the bristles, and the file may be wrong. So a grid about
    the file's values is evaluated with the likelihood, axis by axis.
    """
    for axis in range(2):
        if not extent(motion, axis).enough(axis):
            continue
        if likelihood.frame.bristled(axis):
            places, grid = (PEAK, *range(LAW_SIZE)[BRISTLES]), START_BRISTLES
        else:
            places, grid = tuple(range(LAW_SIZE)[OF_LAW_11]), START_LAWS
        at = [axis * LAW_SIZE + place for place in places]
        tried = []
        for factors in grid:
            trial = free.copy()
            trial[at] += np.log(factors)
            tried.append(trial)
        losses = np.array([likelihood.surprises(trial).loss for trial in tried])
        if np.any(np.isfinite(losses)):
            free = tried[int(np.nanargmin(losses))]
    return free


def _with_initial_noise(frame: Frame, natural: Vector) -> Vector:
    """Return free values with the initial noise."""
    free = frame.free(natural)
    free[NOISE + 2 : NOISE + 4] = np.log(START_NOISE * natural[[0, LAW_SIZE]])
    free[NOISE + 4 : TIMING] = np.log(0.2 * START_NOISE * natural[[0, LAW_SIZE]])
    return free


def _with_encoders(free: Vector, factor: Number) -> Vector:
    made = free.copy()
    made[NOISE : NOISE + 2] += np.log(factor)
    return made


def _walk(search: _Search, x: Vector, steps_max: int) -> _End:
    try:
        found = minimize(
            search.value,
            x,
            method="dogleg",
            jac=search.gradient,
            hess=search.curvature,
            callback=search.ended,
            options={"maxiter": steps_max, "initial_trust_radius": 0.5, "gtol": 1e-3},
        )
    except _NoSlopeError as error:
        return search.newest or _End(search.whole(x), math.inf, 0, str(error))
    return _End(search.whole(found.x), float(found.fun), search.step_count)


def _fixed(frame: Frame, motion: Motion) -> dict[int, str]:
    """Values that are never fitted, with the reasons."""
    reasons: dict[int, str] = {}
    for axis in range(2):
        law, spring = axis * LAW_SIZE, SPRINGS + 3 * axis
        if not extent(motion, axis).enough(axis):
            noise = range(NOISE + axis, SIZE, 2)
            over = range(OVER + 2 * axis, OVER + 2 * axis + 2)
            for index in (*range(law, law + LAW_SIZE), *range(spring, spring + 3), *over, *noise):
                reasons[index] = "the axis hardly moved"
        if frame.sprung(axis):
            reasons[OFFSETS[axis]] = OF_SPRING
        else:
            reasons |= dict.fromkeys((spring, spring + 1), NONE)
        if frame.bristled(axis):
            reasons |= dict.fromkeys((law + at for at in SHAPED), WITH_BRISTLES)
        else:
            reasons |= dict.fromkeys(range(law + BRISTLES.start, law + LAW_SIZE), NONE)
    return reasons


def _unidentified(
    frame: Frame, free: Vector, which: NDArray[np.intp], fisher: Matrix
) -> dict[int, str]:
    """Select values to fix, worst first, until the rest is identified; with the reasons.

    Fisher's information judges, and not the robust covariance: a value that is fixed at the file's
    shifts all others, and their intervals do not say so.
    """
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
    wide[which >= NOISE] = 0.0  # noise is always identified well enough for its use
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
        return place, f"it correlates with {labelled(int(which[other]))} ({together[a, b]:.3f})"
    return None


def _size_of(frame: Frame, free: Vector, index: int) -> float:
    """Change of a free value that changes its quantity by 100 %."""
    if index >= OVER:
        return 1.0
    if index >= SPRINGS:
        axis, part = divmod(index - SPRINGS, 3)
        scale = SPRING_SCALE[axis][part]
        before = abs(float(frame.free(frame.natural)[index]))
        return max(before, 1.0 if part < 2 else 0.5 * scale / scale)
    axis, part = divmod(index, LAW_SIZE)
    if part == 1:  # the hump is as certain as the resulting peak
        coulomb, stribeck = frame.from_free(free)[index - 1 : index + 1]
        return float(stribeck / max(coulomb * np.exp(free[index]), 1e-12))
    return 1.0


def _natural_covariance(frame: Frame, free: Vector, cov: Matrix) -> Matrix:
    """Covariance of natural values, by their derivative by the free ones."""
    slope = np.empty((SIZE, SIZE))
    for index in range(SIZE):
        beside = free.copy()
        beside[index] += 1e-6
        slope[:, index] = (frame.from_free(beside) - frame.from_free(free)) / 1e-6
    return slope @ cov @ slope.T
