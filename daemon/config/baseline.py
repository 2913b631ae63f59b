"""The passive baseline of a leg as a file: written by `gaitd baseline`, read by the service.

It is valid only with the robot file that it was recorded with: its numbers are errors of that
file's parameters. So it holds that file's hash, and is refused with any other.
"""

from pathlib import Path
from typing import Annotated, Final

import numpy as np
from gaitd_toml import SMALLEST, ConfigError, load_toml
from msgspec import Meta
from numpy.typing import NDArray

from daemon.config.settings import Table
from observer.baseline import THETA_MAX, Baseline

Errors = Annotated[
    tuple[Annotated[float, Meta(ge=-THETA_MAX, le=THETA_MAX)], ...], Meta(min_length=1)
]
Row = Annotated[tuple[Annotated[float, Meta(ge=-100, le=100)], ...], Meta(min_length=1)]
Kept = Annotated[float, Meta(ge=1e-3, le=1000)]

HEAD: Final = """\
# What a minute with a passive patient says of the robot file: how far each parameter with an
# uncertainty is off, in its standard deviations (theta), and what is left of its uncertainty
# (covariance). Written by `gaitd baseline` from {source}; a leg that names it publishes what the
# patient adds.

"""


class HipKept(Table, frozen=True):
    """What the baseline cannot tell from the patient at the hip."""

    kept_std_nm: Kept


class SlideKept(Table, frozen=True):
    """What the baseline cannot tell from the patient at the slide."""

    kept_std_n: Kept


class BaselineFile(Table, frozen=True):
    """baseline.toml."""

    robot_sha256: Annotated[str, Meta(pattern=r"^[0-9a-f]{64}\Z")]
    """Hash of the robot file that it was recorded with."""
    cadence_hz: Annotated[float, Meta(ge=0.01, le=2)]
    swing_rad: Annotated[float, Meta(ge=0.01, le=6.3)]
    """Swing of the hip, from its lowest to its highest angle."""
    stride_count: Annotated[int, Meta(ge=1, le=1_000_000)]
    hip: HipKept
    slide: SlideKept
    theta: Errors
    """Error of each parameter, in its standard deviations."""
    covariance: tuple[Row, ...]
    """Covariance of these errors, row by row."""


def load_baseline(path: Path, robot_sha256: str, frictional: tuple[bool, ...]) -> Baseline:
    """Read a baseline for a robot, of which `frictional` has an entry for each parameter.

    Raises:
        ConfigError: the file or one of its values is invalid, or it is another robot's.
    """
    file = load_toml(path, BaselineFile)
    if file.robot_sha256 != robot_sha256:
        wanted = f"{robot_sha256}, of the robot file in use; record it again with `gaitd baseline`"
        raise ConfigError(path, "robot_sha256", file.robot_sha256, wanted)
    count = len(frictional)
    if len(file.theta) != count:
        wanted = f"{count} numbers, one for each parameter with an uncertainty in the robot file"
        raise ConfigError(path, "theta", f"{len(file.theta)} numbers", wanted)
    if [len(row) for row in file.covariance] != [count] * count:
        raise ConfigError(path, "covariance", "another shape", f"{count} rows of {count} numbers")
    covariance = np.array(file.covariance)
    if not (covariance == covariance.T).all() or not _has_root(covariance):
        raise ConfigError(path, "covariance", "no covariance", "a symmetric, positive matrix")
    return Baseline(
        np.array(file.theta),
        covariance,
        (file.hip.kept_std_nm, file.slide.kept_std_n),
        frictional,
        file.stride_count,
        file.cadence_hz,
        file.swing_rad,
    )


def _has_root(covariance: NDArray[np.float64]) -> bool:
    """True if the core can take its root."""
    try:
        np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        return False
    return True


def baseline_text(baseline: Baseline, robot_sha256: str, source: str) -> str:
    """The text of the file for a baseline."""
    hip_nm, slide_n = baseline.kept_std
    theta, *rows = (
        [x if abs(x) >= SMALLEST else 0.0 for x in row]
        for row in (baseline.theta.tolist(), *baseline.covariance.tolist())
    )
    covariance = ",\n".join(f"    {row}" for row in rows)
    lines = [
        f'robot_sha256 = "{robot_sha256}"',
        f"cadence_hz = {baseline.cadence_hz:.6g}",
        f"swing_rad = {baseline.swing_rad:.6g}",
        f"stride_count = {baseline.stride_count}",
        f"hip.kept_std_nm = {hip_nm:.6g}",
        f"slide.kept_std_n = {slide_n:.6g}",
        f"theta = {theta}",
        f"covariance = [\n{covariance},\n]",
    ]
    return HEAD.format(source=source) + "\n".join(lines) + "\n"
