"""Preparation of recordings: without glitches, smoothed, split into rows to fit and to hold out.

Velocity and acceleration come from local polynomials (Savitzky and Golay 1964) over the positions;
they serve the initial values and the checks, the likelihood itself uses positions as measured.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter
from scipy.signal import savgol_filter

from analysis.recording import Recording, RecordingError

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Flags = NDArray[np.bool_]

WINDOW_ROWS: Final = 9
DEGREE: Final = 3
GAP_MAX_S: Final = 0.1
PERIOD_S: Final = (0.004, 0.02)
DURATION_MIN_S: Final = 10.0
MISSING_MAX_RATIO: Final = 0.3
SETTLE_ROWS: Final = 60
"""Rows after a start before innovations count, and before the law acts: velocities and frictions at
the start are as uncertain as the law is curved, and no linearisation survives that."""
BLOCK_S: Final = 2.0
HELD_OUT_OF: Final = 4
"""One period: of this many blocks in a row the last one is held out."""
REST: Final = (0.01, 0.004)
"""Smoothed speeds, rad/s and m/s, below which an axis counts as resting."""
RESTING_RATIO: Final = 2.0
"""Over these speeds: below it a law that is steep about standstill creeps and hunts, which no
linearisation follows."""
REST_MARGIN_ROWS: Final = 30
"""Margin at both ends of a rest, where breaking away and coming to rest follow the law."""
GLITCH: Final = (0.02, 0.01)
"""Distance from the median of five samples, rad and m, beyond any leg's: a glitch."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Concatenated recordings in the form that filter and regressions use; n rows."""

    sources: tuple[str, ...]
    time_s: Vector
    """Shape (n,): common time, without the pauses between recordings."""
    steps_s: Vector
    """Shape (n,): time since the previous row of the same recording."""
    position: Matrix
    """Shape (n, 2): rad, m; NaN where missing or a glitch."""
    effort: Matrix
    """Shape (n, 2): N·m, N; from the previous row to this one."""
    begins: Flags
    """Shape (n,)."""
    settled: Flags
    """Shape (n,): settled after a start."""
    smooth: Matrix
    """Shape (n, 6): position, velocity, acceleration of hip and slide in turn."""
    smooth_effort: Matrix
    """Shape (n, 2): at the row's time, smoothed like the positions."""
    held_out: Flags
    """Shape (n,)."""
    rests: Flags
    """Shape (n, 2): in the middle of a rest of an axis, or not settled: no law acts."""

    @property
    def duration_s(self) -> float:
        """Duration of all recordings."""
        return float(np.sum(self.steps_s[~self.begins]))

    @property
    def seen(self) -> Flags:
        """Shape (n, 2): settled, and the position is known."""
        known: Flags = self.settled[:, None] & ~np.isnan(self.position)
        return known

    @property
    def effort_rate(self) -> Matrix:
        """Shape (n, 2): N·m/s, N/s; central differences, one-sided where a recording ends."""
        steps = np.diff(self.effort, axis=0) / self.steps_s[1:, None]
        inside = ~self.begins[1:, None]
        rate, count = np.zeros(self.effort.shape), np.zeros((len(self.effort), 1))
        for rows in (slice(None, -1), slice(1, None)):
            rate[rows] += steps * inside
            count[rows] += inside
        return rate / np.maximum(count, 1.0)

    @property
    def velocity(self) -> Matrix:
        """Shape (n, 2): rad/s, m/s."""
        return self.smooth[:, 2:4]


def prepare(
    recordings: Sequence[Recording],
    *,
    hold_out: bool = True,
    effort_delay_s: float = 0.0,
    duration_min_s: float = DURATION_MIN_S,
) -> Motion:
    """Prepare recordings of the same machine.

    Args:
        recordings: each of at least one row.
        hold_out: hold out every fourth two seconds; otherwise nothing.
        effort_delay_s: delay of an effort relative to its row.
        duration_min_s: of all of them together.

    Raises:
        RecordingError: too short, the wrong rate, or too much missing.
    """
    for one in recordings:
        _check(one)
    # As a message prints it: 9.98 s between the first row and the last are 10 s of recording.
    duration_s = round(sum(one.duration_s for one in recordings), 1)
    if duration_s < duration_min_s:
        raise RecordingError(
            f"{recordings[0].source}: {duration_s:g} s are too short to calibrate from; at least "
            f"{duration_min_s:g} s are needed, 30 s for each axis are good"
        )
    parts = [_one(one, effort_delay_s) for one in recordings]
    steps_s, position, effort, begins, smooth, smooth_effort = map(
        np.concatenate, zip(*parts, strict=True)
    )
    time_s = np.cumsum(steps_s)
    block = np.floor(time_s / BLOCK_S).astype(np.int64) % HELD_OUT_OF
    settled = _settled(begins)
    speed = np.abs(smooth[:, 2:4])
    rests = maximum_filter1d(speed, 2 * REST_MARGIN_ROWS + 1, axis=0) < RESTING_RATIO * np.array(
        REST
    )
    return Motion(
        tuple(one.source for one in recordings),
        time_s,
        steps_s,
        position,
        effort,
        begins,
        settled,
        smooth,
        smooth_effort,
        (block == HELD_OUT_OF - 1) & hold_out,
        rests | ~settled[:, None],
    )


def _check(one: Recording) -> None:
    if len(one.time_s) < 2 * WINDOW_ROWS:
        raise RecordingError(
            f"{one.source}: {len(one.time_s)} rows are too short to calibrate from"
        )
    period_s = float(np.median(np.diff(one.time_s)))
    if not PERIOD_S[0] <= period_s <= PERIOD_S[1]:
        raise RecordingError(
            f"{one.source}: a row every {1e3 * period_s:.3g} ms; calibration takes "
            f"{1e3 * PERIOD_S[0]:g} to {1e3 * PERIOD_S[1]:g} ms, a service records every 10 ms"
        )
    for axis, column in enumerate(("hip_angle_rad", "slide_position_m")):
        missing = float(np.mean(np.isnan(one.position[:, axis])))
        if missing > MISSING_MAX_RATIO:
            raise RecordingError(
                f"{one.source}: {column} is missing in {missing:.0%} of the rows; "
                f"{MISSING_MAX_RATIO:.0%} are allowed"
            )
    for axis, column in enumerate(("hip_torque_nm", "slide_force_n")):
        if np.mean(np.isnan(one.effort[:, axis])) > MISSING_MAX_RATIO:
            raise RecordingError(f"{one.source}: {column} is missing in most rows")


def _one(
    one: Recording, effort_delay_s: float
) -> tuple[Vector, Matrix, Matrix, Flags, Matrix, Matrix]:
    steps_s = np.diff(one.time_s, prepend=one.time_s[0])
    begins = steps_s > GAP_MAX_S
    begins[0] = True
    period_s = float(np.median(steps_s[1:]))
    position = one.position.copy()
    effort = np.column_stack([_delayed(one, axis, effort_delay_s) for axis in range(2)])
    smooth, smooth_effort = np.zeros((len(steps_s), 6)), effort.copy()
    for axis in range(2):
        filled = _filled(one.time_s, position[:, axis])
        wild = np.abs(filled - median_filter(filled, 5, mode="nearest")) > GLITCH[axis]
        position[wild, axis] = np.nan
        filled = _filled(one.time_s, position[:, axis])
        for part in _parts(begins):
            if part.stop - part.start < WINDOW_ROWS:
                smooth[part, axis] = filled[part]
                continue
            for order in range(3):
                smooth[part, 2 * order + axis] = smoothed(filled[part], order, period_s)
            smooth_effort[part, axis] = smoothed(_at_rows(effort[part, axis]))
    steps_s[begins] = period_s
    return steps_s, position, effort, begins, smooth, smooth_effort


def _delayed(one: Recording, axis: int, delay_s: float) -> Vector:
    """Efforts that acted in each row, with gaps filled, shifted by the delay."""
    effort = _filled(one.time_s, one.effort[:, axis])
    late: Vector = np.interp(one.time_s - delay_s, one.time_s, effort)
    return late


def smoothed(values: Vector, order: int = 0, period_s: float = 1.0) -> Vector:
    """The local polynomial's value or derivative, shape as given."""
    made = savgol_filter(values, WINDOW_ROWS, DEGREE, deriv=order, delta=period_s)
    return np.asarray(made, dtype=np.float64)


def _at_rows(effort: Vector) -> Vector:
    """Efforts at the rows: the mean of the adjacent intervals."""
    after = np.append(effort[1:], effort[-1])
    return 0.5 * (effort + after)


def _parts(begins: Flags) -> list[slice]:
    edges = [*np.flatnonzero(begins).tolist(), len(begins)]
    return [slice(begin, end) for begin, end in pairwise(edges)]


def _settled(begins: Flags) -> Flags:
    settled = np.ones(len(begins), dtype=np.bool_)
    for at in np.flatnonzero(begins):
        settled[at : at + SETTLE_ROWS] = False
    return settled


def _filled(time_s: Vector, values: Vector) -> Vector:
    known = ~np.isnan(values)
    filled: Vector = np.interp(time_s, time_s[known], values[known])
    return filled
