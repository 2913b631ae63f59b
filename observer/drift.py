"""Friction drift monitor: a patient who seems to always brake, or always push, with the motion.

Friction that is higher than its law by e appears as a patient effort of -e sign(v), and NIS does
not show it (observer.md, fact 10). So this module computes the correlation of the patient's effort
with the sign of velocity, over the last tens of seconds of certain motion. For Coulomb friction
that is 10 % off it is 0.98 and more (observer.md, test 33).

A patient who pushes with the motion looks the same (fact 6). So the number is always available, but
it is a reason to calibrate only when the machine is empty.
"""

import math
from typing import Final, NamedTuple

from observer.mechanism.friction import FrictionParameters

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
ERROR_MAX_RATIO: Final = 0.03
"""Share of Coulomb friction: a smaller error does not justify a calibration."""


class Drift(NamedTuple):
    """Weighted sums over samples in certain motion of one axis."""

    motion_s: float = 0.0
    direction_s: float = 0.0
    patient_s: float = 0.0
    product_s: float = 0.0
    square_s: float = 0.0


NO_DRIFT: Final = Drift()


def updated(
    drift: Drift, f: FrictionParameters, speed: float, patient: float, dt_s: float
) -> Drift:
    """Add one valid sample to the sums.

    Args:
        drift: the sums so far; NO_DRIFT at first.
        f: the axis.
        speed: estimated, rad/s or m/s.
        patient: estimated, N m or N.
        dt_s: duration of the sample.
    """
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
