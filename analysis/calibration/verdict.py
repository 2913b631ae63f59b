"""Comparison of old and new robot file on held-out data.

The observer runs with each file's own numbers over the held-out recording: any patient effort in
the empty machine is an error, and NIS shows whether the observer's confidence is consistent. The
likelihood per sample of the filter without a patient is given as well.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.calibration.fit import EQUAL_PER_SAMPLE
from analysis.calibration.likelihood import FINE_SUBSTEPS, Likelihood
from analysis.calibration.motion import REST, Motion
from analysis.calibration.quantities import LAW_SIZE, NOISE, TIMING, Frame
from analysis.calibration.start import extent
from analysis.calibration.transmission import BACKLASHES, crosses
from analysis.replay import filter_setup
from daemon.config.settings import Robot
from observer.offline.batch import Columns, run
from observer.quantities import Number

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Flags = NDArray[np.bool_]
WORSE_MAX_RATIO: Final = 1.02
"""Growth of the false effort above which an axis got worse."""
GOOD_RATIO: Final = 0.03
"""False effort over the Coulomb level that is negligible."""
PATIENT_MIN_RATIO: Final = 0.2
"""False effort while moving, over the Coulomb level, that our friction law cannot cause."""
NOISES: Final = tuple(power * math.log(2.0) for power in range(-2, 16, 2))
"""Logarithms of the factors on fitted noise between which the noise of a given law is searched."""
NOISE_STEPS: Final = tuple(
    math.log(2.0) * power * np.array(way)
    for power, way in product(
        (0.125, 0.25, 0.5, 1.0, 2.0, 3.0), product((-1.0, 0.0, 1.0), repeat=2)
    )
    if any(way)
)
"""Steps of this search, in the noise of effort and of friction. The loss of a law that is far off
is rough: neighbouring factors differ by 100, and a simplex ends too soon."""
LIKELIER_MIN: Final = 0.1
"""The search ends where its best step lowers the loss of all rows by less."""
EQ_11: Final = "with a fit of eq. (11)"
CONTACT_ROWS: Final = 100
"""A second: rows this much above the others are a contact, for instance with an end stop."""
CONTACT_RATIO: Final = 5.0
CONTACT_SHARE_MAX: Final = 0.2
"""Share of a recording: more frequent events are no single contact, but another effect."""
GAP_SHARE_MIN: Final = 0.8
"""Share of the squared effort after reversals of the load from which on a gap is its likely
cause. Measured on virtual machines: 0.87 and 0.92 at a hip with 0.3° of backlash; up to 0.71 with
twice the edge of friction, up to 0.46 with half or twice its hump, at most 0.35 with a level or a
spring 30 % off, or a soft transmission. A gap of a drive that is soft as well, or of a slide, stays
below it."""


class Score(NamedTuple):
    """Score of one robot file on the rows that were not fitted."""

    loss_per_sample: Number
    nis: float
    """Mean; 2 is ideal."""
    hip_rms_nm: float
    """Rms of the false patient effort while the hip moves."""
    slide_rms_n: float


@dataclass(frozen=True, slots=True, eq=False)
class Disturbance:
    """Estimated patient effort over the whole recording."""

    patient: Matrix
    """Shape (n, 2): N·m, N."""
    nis: Vector
    moving: Flags
    """Shape (n, 2)."""


def disturbance(robot: Robot, motion: Motion) -> Disturbance:
    """Run the observer of a robot file over a motion."""
    made = run(filter_setup(robot), Columns(motion.time_s, motion.position, motion.effort))
    moving = np.abs(motion.velocity) > 2.0 * np.array(REST)
    known = np.isfinite(made.state[:, 6:8])
    return Disturbance(made.state[:, 6:8], made.nis, moving & known & motion.settled[:, None])


def without_contact_rows(seen: Disturbance, natural: Vector) -> tuple[Disturbance, Flags]:
    """Exclude a few short contacts, which do not depend on friction; also return their rows.

    Args:
        seen: result with the calibrated file.
        natural: the calibrated values.

    Returns:
        The disturbance, in which no row of a contact counts as moving, and a flag for each row.
    """
    coulomb = natural[[0, LAW_SIZE]]
    size = np.max(np.where(seen.moving, np.abs(seen.patient) / coulomb, 0.0), axis=1)
    loudness = _windowed(size, CONTACT_ROWS)
    loud = loudness > max(CONTACT_RATIO * float(np.median(loudness)), PATIENT_MIN_RATIO)
    contact = _windowed(loud.astype(np.float64), CONTACT_ROWS) > 0.0
    if np.mean(contact) > CONTACT_SHARE_MAX:
        contact = np.zeros(len(contact), dtype=np.bool_)
    return replace(seen, moving=seen.moving & ~contact[:, None]), contact


def outside_swings(
    seen: Disturbance, motion: Motion, robot: Robot, axes: Iterable[int]
) -> Disturbance:
    """Without the rows in which the shafts of these loose axes cross their gaps or swing."""
    moving = seen.moving.copy()
    for axis in axes:
        moving[:, axis] &= ~crosses(motion, robot, axis)
    return replace(seen, moving=moving)


def score(frame: Frame, natural: Vector, motion: Motion, rows: Flags, seen: Disturbance) -> Score:
    """Score natural values, and the observer's run with them, on some rows."""
    likelihood = Likelihood(frame, motion, rows, FINE_SUBSTEPS)
    loss = likelihood.surprises(frame.free(natural)).loss / max(len(likelihood.row), 1)
    nis = seen.nis[rows & np.isfinite(seen.nis) & motion.settled]
    rms = [rms_of(seen, rows, axis) for axis in range(2)]
    return Score(loss, float(np.mean(nis)) if len(nis) else float("nan"), rms[0], rms[1])


def rms_of(seen: Disturbance, rows: Flags, axis: int) -> float:
    """False effort of an axis while it moves; NaN where it does not."""
    chosen = seen.patient[rows & seen.moving[:, axis], axis]
    return float(np.sqrt(np.mean(chosen**2))) if len(chosen) else float("nan")


def like_fitted(frame: Frame, fitted: Vector, motion: Motion) -> Vector:
    """Replace fitted values that are not written: only the law is compared.

    A law that explains less needs more noise: the given file gets the fitted noise of effort and
    that of friction, each times the factor with which the fitted rows are most likely.
    """
    made = frame.natural.copy()
    made[NOISE + 2 :] = fitted[NOISE + 2 :]
    likelihood = Likelihood(frame, motion, ~motion.held_out)

    def louder(log_factors: ArrayLike) -> Vector:
        natural = made.copy()
        natural[NOISE + 2 : TIMING] *= np.repeat(np.exp(log_factors), 2)
        return natural

    def loss(log_factors: ArrayLike) -> float:
        found = likelihood.surprises(frame.free(louder(log_factors))).loss
        return found if math.isfinite(found) else math.inf

    near = np.array(min(product(NOISES, repeat=2), key=loss))
    least = loss(near)
    while True:
        further = min((near + step for step in NOISE_STEPS), key=loss)
        if (less := loss(further)) >= least - LIKELIER_MIN:
            return louder(near)
        near, least = further, less


def two_optima(disagreement: str) -> str:
    """Explain that values are not used because others fit the recording equally well."""
    return (
        f"two sets of values explain this recording equally well: {disagreement}; record slow and "
        "fast motion over the whole range, as in excite friction_hip and friction_slide, and "
        "calibrate from all recordings together"
    )


def why_needless(before: Score, after: Score) -> str:
    """Text that the file describes the held-out data as well; empty if the new one is better."""
    if after.loss_per_sample < before.loss_per_sample:
        return ""
    return (
        "the file describes the held-out part as well: minus log likelihood per sample "
        f"{before.loss_per_sample:.3f}, {after.loss_per_sample:.3f} with calibrated values"
    )


def worse_axis(
    before: Score, after: Score, natural: Vector, motion: Motion, words: str = "before"
) -> str:
    """Axis that the new file describes worse on held-out data; empty if there is none."""
    pairs = (
        ("hip", before.hip_rms_nm, after.hip_rms_nm, "N·m"),
        ("slide", before.slide_rms_n, after.slide_rms_n, "N"),
    )
    for axis, (name, old, new, unit) in enumerate(pairs):
        allowed = max(WORSE_MAX_RATIO * old, GOOD_RATIO * float(natural[LAW_SIZE * axis]))
        if extent(motion, axis).enough(axis) and new > allowed:
            return (
                f"the {name}'s false effort on held-out data is {new:.3g} {unit}, {old:.3g} {words}"
            )
    return ""


def no_better_than_eq_11(eq_11: Score, after: Score, natural: Vector, motion: Motion) -> str:
    """Why eq. (11), fitted to the same rows, is as good as bristles; empty if it is not."""
    if after.loss_per_sample < eq_11.loss_per_sample - EQUAL_PER_SAMPLE:
        return worse_axis(eq_11, after, natural, motion, EQ_11)
    return (
        "minus log likelihood per sample on held-out data is "
        f"{after.loss_per_sample:.3f}, {eq_11.loss_per_sample:.3f} {EQ_11}"
    )


def other_effect(seen: Disturbance, natural: Vector, motion: Motion, robot: Robot) -> str:
    """Describe an effect besides friction; empty if there is none.

    Args:
        seen: result with the calibrated file.
        natural: the calibrated values.
        motion: the recording.
        robot: the calibrated file.
    """
    for axis, (name, unit) in enumerate((("hip", "N·m"), ("slide", "N"))):
        coulomb = float(natural[LAW_SIZE * axis])
        rms = rms_of(seen, np.ones(len(motion.time_s), dtype=np.bool_), axis)
        if extent(motion, axis).enough(axis) and rms > PATIENT_MIN_RATIO * coulomb:
            size = np.abs(np.where(seen.moving[:, axis], seen.patient[:, axis], 0.0))
            found = (
                f"the {name} has {rms:.3g} {unit} rms of effort that is not friction "
                f"({rms / coulomb:.0%} of its Coulomb level), "
            )
            gap_ratio = float(np.sum(size[crosses(motion, robot, axis)] ** 2) / np.sum(size**2))
            if gap_ratio > GAP_SHARE_MIN:
                key = BACKLASHES[axis].key
                return (
                    f"{found}{gap_ratio:.0%} of its square within 0.2 s of a reversal of the "
                    "drive's load, as a gap of its transmission makes it: remove it and record "
                    f"again, or measure it, state {key} and keep the file's other values"
                )
            at_s = float(motion.time_s[int(np.argmax(_windowed(size)))])
            return (
                f"{found}most at {at_s:.0f} s: a patient, an artificial disturbance, "
                "an end stop or a wrong mechanism; calibrate from the empty, undisturbed machine"
            )
    return ""


def _windowed(values: Vector, rows: int = CONTACT_ROWS) -> Vector:
    made: Vector = np.convolve(values, np.full(rows, 1.0 / rows), mode="same")[: len(values)]
    return made
