import pytest
from drive_files import CYCLE, drive

from drives.busload import bus_load, frame_bits, objection

DRIVES = (drive("hip_epos4"), drive("slide_epos4"))
CRC_POLYNOMIAL = 0x4599


def bits_on_the_wire(can_id, data):
    """Exact length of a classic frame, bit by bit (ISO 11898-1), with its intermission."""
    bits = [0] + [can_id >> n & 1 for n in range(10, -1, -1)] + [0, 0, 0]
    bits += [len(data) >> n & 1 for n in range(3, -1, -1)]
    bits += [byte >> n & 1 for byte in data for n in range(7, -1, -1)]
    crc = 0
    for bit in bits:
        crc = (crc << 1 ^ (CRC_POLYNOMIAL if bit ^ crc >> 14 else 0)) & 0x7FFF
    bits += [crc >> n & 1 for n in range(14, -1, -1)]
    stuffed, run, last = 0, 0, None
    for bit in bits:
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5:
            stuffed, run, last = stuffed + 1, 1, 1 - bit
    return len(bits) + stuffed + 13


@pytest.mark.parametrize(("data_bytes", "bits"), [(0, 55), (1, 65), (8, 135)])
def test_the_longest_frame_is_the_literature_s(data_bytes, bits):
    assert frame_bits(data_bytes) == bits


@pytest.mark.parametrize("data", [b"", bytes(8), b"\xff" * 8, b"\x55" * 8, b"\x0f\x83" * 4, b"\0"])
@pytest.mark.parametrize("can_id", [0x000, 0x080, 0x185, 0x7FF])
def test_no_frame_is_longer_than_the_bound(can_id, data):
    assert bits_on_the_wire(can_id, data) <= frame_bits(len(data))


def test_two_drives_at_one_megabit_take_about_a_tenth_of_the_bus():
    load = bus_load(DRIVES, CYCLE, master_heartbeat_ms=20, bitrate_bit_per_s=1_000_000)

    assert 0.09 < load.busy_ratio < 0.13
    assert load.burst_s < 1.3e-3
    assert objection(load, 0.4, CYCLE.period_ms) is None


def test_a_slow_bus_is_refused_before_anything_is_sent():
    load = bus_load(DRIVES, CYCLE, master_heartbeat_ms=20, bitrate_bit_per_s=250_000)

    words = objection(load, 0.4, CYCLE.period_ms)

    assert words is not None
    assert "43.7%" in words
    assert "40%" in words


def test_a_burst_that_fills_half_the_cycle_is_refused():
    load = bus_load(DRIVES, CYCLE, master_heartbeat_ms=20, bitrate_bit_per_s=125_000)

    words = objection(load, 1.0, CYCLE.period_ms)

    assert words is not None
    assert "9.3" in words


def test_the_load_is_the_sum_of_its_streams():
    load = bus_load(DRIVES, CYCLE, master_heartbeat_ms=20, bitrate_bit_per_s=500_000)

    used = sum(frame_bits(s.data_bytes) * s.rate_hz for s in load.streams)

    assert load.busy_ratio == pytest.approx(used / 500_000)
    assert len(load.streams) == 2 + 2 * 6
