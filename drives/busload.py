"""How much of the bus our frames take at worst, known before anything is sent.

A classic CAN frame with an 11-bit identifier and n data bytes has 34 + 8 n bits that are stuffed,
at worst one in four after the first, and 13 more that are not, counting three of intermission:

    bits(n) = 47 + 8 n + floor((34 + 8 n - 1) / 4)                      135 for 8 bytes

Source: ISO 11898-1 frame format; the bound is that of Tindell and Burns, "Guaranteeing message
latencies on Controller Area Network".
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

from drives.pdo import layouts
from drives.plan import CycleSettings
from drives.profile import DriveDescription

BURST_MAX_RATIO: Final = 0.5
"""SYNC, TPDOs and RPDOs of one cycle must fit into this part of it (canopen.md 4.4)."""

_FIXED_BITS: Final = 47
_STUFFED_BITS: Final = 34


class Stream(NamedTuple):
    """One kind of frame, sent so often."""

    name: str
    data_bytes: int
    rate_hz: float
    in_burst: bool
    """SYNC sets it off."""


class BusLoad(NamedTuple):
    """What all our streams take of the bus at worst."""

    busy_ratio: float
    """Of the time, 0..1."""
    burst_s: float
    """Time on the wire of everything that one SYNC sets off."""
    streams: tuple[Stream, ...]


def frame_bits(data_bytes: int) -> int:
    """Longest possible frame, with stuffing and intermission."""
    data_bits = 8 * data_bytes
    return _FIXED_BITS + data_bits + (_STUFFED_BITS + data_bits - 1) // 4


def bus_load(
    descriptions: Sequence[DriveDescription],
    cycle: CycleSettings,
    master_heartbeat_ms: int,
    bitrate_bit_per_s: int,
) -> BusLoad:
    """Worst-case load of the cyclic operation; SDO belongs to bring-up, EMCY to trouble."""
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


def objection(load: BusLoad, load_max_ratio: float, period_ms: int) -> str | None:
    """Why this bus must not be started, or None."""
    if load.busy_ratio > load_max_ratio:
        busy, allowed = load.busy_ratio, load_max_ratio
        return f"the bus would be busy {busy:.1%} of the time, allowed are {allowed:.0%}"
    burst_max_s = BURST_MAX_RATIO * period_ms * 1e-3
    if load.burst_s > burst_max_s:
        burst, allowed = load.burst_s * 1e3, burst_max_s * 1e3
        return (
            f"the frames of one cycle take {burst:.2f} ms on the wire, allowed are {allowed:.2f} ms"
        )
    return None


def _streams(description: DriveDescription, cycle: CycleSettings, sync_hz: float) -> list[Stream]:
    name = description.name
    pdos = layouts(description.profile, description.node_id)
    streams = [
        Stream(f"{name} {layout}", layout.size, sync_hz / layout.transmission_type, in_burst=True)
        for layout in pdos
    ]
    heartbeat_hz = 1e3 / cycle.drive_heartbeat_ms
    return [*streams, Stream(f"{name} heartbeat", 1, heartbeat_hz, in_burst=False)]
