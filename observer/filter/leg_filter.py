"""One cycle of the leg observer as one compiled function: predict, gate, correct, check, report.

Live operation (`leg_observer.py`) and replay (`batch.py`) call the same `advance`, so a replay
gives the same bits. All state from one cycle to the next is in one record, `memory`.

Processing of a sample, in this order:
1. A torque or position that is not finite is not used; the cycle is only predicted, with the last
   valid torque. With a position missing on one axis only, the other axis still corrects.
2. A time step that is not positive is a duplicate or out of order: it only raises flags. A step
   beyond GAP_MAX_S, or more than HOLD_AFTER_CYCLES without samples, ends prediction: the state is
   held, and the filter restarts at the next complete sample.
3. The prediction runs over the true time step; process noise grows with it.
4. A sample whose NIS is beyond the gate is rejected. If a push could have moved the leg there, the
   next prediction allows for that push, so that the filter follows from the second sample on, and
   the split is unreliable for a while, because the cause may be sticking friction. A jump of the
   encoder is too large for a push. After GATED_MAX_IN_A_ROW rejections the next sample is
   accepted: the filter restarts there, flags it, and is BAD until its warm-up is over.
5. Status bits and the validity of each axis are determined, and the estimate is written.
"""

import math
from collections.abc import Sequence
from typing import Annotated, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from observer.filter.cdkf import STEP, compress, correct, innovate, spread
from observer.filter.considered import (
    FRICTION_ROW,
    VARIANT_SIZE,
    VARIANTS_MAX,
    Known,
    add_variance,
    follow_turning,
    widen,
)
from observer.filter.leg_memory import (
    STEPPED,
    LegMemory,
    N,
    Pair,
    State,
    begin_cycle,
    copy_estimate,
    effort_acting,
    is_lost,
    layout_of,
    lose,
    may_start,
    restart,
    start,
    take_efforts,
)
from observer.filter.leg_model import (
    LANES,
    STEP_S,
    Integrator,
    LegModel,
    model_at,
    runge_kutta,
    semi_implicit,
    substeps_for,
)
from observer.filter.leg_noise import (
    LEAN_STRONG,
    REST_COMPLETE_S,
    add_lean,
    rest_from_the_start,
    set_measurement_noise,
    set_process_noise,
)
from observer.filter.patient_rate import carry_rate, fade_rate, follow_rate, forget_rate
from observer.filter.sensitivity import follow_parameters
from observer.filter.status import (
    GAP_MAX_S,
    GATED_MAX_IN_A_ROW,
    LATE_RATIO,
    NIS_USUAL_MAX,
    NIS_WINDOW_SAMPLES,
    PUSH_TIME_CONSTANTS,
    Status,
    Validity,
)
from observer.filter.surprise import doubt_of_stiffness, follow_surprise
from observer.filter.transmission import hide
from observer.filter.validity import determine, mark_split_unknown
from observer.jit import fixed_tuple, inline, kernel
from observer.mechanism.friction import (
    STANDSTILL_GATE,
    FrictionParameters,
    OverPosition,
    bristle_friction,
    bristle_slopes,
    gate,
    law_variance,
)
from observer.mechanism.parameters import LegParameters
from observer.quantities import Number

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

# Places in `out`: the mean first, then
OUT_STD: Final = N
OUT_COVARIANCE: Final = 2 * N
"""Lower triangle, row by row."""
OUT_INNOVATION: Final = OUT_COVARIANCE + N * (N + 1) // 2
OUT_NIS: Final = OUT_INNOVATION + 2
OUT_NET: Final = OUT_NIS + 1
OUT_NET_STD: Final = OUT_NET + 2
OUT_PASSIVE: Final = OUT_NET_STD + 2
"""Known error of friction and patient, hip before slide, by the baseline; 0 without."""
OUT_SIZE: Final = OUT_PASSIVE + 4

PUSH_MAX: Final = 30.0
"""rad/s^2, m/s^2: no push or stick-slip accelerates a leg more; a larger jump is an encoder
error."""
PUSH_BEGUN_RATIO: Final = 3.0
PUSH_BEGUN_LEAN: Final = 0.15
"""A push that began before the last sample seems this much larger. That sample then left the mean
of whitened innovations at least this far on the same side."""
PUSHED_SIGMAS: Final = 4.0
"""In sigma of a rejected sample: an axis with a smaller error was not pushed itself."""
WILD_RATE: Final = 100.0
"""Predicted velocities (rad/s, m/s) beyond those of any leg: the prediction is discarded."""

BOTH: Final = np.array([0, 1], dtype=np.int64)
HIP_ONLY: Final = np.array([0], dtype=np.int64)
SLIDE_ONLY: Final = np.array([1], dtype=np.int64)

# numba supports plain integers, not flags.
LATE_BIT: Final = Status.LATE.value
GATED_BIT: Final = Status.GATED.value
PREDICT_ONLY_BIT: Final = Status.PREDICT_ONLY.value
OUT_OF_WORKSPACE_BIT: Final = Status.OUT_OF_WORKSPACE.value
INCONSISTENT_BIT: Final = Status.INCONSISTENT.value
BASELINE_BIT: Final = Status.BASELINE.value
BAD: Final = Validity.BAD.value
RK4: Final = Integrator.RK4.value


class Options(NamedTuple):
    """Tuning as the kernel takes it, all floats."""

    gate_nis: float
    velocity_gated: Number
    integrator: Number
    substeps: Number
    patient_noise_max_ratio: Number
    viscous_outside: Number
    effort_delay_cycles: Number
    sample_jitter_s: float
    ripple_hip: Number
    ripple_slide: Number
    law_hip: Number
    law_slide: Number
    compliance_hip: Number
    compliance_slide: Number
    backlash_hip: Number
    backlash_slide: Number
    offset_hip: Number
    offset_slide: Number
    friction_slope_hip: Number
    friction_middle_hip: Number
    friction_slope_slide: Number
    friction_middle_slide: Number


LEG_COUNT: Final = len(LegParameters._fields)
FRICTION_COUNT: Final = len(FrictionParameters._fields)
OPTION_COUNT: Final = len(Options._fields)


class SetupRecord(Protocol):
    """Physics and tuning of one filter, which never change; the types give the record's layout.

    Python passes the record as an array of one, as `LegMemory`: tuples of as many numbers cost more
    time.
    """

    leg: Annotated[Vector, (LEG_COUNT,)]
    """LegParameters."""
    hip: Annotated[Vector, (FRICTION_COUNT,)]
    """FrictionParameters."""
    slide: Annotated[Vector, (FRICTION_COUNT,)]
    coriolis_share: Number
    options: Annotated[Vector, (OPTION_COUNT,)]
    process_std: State
    """Per step of STEP_S."""
    measurement_std: Pair
    """rad, m."""
    variant_count: Number
    """Number of considered parameters."""
    variants: Annotated[Matrix, (VARIANTS_MAX, VARIANT_SIZE)]
    """The physics with each of them a standard deviation larger (considered.py)."""
    baseline_taken: Number
    """1 with a passive baseline, which the next three are of (`considered.Known`); else 0."""
    theta: Annotated[Vector, (VARIANTS_MAX,)]
    root: Annotated[Matrix, (VARIANTS_MAX, VARIANTS_MAX)]
    kept_std: Pair


SETUP_LAYOUT: Final = layout_of(SetupRecord)
Setup = Sequence[SetupRecord]
"""An array of one."""


class Constants(NamedTuple):
    """The numbers of a setup by their names, for compiled code."""

    model: LegModel
    options: Options
    process_std: Vector
    measurement_std: Vector
    variant_count: int
    variants: Matrix
    known: Known


@inline
def constants_of(setup: SetupRecord) -> Constants:
    """Read a setup into registers."""
    options = Options(*fixed_tuple(setup.options, OPTION_COUNT))
    model = LegModel(
        LegParameters(*fixed_tuple(setup.leg, LEG_COUNT)),
        FrictionParameters(*fixed_tuple(setup.hip, FRICTION_COUNT)),
        FrictionParameters(*fixed_tuple(setup.slide, FRICTION_COUNT)),
        setup.coriolis_share,
        options.viscous_outside,
    )
    return Constants(
        model,
        options,
        setup.process_std,
        setup.measurement_std,
        int(setup.variant_count),
        setup.variants,
        Known(setup.baseline_taken != 0.0, setup.theta, setup.root, setup.kept_std),
    )


@inline
def friction_over_position(options: Options) -> tuple[OverPosition, OverPosition]:
    """How friction rises along hip and slide."""
    return (
        OverPosition(options.friction_slope_hip, options.friction_middle_hip),
        OverPosition(options.friction_slope_slide, options.friction_middle_slide),
    )


@inline
def placed(constants: Constants, hip_rad: float, slide_m: float) -> Constants:
    """The same constants with the friction of a pose."""
    hip, slide = friction_over_position(constants.options)
    return Constants(
        model_at(constants.model, hip, slide, hip_rad, slide_m),
        constants.options,
        constants.process_std,
        constants.measurement_std,
        constants.variant_count,
        constants.variants,
        constants.known,
    )


@kernel
def advance(
    setup_of: Setup,
    memory_of: Sequence[LegMemory],
    points: Vector,
    position: tuple[float, float],
    effort: tuple[float, float],
    effort_std: tuple[float, float],
    dt_s: float,
    caller_bits: int,
    out: Vector,
) -> tuple[int, int, int]:
    """Run one cycle; return Status and the Validity of hip and slide. Numbers go to `out`.

    `setup_of` has the friction in the middle of each axis: the cycle's is that of its pose.
    `memory_of` holds the state after the previous cycle, zero before the first; `points`
    (POINTS_SIZE) need no content. Positions are measured now (rad, m; not finite if missing),
    efforts acted since the previous cycle (N m, N), `dt_s` ago, with ripples of `effort_std` if
    these exceed the tuning's. `caller_bits` are the Status bits that only the caller can know.
    `out` (OUT_SIZE): mean, std, covariance, innovation, nis, net, net std and what the baseline
    takes off.
    """
    memory = memory_of[0]
    constants = placed(constants_of(setup_of[0]), memory.mean[0], memory.mean[1])
    model, options = constants.model, constants.options
    position_hip, position_slide = position
    begin_cycle(memory, dt_s)
    usable = take_efforts(memory, effort[0] - options.offset_hip, effort[1] - options.offset_slide)
    have_hip = usable and math.isfinite(position_hip)
    have_slide = usable and math.isfinite(position_slide)
    for i in range(OUT_SIZE):
        out[i] = math.nan
    status = caller_bits | BASELINE_BIT if constants.known.taken else caller_bits
    if not 0.0 < dt_s <= LATE_RATIO * STEP_S:
        status |= LATE_BIT
    if memory.started == 0.0 or dt_s > GAP_MAX_S or is_lost(memory):
        complete = have_hip and have_slide
        status |= _begin(model, options, memory, position_hip, position_slide, complete)
    elif dt_s > 0.0:
        memory.measured[0], memory.measured[1] = position_hip, position_slide
        ripple = max(options.ripple_hip, effort_std[0]), max(options.ripple_slide, effort_std[1])
        status |= _predict(constants, ripple, memory, points, dt_s)
        if (have_hip or have_slide) and not is_lost(memory):
            status |= _measure(constants, memory, have_hip, have_slide, dt_s, out)
    if memory.started == 0.0:
        return status | PREDICT_ONLY_BIT, BAD, BAD
    if memory.event == STEPPED:
        _hide(model, options, constants.variant_count > 0, memory, dt_s)
        if constants.variant_count > 0:
            follow_surprise(memory, dt_s)
    _report(model, options, memory, out)
    for i in range(OUT_PASSIVE, OUT_SIZE):
        out[i] = 0.0
    if constants.variant_count > 0:
        _consider(constants, memory, points, dt_s, out)
    return determine(model, memory, dt_s, status)


@inline
def _hide(model: LegModel, options: Options, unsure: bool, m: LegMemory, dt_s: float) -> None:
    """Find what transmissions hide that are not rigid, by the file or by innovations."""
    stated = options.compliance_hip, options.compliance_slide
    backlash = options.backlash_hip, options.backlash_slide
    if unsure:
        hide(model, stated, doubt_of_stiffness(m), backlash, m, dt_s)
    elif stated[0] + stated[1] + backlash[0] + backlash[1] > 0.0:
        hide(model, stated, 0.0, backlash, m, dt_s)


@inline
def _consider(constants: Constants, m: LegMemory, points: Vector, dt_s: float, out: Vector) -> None:
    """Add to sigma what is not known of the machine."""
    model, variants, count = constants.model, constants.variants, constants.variant_count
    if m.event == STEPPED:
        over = friction_over_position(constants.options)
        follow_parameters(model, over, variants, count, m, out, points, dt_s)
    widen(
        count,
        constants.known,
        m.sensitivity,
        OUT_NET_STD,
        m.work,
        m.patient_errors,
        out[OUT_PASSIVE:],
        out,
    )
    if constants.known.taken and m.event == STEPPED:
        follow_turning(out[OUT_PASSIVE:], dt_s, m.known_friction, m.turning)
    for axis in range(2):
        if constants.known.taken:
            add_variance(FRICTION_ROW + axis, m.turning[axis], OUT_NET_STD, out)
        else:
            m.known_friction[axis], m.turning[axis] = math.nan, 0.0


@inline
def _begin(
    model: LegModel, options: Options, memory: LegMemory, hip: float, slide: float, complete: bool
) -> int:
    """Start, or restart, at a complete sample of a possible pose; return status bits."""
    possible = complete and may_start(model.leg, hip, slide)
    if memory.started == 0.0:
        if possible:
            begin_at_rest(model, options, memory, hip, slide)
    elif possible:
        restart(memory, hip, slide, False)
    else:
        lose(memory)
    return OUT_OF_WORKSPACE_BIT if complete and not possible else 0


@inline
def begin_at_rest(
    model: LegModel, options: Options, memory: LegMemory, hip: float, slide: float
) -> None:
    """Start at a measured pose, at rest."""
    start(memory, hip, slide)
    if options.velocity_gated != 0.0:
        rest_from_the_start(model.hip, memory, 0)
        rest_from_the_start(model.slide, memory, 1)


@inline
def _predict(
    constants: Constants, ripple: tuple[float, float], m: LegMemory, points: Vector, dt_s: float
) -> int:
    """Time update over `dt_s`; return status bits. An impossible prediction is discarded."""
    model, options = constants.model, constants.options
    set_process_noise(
        model,
        constants.process_std,
        constants.measurement_std,
        options.patient_noise_max_ratio,
        ripple,
        options.velocity_gated != 0.0,
        m,
        dt_s,
    )
    copy_estimate(m.mean, m.root, m.backup_mean, m.backup_root)
    m.carried_rate[0], m.carried_rate[1] = m.patient_rate[0], m.patient_rate[1]
    carry_rate(m, 0.5 * dt_s)
    spread(m.mean, m.root, STEP, N, LANES, points)
    substeps = substeps_for(dt_s, int(options.substeps))
    step_s = dt_s / substeps
    effort_hip = m.acting[0] = effort_acting(m, 0, options.effort_delay_cycles)
    effort_slide = m.acting[1] = effort_acting(m, 1, options.effort_delay_cycles)
    outside = 0
    for _ in range(substeps):
        if options.integrator == RK4:
            outside += runge_kutta(model, effort_hip, effort_slide, step_s, points)
        else:
            outside += semi_implicit(model, effort_hip, effort_slide, step_s, points)
    compress(points, m.noise, STEP, N, LANES, m.mean, m.root, m.work)
    carry_rate(m, 0.5 * dt_s)
    fade_rate(m, dt_s)
    rate = math.fabs(m.mean[2]) + math.fabs(m.mean[3])
    for i in range(N):
        rate += 0.0 * m.mean[i]  # NaN if that element is not finite
        for j in range(N):
            rate += 0.0 * m.root[i, j]
    if not rate < WILD_RATE:
        copy_estimate(m.backup_mean, m.backup_root, m.mean, m.root)
        lose(m)
        return INCONSISTENT_BIT
    m.event = STEPPED
    copy_estimate(m.mean, m.root, m.forecast_mean, m.forecast_root)
    return OUT_OF_WORKSPACE_BIT if outside > 0 else 0


@inline
def _measure(
    constants: Constants,
    m: LegMemory,
    have_hip: bool,
    have_slide: bool,
    dt_s: float,
    out: Vector,
) -> int:
    """Measurement update by the axes that have a sample, or its rejection; return status bits."""
    model, options = constants.model, constants.options
    count = 2 if have_hip and have_slide else 1
    picks = BOTH if count == 2 else (HIP_ONLY if have_hip else SLIDE_ONLY)
    set_measurement_noise(constants.measurement_std, options.sample_jitter_s, m)
    nis = innovate(
        m.mean,
        m.root,
        picks,
        count,
        m.measured,
        m.seen_std,
        m.innovation,
        m.innovation_root,
        m.work,
    )
    gate_nis = options.gate_nis * max(1.0, m.nis_mean / NIS_USUAL_MAX)
    per_two = min(nis, gate_nis) * 2.0 / count
    m.nis_mean += (per_two - m.nis_mean) / NIS_WINDOW_SAMPLES
    out[OUT_NIS] = nis
    for j in range(count):
        out[OUT_INNOVATION + picks[j]] = m.innovation[j]
    if not nis <= gate_nis:
        return _reject(model, m, picks, count, dt_s)
    for j in range(count):
        add_lean(m, picks[j], j)
    patient_hip, patient_slide = m.mean[6], m.mean[7]
    correct(
        m.mean,
        m.root,
        N,
        picks,
        count,
        m.seen_std,
        m.innovation,
        m.innovation_root,
        m.gain,
        m.work,
    )
    if count == 1 and picks[0] == 1:
        for row in range(N):
            m.gain[row, 0], m.gain[row, 1] = 0.0, m.gain[row, 0]
    m.correction[0], m.correction[1] = m.mean[6] - patient_hip, m.mean[7] - patient_slide
    if m.gated_cycles == 0.0:
        follow_rate(m, 0, m.correction[0], dt_s)
        follow_rate(m, 1, m.correction[1], dt_s)
    m.gated_cycles = 0.0
    for j in range(count):
        m.predicted[picks[j]] = 0.0
    if options.velocity_gated != 0.0:
        _bound_friction(model.hip, m, 0)
        _bound_friction(model.slide, m, 1)
    return 0


@inline
def _bound_friction(f: FrictionParameters, m: LegMemory, axis: int) -> None:
    """Limit friction at rest to its breakaway level; the rest is assigned to the patient.

    A joint that the last sample has moved is not at rest where innovations are biased, for then its
    estimated velocity is wrong: friction follows its law, which corrects a wrong share better.
    """
    believable = m.quiet_s[axis] > 0.0 or math.fabs(m.lean[axis]) < LEAN_STRONG
    slow = gate(f, m.mean[2 + axis]) < STANDSTILL_GATE
    if m.quiet_s[axis] > REST_COMPLETE_S or (slow and believable):
        friction = m.mean[4 + axis]
        held = min(max(friction, -f.stribeck), f.stribeck)
        m.mean[4 + axis] = held
        m.mean[6 + axis] += held - friction


@inline
def _reject(
    model: LegModel, m: LegMemory, picks: NDArray[np.int64], count: int, dt_s: float
) -> int:
    """Count the rejection, and decide between a push and an encoder error; return status bits."""
    forget_rate(m)
    m.gated_cycles += 1.0
    if m.gated_cycles == 1.0:
        m.push[0] = m.push[1] = m.pushed[0] = m.pushed[1] = 0.0
        largest = 0.0
        for j in range(count):
            push = 2.0 * math.fabs(m.innovation[j]) / (dt_s * dt_s)
            m.push[picks[j]] = push
            begun = m.lean[picks[j]] * m.innovation[j] > PUSH_BEGUN_LEAN * math.fabs(
                m.innovation[j]
            )
            largest = max(largest, push / PUSH_BEGUN_RATIO if begun else push)
        if largest > PUSH_MAX:
            m.push[0] = m.push[1] = 0.0
        else:
            _mark_pushed(model, m, picks, count)
    too_many = m.gated_cycles > GATED_MAX_IN_A_ROW
    if too_many and count == 2 and may_start(model.leg, m.measured[0], m.measured[1]):
        restart(m, m.measured[0], m.measured[1], True)
    return GATED_BIT


@inline
def _mark_pushed(model: LegModel, m: LegMemory, picks: NDArray[np.int64], count: int) -> None:
    """Mark the axes that were pushed themselves; their split is unreliable."""
    for j in range(count):
        variance = 0.0
        for k in range(j + 1):
            variance += m.innovation_root[j, k] * m.innovation_root[j, k]
        if m.innovation[j] * m.innovation[j] > PUSHED_SIGMAS * PUSHED_SIGMAS * variance:
            m.pushed[picks[j]] = 1.0
            f = model.hip if picks[j] == 0 else model.slide
            mark_split_unknown(f, m, picks[j], PUSH_TIME_CONSTANTS)


@inline
def _report(model: LegModel, options: Options, m: LegMemory, out: Vector) -> None:
    """Write state, standard deviations, covariance and net efforts to `out`.

    The uncertainty of the split is included, that of a joint at rest wherever it is stored
    (leg_noise.py), that of the friction law, what the transmission hides, and what innovations show
    beyond all that. The friction state of an axis with bristles is only their elastic part; all of
    its friction is written, as it acts in the coming cycle at the estimated velocity.
    """
    m.law[0] = law_variance(model.hip, options.law_hip, m.mean[2]) + m.hidden_friction[0]
    m.law[1] = law_variance(model.slide, options.law_slide, m.mean[3]) + m.hidden_friction[1]
    copy_estimate(m.mean, m.root, m.shown_mean, m.shown_root)
    _add_damping(model.hip, m, 0)
    _add_damping(model.slide, m, 1)
    mean, root = m.shown_mean, m.shown_root
    at = OUT_COVARIANCE
    for row in range(N):
        out[row] = mean[row]
        for column in range(row + 1):
            total = 0.0
            for k in range(column + 1):
                total += root[row, k] * root[column, k]
            if column >= 4 and (row - column) % 2 == 0:
                total += m.split[row % 2] + m.law[row % 2]
            if column == row and row >= 6:
                total += max(m.hidden_net[row % 2], m.shown_net[row % 2])
            out[at] = total
            at += 1
        out[OUT_STD + row] = math.sqrt(out[at - 1])
    for axis in range(2):
        out[OUT_NET + axis] = mean[6 + axis] - mean[4 + axis]
        total = max(m.hidden_net[axis], m.shown_net[axis])
        for k in range(N):
            difference = root[6 + axis, k] - root[4 + axis, k]
            total += difference * difference
        out[OUT_NET_STD + axis] = math.sqrt(total)


@inline
def _add_damping(f: FrictionParameters, m: LegMemory, axis: int) -> None:
    """Replace the elastic part of bristles by the whole friction, in mean and root to report."""
    if f.bristle_stiffness == 0.0:
        return
    elastic, velocity = m.mean[4 + axis], m.mean[2 + axis]
    m.shown_mean[4 + axis] = bristle_friction(f, elastic, velocity, STEP_S)
    by_elastic, by_velocity = bristle_slopes(f, elastic, velocity, STEP_S)
    for k in range(N):
        m.shown_root[4 + axis, k] = (
            by_elastic * m.root[4 + axis, k] + by_velocity * m.root[2 + axis, k]
        )
