"""Replay speed of a recording: computing alone, and from CSV to CSV."""

import tempfile
import time
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from analysis import estimates
from analysis.recording import COLUMNS
from analysis.replay import estimate, read, warm_up
from daemon.config.settings import Robot
from gaitd_lab.benchmark.step_times import recording

DURATION_S: Final = 600.0
RATE_HZ: Final = 100


class ReplaySpeed(NamedTuple):
    """Speeds in seconds of recording per second of work."""

    row_count: int
    computing_ratio: float
    with_csv_ratio: float
    reading_us: float
    """Time per row, like the next two."""
    computing_us: float
    writing_us: float


def measure(robot: Robot) -> ReplaySpeed:
    """Replay ten minutes of a leg that swings."""
    warm_up(robot)
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder) / "in.csv", Path(folder) / "out.csv"
        _write_recording(path)
        begun_s = time.perf_counter()
        source = read(path)
        read_s = time.perf_counter()
        made = estimate(source, robot)
        computed_s = time.perf_counter()
        estimates.write_csv(source.recording.time_s, made, out)
        written_s = time.perf_counter()
    rows = len(source.recording.time_s)
    per_row = 1e6 / rows
    return ReplaySpeed(
        rows,
        source.recording.duration_s / (computed_s - read_s),
        source.recording.duration_s / (written_s - begun_s),
        (read_s - begun_s) * per_row,
        (computed_s - read_s) * per_row,
        (written_s - computed_s) * per_row,
    )


def _write_recording(path: Path) -> None:
    columns = recording(round(DURATION_S * RATE_HZ))
    rows = np.column_stack((columns.time_s, columns.position, columns.effort))
    np.savetxt(path, rows, "%.7f", ",", header=",".join(COLUMNS), comments="")
