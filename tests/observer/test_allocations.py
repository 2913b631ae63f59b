"""The observer's step allocates nothing, and Python keeps nothing of it."""

import importlib
import tracemalloc
from functools import partial

import numpy as np
import pytest
from numba import njit
from numba.core.runtime import nrt

from gaitd_lab.benchmark.step_times import recording, walk
from observer.filter.considered import Drives, Variant
from observer.filter.leg_observer import LegObserver
from observer.offline.batch import Columns, run
from observer.offline.smooth_batch import run_smoothed
from tests.observer.trainer import HIP, PATIENT, SLIDE_FRICTION, TUNING

STEPS = 1000
FEW_ROWS = 500


def compiled_allocations(work):
    """Allocations by numba's own count, for which it has no public switch."""
    switch = importlib.import_module("numba.core.runtime._nrt_python")
    switch.memsys_enable_stats()
    try:
        before = nrt.rtsys.get_allocation_stats().alloc
        work()
        return nrt.rtsys.get_allocation_stats().alloc - before
    finally:
        switch.memsys_disable_stats()


def rows(count):
    columns = recording(FEW_ROWS + STEPS)
    return Columns(columns.time_s[:count], columns.position[:count], columns.effort[:count])


@pytest.mark.parametrize("estimates_of", [run, run_smoothed])
def test_the_compiled_step_allocates_nothing(estimates_of):
    other = Variant(PATIENT, HIP, SLIDE_FRICTION, Drives(effort_ratio_hip=1.05))
    rougher = Variant(PATIENT, HIP, SLIDE_FRICTION._replace(viscous=70.0))
    leg = LegObserver(PATIENT, HIP, SLIDE_FRICTION, TUNING, [other, rougher])
    estimates_of(leg.setup, rows(FEW_ROWS))

    many, few = (
        compiled_allocations(partial(estimates_of, leg.setup, rows(count)))
        for count in (FEW_ROWS + STEPS, FEW_ROWS)
    )

    assert many == few


def test_python_keeps_nothing_of_a_step():
    leg = LegObserver(PATIENT, HIP, SLIDE_FRICTION, TUNING)
    steps = partial(walk, [leg], rows(STEPS))
    steps()
    only = tracemalloc.Filter(inclusive=True, filename_pattern="*/observer/*")

    tracemalloc.start()
    try:
        before = tracemalloc.take_snapshot()
        steps()
        after = tracemalloc.take_snapshot()
    finally:
        tracemalloc.stop()

    grown = after.filter_traces([only]).compare_to(before.filter_traces([only]), "filename")
    assert sum(row.count_diff for row in grown) == 0


def test_allocations_that_there_are_would_be_counted():
    @njit
    def allocate() -> int:
        return np.zeros(3).size

    allocate()

    assert compiled_allocations(lambda: [allocate() for _ in range(7)]) == 7
