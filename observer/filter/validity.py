"""Validity of an estimate: the status bits that the filter determines, and the level of each axis.

An axis is BAD when its numbers may be wrong (out of workspace, inconsistent, unreferenced,
uncalibrated, predicted for too long), SPLIT_UNOBSERVABLE when it has rested for longer than 100 ms,
or was hit by an unmodelled push, and friction has not met its law since, and OK otherwise. A
reversal of less than 100 ms keeps its split.

After a rest friction meets its law when the axis has moved for 2.5 T1, and sigma of the split
(leg_noise.py) is a tenth of its largest. The second takes longer where the joint creeps: friction
follows by a(v) / T1. A push is not in that sigma, so the axis must move for four T1 after it.

The mechanism does not close at a sigma point out of the workspace, so what was corrected there may
be wrong by far more than its covariance. An axis that comes back is BAD for a warm-up.

Consistency is checked by an upper limit of the mean NIS: a filter with too large a covariance gives
no wrong number. NIS does not detect a bias either (observer.md, fact 10); other checks must.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from observer.filter.leg_memory import LegMemory
from observer.filter.leg_model import LegModel
from observer.filter.status import (
    BAD_BITS,
    GAP_MAX_S,
    NEAR_SINGULAR_RATIO,
    NIS_WINDOW_MAX,
    PREDICTED_MAX_CYCLES,
    REST_MAX_S,
    REST_TIME_CONSTANTS,
    SPLIT_KNOWN_RATIO,
    WARM_UP_CYCLES,
    Status,
    Validity,
)
from observer.jit import inline
from observer.mechanism.friction import STANDSTILL_GATE, FrictionParameters, gate
from observer.mechanism.linkage import pose

Vector = NDArray[np.float64]

# numba supports plain integers, not flags.
VALID_BIT: Final = Status.VALID.value
WARM_UP_BIT: Final = Status.WARM_UP.value
PREDICT_ONLY_BIT: Final = Status.PREDICT_ONLY.value
STANDSTILL_HIP_BIT: Final = Status.STANDSTILL_HIP.value
STANDSTILL_SLIDE_BIT: Final = Status.STANDSTILL_SLIDE.value
NEAR_SINGULAR_BIT: Final = Status.NEAR_SINGULAR.value
OUT_OF_WORKSPACE_BIT: Final = Status.OUT_OF_WORKSPACE.value
INCONSISTENT_BIT: Final = Status.INCONSISTENT.value
BAD_MASK: Final = BAD_BITS.value
OK: Final = Validity.OK.value
SPLIT_UNOBSERVABLE: Final = Validity.SPLIT_UNOBSERVABLE.value
BAD: Final = Validity.BAD.value


@inline
def determine(model: LegModel, memory: LegMemory, dt_s: float, status: int) -> tuple[int, int, int]:
    """Determine all status bits and the validity of each axis."""
    leg = model.leg
    at = pose(leg, memory.mean[0], memory.mean[1])
    if not at.closes:
        status |= OUT_OF_WORKSPACE_BIT
    if -at.delta < NEAR_SINGULAR_RATIO * leg.shank_length_m * leg.shoe_length_m:
        status |= NEAR_SINGULAR_BIT
    if status & OUT_OF_WORKSPACE_BIT:
        memory.distrust_cycles = max(memory.distrust_cycles, WARM_UP_CYCLES)
    if memory.nis_mean > NIS_WINDOW_MAX or memory.distrust_cycles > 0.0:
        status |= INCONSISTENT_BIT
    if memory.warm_up_cycles > 0.0:
        status |= WARM_UP_BIT
    if memory.predicted[0] > 0.0 or memory.predicted[1] > 0.0:
        status |= PREDICT_ONLY_BIT
    memory.warm_up_cycles = max(memory.warm_up_cycles - 1.0, 0.0)
    memory.distrust_cycles = max(memory.distrust_cycles - 1.0, 0.0)
    if _count_rest(model.hip, memory, 0, dt_s):
        status |= STANDSTILL_HIP_BIT
    if _count_rest(model.slide, memory, 1, dt_s):
        status |= STANDSTILL_SLIDE_BIT
    level_hip = _level(memory, 0, status)
    level_slide = _level(memory, 1, status)
    if BAD not in (level_hip, level_slide):
        status |= VALID_BIT
    return status, level_hip, level_slide


@inline
def _count_rest(f: FrictionParameters, memory: LegMemory, axis: int, dt_s: float) -> bool:
    """Count how long an axis rests, then how long it has moved since; True if it rests."""
    resting = gate(f, memory.mean[2 + axis]) < STANDSTILL_GATE
    passed_s = dt_s if 0.0 < dt_s <= GAP_MAX_S else 0.0
    if resting:
        memory.rest_s[axis] += passed_s
        if memory.rest_s[axis] > REST_MAX_S:
            mark_split_unknown(f, memory, axis, REST_TIME_CONSTANTS)
    else:
        memory.rest_s[axis] = 0.0
        known = SPLIT_KNOWN_RATIO * f.stribeck
        is_last = memory.settle_s[axis] <= passed_s
        if not is_last or memory.split[axis] <= known * known:
            memory.settle_s[axis] = max(memory.settle_s[axis] - passed_s, 0.0)
    return resting


@inline
def mark_split_unknown(
    f: FrictionParameters, memory: LegMemory, axis: int, time_constants: float
) -> None:
    """Mark the split as not valid until the axis has moved for this long at least, in T1.

    Sigma of the split is not changed.
    """
    memory.settle_s[axis] = max(memory.settle_s[axis], time_constants * f.time_constant_s)


@inline
def _level(memory: LegMemory, axis: int, status: int) -> int:
    if status & BAD_MASK or memory.predicted[axis] > PREDICTED_MAX_CYCLES:
        return BAD
    return SPLIT_UNOBSERVABLE if memory.settle_s[axis] > 0.0 else OK
