"""Bus load: the worst case, computed before anything is sent, and the exact length of one frame.

A classic CAN frame with an 11-bit identifier and n data bytes has 34 + 8 n bits that are stuffed,
at worst one in four after the first, and 13 more that are not:

    start 1, identifier 11, RTR 1, IDE 1, reserved 1, length 4, data 8 n, CRC 15       stuffed
    CRC delimiter 1, acknowledge 2, end of frame 7, intermission 3                     not

    bits(n) <= 47 + 8 n + floor((34 + 8 n - 1) / 4)                     135 for 8 bytes

Intermission is counted, since no frame can follow without it; `canbusload -e` of can-utils counts
the same. Exactly, after each five equal bits one of the opposite value is stuffed, which counts for
the following run; the CRC is over the bits before it, without stuffing.

Source: ISO 11898-1 frame format, its CRC and bit stuffing; the bound is from Tindell and Burns,
"Guaranteeing message latencies on Controller Area Network".
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Final, NamedTuple

from drives.bringup.plan import CycleSettings
from drives.cia402.pdo import layouts
from drives.cia402.profile import DriveDescription
from drives.cia402.temperature import SLOT_CYCLES

_FIXED_BITS: Final = 47
_STUFFED_BITS: Final = 34
_HEADER_BITS: Final = 19
_CRC_POLYNOMIAL: Final = 0x4599
_CRC_MASK: Final = 0x7FFF
_STUFF_AFTER: Final = 5
_HEADERS_KEPT: Final = 256
"""Cache limit, far above our number of streams; a station that sends all identifiers cannot grow
it."""
_IDLE: Final = (1, 0)
"""Before a frame: the last bit was recessive and does not count as a run."""

_Run = tuple[int, int]
"""The last bit sent and its run length, including a stuffed one."""


class Stream(NamedTuple):
    """One kind of frame and how often it is sent."""

    name: str
    data_bytes: int
    rate_hz: float
    in_burst: bool
    """Triggered by SYNC."""


class BusLoad(NamedTuple):
    """Worst-case bus load of all streams."""

    busy_ratio: float
    """Share of the time, 0..1."""
    burst_s: float
    """Time on the wire of everything that one SYNC triggers."""
    streams: tuple[Stream, ...]


def frame_bits(data_bytes: int) -> int:
    """Longest possible frame, with stuffing and intermission."""
    data_bits = 8 * data_bytes
    return _FIXED_BITS + data_bits + (_STUFFED_BITS + data_bits - 1) // 4


def frame_bits_exact(can_id: int, data: bytes) -> int:
    """Length of one data frame as it is on the wire, with stuffing and intermission.

    It costs two look-ups for each byte: cheap enough for every frame of a cycle. A CRC is linear:
    each byte adds its own, as many places from the end as it is.
    """
    state, bits, crc = _header(can_id, len(data))
    for byte, crc_of in zip(data, _CRC_IN[-len(data) :], strict=False):
        state = _STUFFED_8[state & _RUN | byte]
        bits += state >> _COUNT
        crc ^= crc_of[byte]
    state = _STUFFED_8[state & _RUN | crc >> 7]
    return bits + (state >> _COUNT) + (_STUFFED_7[state & _RUN | crc & 0x7F] >> _COUNT)


@lru_cache(_HEADERS_KEPT)
def _header(can_id: int, data_bytes: int) -> tuple[int, int, int]:
    """Return the state after the length, the frame's bits so far, and the CRC if no data were set.

    The bits are those of a frame with data that need no stuffing.
    """
    header = can_id << 7 | data_bytes
    run, stuffed = _stuff(_IDLE, header, _HEADER_BITS)
    crc = 0
    for byte in header.to_bytes(3, "big"):  # the five zeros before it leave a CRC of 0 as it is
        crc = _crc_after(crc, byte)
    for _ in range(data_bytes):
        crc = _crc_after(crc, 0)
    return _number(run) << 8, _FIXED_BITS + 8 * data_bytes + stuffed, crc


def _stuff(run: _Run, value: int, width: int) -> tuple[_Run, int]:
    """Stuff `width` bits, highest first; return the run after them and how many were stuffed."""
    last, length = run
    stuffed = 0
    for shift in reversed(range(width)):
        bit = value >> shift & 1
        length = length + 1 if bit == last else 1
        last = bit
        if length == _STUFF_AFTER:
            last, length, stuffed = 1 - bit, 1, stuffed + 1
    return (last, length), stuffed


def _number(run: _Run) -> int:
    """Number of a run of 1 to 4 bits: 0 to 7."""
    bit, length = run
    return (_STUFF_AFTER - 1) * bit + length - 1


def _stuff_table(width: int) -> tuple[int, ...]:
    """Return `stuffed << 11 | run after << 8` at `run before << 8 | value`, for each of both."""
    found = (
        _stuff((bit, length), value, width)
        for bit in (0, 1)
        for length in range(1, _STUFF_AFTER)
        for value in range(256)
    )
    return tuple(stuffed << _COUNT | _number(run) << 8 for run, stuffed in found)


def _crc_after(crc: int, byte: int) -> int:
    """Return the CRC after eight more bits."""
    crc ^= byte << 7
    for _ in range(8):
        crc = (crc << 1 ^ (_CRC_POLYNOMIAL if crc & 0x4000 else 0)) & _CRC_MASK
    return crc


def _crcs_in(places: int) -> list[tuple[int, ...]]:
    """Return the CRC of each byte alone: first of one before 7 others, last of the last one."""
    tables = [tuple(_crc_after(0, byte) for byte in range(256))]
    while len(tables) < places:
        tables.insert(0, tuple(_crc_after(crc, 0) for crc in tables[0]))
    return tables


_RUN: Final = 0x700
_COUNT: Final = 11
"""Bits of the run in a state, and the place above them of the number of stuffed bits."""
_STUFFED_8: Final = _stuff_table(8)
_STUFFED_7: Final = _stuff_table(7)
_CRC_IN: Final = _crcs_in(8)


def bus_load(
    descriptions: Sequence[DriveDescription],
    cycle: CycleSettings,
    master_heartbeat_ms: int,
    bitrate_bit_per_s: int,
) -> BusLoad:
    """Worst-case load of the cyclic operation, without SDO and EMCY."""
    sync_hz = 1e3 / cycle.period_ms
    streams = [
        Stream("SYNC", 1 if cycle.sync_counter else 0, sync_hz, in_burst=True),
        Stream("master heartbeat", 1, 1e3 / master_heartbeat_ms, in_burst=False),
    ]
    for description in descriptions:
        streams.extend(_streams(description, cycle, sync_hz))
    used_bit_per_s = sum(frame_bits(stream.data_bytes) * stream.rate_hz for stream in streams)
    burst_bits = sum(frame_bits(stream.data_bytes) for stream in streams if stream.in_burst)
    return BusLoad(
        used_bit_per_s / bitrate_bit_per_s, burst_bits / bitrate_bit_per_s, tuple(streams)
    )


def _streams(description: DriveDescription, cycle: CycleSettings, sync_hz: float) -> list[Stream]:
    name = description.name
    pdos = layouts(description.profile, description.node_id)
    streams = [
        Stream(f"{name} {layout}", layout.size, sync_hz / layout.transmission_type, in_burst=True)
        for layout in pdos
    ]
    # At most: the drives share the turns in which their temperatures are read.
    if description.profile.uploaded_temperature is not None:
        streams += [
            Stream(f"{name} SDO {part}", 8, sync_hz / SLOT_CYCLES, in_burst=False)
            for part in ("request", "answer")
        ]
    heartbeat_hz = 1e3 / cycle.drive_heartbeat_ms
    return [*streams, Stream(f"{name} heartbeat", 1, heartbeat_hz, in_burst=False)]
