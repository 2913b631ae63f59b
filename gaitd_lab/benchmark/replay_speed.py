"""Replay speed of a recording: computing alone, and from CSV to CSV."""

import tempfile
import time
from pathlib import Path
from typing import Final

import numpy as np

from analysis import estimates
from analysis.recording import COLUMNS
from analysis.replay import estimate, read, warm_up
from daemon.config.settings import Robot
from gaitd_lab.benchmark.figures import Figure
from gaitd_lab.benchmark.step_times import recording

DURATION_S: Final = 600.0
RATE_HZ: Final = 100


COMPUTING_MIN: Final = 400.0
WITH_CSV_MIN: Final = 250.0


def measure(robot: Robot) -> list[Figure]:
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
    duration_s, rows = source.recording.duration_s, len(source.recording.time_s)
    computing_s, whole_s = computed_s - read_s, written_s - begun_s
    return [
        Figure(
            what="replay, computing alone",
            value=duration_s / computing_s,
            unit="times real time",
            at_least=COMPUTING_MIN,
        ),
        Figure(
            what="replay, from CSV to CSV",
            value=duration_s / whole_s,
            unit="times real time",
            at_least=WITH_CSV_MIN,
        ),
        Figure(what="replay, a row", value=computing_s / rows * 1e6, unit="µs"),
    ]


def _write_recording(path: Path) -> None:
    columns = recording(round(DURATION_S * RATE_HZ))
    rows = np.column_stack((columns.time_s, columns.position, columns.effort))
    np.savetxt(path, rows, "%.7f", ",", header=",".join(COLUMNS), comments="")
