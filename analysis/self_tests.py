"""Friction of both axes from the self-tests of a recording, relative to a robot file.

In a self-test each axis goes forth and back at a constant speed beyond the peak of friction
(`daemon/core/exercises/self_test.py`). Over the rows of that speed, what inertia, weight and
springs of the robot file leave of the measured effort is regressed on

    ratio F_s(v) + load + stiffness (q - mean q)

with F_s of the file, eq. (13), where the axis is. The effort is without the offset that the file
has of its drive. Weight or springs that are not those of the file have the same sign forth and
back: they are in the other two numbers, and not in the ratio. Coulomb and viscous friction cannot
be told apart at one speed; the ratio is of their sum. The standard error is that of Newey and West
(1987), for residuals that are correlated over some rows: the smoothing's, and the cogging of a
motor. It is the error within one test, and knows nothing of the next one.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from analysis.calibration.motion import Motion, prepare
from analysis.calibration.start import residual_effort
from analysis.parquet import Stay
from analysis.recording import Recording, RecordingError
from daemon.config.robot import friction_parameters, leg_parameters, observer_tuning
from daemon.config.settings import Robot
from observer.mechanism.friction import (
    FrictionParameters,
    OverPosition,
    at_position,
    static_friction_of,
)

Vector = NDArray[np.float64]

AXES: Final = ("hip", "slide")
DURATION_MIN_S: Final = 1.0
FAST_SHARE: Final = 0.5
"""Share of the test's speed above which a row counts; impedance guidance lets it swing."""
MARGIN_ROWS: Final = 5
"""Left out at both ends of each way: friction follows its law by a time constant, 20 ms."""
ROWS_MIN: Final = 20
"""In each direction."""
LAGS: Final = 10
"""Rows over which residuals may be correlated: the smoothing's window, 0.1 s."""


class AxisFriction(NamedTuple):
    """Friction of one axis in one self-test; NaN where there is a fault."""

    friction_ratio: float
    """To the friction of the robot file at the same speeds."""
    std_error_ratio: float
    friction_si: float
    """At the mean speed: N·m, N."""
    speed_si_per_s: float
    load_error_si: float
    """What weight and springs have beyond the file: N·m, N."""
    row_count: int
    fault: str
    """Why it is not used; empty if it is."""


def friction_of(test: Stay, robot: Robot) -> tuple[AxisFriction, AxisFriction]:
    """Friction of hip and slide in one self-test."""
    try:
        motion = prepare([test.recording], hold_out=False, duration_min_s=DURATION_MIN_S)
    except RecordingError as error:
        return _unused(str(error)), _unused(str(error))
    left = np.empty((len(motion.steps_s), 2))
    tuning = observer_tuning(robot)
    effort = motion.smooth_effort - np.array(tuning.effort_offset)
    residual_effort(leg_parameters(robot), 1.0, motion.smooth, effort, left)
    laws = zip(friction_parameters(robot), tuning.friction_over_position, strict=True)
    hip, slide = (_of_axis(motion, axis, left[:, axis], *law) for axis, law in enumerate(laws))
    return hip, slide


def warm_up(robot: Robot) -> None:
    """Load the compiled kernels of a process, so that no recording pays for them."""
    time_s = np.linspace(0.01, 2.0, 200)
    forth_and_back = np.column_stack([0.5 + 0.1 * np.minimum(time_s, 2.0 - time_s)] * 2)
    along = np.column_stack([np.where(time_s < 1.0, 1e3, -1e3)] * 2)
    friction_of(Stay(0, Recording("warm-up", time_s, forth_and_back, along)), robot)


def _unused(fault: str, row_count: int = 0) -> AxisFriction:
    return AxisFriction(np.nan, np.nan, np.nan, np.nan, np.nan, row_count, fault)


def _of_axis(
    motion: Motion, axis: int, effort: Vector, law: FrictionParameters, over: OverPosition
) -> AxisFriction:
    velocity = motion.velocity[:, axis]
    speed = np.abs(velocity)
    slowest = max(law.peak, FAST_SHARE * float(np.quantile(speed, 0.95)))
    fast = (speed > slowest) & ~motion.begins
    margin = 2 * MARGIN_ROWS + 1
    used = np.asarray(minimum_filter1d(fast, margin, mode="constant"), dtype=np.bool_)
    forth, back = (int(np.count_nonzero(used & (way * velocity > 0))) for way in (1, -1))
    if min(forth, back) < ROWS_MIN:
        fault = f"{forth} rows forth and {back} back at speed, fewer than {ROWS_MIN}"
        return _unused(fault, forth + back)
    position = motion.smooth[used, axis]
    pairs = zip(position.tolist(), velocity[used].tolist(), strict=True)
    expected = np.array([static_friction_of(at_position(law, over, q), v) for q, v in pairs])
    columns = np.column_stack((expected, np.ones(len(expected)), position - position.mean()))
    found, *_ = np.linalg.lstsq(columns, effort[used], rcond=None)
    ratio, load, _ = found.tolist()
    if ratio <= 0.0:
        return _unused(f"its effort acts against its motion: ratio {ratio:.3g}", forth + back)
    mean_speed = float(speed[used].mean())
    return AxisFriction(
        ratio,
        _std_error(columns, effort[used] - columns @ found),
        ratio * static_friction_of(at_position(law, over, float(position.mean())), mean_speed),
        mean_speed,
        load,
        forth + back,
        "",
    )


def _std_error(columns: NDArray[np.float64], residuals: Vector) -> float:
    """Standard error of the first coefficient, by Newey and West with Bartlett's weights."""
    count, width = columns.shape
    scores = columns * residuals[:, None]
    middle = scores.T @ scores
    for lag in range(1, LAGS + 1):
        across = scores[lag:].T @ scores[:-lag]
        middle += (1.0 - lag / (LAGS + 1)) * (across + across.T)
    bread = np.linalg.inv(columns.T @ columns)
    return float(np.sqrt((bread @ middle @ bread)[0, 0] * count / (count - width)))
