"""State of the leg observer between two cycles: its layout, and its initial values.

Everything is in flat arrays of floats: they are fast to pass to a compiled function, and a copy of
one array is a snapshot.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

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

# Places in `memory`: the mean first, then
ROOT: Final = N
EFFORT: Final = ROOT + N * N
"""The last finite torque and force, followed by older ones."""
EFFORTS: Final = 4
"""For each axis, newest first: the newest effort, and older ones for a delay."""
REST_S: Final = EFFORT + 2 * EFFORTS
"""How long each axis has been at rest."""
SETTLE_S: Final = REST_S + 2
"""How much longer each axis has to move after a rest until its split is valid again."""
QUIET_S: Final = SETTLE_S + 2
"""How long each axis has certainly not moved (leg_noise.py)."""
MARK: Final = QUIET_S + 2
"""Position at which each axis was last detected to move."""
SPLIT: Final = MARK + 2
"""Variance of the share of a load between friction and patient, accumulated at rest."""
LEAN: Final = SPLIT + 2
"""Running mean of each axis' whitened innovations: 0 is white."""
NIS_MEAN: Final = LEAN + 2
STARTED: Final = NIS_MEAN + 1
WARM_UP: Final = STARTED + 1
"""Remaining cycles of warm-up."""
DISTRUST: Final = WARM_UP + 1
"""Remaining cycles in which a restart counts as inconsistent."""
GATED: Final = DISTRUST + 1
"""Number of consecutive rejected samples."""
PUSH: Final = GATED + 1
"""Unmodelled acceleration of each axis that would explain the rejected sample."""
PREDICTED: Final = PUSH + 2
"""Cycles since the last correction of each axis."""
EVENT: Final = PREDICTED + 2
"""Effect of this cycle on the estimate: NOTHING, STEPPED or BEGAN; used by the smoother."""
MEMORY_SIZE: Final = EVENT + 1

NOTHING: Final = 0.0
"""Not started yet, a duplicate, or held."""
STEPPED: Final = 1.0
"""Predicted, and corrected by the measurements."""
BEGAN: Final = 2.0
"""Started or restarted at a measured pose: independent of the past."""

# Places in `scratch`: the working matrix first, then
NOISE: Final = 3 * N * N
BACKUP: Final = NOISE + N * N
FORECAST: Final = BACKUP + N + N * N
MEASURED: Final = FORECAST + N + N * N
SEEN: Final = MEASURED + 2
INNOVATION: Final = SEEN + 2
INNOVATION_ROOT: Final = INNOVATION + 2
GAIN: Final = INNOVATION_ROOT + 4
SCRATCH_SIZE: Final = GAIN + 2 * N
POINTS_SIZE: Final = N * LANES

START_STD: Final = (1e-3, 1e-3, 1e-2, 1e-2, 3.0, 30.0, 1.0, 10.0)
"""Initial standard deviations at rest at a measured pose."""
RESTART_STD: Final = (1e-3, 1e-3, 1.0, 1.0, 10.0, 100.0, 10.0, 100.0)
"""Initial standard deviations for a pose that may be moving."""


class Arrays(NamedTuple):
    """Views of the parts of `memory` and `scratch` by name."""

    memory: Vector
    mean: Vector
    root: Matrix
    points: Vector
    work: Vector
    noise: Matrix
    """Root of this step's process noise, lower triangular."""
    backup: Vector
    """Mean and root before the prediction."""
    forecast: Vector
    """Mean and root after the prediction, before the correction."""
    measured: Vector
    seen_std: Vector
    """Standard deviation of this step's measurement."""
    innovation: Vector
    innovation_root: Matrix
    gain: Matrix


@inline
def arrays_in(memory: Vector, scratch: Vector, points: Vector) -> Arrays:
    """Return the parts of the arrays by name."""
    return Arrays(
        memory,
        memory[:N],
        memory[ROOT:EFFORT].reshape((N, N)),
        points,
        scratch[:NOISE],
        scratch[NOISE:BACKUP].reshape((N, N)),
        scratch[BACKUP:FORECAST],
        scratch[FORECAST:MEASURED],
        scratch[MEASURED:SEEN],
        scratch[SEEN:INNOVATION],
        scratch[INNOVATION:INNOVATION_ROOT],
        scratch[INNOVATION_ROOT:GAIN].reshape((2, 2)),
        scratch[GAIN:].reshape((N, 2)),
    )


@inline
def fill(values: Vector, start: int, end: int, value: float) -> None:
    """Set values[start:end] = value; the slice would take numba a second to compile."""
    for i in range(start, end):
        values[i] = value


@inline
def may_start(leg: LegParameters, hip: float, slide: float) -> bool:
    """True for a pose to start at: closed, not singular, knee not bent backwards."""
    at = pose(leg, hip, slide)
    ratio = -at.delta / (leg.shank_length_m * leg.shoe_length_m)
    cross = at.knee_x * at.shank_y - at.knee_y * at.shank_x
    knee = -math.atan2(cross, at.knee_x * at.shank_x + at.knee_y * at.shank_y)
    return at.closes and ratio > START_RATIO_MIN and knee > START_KNEE_MIN_RAD


@inline
def start(memory: Vector, hip: float, slide: float) -> None:
    """Start at rest at the measured pose, with a long rest of both axes assumed."""
    fill(memory, 0, EFFORT, 0.0)
    memory[0] = hip
    memory[1] = slide
    for i in range(N):
        memory[ROOT + i * (N + 1)] = START_STD[i]
    fill(memory, REST_S, SETTLE_S, 2.0 * REST_MAX_S)
    fill(memory, SETTLE_S, NIS_MEAN, 0.0)
    fill(memory, QUIET_S, MARK, 2.0 * REST_MAX_S)
    memory[DISTRUST] = 0.0
    _begin(memory)


@inline
def restart(memory: Vector, hip: float, slide: float, keep_efforts: bool) -> None:
    """Restart at the measured pose, maybe moving; efforts that are not kept start at zero."""
    memory[0] = hip
    memory[1] = slide
    if not keep_efforts:
        fill(memory, 2, N, 0.0)
    fill(memory, ROOT, EFFORT, 0.0)
    for i in range(N):
        memory[ROOT + i * (N + 1)] = RESTART_STD[i]
    fill(memory, REST_S, NIS_MEAN, 0.0)
    memory[DISTRUST] = WARM_UP_CYCLES
    _begin(memory)


@inline
def _begin(memory: Vector) -> None:
    memory[MARK] = memory[0]
    memory[MARK + 1] = memory[1]
    memory[NIS_MEAN] = 2.0
    memory[STARTED] = 1.0
    memory[WARM_UP] = WARM_UP_CYCLES
    memory[GATED] = 0.0
    memory[EVENT] = BEGAN
    fill(memory, PREDICTED, EVENT, 0.0)


@inline
def begin_cycle(memory: Vector, dt_s: float) -> None:
    """Advance counters and efforts by one cycle."""
    memory[EVENT] = NOTHING
    memory[PREDICTED] += 1.0
    memory[PREDICTED + 1] += 1.0
    if dt_s > 0.0:
        for i in range(2 * EFFORTS - 1, 1, -1):
            memory[EFFORT + i] = memory[EFFORT + i - 2]


@inline
def lose(memory: Vector) -> None:
    """Stop prediction: the state is held until the filter can restart."""
    fill(memory, PREDICTED, EVENT, HOLD_AFTER_CYCLES + 1.0)
    memory[EVENT] = NOTHING


@inline
def is_lost(memory: Vector) -> bool:
    """True if prediction was stopped, or has gone on for too long."""
    return max(memory[PREDICTED], memory[PREDICTED + 1]) > HOLD_AFTER_CYCLES


@inline
def take_efforts(memory: Vector, hip: float, slide: float) -> bool:
    """Store the finite efforts and keep the last value of the others; True if both are finite."""
    if math.isfinite(hip):
        memory[EFFORT] = hip
    if math.isfinite(slide):
        memory[EFFORT + 1] = slide
    return math.isfinite(hip) and math.isfinite(slide)


@inline
def effort_acting(memory: Vector, axis: int, delay_cycles: float) -> float:
    """Effort that acted in this step if efforts act this much later than given.

    A delay between whole cycles: each part of the step is under one of two efforts; returns their
    mean.
    """
    whole = math.floor(delay_cycles)
    part = delay_cycles - whole
    at = EFFORT + 2 * int(whole) + axis
    effort = memory[at]
    if part > 0.0:
        effort += part * (memory[at + 2] - effort)
    return effort
