"""Delay of an effort relative to its row, measured from a recording with fast efforts.

An error of one cycle does not show in the mean NIS, because the disturbance states absorb it. So
the method uses the minimum of the innovations instead of their size: the same recording goes
through the observer once for each assumed delay, and the delay with the smallest innovations
explains best how the motion follows the effort. This is the correlation of effort and acceleration,
where the model accounts for noise, friction and the other axis.

Only rows in motion count. At a reversal friction masks the start of an effort, and a wrong friction
level would look like a delay; in motion a wrong level is a constant, which the disturbance state
absorbs. So the recording needs a fast effort on top of a slow motion: `[excite.delay]`.

Between whole cycles, an effort that is constant over a cycle and acts later by a fraction f of it
has the mean (1 - f) u_k + f u_(k-1) over (k-1, k].
"""

import math
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, gaussian_filter1d

from analysis.recording import Progress, Recording, RecordingError
from analysis.replay import setup_for
from daemon.config.robot import friction_parameters
from daemon.config.settings import Robot
from observer.filter.leg_model import STEP_S
from observer.offline.batch import Columns, run

Values = NDArray[np.float64]
Cycles = tuple[float, float]
"""Assumed delays of hip and slide."""

AXES: Final = ("hip", "slide")
COARSE_CYCLES: Final = tuple(range(-4, 6))
EDGE_CYCLES: Final = (-3, 5)
"""A minimum at or beyond this limit is the end of the search range, not the delay."""
FINE_CYCLES: Final = (-0.5, -0.25, 0.0, 0.25, 0.5)
"""Offsets about the best of the coarse delays, for the parabola."""
START_ROWS: Final = 50
"""Rows in which the filter settles."""
MOVING_EDGES: Final = 5.0
"""An axis faster than this many edge speeds v_0 is certainly in motion."""
MARGIN_ROWS: Final = 3
SMOOTHING_ROWS: Final = 1.5
"""Filter of the speed that decides on motion, not of the measured data."""
MOVING_MIN_ROWS: Final = 100
GLITCH_SIGMAS: Final = 4.0
"""Limit of an innovation: a glitch or a stick-slip event counts no more."""
BLOCKS: Final = 8
"""Parts of the recording, each left out once: the spread of the results is the uncertainty."""
STD_MAX_MS: Final = 1.0
"""A larger uncertainty means that there is no result."""
DOUBTFUL_MS: Final = 2.0
"""Axes that differ more have another cause than one delay; so has a result below minus this."""


class Delay(NamedTuple):
    """Measured delay of one axis."""

    axis: str
    delay_ms: float
    """Delay of the effort relative to its row; NaN where the recording does not identify it."""
    std_ms: float
    """One standard deviation; infinite where the recording does not identify the delay."""
    moving_count: int
    """Rows in motion."""

    @property
    def known(self) -> bool:
        """True if the recording identifies the delay."""
        return self.std_ms <= STD_MAX_MS


def measure(
    recording: Recording, robot: Robot, progress: Progress | None = None
) -> tuple[Delay, Delay]:
    """Measure the delay of hip torque and slide force.

    Args:
        recording: needs fast efforts in motion; two or three a second are too slow.
        robot: the machine of the recording; its own `effort_delay_ms` is ignored.
        progress: called with the share done.

    Raises:
        RecordingError: no axis is in motion for MOVING_MIN_ROWS rows.
    """
    moving = _moving(recording, robot)
    counts = moving.sum(axis=0)
    if counts.max() < MOVING_MIN_ROWS:
        raise RecordingError(
            f"{recording.source}: the hip is in motion in {counts[0]} rows, the slide in "
            f"{counts[1]}; a delay needs {MOVING_MIN_ROWS} rows of at least one axis"
        )
    steps = _counted(progress, len(COARSE_CYCLES) + len(FINE_CYCLES))
    innovations = _innovations_by_delay(recording, robot, steps)
    coarse = {float(cycles): innovations((cycles, cycles)) for cycles in COARSE_CYCLES}
    best = tuple(_best(coarse, moving, axis) for axis in range(2))
    fine = [innovations((best[0] + step, best[1] + step)) for step in FINE_CYCLES]
    hip, slide = (_axis(fine, moving[:, axis], best[axis], axis) for axis in range(2))
    return hip, slide


def delayed(effort: Values, cycles: float) -> Values:
    """Compute the mean effort of each row's cycle if every effort acts later by `cycles`.

    Args:
        effort: shape (n,), constant over each cycle.
        cycles: any; negative is earlier. Beyond the ends the first and the last effort go on.
    """
    whole = math.floor(cycles)
    part = cycles - whole
    rows = np.arange(len(effort)) - whole
    now, before = np.clip(rows, 0, len(effort) - 1), np.clip(rows - 1, 0, len(effort) - 1)
    return (1 - part) * effort[now] + part * effort[before]


def in_words(delay: Delay) -> str:
    """Format one line for the operator."""
    if not delay.known:
        return (
            f"{delay.axis}: not identified from the recording ({delay.moving_count} rows in motion)"
        )
    found = f"{delay.delay_ms:+.1f} ± {delay.std_ms:.1f} ms"
    return f"{delay.axis}: {found}, from {delay.moving_count} rows in motion"


def advice(delays: tuple[Delay, Delay]) -> str:
    """Recommend a value of [observer] effort_delay_ms, or what to record; one sentence."""
    known = [one for one in delays if one.known]
    if not known:
        return "record `excite` with scenario `delay`: quick efforts on top of a slow motion"
    weights = np.array([1.0 / max(one.std_ms, 0.05) ** 2 for one in known])
    mean_ms = float(np.average([one.delay_ms for one in known], weights=weights))
    if len(known) == 2 and abs(known[0].delay_ms - known[1].delay_ms) > DOUBTFUL_MS:
        return (
            "the axes differ by more than one value can hold: check the torque source and the "
            "mapping of both drives before effort_delay_ms is set"
        )
    if mean_ms < -DOUBTFUL_MS:
        return (
            "efforts act before their rows: they are recorded too late, which no delay corrects; "
            "check to which row the torque of a SYNC is written"
        )
    return f"set effort_delay_ms = {max(mean_ms, 0.0):.1f} in [observer] of robot.toml"


def _moving(recording: Recording, robot: Robot) -> NDArray[np.bool_]:
    """Rows that are certainly in motion, with some rows of motion on both sides; shape (n, 2)."""
    position = np.apply_along_axis(_filled, 0, recording.position)
    smooth = gaussian_filter1d(position, SMOOTHING_ROWS, axis=0)
    speed = np.abs(np.gradient(smooth, recording.time_s, axis=0)) if len(smooth) > 1 else smooth * 0
    edges = np.array([one.edge for one in friction_parameters(robot)])
    fast = speed > MOVING_EDGES * edges
    sure = np.asarray(binary_erosion(fast, np.ones((2 * MARGIN_ROWS + 1, 1))), dtype=np.bool_)
    sure[:START_ROWS] = False
    return sure


def _filled(values: Values) -> Values:
    """Fill missing samples by linear interpolation; at least one must be present."""
    known = np.flatnonzero(np.isfinite(values))
    return np.interp(np.arange(len(values)), known, values[known])


def _innovations_by_delay(
    recording: Recording, robot: Robot, progress: Iterator[None]
) -> Callable[[Cycles], Values]:
    setup = setup_for(_compared(robot))

    def innovations(cycles: Cycles) -> Values:
        effort = np.column_stack(
            [delayed(recording.effort[:, axis], cycles[axis]) for axis in range(2)]
        )
        next(progress)
        return run(setup, Columns(recording.time_s, recording.position, effort)).innovation

    return innovations


def _compared(robot: Robot) -> Robot:
    """The robot whose observer has no delay, and the same noise with each assumed one."""
    tuning = msgspec.structs.replace(
        robot.observer, effort_delay_ms=0.0, patient_noise_max_ratio=1.0
    )
    return msgspec.structs.replace(robot, observer=tuning)


def _best(coarse: dict[float, Values], moving: NDArray[np.bool_], axis: int) -> float:
    """Find the delay in whole cycles with the smallest innovations."""
    rows = moving[:, axis]
    if not rows.any():
        return 0.0
    scale = min(_scale(one[rows, axis]) for one in coarse.values())
    costs = {cycles: float(_costs(one[rows, axis], scale).sum()) for cycles, one in coarse.items()}
    return min(costs, key=costs.__getitem__)


def _axis(fine: list[Values], rows: NDArray[np.bool_], best: float, axis: int) -> Delay:
    count = int(np.count_nonzero(rows))
    if count < MOVING_MIN_ROWS:
        return Delay(AXES[axis], math.nan, math.inf, count)
    scale = min(_scale(one[rows, axis]) for one in fine)
    costs = np.array([_costs(one[rows, axis], scale) for one in fine])
    blocks = np.array([part.sum(axis=1) for part in np.array_split(costs, BLOCKS, axis=1)])
    whole = blocks.sum(axis=0)
    bottom, curvature = _bottom(whole)
    if not curvature > 0 or not EDGE_CYCLES[0] < best < EDGE_CYCLES[1]:
        return Delay(AXES[axis], math.nan, math.inf, count)
    left_out = np.array([_bottom(whole - block)[0] for block in blocks])
    # Expected spread of white innovations of variance 1, and the spread of the recording's parts.
    by_curvature = math.sqrt(whole.min() / count / curvature)
    by_parts = math.sqrt((BLOCKS - 1) / BLOCKS * float(np.sum((left_out - left_out.mean()) ** 2)))
    std_ms = 1e3 * STEP_S * max(by_curvature, by_parts)
    if not std_ms <= STD_MAX_MS or abs(bottom) > 1.0:
        return Delay(AXES[axis], math.nan, math.inf, count)
    return Delay(AXES[axis], 1e3 * STEP_S * (best + bottom), std_ms, count)


def _bottom(costs: Values) -> tuple[float, float]:
    """Minimum of the parabola through the costs of FINE_CYCLES, and its curvature."""
    curvature, slope, _ = np.polyfit(FINE_CYCLES, costs, 2)
    return float(-slope / (2 * curvature)), float(curvature)


def _scale(innovation: Values) -> float:
    """Robust standard deviation of the innovations, without the rare large ones."""
    known = innovation[np.isfinite(innovation)]
    return 1.4826 * float(np.median(np.abs(known))) if len(known) else math.inf


def _costs(innovation: Values, scale: float) -> Values:
    """Squares in units of the scale, bounded; a missing sample has no cost."""
    squares = np.square(np.nan_to_num(innovation / scale))
    return np.minimum(squares, GLITCH_SIGMAS**2)


def _counted(progress: Progress | None, turns: int) -> Iterator[None]:
    for turn in range(1, turns + 1):
        if progress:
            progress(turn / turns)
        yield
