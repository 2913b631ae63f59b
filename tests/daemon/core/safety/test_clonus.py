"""Clonus: which swings of an effort are one, how long it counts, and when it is over."""

import math

import pytest

from daemon.core.safety.clonus import ClonusWatch

SWING = 5.0
HALF_WAVES_MIN = 5
PERIOD_MS = 10
WINDOW_MS = 2000


def wave(hertz, amplitude, seconds):
    cycles = round(seconds * 1000 / PERIOD_MS)
    return [
        amplitude * math.sin(2.0 * math.pi * hertz * k * PERIOD_MS * 1e-3) for k in range(cycles)
    ]


def after(efforts, watch=None, max_si=SWING):
    """The watch after these efforts, one a cycle."""
    watch = ClonusWatch(PERIOD_MS, WINDOW_MS) if watch is None else watch
    for effort in efforts:
        watch.update(effort, max_si)
    return watch


@pytest.mark.parametrize("hertz", [5.0, 6.25, 8.0])
def test_an_effort_that_swings_with_the_frequency_of_clonus_is_one_above_its_threshold(hertz):
    gain = math.sin(math.pi * hertz * 0.08) ** 2

    assert after(wave(hertz, 1.1 * SWING / gain, 1.0)).lasts
    assert not after(wave(hertz, 0.99 * SWING / gain, 1.0)).lasts


def test_how_large_an_effort_is_in_its_unit_makes_no_difference():
    efforts = wave(6.25, 10.0, 1.0)
    small = after([1e-3 * effort for effort in efforts], max_si=1e-3 * SWING)
    slow = after([1e-3 * effort for effort in wave(3.0, 40.0, 3.0)], max_si=1e-3 * SWING)

    assert small.cycles == after(efforts).cycles
    assert small.swing_si == pytest.approx(0.01, rel=0.05)
    assert slow.cycles == 0


@pytest.mark.parametrize(("hertz", "amplitude"), [(0.5, 100.0), (1.0, 60.0), (2.0, 20.0)])
def test_a_voluntary_effort_is_none(hertz, amplitude):
    assert after(wave(hertz, amplitude, 4.0)).cycles == 0


@pytest.mark.parametrize("hertz", [3.0, 4.5])
def test_a_slow_swing_however_large_alternates_too_slowly(hertz):
    """Each of its half-waves is above the threshold, and begins 110 ms or more after the last."""
    watch = after(wave(hertz, 40.0, 3.0))

    assert watch.cycles == 0
    assert watch.swing_si > 3.0 * SWING


def test_a_swing_needs_all_of_its_160_ms_and_more_than_its_threshold():
    assert after([0.0] * 8 + [40.0] * 8).swing_si == 0.0
    assert after([0.0] * 16 + [4.0 * SWING]).swing_si == 0.0
    assert after([0.0] * 16 + [4.04 * SWING]).swing_si == pytest.approx(1.01 * SWING)
    swing = [8.0, *([0.0] * 7), 2.0, *([0.0] * 7), -40.0]
    for efforts in (swing, [*([0.0] * 40), *swing]):
        assert after(efforts, max_si=8.9).swing_si == pytest.approx(9.0)


def test_a_steady_effort_and_a_step_are_none():
    assert after([0.0] * 30 + [40.0] * 30 + [-40.0] * 30).cycles == 0


def test_it_is_detected_with_its_last_half_wave_that_it_needs_and_its_time_counts_from_the_first():
    watch = ClonusWatch(PERIOD_MS, WINDOW_MS)
    counted = []
    for effort in wave(6.25, 10.0, 1.0):
        watch.update(effort, SWING)
        counted.append(watch.cycles)
        assert watch.lasts == (watch.cycles > 0)

    first = next(k for k, cycles in enumerate(counted) if cycles)
    half_cycles = 8
    assert counted[first] == 1 + (HALF_WAVES_MIN - 1) * half_cycles
    assert counted[first:] == list(range(counted[first], counted[first] + len(counted) - first))


def test_fewer_alternating_swings_are_none():
    half_s = 0.08
    bursts = [wave(6.25, 10.0, n * half_s) + [0.0] * 30 for n in range(1, 8)]
    watches = [after([0.0] * 20 + burst) for burst in bursts]
    found = [watch.cycles > 0 for watch in watches]

    assert found == [n >= HALF_WAVES_MIN for n in range(1, 8)]


@pytest.mark.parametrize("efforts", [[0.0] * 30, [3.0] * 30])
def test_it_is_over_when_no_swing_follows_within_half_a_period(efforts):
    watch = after(wave(6.25, 10.0, 1.0))
    assert watch.lasts

    after(efforts, watch)

    assert not watch.lasts
    assert watch.swing_si == pytest.approx(10.0, rel=0.05)


def test_bursts_count_in_sum_and_their_time_is_forgotten_after_the_window():
    burst = [0.0] * 30 + wave(6.25, 10.0, 0.64)
    once = after([*burst, *([0.0] * 30)]).cycles
    twice = after([*burst, *burst, *([0.0] * 30)])

    assert 60 <= once <= 90
    assert twice.cycles == 2 * once
    assert after([0.0] * 200, twice).cycles == 0


def test_it_begins_once_in_the_window():
    watch = ClonusWatch(PERIOD_MS, WINDOW_MS)
    burst = [0.0] * 30 + wave(6.25, 10.0, 0.64)
    begins = []
    for effort in [*burst, *burst, *([0.0] * 250), *burst]:
        watch.update(effort, SWING)
        begins.append(watch.begins)

    first, second = (k for k, begun in enumerate(begins) if begun)
    assert second - first == 2 * len(burst) + 250


def test_an_estimate_that_cannot_be_used_ends_it_and_its_time_goes_on():
    watch = after(wave(6.25, 10.0, 1.0))
    before = watch.cycles

    watch.update(None, SWING)

    assert (watch.lasts, watch.cycles) == (False, before)
    after([None] * 200, watch)
    assert watch.cycles == 0


def test_swings_before_and_after_an_estimate_that_cannot_be_used_do_not_add_up():
    half = wave(6.25, 10.0, 0.24)

    assert after([*half, None, *half]).cycles == 0
    assert after([40.0] * 17 + [None] + [0.0] * 10).swing_si == 0.0


def test_after_a_reset_there_is_nothing():
    efforts = wave(6.25, 10.0, 1.0)
    alone = after(efforts)
    watch = ClonusWatch(PERIOD_MS, WINDOW_MS)
    for effort in efforts:
        watch.update(effort, SWING)
        if watch.begins:
            break

    watch.reset()

    assert (watch.lasts, watch.cycles, watch.swing_si, watch.begins) == (False, 0, 0.0, False)
    assert after(efforts, watch).cycles == alone.cycles
