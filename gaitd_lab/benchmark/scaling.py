"""Growth of the observer's cost with recordings and legs in one process, and its allocations."""

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
from observer.filter.leg_model import STEP_S
from observer.filter.leg_observer import LegObserver, Setup
from observer.offline.batch import BatchEstimates, Columns, run

COUNTS: Final = (1, 2, 4, 8)
ROWS: Final = 2000
"""Rows of each recording."""
STEPS: Final = 500
"""Steps of each leg, live."""
REPEATS: Final = 9
COUNTED_STEPS: Final = 1000
DOUBLE_BYTES: Final = 8


class Growth(NamedTuple):
    """Medians over some repeats for a number of recordings, or of legs that step in turn."""

    together_count: int
    recording_us: float
    """Time per row of each recording."""
    recording_ratio: float
    """Ratio to one recording; 1 is linear growth."""
    leg_us: float
    """Time per step of each leg, from Python."""
    leg_ratio: float
    """Ratio to one leg."""


class Memory(NamedTuple):
    """Allocations during operation, and permanent memory."""

    compiled_count: int
    """Allocations by the compiled step in 1000 rows of a recording."""
    call_count: int
    """Allocations in 1000 steps from Python: numba wraps each array argument, then frees it."""
    kept_count: int
    """Python objects left over by 1000 further steps."""
    peak_bytes_count: int
    """Peak of Python memory above its initial value: the returned estimate."""
    leg_bytes_count: int
    """Size of one filter's arrays."""
    row_bytes_count: int
    """Size of the results of one row of a replay."""


class Scaling(NamedTuple):
    """Growth and memory of one run."""

    growth: tuple[Growth, ...]
    memory: Memory


def measure(robot: Robot) -> Scaling:
    """Measure all numbers of recordings and legs in turn, so that other load affects all alike."""
    columns = _recording(ROWS)
    setup = setup_for(robot)
    legs = [_leg(robot) for _ in range(max(COUNTS))]
    contests: dict[tuple[str, int], tuple[Callable[[], object], int]] = {}
    for count in COUNTS:
        contests["recording", count] = (_recordings(setup, columns, count), count * ROWS)
        contests["leg", count] = (_steps(legs[:count], columns, STEPS), count * STEPS)
    result = _race(contests)
    growth = tuple(
        Growth(
            count,
            result["recording", count],
            result["recording", count] / result["recording", 1],
            result["leg", count],
            result["leg", count] / result["leg", 1],
        )
        for count in COUNTS
    )
    return Scaling(growth, memory(legs[0], columns))


def memory(leg: LegObserver, columns: Columns) -> Memory:
    """Measure with the recording's rows, of which there are at least 1000."""
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
        sum(buffer.nbytes for buffer in leg.buffers),
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
    """Step all legs once, then again, as the core's cycle does."""
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
    """Return the allocations by numba's own count."""
    # numba has no public switch for this count.
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
    """Return the allocations of 1000 more rows, without those of each call."""
    many = Columns(columns.time_s[:1500], columns.position[:1500], columns.effort[:1500])
    few = Columns(columns.time_s[:500], columns.position[:500], columns.effort[:500])
    return _compiled_allocations(lambda: run(leg.setup, many)) - _compiled_allocations(
        lambda: run(leg.setup, few)
    )


def _kept(before: tracemalloc.Snapshot, after: tracemalloc.Snapshot) -> int:
    """Return the live objects of the observer's files; the measurement's own do not count."""
    only = tracemalloc.Filter(inclusive=True, filename_pattern="*/observer/*")
    grown = after.filter_traces([only]).compare_to(before.filter_traces([only]), "filename")
    return sum(row.count_diff for row in grown)


def _row_bytes(made: BatchEstimates) -> int:
    rows = len(made.nis)
    numbers = (made.state, made.std, made.covariance, made.innovation, made.net, made.net_std)
    each = sum(part.shape[1] for part in numbers) + 1 + 1 + made.validity.shape[1]
    return each * DOUBLE_BYTES if rows else 0
