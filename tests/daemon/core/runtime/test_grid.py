"""A missed grid point is put down to the part of the cycle that took longest beyond what it may."""

import pytest
from gaitd_names import CyclePart

from daemon.core.runtime.grid import count_missed, longest_part
from daemon.ipc.cycle_timing import CycleTiming

WINDOW_NS = 4_000_000


@pytest.mark.parametrize(
    ("timing", "part"),
    [
        (CycleTiming(9_000_000, 4_000_000, 400_000, 0), CyclePart.WAKE_UP),
        (CycleTiming(100_000, 12_000_000, 400_000, 0), CyclePart.WINDOW),
        (CycleTiming(100_000, 4_100_000, 8_000_000, 0), CyclePart.WORK),
        (CycleTiming(100_000, 4_100_000, 400_000, 0, publish_ns=20_000_000), CyclePart.PUBLISH),
    ],
)
def test_the_part_that_took_longest_is_named_and_a_whole_window_is_what_it_may_take(timing, part):
    assert longest_part(timing, WINDOW_NS) is part


def test_missed_grid_points_are_counted_by_their_part():
    timing = CycleTiming(0, 0, 0, 0)
    for part, missed in ((CyclePart.WORK, 2), (CyclePart.WINDOW, 1), (CyclePart.WORK, 1)):
        timing = count_missed(timing, missed, part)

    assert (timing.overrun_count, timing.overrun_by_part) == (
        4,
        {CyclePart.WORK: 3, CyclePart.WINDOW: 1},
    )
