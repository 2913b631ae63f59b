"""How the observer's cost grows with recordings and legs in one process, and what it allocates."""

import importlib
import statistics
import time
import tracemalloc
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from numba.core.runtime import nrt

from analysis.replay import setup_for
from daemon.config.robot import friction_parameters, leg_parameters, observer_tuning
from daemon.config.settings import Robot
from observer.filter.leg_memory import MEMORY_SIZE, POINTS_SIZE, SCRATCH_SIZE
from observer.filter.leg_model import STEP_S
from observer.filter.leg_observer import LegObserver, Setup
from observer.offline.batch import BatchEstimates, Columns, run

COUNTS: Final = (1, 2, 4, 8)
ROWS: Final = 2000
"""Of each recording."""
STEPS: Final = 500
"""Of each leg, live."""
REPEATS: Final = 9
COUNTED_STEPS: Final = 1000
DOUBLE_BYTES: Final = 8


class Growth(NamedTuple):
    """Of a number of recordings, or of legs that step in turn; medians over some repeats."""

    together_count: int
    recording_us: float
    """For each row of each recording."""
    recording_ratio: float
    """To one recording; 1 is linear growth."""
    leg_us: float
    """For each step of each leg, from Python."""
    leg_ratio: float
    """To one leg."""


class Memory(NamedTuple):
    """What is allocated while it runs, and what is there for good."""

    compiled_count: int
    """Allocations by the compiled step in 1000 rows of a recording."""
    call_count: int
    """Those in 1000 steps from Python: numba wraps each array that it is handed, and lets it go."""
    kept_count: int
    """Python objects that are there after 1000 steps more and were not before."""
    peak_bytes_count: int
    """Most that Python held at a time beyond its beginning: the estimate that is handed out."""
    leg_bytes_count: int
    """Arrays of one filter."""
    row_bytes_count: int
    """Results of one row of a replay."""


class Scaling(NamedTuple):
    """Both of a run."""

    growth: tuple[Growth, ...]
    memory: Memory


def measure(robot: Robot) -> Scaling:
    """Numbers of recordings and legs take turns, so that a busy machine is busy for all."""
    columns = _recording(ROWS)
    setup = setup_for(robot)
    legs = [_leg(robot) for _ in range(max(COUNTS))]
    contests: dict[tuple[str, int], tuple[Callable[[], object], int]] = {}
    for count in COUNTS:
        contests["recording", count] = (_recordings(setup, columns, count), count * ROWS)
        contests["leg", count] = (_steps(legs[:count], columns, STEPS), count * STEPS)
    found = _race(contests)
    growth = tuple(
        Growth(
            count,
            found["recording", count],
            found["recording", count] / found["recording", 1],
            found["leg", count],
            found["leg", count] / found["leg", 1],
        )
        for count in COUNTS
    )
    return Scaling(growth, memory(legs[0], columns))


def memory(leg: LegObserver, columns: Columns) -> Memory:
    """Counted with the recording's rows, of which there are at least 1000."""
    steps = _steps([leg], columns, COUNTED_STEPS)
    steps()
    made = run(leg.setup, columns)
    tracemalloc.start()
    try:
        before = tracemalloc.take_snapshot()
        tracemalloc.reset_peak()
        held = tracemalloc.get_traced_memory()[0]
        steps()
        peak = tracemalloc.get_traced_memory()[1] - held
        after = tracemalloc.take_snapshot()
    finally:
        tracemalloc.stop()
    return Memory(
        _of_more_rows(leg, columns),
        _compiled_allocations(steps),
        _kept(before, after),
        peak,
        (MEMORY_SIZE + SCRATCH_SIZE + POINTS_SIZE) * DOUBLE_BYTES,
        _row_bytes(made),
    )


def _leg(robot: Robot) -> LegObserver:
    hip, slide = friction_parameters(robot)
    return LegObserver(leg_parameters(robot), hip, slide, observer_tuning(robot))


def _recording(rows: int) -> Columns:
    time_s = np.arange(rows, dtype=np.float64) * STEP_S
    swing = np.sin(2 * np.pi * 0.25 * time_s)
    effort = np.cos(1.5 * time_s)
    return Columns(
        time_s,
        np.column_stack((0.24 + 0.15 * swing, 0.59 + 0.12 * swing)),
        np.column_stack((7.0 * effort, 75.0 * effort)),
    )


def _recordings(setup: Setup, columns: Columns, count: int) -> Callable[[], object]:
    return lambda: [run(setup, columns) for _ in range(count)] and None


def _steps(legs: list[LegObserver], columns: Columns, count: int) -> Callable[[], object]:
    """All legs one step, then the next step, as the core's cycle does."""
    positions, efforts = columns.position[:count], columns.effort[:count]

    def walk() -> None:
        for leg in legs:
            leg.reset(positions[0])
        for position, effort in zip(positions, efforts, strict=True):
            for leg in legs:
                leg.step(position, effort, STEP_S)

    return walk


def _race(
    contests: dict[tuple[str, int], tuple[Callable[[], object], int]],
) -> dict[tuple[str, int], float]:
    """Median us of a step of each, after one round to warm up."""
    times: dict[tuple[str, int], list[float]] = {name: [] for name in contests}
    for number in range(REPEATS + 1):
        for name, (contest, steps) in contests.items():
            begun_s = time.perf_counter()
            contest()
            if number:
                times[name].append((time.perf_counter() - begun_s) / steps * 1e6)
    return {name: statistics.median(values) for name, values in times.items()}


def _compiled_allocations(work: Callable[[], object]) -> int:
    """By numba's own count."""
    # numba has no public switch for it.
    switch: Any = importlib.import_module("numba.core.runtime._nrt_python")
    counter: Any = nrt.rtsys
    switch.memsys_enable_stats()
    try:
        before: int = counter.get_allocation_stats().alloc
        work()
        return counter.get_allocation_stats().alloc - before
    finally:
        switch.memsys_disable_stats()


def _of_more_rows(leg: LegObserver, columns: Columns) -> int:
    """Of 1000 rows more: what a call allocates whatever its length is no matter here."""
    many = Columns(columns.time_s[:1500], columns.position[:1500], columns.effort[:1500])
    few = Columns(columns.time_s[:500], columns.position[:500], columns.effort[:500])
    return _compiled_allocations(lambda: run(leg.setup, many)) - _compiled_allocations(
        lambda: run(leg.setup, few)
    )


def _kept(before: tracemalloc.Snapshot, after: tracemalloc.Snapshot) -> int:
    """Objects of the observer's files; the measurement's own do not count."""
    only = tracemalloc.Filter(inclusive=True, filename_pattern="*/observer/*")
    grown = after.filter_traces([only]).compare_to(before.filter_traces([only]), "filename")
    return sum(row.count_diff for row in grown)


def _row_bytes(made: BatchEstimates) -> int:
    rows = len(made.nis)
    numbers = (made.state, made.std, made.covariance, made.innovation, made.net, made.net_std)
    each = sum(part.shape[1] for part in numbers) + 1 + 1 + made.validity.shape[1]
    return each * DOUBLE_BYTES if rows else 0
