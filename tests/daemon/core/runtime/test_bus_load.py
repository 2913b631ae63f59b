"""The measured load of the bus, against bits counted by hand."""

import pytest

from daemon.core.runtime.bus_load import LoadMeter
from drives.bringup.bus_load import frame_bits, frame_bits_exact
from drives.canopen.bus import Frame

S = 1_000_000_000
ALTERNATING = Frame(0x555, b"\x55" * 8)
ERROR = Frame(0x040, bytes(8), is_error=True)


def test_a_second_of_frames_is_their_bits_over_the_bit_rate():
    meter = LoadMeter(125_000)
    meter.count(7 * S)
    for _ in range(10):
        meter.add([ALTERNATING] * 5)
        meter.count(8 * S - 1)
    assert meter.busy_ratio == 0.0

    meter.count(8 * S)

    bits = frame_bits_exact(ALTERNATING.can_id, ALTERNATING.data)
    assert meter.busy_ratio == pytest.approx(50 * bits / 125_000)
    meter.add([ALTERNATING])
    meter.count(10 * S)
    assert meter.busy_ratio == pytest.approx(bits / 250_000)
    meter.count(11 * S)
    assert meter.busy_ratio == 0.0


def test_error_frames_have_no_length_that_could_be_counted():
    meter = LoadMeter(125_000)
    meter.count(0)
    meter.add([ERROR] * 100)
    meter.count(S)

    assert meter.busy_ratio == 0.0


def test_a_bus_that_babbles_is_counted_at_its_longest_beyond_a_bounded_number():
    meter = LoadMeter(1_000_000)
    meter.count(0)
    meter.add([ALTERNATING] * 500)
    meter.count(S)

    exact = 64 * frame_bits_exact(ALTERNATING.can_id, ALTERNATING.data)
    assert meter.busy_ratio == pytest.approx((exact + (500 - 64) * frame_bits(8)) / 1e6)
