"""Replay is the live observer, bit for bit."""

import dataclasses

import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys

from observer.filter.leg_observer import LegObserver
from observer.filter.states import STATE_COUNT
from observer.filter.status import Status, Validity
from observer.offline import batch
from tests.observer.trainer import HIP, PATIENT, SLIDE_FRICTION, TUNING, encoded, gait, simulate

OBSERVER = LegObserver(PATIENT, HIP, SLIDE_FRICTION, TUNING)


def difficult_recording():
    """A walk with lost samples, a glitch, numbers that are none, late and repeated rows, a gap."""
    cycles = 900
    path = gait(PATIENT, np.maximum(np.arange(1, cycles + 1) * 0.01 - 0.5, 0.0), 0.25)
    columns = encoded(simulate(PATIENT, cycles, reference=path, start=path[0]))
    position, effort = columns.position.copy(), columns.effort.copy()
    time_s, bits = columns.time_s.copy(), np.zeros(cycles, dtype=np.int64)
    position[100:104] = np.nan
    position[150:170, 0] = np.nan
    position[200, 1] += 0.05
    position[300:310, 0] += 0.1
    effort[350, 1] = np.inf
    time_s[400] = time_s[399]
    time_s[450] = time_s[449] - 0.05
    position[500:580] = np.nan
    time_s[700:] += 3.0
    bits[720:730] = Status.ARTIFICIAL.value
    position[:3, 0] = np.nan
    return batch.Columns(time_s, position, effort, bits)


def live(columns):
    observer = LegObserver(PATIENT, HIP, SLIDE_FRICTION, TUNING)
    before = columns.time_s[0] - 0.01
    for row, now in enumerate(columns.time_s):
        dt_s = 0.01 if row == 0 else round((now - before) * 1e9) * 1e-9
        artificial = bool(columns.caller_bits[row])
        yield observer.step(columns.position[row], columns.effort[row], dt_s, artificial=artificial)
        before = now


def test_replay_gives_the_bits_of_live_operation_through_all_kinds_of_trouble():
    columns = difficult_recording()
    replayed = batch.run(OBSERVER.setup, columns)

    seen = Status(0)
    for row, estimate in enumerate(live(columns)):
        seen |= estimate.status
        for name in ("state", "std", "covariance", "innovation", "nis", "net", "net_std"):
            np.testing.assert_array_equal(getattr(replayed, name)[row], getattr(estimate, name))
        assert replayed.status[row] == estimate.status.value
        assert tuple(replayed.validity[row]) == estimate.validity
    for bit in (Status.VALID, Status.GATED, Status.LATE, Status.PREDICT_ONLY, Status.INCONSISTENT):
        assert bit in seen


def test_the_same_recording_gives_the_same_bits_again():
    columns = difficult_recording()
    first, second = batch.run(OBSERVER.setup, columns), batch.run(OBSERVER.setup, columns)

    for field in dataclasses.fields(batch.BatchEstimates):
        np.testing.assert_array_equal(getattr(first, field.name), getattr(second, field.name))


def test_before_the_first_complete_pose_there_is_nothing_and_it_is_bad():
    replayed = batch.run(OBSERVER.setup, difficult_recording())

    assert np.all(np.isnan(replayed.state[:3]))
    assert np.all(replayed.validity[:3] == Validity.BAD)
    assert np.all(np.isfinite(replayed.state[3:]))


def test_an_empty_recording_gives_empty_estimates():
    nothing = np.zeros((0, 2))
    replayed = batch.run(OBSERVER.setup, batch.Columns(np.zeros(0), nothing, nothing))

    assert replayed.state.shape == (0, STATE_COUNT)
    assert replayed.covariance.shape == (0, 36)


@pytest.mark.parametrize("name", ["position", "effort", "caller_bits"])
def test_columns_of_different_lengths_are_refused_by_name(name):
    columns = difficult_recording()
    short = dataclasses.replace(columns, **{name: getattr(columns, name)[:-1]})

    with pytest.raises(ValueError, match=name):
        batch.run(OBSERVER.setup, short)


def test_no_row_allocates_memory():
    def allocations(rows):
        columns = difficult_recording()
        cut = batch.Columns(columns.time_s[:rows], columns.position[:rows], columns.effort[:rows])
        before = rtsys.get_allocation_stats().alloc
        batch.run(OBSERVER.setup, cut)
        return rtsys.get_allocation_stats().alloc - before

    _nrt_python.memsys_enable_stats()
    few, many = allocations(10), allocations(900)
    _nrt_python.memsys_disable_stats()

    assert few == many
