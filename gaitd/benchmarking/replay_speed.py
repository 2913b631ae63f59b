"""How much faster than time the observer goes over a recording: computing alone, and with CSV."""

import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from analysis.estimates import write_csv
from analysis.replay import estimate, read, warm_up
from daemon.config.settings import Robot
from daemon.config.strict import load_toml

PERIOD_S = 0.01


class Speed(NamedTuple):
    """As multiples of real time."""

    recorded_s: float
    computing_ratio: float
    with_csv_ratio: float


def measure(configs: Path, recorded_s: float) -> Speed:
    """Make a recording of a leg that swings, and go over it twice."""
    robot = load_toml(configs / "robot.toml", Robot)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recording.csv"
        _write_recording(path, round(recorded_s / PERIOD_S))
        warm_up(robot)
        source = read(path)
        started_s = time.perf_counter()
        estimate(source, robot)
        computing_s = time.perf_counter() - started_s
        started_s = time.perf_counter()
        again = read(path)
        estimates = estimate(again, robot)
        write_csv(again.recording.time_s, estimates, Path(folder) / "estimates.csv")
        whole_s = time.perf_counter() - started_s
    return Speed(recorded_s, recorded_s / computing_s, recorded_s / whole_s)


def _write_recording(path: Path, rows: int) -> None:
    """A leg that swings slowly about mid pose, and efforts that roughly go with it."""
    time_s = np.arange(rows) * PERIOD_S
    swing = np.sin(2 * np.pi * 0.25 * time_s)
    columns = {
        "time_s": time_s,
        "hip_angle_rad": 0.24 + 0.15 * swing,
        "slide_position_m": 0.59 + 0.12 * swing,
        "hip_torque_nm": 7.0 * np.cos(1.5 * time_s),
        "slide_force_n": 75.0 * np.cos(1.5 * time_s),
    }
    table = np.column_stack(tuple(columns.values()))
    np.savetxt(path, table, fmt="%.9g", delimiter=",", header=",".join(columns), comments="")
