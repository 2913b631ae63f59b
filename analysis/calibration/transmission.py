"""How the transmissions give way, from the empty machine's recording.

The encoder sits at the drive's shaft. Behind a transmission that gives way the joint lags by the
windup

    w = c t + b/2 tanh(t / t_0)        compliance c, backlash b; t_0: GAP_EFFORT

of the effort t that goes through: the drive's, less what accelerates its rotor. While the joint
sticks between two reversals, the encoder shows this windup. It is no creep of the friction law:
that grows with time, and windup with effort. It is no bristles either: these break away, and windup
goes on with the effort while the axis moves.

So the likelihood is evaluated on the motion of the joints, with c as one more value, from a rigid
axis on: behind a transmission that is too soft the law of friction finds an optimum of its own.
Newton's first step, with Fisher's information over all fitted values, tells whether there is
anything to find.

Where the motion surprises after the reversals of the load, c and b are searched together. How a
shaft crosses its gap and swings behind it is in no model here, so the rows of a crossing take no
part: the encoder's way from one side to the other is left.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.calibration.fit import (
    AS_GIVEN,
    AS_GOOD_WITHOUT,
    EQUAL_PER_SAMPLE,
    QUANTILE,
    Fit,
    Progress,
    Result,
    fitted_on,
)
from analysis.calibration.likelihood import (
    CLIP,
    PRIOR_TIMING,
    Flags,
    Likelihood,
    robust_covariance,
    scores,
)
from analysis.calibration.motion import Motion, smoothed
from analysis.calibration.quantities import LAW_SIZE, SIZE, TIMING, Quantity, value_of
from analysis.recording import RecordingError
from daemon.config.settings import Robot
from observer.filter.transmission import GAP_EFFORT
from observer.quantities import Number

Vector = NDArray[np.float64]

STIFFNESSES: Final = (
    Quantity("transmission.hip.stiffness_nm_per_rad", "hip transmission stiffness", "N·m/rad", 0),
    Quantity("transmission.slide.stiffness_n_per_m", "slide transmission stiffness", "N/m", 1),
)
BACKLASHES: Final = (
    Quantity("transmission.hip.backlash_rad", "hip transmission backlash", "rad", 0),
    Quantity("transmission.slide.backlash_m", "slide transmission backlash", "m", 1),
)
COULOMB_KEYS: Final = ("friction.hip.coulomb_nm", "friction.slide.coulomb_n")
DRIVE_KEYS: Final = ("hip.drive_inertia_kg_m2", "slide.drive_mass_kg")
WINDUP_MIN: Final = (1e-3, 2.5e-4)
"""Windup between both directions of Coulomb friction, rad and m, below which a transmission counts
as rigid, and a change as none: twenty and ten times the encoder's noise. Less backlash than this
is none, too. On rigid axes the first step is below a fifth of it."""
MODEL_RATIO: Final = (0.6, 0.3)
"""Least half interval over stiffness and over backlash: the windup has no damper, and shaft and
joint swing faster than a recording shows. Virtual hips were found up to half again as stiff, and
twice as stiff beside a gap."""
CROSSING_ROWS: Final = 20
"""From the last change of the load's sign on: a shaft of 0.35 kg m² behind 4000 N·m/rad has settled
on the other side of its gap."""
DIFFERENCE_RATIO: Final = 1e-3
"""Step of a derivative, over that of WINDUP_MIN."""
LOOSE_RATIO: Final = 2.0
"""Surprise after reversals of the load over that elsewhere, with a rigid fit, from which on a gap
is searched. Virtual machines: 2.9 to 6.9 with 0.3° or 1 mm, at most 1.3 without."""
START_RATIOS: Final = (2.0, 5.0)
"""Backlashes to begin at, over WINDUP_MIN: the likelihood has more than one optimum, and an
interval holds all that explain the recording equally well."""
ROUNDS: Final = 8
CONVERGED_RATIO: Final = 0.05
"""Last step over the value: far inside its interval."""
HARDLY_MOVED: Final = "the axis hardly moved"
OF_BRISTLES: Final = "the file's bristles give way like it"
STIFFER: Final = "the recording shows one that gives way less; the file's only widens sigma"


class GivesWay(NamedTuple):
    """How far a transmission gives way; nothing: rigid."""

    compliance_si: float = 0.0
    """rad/(N m) or m/N."""
    backlash_si: float = 0.0
    """rad or m, from side to side."""


RIGID: Final = (GivesWay(), GivesWay())


class Found(NamedTuple):
    """How an axis gives way, with 95 % half intervals."""

    way: GivesWay
    half: GivesWay


def ways_of(found: Mapping[int, Found]) -> tuple[GivesWay, GivesWay]:
    """How both axes give way."""
    hip, slide = (found[axis].way if axis in found else RIGID[axis] for axis in range(2))
    return hip, slide


def loose_axes(ways: tuple[GivesWay, GivesWay]) -> list[int]:
    """Axes with backlash."""
    return [axis for axis in range(2) if ways[axis].backlash_si]


def stated(robot: Robot) -> tuple[GivesWay, GivesWay]:
    """What the file says; a transmission that a recording cannot tell from a rigid one is one."""
    return _stated(robot, 0), _stated(robot, 1)


def _stated(robot: Robot, axis: int) -> GivesWay:
    stiffness = value_of(robot, STIFFNESSES[axis].key)
    compliance = 1.0 / stiffness if stiffness else 0.0
    backlash = value_of(robot, BACKLASHES[axis].key)
    least = _least(axis, value_of(robot, COULOMB_KEYS[axis]))
    return GivesWay(
        compliance if compliance >= least.compliance_si else 0.0,
        backlash if backlash >= least.backlash_si else 0.0,
    )


def load_of(motion: Motion, robot: Robot, axis: int) -> Vector:
    """Effort that goes through a transmission, (n): N·m or N."""
    rotor = value_of(robot, DRIVE_KEYS[axis]) * motion.smooth[:, 4 + axis]
    load: Vector = motion.smooth_effort[:, axis] - rotor
    return load


def of_joints(motion: Motion, robot: Robot, ways: tuple[GivesWay, GivesWay]) -> Motion:
    """The motion of the joints behind these transmissions, which a recording shows of the shafts.

    While a shaft crosses its gap, the position of its joint is not known.

    Args:
        motion: as the encoders show it.
        robot: with the inertias of the drives.
        ways: how hip and slide give way.
    """
    if ways == RIGID:
        return motion
    position, smooth = motion.position.copy(), motion.smooth.copy()
    period_s = float(np.median(motion.steps_s))
    for axis, (compliance, backlash) in enumerate(ways):
        load = load_of(motion, robot, axis)
        windup = compliance * load + 0.5 * backlash * np.tanh(load / GAP_EFFORT[axis])
        position[:, axis] -= windup
        for order in range(3):
            smooth[:, 2 * order + axis] -= smoothed(windup, order, period_s)
    moved = replace(motion, position=position, smooth=smooth)
    return outside_gaps(moved, motion, robot, loose_axes(ways))


def outside_gaps(moving: Motion, motion: Motion, robot: Robot, axes: Iterable[int]) -> Motion:
    """The moving machine without the positions at which the shafts of these axes cross their gaps.

    Args:
        moving: to leave rows out of.
        motion: the same rows, as the encoders show them.
        robot: with the inertias of the drives.
        axes: loose ones.
    """
    position = moving.position.copy()
    for axis in axes:
        is_open = np.abs(load_of(motion, robot, axis)) < 2.0 * GAP_EFFORT[axis]
        out = (crosses(motion, robot, axis) | is_open) & ~motion.rests[:, axis]
        position[out, axis] = np.nan
    return replace(moving, position=position)


def crosses(motion: Motion, robot: Robot, axis: int) -> Flags:
    """Rows in which a shaft may cross the gap of its transmission, or swings after it, (n)."""
    loaded = np.sign(load_of(motion, robot, axis))
    reversed_now = np.append(False, loaded[1:] != loaded[:-1])
    made: Flags = np.convolve(reversed_now, np.ones(CROSSING_ROWS))[: len(loaded)] > 0.0
    return made


def softness(
    made: Fit,
    motion: Motion,
    robot: Robot,
    progress: Progress,
    near: Mapping[int, Found] = MappingProxyType({}),
) -> dict[int, Found]:
    """How the axes give way that are not rigid, by axis.

    Args:
        made: fitted as if both were rigid, or behind `near`.
        motion: as the encoders show it.
        robot: the given file.
        progress: called with a text and the share done.
        near: what an earlier search found.
    """
    found: dict[int, Found] = {}
    for axis in range(2):
        if axis * LAW_SIZE in made.fixed or made.frame.bristled(axis):
            continue
        one = _of_axis(made, motion, robot, axis, progress, near)
        if any(one.way):
            found[axis] = one
    return found


def _of_axis(
    made: Fit,
    motion: Motion,
    robot: Robot,
    axis: int,
    progress: Progress,
    near: Mapping[int, Found],
) -> Found:
    ways = ways_of(near)
    soft = _Search(made, motion, robot, axis, ("compliance_si",), progress, ways)
    loose = _Search(made, motion, robot, axis, GivesWay._fields, progress, ways)
    way = ways[axis]
    if way.backlash_si:
        again = loose.end(way).found
        half = GivesWay(*map(max, again.half, near[axis].half))
        if again.way.backlash_si > half.backlash_si:
            return Found(again.way, half)
        way = way._replace(backlash_si=0.0)
    without = soft.end(way).found
    if axis in near or _surprise_after_reversals(made, motion, robot, axis) <= LOOSE_RATIO:
        return without
    starts = (without.way._replace(backlash_si=x * WINDUP_MIN[axis]) for x in START_RATIOS)
    best = best_of([loose.end(start) for start in starts])
    return best if best.way.backlash_si > best.half.backlash_si else without


def _surprise_after_reversals(made: Fit, motion: Motion, robot: Robot, axis: int) -> float:
    """Mean of z^2 / s where a shaft may cross its gap, over that of the other rows."""
    likelihood = Likelihood(made.frame, motion, ~motion.held_out)
    found = likelihood.surprises(made.frame.free(made.natural))
    row, axes = np.nonzero(likelihood.counted)
    size = np.minimum(found.z**2 / found.s, CLIP)[axes == axis]
    crossing = crosses(motion, robot, axis)[row[axes == axis]]
    if np.all(crossing) or not np.any(crossing):
        return 0.0
    return float(np.mean(size[crossing]) / np.mean(size[~crossing]))


class End(NamedTuple):
    """Where a search ends."""

    found: Found
    loss_per_sample: Number


def best_of(ends: Sequence[End]) -> Found:
    """The best end; its interval holds the backlash of each that explains the recording as well."""
    best = min(ends, key=lambda end: end.loss_per_sample)
    (way, half), least = best.found, best.loss_per_sample + EQUAL_PER_SAMPLE
    as_good = (end.found.way.backlash_si for end in ends if end.loss_per_sample <= least)
    spread = max(abs(other - way.backlash_si) for other in as_good)
    return Found(way, half._replace(backlash_si=max(half.backlash_si, spread)))


class _Search:
    """Search of how one axis gives way."""

    def __init__(
        self,
        made: Fit,
        motion: Motion,
        robot: Robot,
        axis: int,
        names: tuple[str, ...],
        progress: Progress,
        ways: tuple[GivesWay, GivesWay],
    ) -> None:
        """Search the first fields of GivesWay; with backlash, the rows of a gap take no part.

        `ways` has that of the other axis.
        """
        self._made, self._motion, self._robot, self._axis = made, motion, robot, axis
        self._names, self._progress, self._ways = names, progress, ways
        self._loose = [axis] if "backlash_si" in names else []

    def end(self, way: GivesWay) -> End:
        """The best of the steps from `way` on, each with a fit of the law.

        Its loss is infinite where no motion can be computed.
        """
        least = _least(self._axis, float(self._made.natural[self._axis * LAW_SIZE]))
        free = self._made.frame.free(self._made.natural)
        best = End(Found(GivesWay(), GivesWay()), np.inf)
        for _ in range(ROUNDS):
            likelihood = self._likelihood(way)
            try:
                free = fitted_on(self._made, likelihood, self._progress, free)
                change, std = self._step(way, free)
            except RecordingError:
                break
            loss_per_sample = likelihood.surprises(free).loss / len(likelihood.row)
            if loss_per_sample < best.loss_per_sample:
                best = End(_told(way, std, least), loss_per_sample)
            better = way._replace(
                **{
                    name: max(getattr(way, name) + step, 0.0)
                    for name, step in zip(self._names, change.tolist(), strict=True)
                }
            )
            close = (
                abs(new - old) <= (CONVERGED_RATIO * max(old, bound) if any(way) else bound)
                for new, old, bound in zip(better, way, least, strict=True)
            )
            if all(close):
                break
            way = better
        return best

    def _likelihood(self, way: GivesWay) -> Likelihood:
        hip, slide = self._ways
        ways = (way, slide) if self._axis == 0 else (hip, way)
        joints = of_joints(self._motion, self._robot, ways)
        joints = outside_gaps(joints, self._motion, self._robot, self._loose)
        return Likelihood(self._made.frame, joints, ~self._motion.held_out)

    def _step(
        self, way: GivesWay, free: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Newton's step with all fitted values, and its standard deviation, one for each name.

        Raises:
            RecordingError: no motion can be computed beside `way`.
        """
        which = np.array([i for i in range(SIZE) if i not in self._made.fixed], dtype=np.intp)
        here = self._likelihood(way)
        base, dz, ds = here.derivatives(free, which)
        count = len(self._names)
        least = _least(self._axis, float(self._made.natural[self._axis * LAW_SIZE]))
        units = np.array(least[:count])
        for name, unit in zip(self._names, units.tolist(), strict=True):
            moved = way._replace(**{name: getattr(way, name) + DIFFERENCE_RATIO * unit})
            beside = self._likelihood(moved).surprises(free)
            dz = np.column_stack((dz, (beside.z - base.z) / DIFFERENCE_RATIO))
            ds = np.column_stack((ds, (beside.s - base.s) / DIFFERENCE_RATIO))
        each, fisher = scores(base, dz, ds)
        if not np.all(np.isfinite(fisher)):
            raise RecordingError("no motion can be computed behind such a transmission")
        fisher += np.diag(np.append((which >= TIMING) / PRIOR_TIMING**2, np.zeros(count)))
        change = -np.linalg.lstsq(fisher, each.sum(axis=0), rcond=None)[0][-count:]
        variance = np.diag(robust_covariance(each, fisher, here.row))[-count:]
        return units * change, units * np.sqrt(np.maximum(variance, 0.0))


def results_of(
    robot: Robot, made: Fit, found: Mapping[int, Found], as_good: bool
) -> tuple[Result, ...]:
    """What becomes of stiffness and backlash of the file, hip and slide in turn.

    Args:
        robot: the given file.
        made: the fit.
        found: see `softness`.
        as_good: the held-out part is described as well without what was found.
    """
    made_results: list[Result] = []
    for axis in range(2):
        given, one = stated(robot)[axis], found.get(axis)
        for place, quantity in enumerate((STIFFNESSES[axis], BACKLASHES[axis])):
            before = value_of(robot, quantity.key)
            value, half = (one.way[place], one.half[place]) if one else (0.0, 0.0)
            if value and quantity in STIFFNESSES:
                value, half = 1.0 / value, half / value**2
            if value and not as_good and abs(value - before) > half:
                made_results.append(Result(quantity, before, value, half, ""))
                continue
            if axis * LAW_SIZE in made.fixed:
                reason = HARDLY_MOVED
            elif made.frame.bristled(axis):
                reason = OF_BRISTLES
            elif as_good and value:
                reason = AS_GOOD_WITHOUT
            else:
                reason = STIFFER if given[place] and not value else AS_GIVEN
            made_results.append(Result(quantity, before, before, float("nan"), reason))
    return tuple(made_results)


def _told(way: GivesWay, std: Vector, least: GivesWay) -> Found:
    """What of a way counts, with the half intervals of what was searched."""
    searched = np.maximum(QUANTILE * std, (np.array(MODEL_RATIO) * way)[: len(std)])
    half = GivesWay(*searched.tolist())
    compliance = way.compliance_si if way.compliance_si > least.compliance_si else 0.0
    backlash = way.backlash_si if way.backlash_si > least.backlash_si else 0.0
    return Found(GivesWay(compliance, backlash), half)


def _least(axis: int, coulomb: float) -> GivesWay:
    return GivesWay(WINDUP_MIN[axis] / (2.0 * coulomb), WINDUP_MIN[axis])
