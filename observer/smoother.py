"""Fixed-lag smoother: the estimate of a cycle from the samples of the 150 ms after it.

The filter lags behind a patient by up to 30 ms, which costs a part of a stride's work. So all
figures of work use the smoothed estimate, while controllers use the filter's without delay.

Rauch, Tung and Striebel's recursion, with the cross covariance from the filter's propagated sigma
points (Saerkkae, Bayesian Filtering and Smoothing, 2013, 10.2):

    C = S_k A1',  G_k = C (P-)^-1                               A1, A2: differences of the points
    x_s(k) = x_k + G_k (x_s(k+1) - x-(k+1))
    P_s(k) = W_k + G_k P_s(k+1) G_k'
    W_k = (S_k - G A1)(..)' + (G A2)(..)' + (G Q)(..)'          Q: root of the process noise

P_k - G P- G' equals W_k, but W_k is a sum of squares: nothing is subtracted from a covariance here
either. Where the filter restarted the chain is cut: later samples do not affect earlier estimates.

The derivatives by considered parameters go back with the mean, by the same gains. What innovations
show beyond the filter's covariance (`surprise.py`) comes after the cycle that it revises: each one
has the largest of what it and the cycles after it show.

The result is what is published: without the part that a passive baseline explains.

Each cycle is one node in a ring of LAG + 1; all in one flat array of floats, so a copy is a
snapshot. `store` is called after each `leg_filter.advance`, with its
memory and points; `smoothed` gives the node that is LAG cycles old.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from observer.filter.cdkf import SIGMA_4, STEP
from observer.filter.considered import FRICTION_ROW, VARIANTS_MAX, add_variance, take_off, widen
from observer.filter.leg_filter import Setup, constants_of, placed
from observer.filter.leg_memory import NOTHING, STEPPED, LegMemory, N
from observer.filter.leg_model import LANES, STEP_S
from observer.jit import inline, kernel
from observer.mechanism.friction import FrictionParameters, bristle_friction, bristle_slopes

Vector = NDArray[np.float64]

LAG: Final = 15
"""Cycles of lag: 150 ms."""
NODES: Final = LAG + 1
SQUARE: Final = N * N

# Places in a node: the filtered mean first, then
COVARIANCE: Final = N
LINKED: Final = COVARIANCE + SQUARE
"""Relation to the previous node: CUT, SAME or LINKED_BY_MODEL."""
GAIN: Final = LINKED + 1
"""Smoother gain of the previous node, from this one."""
FORECAST: Final = GAIN + SQUARE
OWN: Final = FORECAST + N
"""W of the previous node."""
OPEN_SPLIT: Final = OWN + SQUARE
"""Variance of the split that the filter keeps apart (leg_noise.py), and of the friction law."""
HIDDEN_NET: Final = OPEN_SPLIT + 2
"""Variance of net that the transmission hides."""
SHOWN_NET: Final = HIDDEN_NET + 2
"""Variance of net that innovations show."""
TURNING: Final = SHOWN_NET + 2
"""Variance of friction by the changes of its known error, as the filter has it."""
SENSITIVITY: Final = TURNING + 2
"""Derivative of the filtered mean by each considered parameter."""
FORECAST_SENSITIVITY: Final = SENSITIVITY + VARIANTS_MAX * N
CYCLE_DATA: Final = FORECAST_SENSITIVITY + VARIANTS_MAX * N
"""Caller's data, kept with the node."""
CYCLE_DATA_COUNT: Final = 6
NODE_SIZE: Final = CYCLE_DATA + CYCLE_DATA_COUNT

CUT: Final = 0.0
SAME: Final = 1.0
LINKED_BY_MODEL: Final = 2.0

# Places in a ring: the nodes first, then
COUNT: Final = NODES * NODE_SIZE
"""Number of nodes ever stored."""
RING_SIZE: Final = COUNT + 1
OF_PARAMETERS: Final = max(5 * SQUARE, 2 * SQUARE + 4 * VARIANTS_MAX)
"""Place of the derivatives in the scratch memory, behind that of `_link`, `_step_back`, `widen`."""
WORK_SIZE: Final = OF_PARAMETERS + VARIANTS_MAX * N

# Places in the result: the mean first, then
SMOOTH_STD: Final = N
SMOOTH_COVARIANCE: Final = 2 * N
"""Lower triangle, row by row."""
SMOOTH_NET: Final = SMOOTH_COVARIANCE + N * (N + 1) // 2
SMOOTH_NET_STD: Final = SMOOTH_NET + 2
SMOOTH_CYCLE_DATA: Final = SMOOTH_NET_STD + 2
SMOOTH_UNSURE: Final = SMOOTH_CYCLE_DATA + CYCLE_DATA_COUNT
"""Error of the patient's effort by each considered parameter, hip then slide; 0 for none. With a
baseline by each independent combination of them."""
SMOOTH_SIZE: Final = SMOOTH_UNSURE + 2 * VARIANTS_MAX


@kernel
def store(
    ring: Vector, memory_of: Sequence[LegMemory], points: Vector, cycle_data: Vector, work: Vector
) -> None:
    """Store the cycle that `advance` has just finished.

    Args:
        ring: (RING_SIZE), all zero before the first cycle.
        memory_of: the filter's memory after `advance`.
        points: the filter's sigma points after `advance`.
        cycle_data: (CYCLE_DATA_COUNT), stored with the node.
        work: scratch, (WORK_SIZE).
    """
    memory = memory_of[0]
    count = int(ring[COUNT])
    at = (count % NODES) * NODE_SIZE
    node = ring[at : at + NODE_SIZE]
    for i in range(N):
        node[i] = memory.mean[i] if memory.started != 0.0 else math.nan
    for i in range(N):
        for j in range(N):
            total = 0.0
            for k in range(min(i, j) + 1):
                total += memory.root[i, k] * memory.root[j, k]
            node[COVARIANCE + i * N + j] = total
    for i in range(2):
        node[OPEN_SPLIT + i] = memory.split[i] + memory.law[i]
        node[HIDDEN_NET + i] = memory.hidden_net[i]
        node[SHOWN_NET + i] = memory.shown_net[i]
        node[TURNING + i] = memory.turning[i]
    for k in range(VARIANTS_MAX):
        for i in range(N):
            node[SENSITIVITY + k * N + i] = memory.sensitivity[k, i]
            node[FORECAST_SENSITIVITY + k * N + i] = memory.forecast_sensitivity[k, i]
    for i in range(CYCLE_DATA_COUNT):
        node[CYCLE_DATA + i] = cycle_data[i]
    node[LINKED] = CUT
    if count > 0 and memory.event == STEPPED:
        node[LINKED] = LINKED_BY_MODEL
        _link(node, memory, points, work)
    elif count > 0 and memory.event == NOTHING and memory.started != 0.0:
        node[LINKED] = SAME
    ring[COUNT] = count + 1.0


@inline
def _link(node: Vector, m: LegMemory, points: Vector, work: Vector) -> None:
    """Compute gain, forecast and W from the previous node to this one."""
    before = m.backup_root
    first, second = work[:SQUARE], work[SQUARE : 2 * SQUARE]
    _differences(points, first, second)
    gain = node[GAIN:FORECAST]
    for i in range(N):
        for j in range(N):
            total = 0.0
            for k in range(i + 1):
                total += before[i, k] * first[j * N + k]
            gain[i * N + j] = total
        _solve(m.forecast_root, gain[i * N : i * N + N])
    for i in range(N):
        node[FORECAST + i] = m.forecast_mean[i]
    own, scaled, noised = (
        work[2 * SQUARE : 3 * SQUARE],
        work[3 * SQUARE : 4 * SQUARE],
        work[4 * SQUARE : 5 * SQUARE],
    )
    for i in range(N):
        for k in range(N):
            rest, spread, noise = before[i, k], 0.0, 0.0
            for j in range(N):
                g = gain[i * N + j]
                rest -= g * first[j * N + k]
                spread += g * second[j * N + k]
                noise += g * m.noise[j, k]
            own[i * N + k], scaled[i * N + k], noised[i * N + k] = rest, spread, noise
    for i in range(N):
        for j in range(N):
            total = 0.0
            for k in range(N):
                total += own[i * N + k] * own[j * N + k] + scaled[i * N + k] * scaled[j * N + k]
                total += noised[i * N + k] * noised[j * N + k]
            node[OWN + i * N + j] = total


@inline
def _differences(points: Vector, first: Vector, second: Vector) -> None:
    """Differences A1 and A2 of propagated sigma points, as in `cdkf.compress`."""
    to_first = 0.5 / STEP
    to_second = math.sqrt(SIGMA_4 - 1.0) * 0.5 / (STEP * STEP)
    for row in range(N):
        base = row * LANES
        for i in range(N):
            plus = points[base + 1 + i] - points[base]
            minus = points[base + 1 + N + i] - points[base]
            first[row * N + i] = to_first * (plus - minus)
            second[row * N + i] = to_second * (plus + minus)


@inline
def _solve(root: Vector, row: Vector) -> None:
    """Row (root root')^-1 in place: two triangular solves."""
    for i in range(N):
        for k in range(i):
            row[i] -= root[i, k] * row[k]
        row[i] /= root[i, i]
    for i in range(N - 1, -1, -1):
        for k in range(i + 1, N):
            row[i] -= root[k, i] * row[k]
        row[i] /= root[i, i]


@kernel
def smoothed(
    setup_of: Setup,
    ring: Vector,
    lag: int,
    out: Vector,
    work: Vector,
) -> bool:
    """Smooth the node that is `lag` cycles old by all later nodes; False if there is none.

    Args:
        setup_of: that of the filter.
        ring: as written by `store`.
        lag: 0..LAG; 0 is the newest, equal to the filter's estimate.
        out: result, (SMOOTH_SIZE).
        work: scratch, (WORK_SIZE).
    """
    count = int(ring[COUNT])
    if lag >= count or lag > LAG:
        return False
    mean, covariance = work[:N], work[SQUARE : 2 * SQUARE]
    everywhere = constants_of(setup_of[0])
    of_parameters = everywhere.variant_count * N
    sensitivity, difference = work[OF_PARAMETERS:], work[2 * SQUARE : 2 * SQUARE + N]
    newest = ring[((count - 1) % NODES) * NODE_SIZE :]
    _copy(newest, 0, mean, N)
    _copy(newest, COVARIANCE, covariance, SQUARE)
    _copy(newest, SENSITIVITY, sensitivity, of_parameters)
    shown = newest[SHOWN_NET], newest[SHOWN_NET + 1]
    for back in range(lag):
        after = ring[((count - 1 - back) % NODES) * NODE_SIZE :]
        before = ring[((count - 2 - back) % NODES) * NODE_SIZE :]
        hip, slide = before[SHOWN_NET], before[SHOWN_NET + 1]
        if after[LINKED] == CUT:
            shown = hip, slide
            _copy(before, 0, mean, N)
            _copy(before, COVARIANCE, covariance, SQUARE)
            _copy(before, SENSITIVITY, sensitivity, of_parameters)
        else:
            shown = max(shown[0], hip), max(shown[1], slide)
        if after[LINKED] == LINKED_BY_MODEL:
            _step_back(before, after, mean, covariance, work[2 * SQUARE :])
            for k in range(everywhere.variant_count):
                at, forecast = SENSITIVITY + k * N, FORECAST_SENSITIVITY + k * N
                derivative = sensitivity[k * N : k * N + N]
                _revise(before[at:], after[forecast:], after[GAIN:], derivative, difference)
    constants = placed(everywhere, mean[0], mean[1])
    _add_damping(constants.model.hip, 0, mean, covariance)
    _add_damping(constants.model.slide, 1, mean, covariance)
    node = ring[((count - 1 - lag) % NODES) * NODE_SIZE :]
    _write(node, mean, covariance, shown, out)
    for i in range(2 * VARIANTS_MAX):
        out[SMOOTH_UNSURE + i] = 0.0
    if constants.variant_count > 0:
        widen(
            constants.variant_count,
            constants.known,
            sensitivity[: VARIANTS_MAX * N].reshape((VARIANTS_MAX, N)),
            SMOOTH_NET_STD,
            work[2 * SQUARE :],
            out[SMOOTH_UNSURE:],
            work,
            out,
        )
        if constants.known.taken:
            for axis in range(2):
                add_variance(FRICTION_ROW + axis, node[TURNING + axis], SMOOTH_NET_STD, out)
            take_off(work, SMOOTH_NET, out)
    return True


@inline
def _revise(
    before: Vector, forecast: Vector, gain: Vector, value: Vector, difference: Vector
) -> None:
    """Replace a value of eight states by that of the previous node: before + G (value - forecast).

    Args:
        before: as filtered at the previous node.
        forecast: as predicted from there.
        gain: G, row by row.
        value: as smoothed at this node; changed.
        difference: scratch, (N).
    """
    for i in range(N):
        difference[i] = value[i] - forecast[i]
    for i in range(N):
        total = before[i]
        for k in range(N):
            total += gain[i * N + k] * difference[k]
        value[i] = total


@inline
def _copy(source: Vector, start: int, target: Vector, count: int) -> None:
    for i in range(count):
        target[i] = source[start + i]


@inline
def _step_back(
    before: Vector, after: Vector, mean: Vector, covariance: Vector, work: Vector
) -> None:
    """Replace mean and covariance of a node by those of the previous node."""
    _revise(before, after[FORECAST:], after[GAIN:], mean, work)
    half = work[SQUARE : 2 * SQUARE]
    for i in range(N):
        for j in range(N):
            total = 0.0
            for k in range(N):
                total += after[GAIN + i * N + k] * covariance[k * N + j]
            half[i * N + j] = total
    for i in range(N):
        for j in range(i + 1):
            total = after[OWN + i * N + j]
            for k in range(N):
                total += half[i * N + k] * after[GAIN + j * N + k]
            covariance[i * N + j] = covariance[j * N + i] = total


@inline
def _add_damping(f: FrictionParameters, axis: int, mean: Vector, covariance: Vector) -> None:
    """Replace the elastic part of bristles by the whole friction, as the filter reports it."""
    if f.bristle_stiffness == 0.0:
        return
    friction, velocity = 4 + axis, 2 + axis
    by_elastic, by_velocity = bristle_slopes(f, mean[friction], mean[velocity], STEP_S)
    mean[friction] = bristle_friction(f, mean[friction], mean[velocity], STEP_S)
    for k in range(N):
        covariance[friction * N + k] *= by_elastic
        covariance[friction * N + k] += by_velocity * covariance[velocity * N + k]
    for k in range(N):
        covariance[k * N + friction] *= by_elastic
        covariance[k * N + friction] += by_velocity * covariance[k * N + velocity]


@inline
def _write(
    node: Vector, mean: Vector, covariance: Vector, shown_net: tuple[float, float], out: Vector
) -> None:
    """Write the result of one node, with the uncertainty of the split that the filter reports."""
    at = SMOOTH_COVARIANCE
    for row in range(N):
        out[row] = mean[row]
        for column in range(row + 1):
            out[at] = covariance[row * N + column]
            if column >= 4 and (row - column) % 2 == 0:
                out[at] += node[OPEN_SPLIT + row % 2]
            if column == row and row >= 6:
                out[at] += max(node[HIDDEN_NET + row % 2], shown_net[row % 2])
            at += 1
        out[SMOOTH_STD + row] = math.sqrt(max(out[at - 1], 0.0))
    for axis in range(2):
        out[SMOOTH_NET + axis] = mean[6 + axis] - mean[4 + axis]
        patient, friction = 6 + axis, 4 + axis
        variance = (
            covariance[patient * N + patient]
            + covariance[friction * N + friction]
            - 2.0 * covariance[patient * N + friction]
            + max(node[HIDDEN_NET + axis], shown_net[axis])
        )
        out[SMOOTH_NET_STD + axis] = math.sqrt(max(variance, 0.0))
    for i in range(CYCLE_DATA_COUNT):
        out[SMOOTH_CYCLE_DATA + i] = node[CYCLE_DATA + i]
