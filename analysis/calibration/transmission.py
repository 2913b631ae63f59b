"""How softly the transmissions give way, from the empty machine's recording.

The encoder sits at the drive's shaft. Behind an elastic transmission the joint lags by `c t`, with
the compliance c and the effort t that goes through: the drive's, less what accelerates its rotor.
While the joint sticks between two reversals, the encoder shows this windup. It is no creep of the
friction law: that grows with time, and windup with effort. It is no bristles either: these break
away, and windup goes on with the effort while the axis moves.

So the likelihood is evaluated on the motion of the joints, with c as one more value, from a rigid
axis on: behind a transmission that is too soft the law of friction finds an optimum of its own.
Newton's first step, with Fisher's information over all fitted values, tells whether there is
anything to find. How a shaft crosses a gap is in no model here: a gap leaves effort after each
change of the load's sign, of which `verdict.py` tells.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.calibration.fit import (
    AS_GIVEN,
    AS_GOOD_WITHOUT,
    QUANTILE,
    Fit,
    Progress,
    Result,
    fitted_on,
)
from analysis.calibration.likelihood import (
    PRIOR_TIMING,
    Likelihood,
    robust_covariance,
    scores,
)
from analysis.calibration.motion import Motion, smoothed
from analysis.calibration.quantities import LAW_SIZE, SIZE, TIMING, Quantity, value_of
from daemon.config.settings import Robot

Vector = NDArray[np.float64]

STIFFNESSES: Final = (
    Quantity("transmission.hip.stiffness_nm_per_rad", "hip transmission stiffness", "N·m/rad", 0),
    Quantity("transmission.slide.stiffness_n_per_m", "slide transmission stiffness", "N/m", 1),
)
COULOMB_KEYS: Final = ("friction.hip.coulomb_nm", "friction.slide.coulomb_n")
DRIVE_KEYS: Final = ("hip.drive_inertia_kg_m2", "slide.drive_mass_kg")
WINDUP_MIN: Final = (1e-3, 2.5e-4)
"""Windup between both directions of Coulomb friction, rad and m, below which a transmission counts
as rigid, and a change as none: twenty and ten times the encoder's noise. On rigid axes the first
step is below a fifth of it."""
MODEL_RATIO: Final = 0.3
"""Least half interval over the compliance: the windup has no damper, and shaft and joint swing
faster than a recording shows. Virtual axes of 800 N·m/rad are found up to 26 % stiffer for that."""
DIFFERENCE_RATIO: Final = 1e-3
"""Step of a derivative, over the compliance of WINDUP_MIN."""
ROUNDS: Final = 8
CONVERGED_RATIO: Final = 0.05
"""Last step over the compliance: far inside its interval."""
HARDLY_MOVED: Final = "the axis hardly moved"
OF_BRISTLES: Final = "the file's bristles give way like it"
STIFFER: Final = "the recording shows a stiffer one; the file's only widens sigma"


class Compliances(NamedTuple):
    """How far both transmissions give way; 0: rigid."""

    hip_rad_per_nm: float
    slide_m_per_n: float


RIGID: Final = Compliances(0.0, 0.0)


def stated(robot: Robot) -> Compliances:
    """What the file says; a transmission that a recording cannot tell from a rigid one is one."""
    made = [0.0, 0.0]
    for axis, quantity in enumerate(STIFFNESSES):
        if stiffness := value_of(robot, quantity.key):
            least = _compliance_of(WINDUP_MIN[axis], value_of(robot, COULOMB_KEYS[axis]))
            made[axis] = 1.0 / stiffness if 1.0 / stiffness >= least else 0.0
    return Compliances(*made)


def load_of(motion: Motion, robot: Robot, axis: int) -> Vector:
    """Effort that goes through a transmission, (n): N·m or N."""
    rotor = value_of(robot, DRIVE_KEYS[axis]) * motion.smooth[:, 4 + axis]
    load: Vector = motion.smooth_effort[:, axis] - rotor
    return load


def of_joints(motion: Motion, robot: Robot, compliances: Compliances) -> Motion:
    """The motion of the joints behind these transmissions, which a recording shows of the shafts.

    Args:
        motion: as the encoders show it.
        robot: with the inertias of the drives.
        compliances: of both axes.
    """
    if not any(compliances):
        return motion
    position, smooth = motion.position.copy(), motion.smooth.copy()
    period_s = float(np.median(motion.steps_s))
    for axis, compliance in enumerate(compliances):
        windup = compliance * load_of(motion, robot, axis)
        position[:, axis] -= windup
        for order in range(3):
            smooth[:, 2 * order + axis] -= smoothed(windup, order, period_s)
    return replace(motion, position=position, smooth=smooth)


def softness(
    made: Fit, motion: Motion, robot: Robot, progress: Progress
) -> dict[int, tuple[float, float]]:
    """Compliances of the axes that are not rigid, with 95 % half intervals, by axis.

    Args:
        made: fitted as if both were rigid.
        motion: as the encoders show it.
        robot: the given file.
        progress: called with a text and the share done.
    """
    found: dict[int, tuple[float, float]] = {}
    for axis in range(2):
        if axis * LAW_SIZE in made.fixed or made.frame.bristled(axis):
            continue
        least = _compliance_of(WINDUP_MIN[axis], float(made.natural[axis * LAW_SIZE]))

        def likelihood(compliance: float, axis: int = axis) -> Likelihood:
            way = RIGID._replace(**{RIGID._fields[axis]: compliance})
            return Likelihood(made.frame, of_joints(motion, robot, way), ~motion.held_out)

        compliance, half, free = 0.0, 0.0, made.frame.free(made.natural)
        for number in range(ROUNDS):
            change, std = _step(made, likelihood, compliance, free, least)
            half = QUANTILE * std
            better = max(compliance + change, 0.0)
            enough = CONVERGED_RATIO * compliance if number else least
            if abs(better - compliance) <= enough:
                break
            compliance = better
            free = fitted_on(made, likelihood(compliance), progress, free)
        else:
            continue  # no optimum
        if compliance > least:
            found[axis] = compliance, max(half, MODEL_RATIO * compliance)
    return found


def results_of(
    robot: Robot, made: Fit, found: Mapping[int, tuple[float, float]], as_good: bool
) -> tuple[Result, ...]:
    """What becomes of both stiffnesses of the file.

    Args:
        robot: the given file.
        made: the fit.
        found: see `softness`.
        as_good: the held-out part is described as well without what was found.
    """
    made_results: list[Result] = []
    for axis, quantity in enumerate(STIFFNESSES):
        before = value_of(robot, quantity.key)
        given = stated(robot)[axis]
        compliance, half = found.get(axis, (0.0, 0.0))
        if axis in found and not as_good and abs(compliance - given) > half:
            value = 1.0 / compliance
            made_results.append(Result(quantity, before, value, half * value**2, ""))
            continue
        if axis * LAW_SIZE in made.fixed:
            reason = HARDLY_MOVED
        elif made.frame.bristled(axis):
            reason = OF_BRISTLES
        elif as_good and axis in found:
            reason = AS_GOOD_WITHOUT
        else:
            reason = STIFFER if given and axis not in found else AS_GIVEN
        made_results.append(Result(quantity, before, before, float("nan"), reason))
    return tuple(made_results)


def _compliance_of(windup: float, coulomb: float) -> float:
    return windup / (2.0 * coulomb)


def _step(
    made: Fit,
    likelihood: Callable[[float], Likelihood],
    compliance: float,
    free: NDArray[np.float64],
    unit: float,
) -> tuple[float, float]:
    """Newton's step of a compliance with all fitted values, and its standard deviation."""
    which = np.array([i for i in range(SIZE) if i not in made.fixed], dtype=np.intp)
    here = likelihood(compliance)
    base, dz, ds = here.derivatives(free, which)
    beside = likelihood(compliance + DIFFERENCE_RATIO * unit).surprises(free)
    dz = np.column_stack((dz, (beside.z - base.z) / DIFFERENCE_RATIO))
    ds = np.column_stack((ds, (beside.s - base.s) / DIFFERENCE_RATIO))
    each, fisher = scores(base, dz, ds)
    fisher += np.diag(np.append((which >= TIMING) / PRIOR_TIMING**2, 0.0))
    change = -float(np.linalg.lstsq(fisher, each.sum(axis=0), rcond=None)[0][-1])
    variance = float(robust_covariance(each, fisher, here.row)[-1, -1])
    return unit * change, unit * max(variance, 0.0) ** 0.5
