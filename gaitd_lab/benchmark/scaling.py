"""Growth of the observer's cost with recordings and legs in one process, and its allocations."""

import importlib
import tracemalloc
from collections.abc import Callable
from functools import partial
from typing import Any, Final, NamedTuple

from numba.core.runtime import nrt

from analysis.replay import setup_for
from daemon.config.robot import friction_parameters, leg_parameters, observer_tuning
from daemon.config.settings import Robot
from gaitd_lab.benchmark.step_times import Work, recording, step_times_us, walk
from observer.filter.leg_observer import LegObserver, Setup
from observer.offline.batch import BatchEstimates, Columns, run

COUNTS: Final = (1, 2, 4, 8)
ROWS: Final = 2000
"""Rows of each recording."""
STEPS: Final = 500
"""Steps of each leg, live."""
COUNTED_STEPS: Final = 1000
FEW_ROWS: Final = 500
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
    columns = recording(ROWS)
    setup = setup_for(robot)
    legs = [_leg(robot) for _ in range(max(COUNTS))]
    works: dict[tuple[str, int], Work] = {}
    some = _rows(columns, STEPS)
    for count in COUNTS:
        works["recording", count] = (_recordings(setup, columns, count), count * ROWS)
        works["leg", count] = (partial(walk, legs[:count], some), count * STEPS)
    result = step_times_us(works)
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
    steps = partial(walk, [leg], _rows(columns, COUNTED_STEPS))
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


def _recordings(setup: Setup, columns: Columns, count: int) -> Callable[[], object]:
    return lambda: [run(setup, columns) for _ in range(count)] and None


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
    many, few = (
        _compiled_allocations(partial(run, leg.setup, _rows(columns, count)))
        for count in (FEW_ROWS + COUNTED_STEPS, FEW_ROWS)
    )
    return many - few


def _rows(columns: Columns, count: int) -> Columns:
    return Columns(columns.time_s[:count], columns.position[:count], columns.effort[:count])


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
