"""What the leg observer keeps from one cycle to the next, where it lies, and how it begins.

Everything is in flat arrays of floats: they are quick to hand to a compiled function, and a copy of
one array is a snapshot.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.jit import inline
from observer.leg_model import LANES
from observer.linkage import pose
from observer.parameters import LegParameters
from observer.states import STATE_COUNT
from observer.status import (
    HOLD_AFTER_CYCLES,
    REST_MAX_S,
    START_KNEE_MIN_RAD,
    START_RATIO_MIN,
    WARM_UP_CYCLES,
)

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

N: Final = STATE_COUNT

# Places in `memory`: the mean, and then
ROOT: Final = N
EFFORT: Final = ROOT + N * N
"""The last finite torque and force."""
REST_S: Final = EFFORT + 2
"""For how long each axis has been at rest."""
NIS_MEAN: Final = REST_S + 2
STARTED: Final = NIS_MEAN + 1
WARM_UP: Final = STARTED + 1
"""Cycles left of warm-up."""
DISTRUST: Final = WARM_UP + 1
"""Cycles left in which a new start counts as inconsistent."""
GATED: Final = DISTRUST + 1
"""Rejected samples in a row."""
PUSH: Final = GATED + 1
"""Unforeseen acceleration of each axis that would explain the sample that was rejected."""
PREDICTED: Final = PUSH + 2
"""Cycles since each axis was last corrected."""
MEMORY_SIZE: Final = PREDICTED + 2

# Places in `scratch`: the working matrix, and then
NOISE: Final = 3 * N * N
BACKUP: Final = NOISE + N
MEASURED: Final = BACKUP + N + N * N
INNOVATION: Final = MEASURED + 2
INNOVATION_ROOT: Final = INNOVATION + 2
GAIN: Final = INNOVATION_ROOT + 4
SCRATCH_SIZE: Final = GAIN + 2 * N
POINTS_SIZE: Final = N * LANES

START_STD: Final = (1e-3, 1e-3, 1e-2, 1e-2, 1.0, 10.0, 1.0, 10.0)
"""At rest at a measured pose."""
RESTART_STD: Final = (1e-3, 1e-3, 1.0, 1.0, 10.0, 100.0, 10.0, 100.0)
"""Anywhere, maybe moving."""


class Arrays(NamedTuple):
    """Names for the parts of `memory` and `scratch`; views, no copies."""

    memory: Vector
    mean: Vector
    root: Matrix
    points: Vector
    work: Vector
    noise: Vector
    backup: Vector
    """Mean and root before the prediction."""
    measured: Vector
    innovation: Vector
    innovation_root: Matrix
    gain: Matrix


@inline
def arrays_in(memory: Vector, scratch: Vector, points: Vector) -> Arrays:
    """The parts by name."""
    return Arrays(
        memory,
        memory[:N],
        memory[ROOT:EFFORT].reshape((N, N)),
        points,
        scratch[:NOISE],
        scratch[NOISE:BACKUP],
        scratch[BACKUP:MEASURED],
        scratch[MEASURED:INNOVATION],
        scratch[INNOVATION:INNOVATION_ROOT],
        scratch[INNOVATION_ROOT:GAIN].reshape((2, 2)),
        scratch[GAIN:].reshape((N, 2)),
    )


@inline
def fill(values: Vector, start: int, end: int, value: float) -> None:
    """values[start:end] = value, which as a slice takes numba a second to compile."""
    for i in range(start, end):
        values[i] = value


@inline
def may_start(leg: LegParameters, hip: float, slide: float) -> bool:
    """Whether this is a pose to begin at: closed, off the singularity, knee not bent backwards."""
    at = pose(leg, hip, slide)
    ratio = -at.delta / (leg.shank_length_m * leg.shoe_length_m)
    cross = at.knee_x * at.shank_y - at.knee_y * at.shank_x
    knee = -math.atan2(cross, at.knee_x * at.shank_x + at.knee_y * at.shank_y)
    return at.closes and ratio > START_RATIO_MIN and knee > START_KNEE_MIN_RAD


@inline
def start(memory: Vector, hip: float, slide: float) -> None:
    """Begin at rest at the measured pose; what rests there has rested for long."""
    fill(memory, 0, EFFORT, 0.0)
    memory[0] = hip
    memory[1] = slide
    for i in range(N):
        memory[ROOT + i * (N + 1)] = START_STD[i]
    fill(memory, REST_S, NIS_MEAN, 2.0 * REST_MAX_S)
    memory[DISTRUST] = 0.0
    _begin(memory)


@inline
def restart(memory: Vector, hip: float, slide: float, keep_efforts: bool) -> None:
    """Begin anew at the measured pose, maybe moving; what is not kept begins at zero."""
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
    memory[NIS_MEAN] = 2.0
    memory[STARTED] = 1.0
    memory[WARM_UP] = WARM_UP_CYCLES
    memory[GATED] = 0.0
    fill(memory, PREDICTED, MEMORY_SIZE, 0.0)


@inline
def lose(memory: Vector) -> None:
    """Give up prediction: the state is held until the filter can begin anew."""
    fill(memory, PREDICTED, MEMORY_SIZE, HOLD_AFTER_CYCLES + 1.0)


@inline
def is_lost(memory: Vector) -> bool:
    """Whether prediction was given up, or has gone on for too long."""
    return max(memory[PREDICTED], memory[PREDICTED + 1]) > HOLD_AFTER_CYCLES


@inline
def take_efforts(memory: Vector, hip: float, slide: float) -> bool:
    """Remember the efforts that are numbers; whether both are."""
    if math.isfinite(hip):
        memory[EFFORT] = hip
    if math.isfinite(slide):
        memory[EFFORT + 1] = slide
    return math.isfinite(hip) and math.isfinite(slide)
