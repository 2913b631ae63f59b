"""A missed grid point is put down to the part of the cycle that took longest beyond what it may."""

import pytest
from gaitd_names import CyclePart

from daemon.core.runtime.grid import Grid, count_missed, longest_part
from daemon.ipc.cycle_timing import CycleTiming

WINDOW_NS = 4_000_000


@pytest.mark.parametrize(
    ("timing", "part"),
    [
        (CycleTiming(9_000_000, 4_000_000, 400_000, 0), CyclePart.WAKE_UP),
        (CycleTiming(100_000, 12_000_000, 400_000, 0), CyclePart.WINDOW),
        (CycleTiming(100_000, 4_100_000, 8_000_000, 0), CyclePart.WORK),
        (CycleTiming(100_000, 4_100_000, 400_000, 0), CyclePart.WORK),
        (CycleTiming(100_000, 4_200_000, 400_000, 0), CyclePart.WORK),
        (CycleTiming(100_000, 4_100_000, 400_000, 0, publish_ns=20_000_000), CyclePart.PUBLISH),
    ],
)
def test_the_part_that_took_longest_is_named_and_a_whole_window_is_what_it_may_take(timing, part):
    assert longest_part(timing, WINDOW_NS) is part


def test_missed_grid_points_are_counted_by_their_part():
    timing = CycleTiming(0, 0, 0, 0)
    for part, missed in ((CyclePart.WORK, 3), (CyclePart.WINDOW, 1), (CyclePart.WORK, 1)):
        timing = count_missed(timing, missed, part)

    assert (timing.overrun_count, timing.overrun_by_part) == (
        5,
        {CyclePart.WORK: 4, CyclePart.WINDOW: 1},
    )


MS = 1_000_000


class Clock:
    now = 5 * MS

    def now_ns(self):
        return self.now


@pytest.fixture
def grid():
    return Grid(Clock(), 10 * MS)


@pytest.mark.parametrize(
    ("late_ns", "missed"),
    [(-MS, 0), (3 * MS, 0), (3 * MS + 1, 1), (10 * MS - 1, 1), (15 * MS, 2), (25 * MS, 3)],
)
def test_a_grid_point_is_missed_when_its_sync_would_come_close_to_the_next(grid, late_ns, missed):
    assert (grid.due_ns, grid.end_ns, grid.cycle) == (15 * MS, 25 * MS, 0)
    grid._clock.now = 15 * MS + late_ns

    assert grid.next_cycle == missed
    assert grid.skip_missed() == missed
    assert (grid.due_ns, grid.cycle, grid.missed_in_a_row) == (
        (15 + 10 * missed) * MS,
        missed,
        missed,
    )


def test_missed_points_add_up_until_one_is_met(grid):
    found = []
    for now_ms in (29, 39, 59, 60):
        grid._clock.now = now_ms * MS
        found.append((grid.advance(), grid.missed_in_a_row, grid.cycle, grid.due_ns // MS))

    assert found == [(1, 1, 2, 35), (0, 0, 3, 45), (1, 1, 5, 65), (0, 0, 6, 75)]
    grid._clock.now = 88 * MS
    assert grid.next_cycle == 8


@pytest.mark.parametrize(("late_ms", "points"), [(-4, 1), (0, 1), (9, 1), (10, 2), (31, 4)])
def test_a_jump_leads_to_the_next_point_from_now_and_misses_none(grid, late_ms, points):
    grid._clock.now = (15 + late_ms) * MS

    grid.jump()

    assert (grid.cycle, grid.due_ns) == (points, (15 + 10 * points) * MS)
    assert grid.missed_in_a_row == 0
