"""Check of the mechanism: residual efforts of the empty machine over position.

The residual effort after inertia, weight and springs of the file is friction of the form

    F = coulomb (1 + slope q) tanh(v / transition) + hump + viscous v      per axis, free factors

plus, where one number of the mechanism is wrong, the resulting change of weight and springs.
Each candidate is fitted alone, together with the free friction; the one with the smallest residual
explains best. NIS does not detect this: the observer's integrators absorb it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from analysis.calibration.motion import REST, Motion
from analysis.calibration.quantities import AXES, value_of
from analysis.calibration.start import FAST, extent, residual_effort
from analysis.recording import RecordingError
from daemon.config.edits import replaced
from daemon.config.robot import friction_parameters, leg_parameters, observer_tuning
from daemon.config.settings import Robot
from observer.filter.status import START_KNEE_MIN_RAD
from observer.mechanism.mechanism import WorkspaceError, knee_angle
from observer.mechanism.parameters import LegParameters
from observer.quantities import Number

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

QUANTILE: Final = 1.96
BLOCK_ROWS: Final = 100
"""Rows that count as one independent sample: a second."""
NOTICED: Final = 0.04
"""Least effort, rms over the Coulomb level, that a wrong mechanism must explain to be reported."""
SIGNIFICANT: Final = 12.0
"""Least fall of the misfit in block units (chi squared with one degree of freedom)."""
AS_GOOD: Final = 9.0
"""In the same units: a candidate this close to the best cannot be distinguished from it."""
PLAUSIBLE: Final = 10.0
"""A change by this many standard deviations costs an explanation 1 of the same units, and by n
times as many n^2: one of them is rare, a hundred are another machine."""


ENOUGH_RATIO: Final = 0.5
"""Least fall of an explanation, however plausible, over that of the best."""


class Candidate(NamedTuple):
    """One number of the mechanism that may be wrong."""

    words: str
    unit: str
    scale: Number
    key: str
    """Place of the number in the robot file; empty: it is in more than one."""
    std: Callable[[Robot], float]
    """Standard deviation by [uncertainty] of the robot file; 0: it says nothing."""
    changed: Callable[[Robot, float], Robot]
    """Returns the robot with the number changed by this amount."""
    fitted: bool = False
    """True if a calibration fits it."""


def _along_rail(robot: Robot, change_m: float) -> Robot:
    angle = math.radians(robot.geometry.rail_angle_deg)
    moved_x = _in("geometry.rail_x_m")(robot, change_m * math.cos(angle))
    return _in("geometry.rail_y_m")(moved_x, change_m * math.sin(angle))


def _in(key: str) -> Callable[[Robot, float], Robot]:
    return lambda robot, change: replaced(robot, {key: value_of(robot, key) + change})


def _candidate(
    words: str, unit: str, scale: Number, key: str, uncertainty: str, *, fitted: bool = False
) -> Candidate:
    """A candidate of one key, whose uncertainty is a ratio or has the unit of the number."""

    def std(robot: Robot) -> float:
        found = value_of(robot, f"uncertainty.{uncertainty}")
        return found * value_of(robot, key) if uncertainty.endswith("_ratio") else found

    return Candidate(words, unit, scale, key, std, _in(key), fitted)


def _recline_std(robot: Robot) -> float:
    return math.hypot(robot.uncertainty.recline_deg, robot.uncertainty.hip.angle_deg)


def _offset_std(robot: Robot) -> float:
    return math.hypot(robot.uncertainty.rail_m, robot.uncertainty.slide.position_m)


CANDIDATES: Final = (
    # Equivalent for the mechanism: both turn the thigh against gravity.
    Candidate(
        *("recline or hip encoder offset", "deg", 5.0, "geometry.recline_deg"),
        *(_recline_std, _in("geometry.recline_deg")),
    ),
    Candidate("slide encoder offset", "m", 0.05, "", _offset_std, _along_rail),
    *(
        _candidate(*row, fitted=True)
        for row in (
            (
                *("hip spring stiffness", "N·m/rad", 4.0),
                *("springs.hip.stiffness_nm_per_rad", "hip.spring_ratio"),
            ),
            ("hip spring rest", "rad", 0.1, "springs.hip.rest_rad", "hip.spring_rest_rad"),
            (
                *("slide spring stiffness", "N/m", 20.0),
                *("springs.slide.stiffness_n_per_m", "slide.spring_ratio"),
            ),
            ("slide spring rest", "m", 0.1, "springs.slide.rest_m", "slide.spring_rest_m"),
            (
                *("hip drive inertia", "kg m²", 0.1),
                *("hip.drive_inertia_kg_m2", "drive_inertia_ratio"),
            ),
            ("slide drive mass", "kg", 2.0, "slide.drive_mass_kg", "drive_inertia_ratio"),
        )
    ),
    *(
        _candidate(f"{part} mass", "kg", 0.5, f"{part}.mass_kg", "machine_mass_ratio")
        for part in ("thigh", "shank", "shoe", "slide")
    ),
)


@dataclass(frozen=True, slots=True)
class Explanation:
    """Explanation of the residual by a change of one number."""

    words: str
    unit: str
    change: Number
    half_interval: Number
    before: Number
    """The file's value; NaN if it is in more than one number."""
    allowed: Number
    """95 % half interval of the file's value by its [uncertainty]."""
    fitted: bool
    """True if a calibration fits it."""
    explained_ratio: float
    """Share of the misfit of friction alone."""
    fall: Number

    @property
    def plausible_fall(self) -> float:
        """The fall, less what its size costs."""
        if self.allowed == 0.0:
            return self.fall
        return self.fall - (QUANTILE * self.change / (PLAUSIBLE * self.allowed)) ** 2

    def __str__(self) -> str:
        change = f"{self.words} {self.change:+.3g} ± {self.half_interval:.2g} {self.unit}"
        allowed = f"allowed by its [uncertainty] ± {self.allowed:.2g}"
        if math.isnan(self.before):
            return f"{change} ({allowed})"
        after = self.before + self.change
        return f"{change} ({after:.4g}, the file has {self.before:.4g}, {allowed})"


@dataclass(frozen=True, slots=True)
class Check:
    """Result of the check of the mechanism."""

    well: bool
    best: Explanation
    as_good: tuple[Explanation, ...]
    hip_left_nm: float
    slide_left_n: float
    """Rms residual of the best friction, which the mechanism might explain."""

    @property
    def mendable(self) -> bool:
        """True if nothing is wrong, or if calibration corrects it."""
        return self.well or any(one.fitted for one in (self.best, *self.as_good))

    def __str__(self) -> str:
        if self.well:
            return (
                f"the mechanism fits: {self.hip_left_nm:.2g} N·m and {self.slide_left_n:.2g} N rms "
                "are left beside friction"
            )
        text = (
            f"the mechanism does not fit: friction alone leaves {self.hip_left_nm:.2g} N·m and "
            f"{self.slide_left_n:.2g} N rms. Best explained by {self.best}, which takes away "
            f"{self.best.explained_ratio:.0%} of it"
        )
        if self.as_good:
            others = "; ".join(str(one) for one in self.as_good)
            text += f". This recording cannot distinguish it from: {others}"
        return text


def refuse_wrong_branch(robot: Robot, motion: Motion) -> None:
    """Refuse a recording whose first pose is impossible for a leg.

    Raises:
        RecordingError: the mechanism does not close there, or the knee is bent backwards.
    """
    leg = leg_parameters(robot)
    for row in np.flatnonzero(motion.begins):
        q = np.ascontiguousarray(motion.smooth[row, :2])
        where = f"{motion.sources[0]}: at hip {math.degrees(q[0]):.1f} deg and slide {q[1]:.3f} m"
        try:
            knee = float(knee_angle(leg, q))
        except WorkspaceError as error:
            raise RecordingError(
                f"{where}, where it begins, the robot file's shank and shoe do not meet: wrong "
                "encoder offset, wrong lengths or wrong rail"
            ) from error
        if knee < START_KNEE_MIN_RAD:
            raise RecordingError(
                f"{where}, where it begins, the knee would be bent backwards by "
                f"{-math.degrees(knee):.0f} deg: wrong branch of the mechanism, wrong sign or "
                "wrong encoder offset"
            )


def judge(robot: Robot, fitted: Robot, motion: Motion) -> Check:
    """Find the number that is wrong in a mechanism whose springs and drives are fitted.

    What these explain is no fault, unless one other number of the file explains as much alone: then
    they have taken its place within this range of motion, and would be wrong outside of it.

    Args:
        robot: of the file to begin with.
        fitted: with the fitted values.
        motion: the recording.

    Raises:
        RecordingError: no axis moves.
    """
    left = check(fitted, motion, springs_free=True)
    if not left.well:
        return left
    given = check(robot, motion)
    if given.mendable:
        return left
    regression = _Regression(robot, motion)
    fall = regression.fall(robot, fitted)
    return left if fall > given.best.fall + SIGNIFICANT else given


def check(robot: Robot, motion: Motion, *, springs_free: bool = False) -> Check:
    """Find the number of the mechanism that explains best what friction does not.

    Args:
        robot: with the numbers to check.
        motion: the recording.
        springs_free: let each candidate have the springs and drives that suit it best.

    Raises:
        RecordingError: no axis moves.
    """
    regression = _Regression(robot, motion, springs_free=springs_free)
    alone = regression.misfit(robot)
    absent = tuple(
        f"{axis} spring" for axis, k in zip(AXES, _stiffness(robot), strict=True) if not k
    )
    tried = [
        _explain(robot, regression, candidate, alone)
        for candidate in CANDIDATES
        if not candidate.words.startswith(absent) and not (springs_free and candidate.fitted)
    ]
    most = max(tried, key=lambda one: one.fall)
    well = most.fall < SIGNIFICANT or regression.noticed(robot, most) < NOTICED
    enough = [one for one in tried if one.fall >= ENOUGH_RATIO * most.fall]
    best = max(enough, key=lambda one: one.plausible_fall)
    least = best.plausible_fall - AS_GOOD
    as_good = tuple(one for one in enough if one is not best and one.plausible_fall > least)
    left = regression.left_rms(robot)
    return Check(well, best, () if well else as_good, *left)


def _stiffness(robot: Robot) -> tuple[float, float]:
    return robot.springs.hip.stiffness_nm_per_rad, robot.springs.slide.stiffness_n_per_m


def _explain(
    robot: Robot, regression: "_Regression", candidate: Candidate, alone: float
) -> Explanation:
    def differences(x: Vector) -> Vector:
        return regression.differences(candidate.changed(robot, float(x[0]) * candidate.scale))

    found = least_squares(differences, np.zeros(1), diff_step=1e-3, x_scale=1.0, max_nfev=12)
    misfit = 2.0 * float(found.cost)
    blocks = regression.block_count
    slope = float(np.sum(found.jac**2))
    # Share of the remaining variance, in independent samples.
    std = math.sqrt(misfit / blocks / max(slope / len(found.fun), 1e-12) / len(found.fun))
    return Explanation(
        candidate.words,
        candidate.unit,
        float(found.x[0]) * candidate.scale,
        QUANTILE * std * candidate.scale,
        value_of(robot, candidate.key) if candidate.key else math.nan,
        QUANTILE * candidate.std(robot),
        candidate.fitted,
        1.0 - misfit / alone,
        blocks * math.log(alone / max(misfit, 1e-300)),
    )


class _Regression:
    """Residual efforts without the friction's free factors; in units of Coulomb levels."""

    def __init__(self, robot: Robot, motion: Motion, *, springs_free: bool = False) -> None:
        self.motion = motion
        self.rows: list[NDArray[np.bool_]] = []
        self.bases: list[Matrix] = []
        self.scales: list[float] = []
        self.laws = friction_parameters(robot)
        for axis in range(2):
            speed = np.abs(motion.velocity[:, axis])
            enough = extent(motion, axis).enough(axis)
            chosen = motion.seen[:, axis] & (speed > 3 * REST[axis]) & enough
            self.rows.append(chosen)
            sprung = _stiffness(robot)[axis] > 0.0
            base = self._base(axis, chosen, sprung=sprung, springs_free=springs_free)
            self.bases.append(np.linalg.qr(base)[0] if np.any(chosen) else base)
        if not any(np.any(rows) for rows in self.rows):
            raise RecordingError(
                f"{motion.sources[0]}: neither axis moves; nothing can be identified"
            )
        left = self._left(leg_parameters(robot), robot)
        for axis in range(2):
            values = left[self.rows[axis], axis]
            self.scales.append(float(np.median(np.abs(values))) if len(values) else 1.0)

    @property
    def block_count(self) -> float:
        """Number of independent samples."""
        return sum(float(np.count_nonzero(rows)) for rows in self.rows) / BLOCK_ROWS

    def _base(
        self, axis: int, chosen: NDArray[np.bool_], *, sprung: bool, springs_free: bool
    ) -> Matrix:
        v = self.motion.velocity[chosen, axis]
        before = self.motion.smooth[chosen, 4 + axis]
        speed = FAST[axis] / 3
        slow = np.sign(v) * np.exp(-np.abs(v) / speed)
        along = np.sign(v) * self.motion.smooth[chosen, axis]
        base = [np.sign(v), along, slow, v, v * np.abs(v), np.tanh(before / 0.5) * slow]
        if springs_free:
            base.append(before)
        if springs_free and sprung:
            base.append(self.motion.smooth[chosen, axis])
        if springs_free or not sprung:
            # Without a spring, whose rest position adds one, a constant effort is fitted, too.
            base.append(np.ones(len(v)))
        return np.column_stack(base)

    def _left(self, leg: LegParameters, robot: Robot) -> Matrix:
        left = np.empty((len(self.motion.steps_s), 2))
        share = 1.0 if robot.observer.coriolis else 0.0
        effort = self.motion.smooth_effort - np.array(observer_tuning(robot).effort_offset)
        residual_effort(leg, share, self.motion.smooth, effort, left)
        return left

    def differences(self, robot: Robot) -> Vector:
        """Residuals of both axes in Coulomb levels, one after the other."""
        pairs = zip(self._residuals(robot), self.scales, strict=True)
        return np.concatenate([rest / scale for rest, scale in pairs])

    def _residuals(self, robot: Robot) -> list[Vector]:
        """Efforts that the best friction leaves, of each axis: N·m, N; empty if it rests."""
        left = self._left(leg_parameters(robot), robot)
        parts = (left[rows, axis] for axis, rows in enumerate(self.rows))
        return [
            values - base @ (base.T @ values) if len(values) else values
            for values, base in zip(parts, self.bases, strict=True)
        ]

    def misfit(self, robot: Robot) -> float:
        return float(np.sum(self.differences(robot) ** 2))

    def fall(self, before: Robot, after: Robot) -> float:
        """Fall of the misfit from one robot to another, in block units."""
        return self.block_count * math.log(self.misfit(before) / max(self.misfit(after), 1e-300))

    def noticed(self, robot: Robot, best: Explanation) -> float:
        """Rms effort of the change, over the Coulomb level."""
        candidate = next(one for one in CANDIDATES if one.words == best.words)
        change = self.differences(candidate.changed(robot, best.change)) - self.differences(robot)
        return float(np.sqrt(np.mean(change**2)))

    def left_rms(self, robot: Robot) -> tuple[float, float]:
        """Rms residual of the best friction, N·m and N."""
        hip, slide = (
            float(np.sqrt(np.mean(rest**2))) if len(rest) else 0.0
            for rest in self._residuals(robot)
        )
        return hip, slide
