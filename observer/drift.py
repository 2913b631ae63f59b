"""Friction drift monitor: a patient who seems to always brake, or always push, with the motion.

Friction that is higher than its law by e appears as a patient effort of -e sign(v), and NIS does
not show it (observer.md, fact 10). So this module computes the correlation of the patient's effort
with the sign of velocity, over the last tens of seconds of certain motion. For Coulomb friction
that is 10 % off it is 0.98 and more (observer.md, test 33).

A patient who pushes with the motion looks the same (fact 6). So the number is always available, but
it is a reason to calibrate only when the machine is empty.

The patient of an empty machine shows two more errors of its file. His mean over both directions is
an offset that the drive shows, or a wrong weight or spring: it is compared with the sigma of his
estimate, which holds what the file says of its own uncertainty. The part of his effort along the
motion that grows with the position is a slope of friction over position. Both are errors beyond the
file's own offset and slope, which the observer knows.
"""

import math
from typing import Final, NamedTuple

from observer.mechanism.friction import FrictionParameters
from observer.quantities import Effort, Position, Speed

MEMORY_S: Final = 20.0
"""Time constant, in time of motion: weights fall to 1/e."""
CERTAIN_EDGES: Final = 3.0
"""Only samples faster than this many times the gate's edge count: beyond the friction peak."""
MOTION_MIN_S: Final = 4.0
"""Least motion for a result."""
BALANCE_MIN: Final = 0.2
"""Least share of samples in either direction: one direction alone gives no correlation."""
CORRELATION_MAX: Final = 0.8
NO_FRICTION_CORRELATION: Final = 0.9
SIGMAS: Final = 3.0
"""An offset or a slope this many standard deviations from the file's is beyond its uncertainty."""
ERROR_MAX_RATIO: Final = 0.03
"""Share of Coulomb friction: a smaller error does not justify a calibration."""


class Drift(NamedTuple):
    """Weighted sums over samples in certain motion of one axis."""

    motion_s: float = 0.0
    direction_s: float = 0.0
    patient_s: float = 0.0
    product_s: float = 0.0
    square_s: float = 0.0
    variance_s: float = 0.0
    """Variance of the published estimate."""
    place_s: float = 0.0
    place_square_s: float = 0.0
    along_place_s: float = 0.0
    """Direction times position."""
    patient_along_place_s: float = 0.0


NO_DRIFT: Final = Drift()


class Sample(NamedTuple):
    """A valid estimate of one axis."""

    place: Position
    speed: Speed
    patient: Effort
    patient_std: Effort


def updated(drift: Drift, f: FrictionParameters, sample: Sample, dt_s: float) -> Drift:
    """Add one valid sample to the sums.

    Args:
        drift: the sums so far; NO_DRIFT at first.
        f: the axis.
        sample: of the axis.
        dt_s: duration of the sample.
    """
    place, speed, patient, std = sample
    if not abs(speed) > CERTAIN_EDGES * f.edge:
        return drift
    keep = math.exp(-dt_s / MEMORY_S)
    along = math.copysign(dt_s, speed)
    return Drift(
        keep * drift.motion_s + dt_s,
        keep * drift.direction_s + along,
        keep * drift.patient_s + patient * dt_s,
        keep * drift.product_s + patient * along,
        keep * drift.square_s + patient * patient * dt_s,
        keep * drift.variance_s + std * std * dt_s,
        keep * drift.place_s + place * dt_s,
        keep * drift.place_square_s + place * place * dt_s,
        keep * drift.along_place_s + place * along,
        keep * drift.patient_along_place_s + patient * place * along,
    )


def correlation(drift: Drift) -> float:
    """Correlation of patient effort and direction of motion, -1..1; NaN with too few samples."""
    if not _is_significant(drift):
        return math.nan
    covariance, directions, patients = _moments(drift)
    return covariance / math.sqrt(directions * patients) if patients > 0.0 else 0.0


def friction_error(drift: Drift) -> float:
    """Estimated excess of friction over its law, N m or N; NaN with too few samples."""
    if not _is_significant(drift):
        return math.nan
    covariance, directions, _ = _moments(drift)
    return -covariance / directions


def asks_for_calibration(drift: Drift, f: FrictionParameters) -> bool:
    """True if an empty machine with this drift should be calibrated."""
    far = abs(friction_error(drift)) > ERROR_MAX_RATIO * f.coulomb
    return far and abs(correlation(drift)) > CORRELATION_MAX


def is_no_friction(drift: Drift, f: FrictionParameters) -> bool:
    """True if the excess is beyond the whole law: friction is not negative, nor twice its law.

    It is a patient, a wrong sign of an effort, or the column of another axis.
    """
    far = abs(friction_error(drift)) > f.coulomb
    return far and abs(correlation(drift)) > NO_FRICTION_CORRELATION


def offset_error(drift: Drift) -> float:
    """Effort that the drive shows beyond the file, N m or N; NaN with too few samples."""
    if not _is_significant(drift):
        return math.nan
    covariance, directions, _ = _moments(drift)
    mean, direction = drift.patient_s / drift.motion_s, drift.direction_s / drift.motion_s
    return covariance / directions * direction - mean


def offset_allowed(drift: Drift) -> float:
    """Largest such error by what the file says of its uncertainty; NaN with too few samples."""
    if not _is_significant(drift):
        return math.nan
    return SIGMAS * math.sqrt(drift.variance_s / drift.motion_s)


def is_offset(drift: Drift) -> bool:
    """True if an empty machine with this drift has an offset that its file does not allow."""
    return abs(offset_error(drift)) > offset_allowed(drift)


def slope_error(drift: Drift, f: FrictionParameters) -> float:
    """Slope of friction over position beyond the file's, 1/rad or 1/m; NaN with too few samples."""
    return _slope(drift, f)[0]


def is_sloped(drift: Drift, f: FrictionParameters, std: float) -> bool:
    """True if an empty machine with this drift has a slope that its file does not allow.

    Args:
        drift: of the axis.
        f: the axis.
        std: standard deviation of the file's slope, 1/rad or 1/m.
    """
    slope, explained = _slope(drift, f)
    return abs(slope) > SIGMAS * std and explained > CORRELATION_MAX * CORRELATION_MAX


def _slope(drift: Drift, f: FrictionParameters) -> tuple[float, float]:
    """Slope, and the share that it explains of what the direction alone does not.

    Least squares of the patient over a constant, the direction, and direction times position.
    """
    if not _is_significant(drift):
        return math.nan, math.nan
    whole = drift.motion_s
    direction, patient = drift.direction_s / whole, drift.patient_s / whole
    along = drift.along_place_s / whole
    by_direction, directions, patients = _moments(drift)
    across = drift.place_s / whole - direction * along
    spread = drift.place_square_s / whole - along * along - across * across / directions
    shared = drift.patient_along_place_s / whole - patient * along
    shared -= by_direction * across / directions
    left = patients - by_direction * by_direction / directions
    if not (spread > 0.0 and left > 0.0):
        return math.nan, math.nan
    return -shared / spread / f.coulomb, shared * shared / (spread * left)


def _is_significant(drift: Drift) -> bool:
    if drift.motion_s < MOTION_MIN_S:
        return False
    return abs(drift.direction_s) <= (1.0 - 2.0 * BALANCE_MIN) * drift.motion_s


def _moments(drift: Drift) -> tuple[float, float, float]:
    """Covariance of patient and direction, then the variances of direction and patient."""
    direction = drift.direction_s / drift.motion_s
    patient = drift.patient_s / drift.motion_s
    return (
        drift.product_s / drift.motion_s - direction * patient,
        1.0 - direction * direction,
        drift.square_s / drift.motion_s - patient * patient,
    )
