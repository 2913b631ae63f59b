"""State of the leg observer between two cycles, its scratch memory, and the initial values.

One record holds everything but the sigma points, whose loops the compiler vectorises only over an
array of unknown length. A copy is a snapshot. Python passes the record as an array of one: a record
by itself costs 4 us per call, because numpy describes all of its fields anew.
"""

import math
from typing import Annotated, Any, Final, Protocol, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from observer.filter.considered import VARIANTS_MAX
from observer.filter.leg_model import LANES
from observer.filter.states import STATE_COUNT
from observer.filter.status import (
    HOLD_AFTER_CYCLES,
    REST_MAX_S,
    START_KNEE_MIN_RAD,
    START_RATIO_MIN,
    WARM_UP_CYCLES,
)
from observer.jit import inline
from observer.mechanism.linkage import pose
from observer.mechanism.parameters import LegParameters

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

N: Final = STATE_COUNT
EFFORTS: Final = 4
"""Stored efforts of each axis: the newest, and older ones for a delay."""
POINTS_SIZE: Final = N * LANES

State = Annotated[Vector, (N,)]
Root = Annotated[Matrix, (N, N)]
Pair = Annotated[Vector, (2,)]
"""One value for hip and slide each."""


class LegMemory(Protocol):
    """One filter's record; the types give its layout."""

    mean: State
    root: Root
    efforts: Annotated[Matrix, (EFFORTS, 2)]
    """The last finite torque and force, followed by older ones."""
    rest_s: Pair
    """How long each axis has been at rest."""
    settle_s: Pair
    """How much longer each axis has to move, at least, until its split is valid again; else 0."""
    quiet_s: Pair
    """How long each axis has certainly not moved (leg_noise.py)."""
    mark: Pair
    """Position at which each axis was last detected to move."""
    split: Pair
    """Variance of the share of a load between friction and patient, accumulated at rest."""
    lean: Pair
    """Running mean of each axis' whitened innovations: 0 is white."""
    whitened: Pair
    """Last whitened innovation of each axis."""
    patient_ratio: Pair
    """Evidence of a working patient, a factor on the patient's noise (leg_noise.py)."""
    patient_rate: Pair
    """Rate at which a working patient's effort changes, N m/s and N/s (patient_rate.py)."""
    nis_mean: float
    started: float
    warm_up_cycles: float
    """Remaining cycles of warm-up."""
    distrust_cycles: float
    """Remaining cycles in which a restart counts as inconsistent."""
    gated_cycles: float
    """Number of consecutive rejected samples."""
    push: Pair
    """Unmodelled acceleration of each axis that would explain the rejected sample."""
    pushed: Pair
    """1 for an axis whose own error in the rejected sample is too large for noise."""
    predicted: Pair
    """Cycles since the last correction of each axis."""
    acting: Pair
    """Efforts of the drives in the last step."""
    sensitivity: Annotated[Matrix, (VARIANTS_MAX, N + 2)]
    """Derivative of the mean and of both patient rates by each considered parameter
    (sensitivity.py)."""
    followed_effort: Pair
    """Efforts behind a low-pass, and their rates (transmission.py)."""
    followed_rate: Pair
    hidden_error: Pair
    """Friction of the joint minus the filter's, behind a transmission that gives way."""
    hidden_friction: Pair
    """Variances of friction and net that the transmission hides."""
    hidden_net: Pair
    usual_friction: Pair
    """Mean of friction over a tenth of a second (transmission.py)."""
    surprise: Pair
    """Mean square of each axis' whitened innovations (surprise.py)."""
    onward_s: Pair
    """For how long each axis has moved the same way, s, with the way's sign; 0 at rest."""
    misfit: Pair
    """Mean square of whitened innovations over seconds of motion away from reversals."""
    corrected: Pair
    """Mean square of what samples correct of each patient's effort."""
    shown_net: Pair
    """Variance of patient and net that innovations show."""
    known_friction: Pair
    """What the baseline explains of friction, N m and N; NaN before there is one. Then the mean
    square of its changes from cycle to cycle (considered.py)."""
    turning: Pair
    event: float
    """Effect of this cycle on the estimate: NOTHING, STEPPED or BEGAN; used by the smoother."""

    # From here on nothing is kept from one cycle to the next.
    work: Annotated[Vector, (3 * N * N,)]
    patient_errors: Annotated[Vector, (2 * VARIANTS_MAX,)]
    """Error of the patient's effort by each considered parameter, hip then slide."""
    noise: Root
    """Root of this step's process noise, lower triangular."""
    backup_mean: State
    backup_root: Root
    """Before the prediction."""
    forecast_mean: State
    forecast_root: Root
    """After the prediction, before the correction."""
    forecast_sensitivity: Annotated[Matrix, (VARIANTS_MAX, N)]
    """Derivative of `forecast_mean` by each considered parameter."""
    measured: Pair
    seen_std: Pair
    """Standard deviation of this step's measurement."""
    innovation: Pair
    innovation_root: Annotated[Matrix, (2, 2)]
    gain: Annotated[Matrix, (N, 2)]
    """K of this cycle by the samples of hip and slide; 0 of a sample that corrected nothing."""
    carried_rate: Pair
    """Rate of the patient along which this cycle's prediction went."""
    correction: Pair
    """What this cycle's samples have corrected of each patient's effort, N m and N."""
    rate_kept: Pair
    """What this cycle has left of the patient's rate before it was corrected, 0..1."""
    rate_gain: Pair
    """Gain of the patient's rate from the correction of the patient, 1/s."""
    shown_mean: State
    shown_root: Root
    """The estimate to report, with all friction of bristles."""
    law: Pair
    """Variance of friction to report: that of its law at this speed, and what is hidden."""


def layout_of(record: type) -> np.dtype[np.void]:
    """The layout of a record whose types give it."""
    hints = get_type_hints(record, include_extras=True).items()
    return np.dtype([(name, np.float64, (get_args(hint) or (0, ()))[1]) for name, hint in hints])


LAYOUT: Final = layout_of(LegMemory)

NOTHING: Final = 0.0
"""Not started yet, a duplicate, or held."""
STEPPED: Final = 1.0
"""Predicted, and corrected by the measurements."""
BEGAN: Final = 2.0
"""Started or restarted at a measured pose: independent of the past."""

START_STD: Final = (1e-3, 1e-3, 1e-2, 1e-2, 3.0, 30.0, 1.0, 10.0)
"""Initial standard deviations at rest at a measured pose."""
RESTART_STD: Final = (1e-3, 1e-3, 1.0, 1.0, 10.0, 100.0, 10.0, 100.0)
"""Initial standard deviations for a pose that may be moving."""
MISFIT_FULL: Final = 1.3
"""Misfit from which on the stiffness of a transmission is in full doubt, as it is at first
(surprise.py): a stiff one shows less, and one of 800 N m/rad shows more in most strides."""


def new_memory() -> tuple[Any, Vector]:
    """Return the record, in an array of one, and the sigma points before the first cycle."""
    return np.zeros(1, LAYOUT), np.zeros(POINTS_SIZE)


@inline
def copy_estimate(mean: Vector, root: Matrix, to_mean: Vector, to_root: Matrix) -> None:
    """Copy a mean and its root; the slice would take numba a second to compile."""
    for i in range(N):
        to_mean[i] = mean[i]
        for j in range(N):
            to_root[i, j] = root[i, j]


@inline
def may_start(leg: LegParameters, hip: float, slide: float) -> bool:
    """True for a pose to start at: closed, not singular, knee not bent backwards."""
    at = pose(leg, hip, slide)
    ratio = -at.delta / (leg.shank_length_m * leg.shoe_length_m)
    cross = at.knee_x * at.shank_y - at.knee_y * at.shank_x
    knee = -math.atan2(cross, at.knee_x * at.shank_x + at.knee_y * at.shank_y)
    return at.closes and ratio > START_RATIO_MIN and knee > START_KNEE_MIN_RAD


@inline
def start(m: LegMemory, hip: float, slide: float) -> None:
    """Start at rest at the measured pose, with a long rest of both axes assumed.

    What earlier motion has shown of the transmissions is kept: it is the machine's.
    """
    if m.started == 0.0:
        m.misfit[0] = m.misfit[1] = MISFIT_FULL
    _begin(m, hip, slide, START_STD, 2.0 * REST_MAX_S, False)
    m.distrust_cycles = 0.0


@inline
def restart(m: LegMemory, hip: float, slide: float, keep_efforts: bool) -> None:
    """Restart at the measured pose, maybe moving; efforts that are not kept start at zero.

    The misfit is kept: it is the machine's.
    """
    _begin(m, hip, slide, RESTART_STD, 0.0, keep_efforts)
    m.distrust_cycles = WARM_UP_CYCLES


@inline
def _begin(
    m: LegMemory, hip: float, slide: float, std: tuple[float, ...], rest_s: float, keep: bool
) -> None:
    m.mean[0] = m.mark[0] = hip
    m.mean[1] = m.mark[1] = slide
    if not keep:
        for i in range(2, N):
            m.mean[i] = 0.0
    for i in range(N):
        for j in range(N):
            m.root[i, j] = std[i] if i == j else 0.0
    for axis in range(2):
        m.rest_s[axis] = m.quiet_s[axis] = rest_s
        m.settle_s[axis] = m.split[axis] = m.lean[axis] = m.predicted[axis] = 0.0
        m.whitened[axis], m.patient_ratio[axis], m.acting[axis] = 0.0, 1.0, 0.0
        m.patient_rate[axis] = 0.0
        m.followed_effort[axis], m.followed_rate[axis] = m.efforts[0, axis], 0.0
        m.hidden_error[axis] = m.hidden_friction[axis] = m.hidden_net[axis] = 0.0
        m.usual_friction[axis] = m.mean[4 + axis]
        m.known_friction[axis], m.turning[axis] = math.nan, 0.0
        m.surprise[axis] = m.corrected[axis] = m.shown_net[axis] = m.onward_s[axis] = 0.0
    for k in range(VARIANTS_MAX):
        for i in range(N + 2):
            if not (keep and 2 <= i < N):
                m.sensitivity[k, i] = 0.0
    m.nis_mean = 2.0
    m.started = 1.0
    m.warm_up_cycles = WARM_UP_CYCLES
    m.gated_cycles = 0.0
    m.event = BEGAN


@inline
def begin_cycle(m: LegMemory, dt_s: float) -> None:
    """Advance counters and efforts by one cycle."""
    m.event = NOTHING
    for row in range(N):
        m.gain[row, 0] = m.gain[row, 1] = 0.0
    for axis in range(2):
        m.rate_kept[axis], m.rate_gain[axis] = 1.0, 0.0
        m.predicted[axis] += 1.0
        if dt_s > 0.0:
            for age in range(EFFORTS - 1, 0, -1):
                m.efforts[age, axis] = m.efforts[age - 1, axis]


@inline
def lose(m: LegMemory) -> None:
    """Stop prediction: the state is held until the filter can restart."""
    m.predicted[0] = m.predicted[1] = HOLD_AFTER_CYCLES + 1.0
    m.event = NOTHING


@inline
def is_lost(m: LegMemory) -> bool:
    """True if prediction was stopped, or has gone on for too long."""
    return max(m.predicted[0], m.predicted[1]) > HOLD_AFTER_CYCLES


@inline
def take_efforts(m: LegMemory, hip: float, slide: float) -> bool:
    """Store the finite efforts and keep the last value of the others; True if both are finite."""
    if math.isfinite(hip):
        m.efforts[0, 0] = hip
    if math.isfinite(slide):
        m.efforts[0, 1] = slide
    return math.isfinite(hip) and math.isfinite(slide)


@inline
def effort_acting(m: LegMemory, axis: int, delay_cycles: float) -> float:
    """Effort that acted in this step if efforts act this much later than given.

    A delay between whole cycles: each part of the step is under one of two efforts; returns their
    mean.
    """
    whole = math.floor(delay_cycles)
    part = delay_cycles - whole
    effort = m.efforts[whole, axis]
    if part > 0.0:
        effort += part * (m.efforts[whole + 1, axis] - effort)
    return effort
