"""One cycle of the leg observer as one compiled function: predict, gate, correct, check, report.

Live operation (`leg_observer.py`) and replay (`batch.py`) call the same `advance`, so a replay
gives the same bits. All state from one cycle to the next is in one flat array, `memory`.

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
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.filter.cdkf import STEP, compress, correct, innovate, spread
from observer.filter.leg_memory import (
    EFFORT,
    EVENT,
    GATED,
    NIS_MEAN,
    PREDICTED,
    PUSH,
    SPLIT,
    STARTED,
    STEPPED,
    Arrays,
    N,
    arrays_in,
    begin_cycle,
    effort_acting,
    fill,
    is_lost,
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
    runge_kutta,
    semi_implicit,
    substeps_for,
)
from observer.filter.leg_noise import (
    note_lean,
    rest_from_the_start,
    set_measurement_noise,
    set_process_noise,
)
from observer.filter.status import (
    GAP_MAX_S,
    GATED_MAX_IN_A_ROW,
    LATE_RATIO,
    NIS_USUAL_MAX,
    NIS_WINDOW_SAMPLES,
    Status,
    Validity,
)
from observer.filter.validity import distrust_split, judge
from observer.jit import inline, kernel
from observer.mechanism.friction import STANDSTILL_GATE, FrictionParameters, gate
from observer.mechanism.parameters import LegParameters
from observer.quantities import Number

Vector = NDArray[np.float64]

# Places in `out`: the mean first, then
OUT_STD: Final = N
OUT_COVARIANCE: Final = 2 * N
"""Lower triangle, row by row."""
OUT_INNOVATION: Final = OUT_COVARIANCE + N * (N + 1) // 2
OUT_NIS: Final = OUT_INNOVATION + 2
OUT_NET: Final = OUT_NIS + 1
OUT_NET_STD: Final = OUT_NET + 2
OUT_SIZE: Final = OUT_NET_STD + 2

PUSH_MAX: Final = 30.0
"""rad/s^2, m/s^2: no push or stick-slip accelerates a leg more; a larger jump is an encoder
error."""
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
BAD: Final = Validity.BAD.value
RK4: Final = Integrator.RK4.value


class Options(NamedTuple):
    """Tuning as the kernel takes it; all floats, because such a tuple is fast to pass."""

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


@kernel
def advance(
    leg: tuple[float, ...],
    hip: tuple[float, ...],
    slide: tuple[float, ...],
    coriolis_share: float,
    options_of: tuple[float, ...],
    process_std: Vector,
    measurement_std: Vector,
    memory: Vector,
    scratch: Vector,
    points: Vector,
    position_hip: float,
    position_slide: float,
    effort_hip: float,
    effort_slide: float,
    dt_s: float,
    caller_bits: int,
    out: Vector,
) -> tuple[int, int, int]:
    """Run one cycle; return Status and the Validity of hip and slide. Numbers go to `out`.

    Physics and Options are plain tuples of floats, which are faster to pass than named ones.
    `process_std` (N) is per step of STEP_S, `measurement_std` (2) in rad, m. `memory` (MEMORY_SIZE)
    is the state after the previous cycle, zero before the first; `scratch` (SCRATCH_SIZE) and
    `points` (POINTS_SIZE) need no content. Positions are measured now (rad, m; not finite if
    missing), efforts acted since the previous cycle (N m, N), `dt_s` ago. `caller_bits` are the
    Status bits that only the caller can know. `out` (OUT_SIZE): mean, std, covariance, innovation,
    nis, net and net std.
    """
    options = Options(*options_of)
    model = LegModel(
        LegParameters(*leg),
        FrictionParameters(*hip),
        FrictionParameters(*slide),
        coriolis_share,
        options.viscous_outside,
    )
    arrays = arrays_in(memory, scratch, points)
    begin_cycle(memory, dt_s)
    usable = take_efforts(memory, effort_hip, effort_slide)
    have_hip = usable and math.isfinite(position_hip)
    have_slide = usable and math.isfinite(position_slide)
    fill(out, 0, OUT_SIZE, math.nan)
    status = caller_bits
    if not 0.0 < dt_s <= LATE_RATIO * STEP_S:
        status |= LATE_BIT
    if memory[STARTED] == 0.0 or dt_s > GAP_MAX_S or is_lost(memory):
        complete = have_hip and have_slide
        status |= _begin(model, options, memory, position_hip, position_slide, complete)
    elif dt_s > 0.0:
        arrays.measured[0], arrays.measured[1] = position_hip, position_slide
        status |= _predict(model, options, process_std, measurement_std, arrays, dt_s)
        if (have_hip or have_slide) and not is_lost(memory):
            status |= _measure(
                model, options, measurement_std, arrays, have_hip, have_slide, dt_s, out
            )
    if memory[STARTED] == 0.0:
        return status | PREDICT_ONLY_BIT, BAD, BAD
    _report(arrays, out)
    return judge(model, memory, dt_s, status)


@inline
def _begin(
    model: LegModel, options: Options, memory: Vector, hip: float, slide: float, complete: bool
) -> int:
    """Start, or restart, at a complete sample of a possible pose; return status bits."""
    possible = complete and may_start(model.leg, hip, slide)
    if memory[STARTED] == 0.0:
        if possible:
            begin_at_rest(model, options, memory, hip, slide)
    elif possible:
        restart(memory, hip, slide, False)
    else:
        lose(memory)
    return OUT_OF_WORKSPACE_BIT if complete and not possible else 0


@inline
def begin_at_rest(
    model: LegModel, options: Options, memory: Vector, hip: float, slide: float
) -> None:
    """Start at a measured pose, at rest."""
    start(memory, hip, slide)
    if options.velocity_gated != 0.0:
        rest_from_the_start(model.hip, memory, 0)
        rest_from_the_start(model.slide, memory, 1)


@inline
def _predict(
    model: LegModel,
    options: Options,
    process_std: Vector,
    measurement_std: Vector,
    a: Arrays,
    dt_s: float,
) -> int:
    """Time update over `dt_s`; return status bits. An impossible prediction is discarded."""
    set_process_noise(
        model,
        process_std,
        measurement_std,
        options.patient_noise_max_ratio,
        (options.ripple_hip, options.ripple_slide),
        options.velocity_gated != 0.0,
        a,
        dt_s,
    )
    for i in range(EFFORT):
        a.backup[i] = a.memory[i]
    spread(a.mean, a.root, STEP, N, LANES, a.points)
    substeps = substeps_for(dt_s, int(options.substeps))
    step_s = dt_s / substeps
    effort_hip = effort_acting(a.memory, 0, options.effort_delay_cycles)
    effort_slide = effort_acting(a.memory, 1, options.effort_delay_cycles)
    outside = 0
    for _ in range(substeps):
        if options.integrator == RK4:
            outside += runge_kutta(model, effort_hip, effort_slide, step_s, a.points)
        else:
            outside += semi_implicit(model, effort_hip, effort_slide, step_s, a.points)
    compress(a.points, a.noise, STEP, N, LANES, a.mean, a.root, a.work)
    rate = math.fabs(a.mean[2]) + math.fabs(a.mean[3])
    for i in range(EFFORT):
        rate += 0.0 * a.memory[i]  # NaN if that element is not finite
    if not rate < WILD_RATE:
        for i in range(EFFORT):
            a.memory[i] = a.backup[i]
        lose(a.memory)
        return INCONSISTENT_BIT
    a.memory[EVENT] = STEPPED
    for i in range(EFFORT):
        a.forecast[i] = a.memory[i]
    return OUT_OF_WORKSPACE_BIT if outside > 0 else 0


@inline
def _measure(
    model: LegModel,
    options: Options,
    measurement_std: Vector,
    a: Arrays,
    have_hip: bool,
    have_slide: bool,
    dt_s: float,
    out: Vector,
) -> int:
    """Measurement update by the axes that have a sample, or its rejection; return status bits."""
    count = 2 if have_hip and have_slide else 1
    picks = BOTH if count == 2 else (HIP_ONLY if have_hip else SLIDE_ONLY)
    set_measurement_noise(measurement_std, options.sample_jitter_s, a)
    nis = innovate(
        a.mean,
        a.root,
        picks,
        count,
        a.measured,
        a.seen_std,
        a.innovation,
        a.innovation_root,
        a.work,
    )
    gate_nis = options.gate_nis * max(1.0, a.memory[NIS_MEAN] / NIS_USUAL_MAX)
    per_two = min(nis, gate_nis) * 2.0 / count
    a.memory[NIS_MEAN] += (per_two - a.memory[NIS_MEAN]) / NIS_WINDOW_SAMPLES
    out[OUT_NIS] = nis
    for j in range(count):
        out[OUT_INNOVATION + picks[j]] = a.innovation[j]
    if not nis <= gate_nis:
        return _reject(model, a, picks, count, dt_s)
    for j in range(count):
        note_lean(a, picks[j], j)
    correct(
        a.mean,
        a.root,
        N,
        picks,
        count,
        a.seen_std,
        a.innovation,
        a.innovation_root,
        a.gain,
        a.work,
    )
    a.memory[GATED] = 0.0
    for j in range(count):
        a.memory[PREDICTED + picks[j]] = 0.0
    if options.velocity_gated != 0.0:
        _bound_friction(model.hip, a, 0)
        _bound_friction(model.slide, a, 1)
    return 0


@inline
def _bound_friction(f: FrictionParameters, a: Arrays, axis: int) -> None:
    """Limit friction at rest to its breakaway level; the rest is assigned to the patient."""
    if gate(f, a.mean[2 + axis]) < STANDSTILL_GATE:
        friction = a.mean[4 + axis]
        held = min(max(friction, -f.stribeck), f.stribeck)
        a.mean[4 + axis] = held
        a.mean[6 + axis] += held - friction


@inline
def _reject(model: LegModel, a: Arrays, picks: NDArray[np.int64], count: int, dt_s: float) -> int:
    """Count the rejection, and decide between a push and an encoder error; return status bits."""
    a.memory[GATED] += 1.0
    if a.memory[GATED] == 1.0:
        a.memory[PUSH] = a.memory[PUSH + 1] = 0.0
        largest = 0.0
        for j in range(count):
            a.memory[PUSH + picks[j]] = 2.0 * math.fabs(a.innovation[j]) / (dt_s * dt_s)
            largest = max(largest, a.memory[PUSH + picks[j]])
        if largest > PUSH_MAX:
            a.memory[PUSH] = a.memory[PUSH + 1] = 0.0
        else:
            _distrust_pushed(model, a, picks, count)
    too_many = a.memory[GATED] > GATED_MAX_IN_A_ROW
    if too_many and count == 2 and may_start(model.leg, a.measured[0], a.measured[1]):
        restart(a.memory, a.measured[0], a.measured[1], True)
    return GATED_BIT


@inline
def _distrust_pushed(model: LegModel, a: Arrays, picks: NDArray[np.int64], count: int) -> None:
    """Mark the split of the pushed axes as unreliable."""
    for j in range(count):
        variance = 0.0
        for k in range(j + 1):
            variance += a.innovation_root[j, k] * a.innovation_root[j, k]
        if a.innovation[j] * a.innovation[j] > PUSHED_SIGMAS * PUSHED_SIGMAS * variance:
            distrust_split(model.hip if picks[j] == 0 else model.slide, a.memory, picks[j])


@inline
def _report(a: Arrays, out: Vector) -> None:
    """Write state, standard deviations, covariance and net efforts to `out`.

    The uncertainty of the split of a joint at rest is included, wherever it is stored
    (leg_noise.py).
    """
    at = OUT_COVARIANCE
    for row in range(N):
        out[row] = a.mean[row]
        for column in range(row + 1):
            total = 0.0
            for k in range(column + 1):
                total += a.root[row, k] * a.root[column, k]
            if column >= 4 and (row - column) % 2 == 0:
                total += a.memory[SPLIT + row % 2]
            out[at] = total
            at += 1
        out[OUT_STD + row] = math.sqrt(out[at - 1])
    for axis in range(2):
        out[OUT_NET + axis] = a.mean[6 + axis] - a.mean[4 + axis]
        total = 0.0
        for k in range(N):
            difference = a.root[6 + axis, k] - a.root[4 + axis, k]
            total += difference * difference
        out[OUT_NET_STD + axis] = math.sqrt(total)
