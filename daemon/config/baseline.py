"""The passive baseline of a leg as a file: written by `gaitd baseline`, read by the service.

A baseline is valid only with the robot file that it was recorded with, because other masses or
friction leave another residual. So it holds that file's hash, and is refused with any other.
"""

from pathlib import Path
from typing import Annotated, Final

import numpy as np
from gaitd_toml import SMALLEST, ConfigError, load_toml
from msgspec import Meta
from numpy.typing import NDArray

from daemon.config.settings import Table
from observer.baseline import Baseline
from observer.strides import BASELINE_BINS

Bins = Annotated[
    tuple[Annotated[float, Meta(ge=-1500, le=1500)], ...],
    Meta(min_length=BASELINE_BINS, max_length=BASELINE_BINS),
]

HEAD: Final = """\
# Estimated patient effort of a passive patient over the gait phase, from one rise of the hip to
# the next, in {bins} parts. Recorded by `gaitd baseline` from {source};
# it is subtracted from the stride figures of a leg that names this file.

"""


class HipBaseline(Table, frozen=True):
    """The passive hip over the stride."""

    mean_nm: Bins
    std_nm: Bins


class SlideBaseline(Table, frozen=True):
    """The passive slide over the stride."""

    mean_n: Bins
    std_n: Bins


class BaselineFile(Table, frozen=True):
    """baseline.toml."""

    robot_sha256: Annotated[str, Meta(pattern=r"^[0-9a-f]{64}\Z")]
    """Hash of the robot file that it was recorded with."""
    cadence_hz: Annotated[float, Meta(ge=0.01, le=2)]
    stride_count: Annotated[int, Meta(ge=1, le=1_000_000)]
    hip: HipBaseline
    slide: SlideBaseline


def load_baseline(path: Path, robot_sha256: str) -> NDArray[np.float64]:
    """Read a baseline for a robot, shape (BASELINE_BINS, 2): N m, N.

    Raises:
        ConfigError: the file or one of its values is invalid, or it is another robot's.
    """
    file = load_toml(path, BaselineFile)
    if file.robot_sha256 != robot_sha256:
        wanted = f"{robot_sha256}, of the robot file in use; record it again with `gaitd baseline`"
        raise ConfigError(path, "robot_sha256", file.robot_sha256, wanted)
    return np.column_stack((file.hip.mean_nm, file.slide.mean_n))


def baseline_text(baseline: Baseline, robot_sha256: str, source: str) -> str:
    """The text of the file for a baseline."""
    lists = (
        ("hip.mean_nm", baseline.mean[:, 0]),
        ("hip.std_nm", baseline.std[:, 0]),
        ("slide.mean_n", baseline.mean[:, 1]),
        ("slide.std_n", baseline.std[:, 1]),
    )
    lines = [
        f'robot_sha256 = "{robot_sha256}"',
        f"cadence_hz = {baseline.cadence_hz:.6g}",
        f"stride_count = {baseline.stride_count}",
    ]
    lines += [
        f"{key} = [{', '.join(f'{x if abs(x) >= SMALLEST else 0.0:.6g}' for x in values.tolist())}]"
        for key, values in lists
    ]
    return HEAD.format(bins=BASELINE_BINS, source=source) + "\n".join(lines) + "\n"
