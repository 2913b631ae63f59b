import pytest
from drive_files import CYCLE, drive
from hypothesis import given
from hypothesis import strategies as st

from drives.bringup import bus_load as bus_load_module
from drives.bringup.bus_load import bus_load, frame_bits, frame_bits_exact

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


@pytest.mark.parametrize(
    ("frame", "bits"),
    [
        ("000#8105", 68),
        ("080#", 51),
        ("123#", 48),
        ("705#05", 59),
        ("305#85FF", 67),
        ("185#3716123456000A", 105),
        ("205#0F000A00000000", 112),
        ("605#2340600000000000", 123),
        ("000#0000000000000000", 127),
        ("7FF#FFFFFFFFFFFFFFFF", 126),
        ("555#5555555555555555", 112),
        ("07C#0F83E0F83E0F83E0", 128),
        ("078#3C3C3C3C3C3C3C3C", 131),
    ],
)
def test_a_frame_is_as_long_as_can_utils_says(frame, bits):
    # The numbers are of canframelen.c, mode exact, of linux-can/can-utils at 95aae6b.
    can_id, _, data = frame.partition("#")

    assert frame_bits_exact(int(can_id, 16), bytes.fromhex(data)) == bits


any_id = st.integers(0, 0x7FF)
any_data = st.binary(max_size=8) | st.lists(
    st.sampled_from((0x00, 0xFF, 0x0F, 0xF8, 0x83, 0x3E)), max_size=8
).map(bytes)


@given(any_id, any_data)
def test_a_frame_is_as_long_as_its_bits_one_by_one(can_id, data):
    assert frame_bits_exact(can_id, data) == bits_on_the_wire(can_id, data)


@given(any_id, any_data)
def test_no_frame_is_longer_than_the_bound(can_id, data):
    assert frame_bits_exact(can_id, data) <= frame_bits(len(data))


@given(any_id, any_data)
def test_no_frame_is_shorter_than_without_stuffing(can_id, data):
    assert frame_bits_exact(can_id, data) >= 47 + 8 * len(data)


def test_two_drives_at_one_megabit_take_about_a_tenth_of_the_bus():
    load = bus_load(DRIVES, CYCLE, master_heartbeat_ms=20, bitrate_bit_per_s=1_000_000)

    assert 0.09 < load.busy_ratio < 0.13
    assert load.burst_s < 1.3e-3


def test_each_stream_has_its_name_its_size_and_its_rate():
    cycle = CYCLE._replace(period_ms=3, drive_heartbeat_ms=7, sync_counter=10)

    load = bus_load(DRIVES[:1], cycle, master_heartbeat_ms=13, bitrate_bit_per_s=1_000_000)

    sync_hz = pytest.approx(333.33333)
    assert load.streams == (
        ("SYNC", 1, sync_hz, True),
        ("master heartbeat", 1, pytest.approx(76.923077), False),
        ("right/hip TPDO1", 7, sync_hz, True),
        ("right/hip TPDO2", 8, sync_hz, True),
        ("right/hip TPDO3", 2, pytest.approx(33.333333), True),
        ("right/hip RPDO1", 7, sync_hz, True),
        ("right/hip RPDO2", 2, sync_hz, True),
        ("right/hip SDO request", 8, pytest.approx(13.333333), False),
        ("right/hip SDO answer", 8, pytest.approx(13.333333), False),
        ("right/hip heartbeat", 1, pytest.approx(142.857143), False),
    )


def test_a_drive_whose_temperature_is_mapped_has_no_sdo_in_the_cycle():
    load = bus_load([drive("hip_generic")], CYCLE, 20, 1_000_000)

    assert not [stream for stream in load.streams if "SDO" in stream.name]


def test_a_station_that_sends_every_identifier_fills_no_more_memory_than_256_headers():
    for can_id in range(0x800):
        frame_bits_exact(can_id, b"")

    assert bus_load_module._header.cache_info().currsize == 256


def test_the_load_is_the_sum_of_its_streams():
    load = bus_load(DRIVES, CYCLE, master_heartbeat_ms=20, bitrate_bit_per_s=500_000)

    used = sum(frame_bits(s.data_bytes) * s.rate_hz for s in load.streams)
    burst = sum(frame_bits(s.data_bytes) for s in load.streams if s.in_burst)

    assert load.busy_ratio == pytest.approx(used / 500_000)
    assert load.burst_s == pytest.approx(burst / 500_000)
    assert len(load.streams) == 2 + 2 * 8
    assert load.streams[0].data_bytes == 0  # SYNC without a counter
