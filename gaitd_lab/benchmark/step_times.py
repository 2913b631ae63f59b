"""Shared by the benchmarks of the observer: a recording, legs that step through it, and the times.

`gaitd_lab/peers` uses it, too.
"""

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Final, TypeVar

import numpy as np

from observer.filter.leg_model import STEP_S
from observer.filter.leg_observer import LegObserver
from observer.offline.batch import Columns

Name = TypeVar("Name")
Work = tuple[Callable[[], object], int]
"""Work to time, and the number of steps in it."""

REPEATS: Final = 9


def step_times_us(works: Mapping[Name, Work]) -> dict[Name, float]:
    """Median time of a step of each work, after one round to warm up.

    The works take turns, so that other load affects all alike.
    """
    times_us: dict[Name, list[float]] = {name: [] for name in works}
    for number in range(REPEATS + 1):
        for name, (work, steps) in works.items():
            begun_s = time.perf_counter()
            work()
            if number:
                times_us[name].append((time.perf_counter() - begun_s) / steps * 1e6)
    return {name: statistics.median(values) for name, values in times_us.items()}


def recording(rows: int) -> Columns:
    """A leg that swings slowly about mid pose, and efforts of about that motion."""
    time_s = np.arange(rows, dtype=np.float64) * STEP_S
    swing = np.sin(2 * np.pi * 0.25 * time_s)
    effort = np.cos(1.5 * time_s)
    return Columns(
        time_s,
        np.column_stack((0.24 + 0.15 * swing, 0.59 + 0.12 * swing)),
        np.column_stack((7.0 * effort, 75.0 * effort)),
    )


def walk(legs: Sequence[LegObserver], columns: Columns) -> None:
    """Start all legs, then step all of them row by row, as the core's cycle does."""
    for leg in legs:
        leg.reset(columns.position[0])
    for position, effort in zip(columns.position, columns.effort, strict=True):
        for leg in legs:
            leg.step(position, effort, STEP_S)
