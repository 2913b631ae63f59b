"""Replay speed of a recording: computing alone, and from CSV to CSV."""

import tempfile
import time
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from analysis import estimates, recording
from analysis.replay import estimate, read, warm_up
from daemon.config.settings import Robot

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
    time_s = np.arange(round(DURATION_S * RATE_HZ)) / RATE_HZ
    swing = 2 * np.pi * 0.25 * time_s
    columns = (
        time_s,
        0.24 + 0.15 * np.sin(swing),
        0.59 + 0.12 * np.sin(swing),
        7.0 * np.cos(swing),
        75.0 * np.cos(swing),
    )
    header = ",".join(recording.COLUMNS)
    np.savetxt(path, np.column_stack(columns), "%.7f", ",", header=header, comments="")
