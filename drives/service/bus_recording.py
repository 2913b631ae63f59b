"""A recorded bus as samples of two drives: position and torque of each SYNC, in SI units.

The frames may be those of any CANopen master. Rules:

1.  The SDO traffic of the recording says which objects are in a TPDO, and on which identifier: a
    download counts when the drive has confirmed it, an upload when it is answered (CiA 301,
    7.2.4.3), both expedited, with or without their size. An object of 1800h..1803h and
    1A00h..1A03h that never appears is as the profile maps it.
2.  What the drive says of its units (6076h and its brothers) counts before the axis file.
3.  A SYNC begins a row; a sample belongs to the SYNC before it. A drive that does not answer leaves
    NaN. Rows before the first sample of both drives, and after the last one, are left out.
4.  A TPDO whose length differs from its mapping is an error, not a guess. A sample from a TPDO
    that the SDO traffic has made asynchronous is of no SYNC: it is left out, and an error if there
    never was another one.
5.  A boot-up message ends what the file has told of the drive's communication (CiA 301, 7.3.2.2).
    Once a drive has been sampled, the profile says nothing of its mapping after a boot-up: its
    TPDOs are left out, with a note, until the SDO traffic tells it again.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from drives.canopen.emcy import EMERGENCY_ID
from drives.canopen.nmt import HEARTBEAT_ID, NMT_ID, SYNC_ID
from drives.canopen.objects import Object
from drives.canopen.sdo import SDO_ANSWER_ID, SDO_REQUEST_ID
from drives.cia402.pdo import POSITION, layouts
from drives.cia402.profile import DriveDescription
from drives.cia402.torque import ObjectRef
from drives.cia402.units import AxisScaling, axis_scaling, base_from_raw, position_si

TPDO_NUMBERS: Final = (1, 2, 3, 4)
RPDO_IDS: Final = (0x200, 0x300, 0x400, 0x500)
TIME_ID: Final = 0x100
SYNCHRONOUS_MAX: Final = 240
"""Largest transmission type of a TPDO whose sample is taken at a SYNC."""
MAPPED_MAX: Final = 64
"""Most objects of a PDO (CiA 301, 7.5.2.36); a larger count is no mapping."""
_INVALID: Final = 1 << 31
"""Bit of a PDO's identifier: it does not exist."""
_IDENTIFIER: Final = 0x7FF
_COMMAND: Final = 0xE0
_DOWNLOAD: Final = 0x20
_UPLOADED: Final = 0x40
_DOWNLOADED: Final = 0x60
_EXPEDITED: Final = 0x02
"""Some masters leave the size out, and send four bytes (CiA 301, 7.2.4.3.3: s = 0)."""
_SDO_BYTES: Final = 8
_BOOT_UP: Final = b"\0"
_COMMUNICATION_AREA: Final = range(0x1000, 0x2000)
_COMMUNICATION: Final = (Object.TPDO, Object.TPDO_MAPPING)

Place = tuple[int, int]
"""Index and sub-index."""


class RecordedBusError(Exception):
    """A recorded bus gives no samples: names what, where, and what would do."""


class BusFrame(NamedTuple):
    """One frame of a recording."""

    time_s: float
    can_id: int
    data: bytes


class Row(NamedTuple):
    """One SYNC; NaN where a drive did not answer."""

    time_s: float
    hip_angle_rad: float
    slide_position_m: float
    hip_torque_nm: float
    slide_force_n: float


class Part(NamedTuple):
    """One mapped object and the place of its lowest bit in the frame."""

    object_index: int
    sub: int
    bits: int
    first_bit: int

    def raw(self, data: bytes, *, signed: bool) -> int:
        """Its value in a frame."""
        value = int.from_bytes(data, "little") >> self.first_bit & ((1 << self.bits) - 1)
        return value - (1 << self.bits) if signed and value >> (self.bits - 1) else value


class Tpdo(NamedTuple):
    """One TPDO as the drive sends it."""

    number: int
    can_id: int
    parts: tuple[Part, ...]
    size: int
    of_recording: bool
    """True if the recording says what is in it, False if the profile does."""
    transmission_type: int
    """1800h..1803h:02; where the recording has none, the profile's synchronous one."""

    @property
    def is_synchronous(self) -> bool:
        """True if its samples are taken at a SYNC."""
        return self.transmission_type <= SYNCHRONOUS_MAX

    def part(self, ref: Place) -> Part | None:
        """Where this object is, if it is mapped here."""
        return next((part for part in self.parts if (part.object_index, part.sub) == ref), None)


@dataclass(slots=True, eq=False)
class Station:
    """One drive of the recording."""

    description: DriveDescription
    values: dict[Place, int] = field(default_factory=dict[Place, int])
    """Objects whose value the SDO traffic has shown, unsigned."""
    tpdos: tuple[Tpdo, ...] = ()
    frame_count: int = 0
    pending: tuple[Place, int] | None = None
    """A download that is not confirmed yet."""
    tpdo_ids: set[int] = field(default_factory=set[int])
    """Identifiers that its TPDOs have had."""
    sampled: set[Place] = field(default_factory=set[Place])
    """Objects that were in a synchronous TPDO when it came."""
    booted_s: float | None = None
    """Time of a boot-up message after samples, as in the file."""
    left_out_count: int = 0
    """TPDOs after it whose mapping is not known."""
    asynchronous_count: int = 0
    """TPDOs with position or torque that are of no SYNC."""
    position_counts: float = math.nan
    torque_count: float = math.nan
    """Sample of the present row, raw."""

    @property
    def node_id(self) -> int:
        """Its node number."""
        return self.description.axis.node_id

    @property
    def from_drive(self) -> frozenset[int]:
        """Identifiers on which it sends."""
        own = (HEARTBEAT_ID, EMERGENCY_ID, SDO_ANSWER_ID)
        return frozenset((*self.tpdo_ids, *(i + self.node_id for i in own)))

    @property
    def to_drive(self) -> frozenset[int]:
        """Identifiers on which it receives: its own, and those of all nodes."""
        own = (SDO_REQUEST_ID, *RPDO_IDS)
        moved = (self.values.get((Object.RPDO + number, 1), 0) for number in range(len(RPDO_IDS)))
        master = self.values.get((Object.HEARTBEAT_CONSUMER, 1), 0) >> 16 & 0x7F
        everyone = (NMT_ID, SYNC_ID, TIME_ID, HEARTBEAT_ID + master)
        told = (one & _IDENTIFIER for one in moved if one and not one & _INVALID)
        return frozenset((*(one + self.node_id for one in own), *told, *everyone))


class BusRecording(NamedTuple):
    """What a recorded bus holds of two drives."""

    rows: list[Row]
    hip: Station
    slide: Station
    missing: tuple[int, int]
    """Rows without a position of hip and slide."""
    notes: tuple[str, ...]
    """What was left out, one line each."""
    others: dict[int, int]
    """Count of frames by identifier that are of neither drive: the master's, and other nodes'."""


def read_bus(
    frames: Iterable[BusFrame], hip: DriveDescription, slide: DriveDescription
) -> BusRecording:
    """Sort the frames of a recording into rows.

    Args:
        frames: in the order of time.
        hip: profile and axis file of its drive.
        slide: those of the slide's.

    Raises:
        RecordedBusError: no SYNC, no sample, a TPDO that does not fit its mapping, or one that is
            missing.
    """
    stations = Station(hip), Station(slide)
    by_id: dict[int, Callable[[BusFrame], None]] = {}
    for station in stations:
        _route(station, by_id)
    raw: list[tuple[float, ...]] = []
    others: dict[int, int] = {}
    sync_s: float | None = None
    for frame in frames:
        if frame.can_id in by_id:
            by_id[frame.can_id](frame)
            continue
        if frame.can_id == SYNC_ID:
            if sync_s is not None:
                raw.append(_row(sync_s, stations))
            sync_s = frame.time_s
        others[frame.can_id] = others.get(frame.can_id, 0) + 1
    if sync_s is None:
        raise RecordedBusError(
            f"no SYNC ({SYNC_ID:03X}h) among the frames: a row needs samples of both drives of the "
            "same time, so both must send synchronous TPDOs"
        )
    raw.append(_row(sync_s, stations))
    for station in stations:
        _check_sources(station)
    sampled = [i for i, row in enumerate(raw) if not any(map(math.isnan, row))]
    if not sampled:
        raise RecordedBusError(_nothing_sampled(stations, len(raw)))
    kept = raw[sampled[0] : sampled[-1] + 1]
    missing = sum(math.isnan(row[1]) for row in kept), sum(math.isnan(row[3]) for row in kept)
    notes = tuple(note for station in stations for note in _left_out(station))
    return BusRecording(_in_si(kept, stations), *stations, missing, notes, others)


def _route(station: Station, by_id: dict[int, Callable[[BusFrame], None]]) -> None:
    """Enter what is done with each identifier of a drive; TPDOs may move while it is configured."""
    for tpdo in station.tpdos:
        by_id.pop(tpdo.can_id, None)
    station.tpdos = _tpdos(station)
    station.tpdo_ids.update(one.can_id for one in station.tpdos)
    node = station.node_id

    def request(frame: BusFrame) -> None:
        _take_request(station, frame.data)

    def answer(frame: BusFrame) -> None:
        station.frame_count += 1
        if _take_answer(station, frame.data):
            _route(station, by_id)

    def count(_: BusFrame) -> None:
        station.frame_count += 1

    by_id[SDO_REQUEST_ID + node], by_id[SDO_ANSWER_ID + node] = request, answer

    def heartbeat(frame: BusFrame) -> None:
        station.frame_count += 1
        if frame.data == _BOOT_UP:
            _boot(station, frame.time_s)
            _route(station, by_id)

    by_id[HEARTBEAT_ID + node], by_id[EMERGENCY_ID + node] = heartbeat, count
    for tpdo in station.tpdos:

        def sample(frame: BusFrame, tpdo: Tpdo = tpdo) -> None:
            _take_sample(station, tpdo, frame)

        by_id[tpdo.can_id] = sample


def _left_out(station: Station) -> Iterator[str]:
    """TPDOs that gave no sample, one line for each reason."""
    node = station.node_id
    if station.left_out_count:
        yield (
            f"{station.left_out_count} TPDOs of node {node} left out after its boot-up at "
            f"{station.booted_s:.6f} s: a reset ends the mapping, and the file has no new one"
        )
    if station.asynchronous_count:
        yield f"{station.asynchronous_count} TPDOs of node {node} left out: asynchronous then"


def _boot(station: Station, time_s: float) -> None:
    """Forget the communication parameters (rule 5)."""
    station.values = {
        place: value
        for place, value in station.values.items()
        if place[0] not in _COMMUNICATION_AREA
    }
    station.pending = None
    if station.sampled:
        station.booted_s = time_s


def _take_request(station: Station, data: bytes) -> None:
    if len(data) != _SDO_BYTES or data[0] & _COMMAND != _DOWNLOAD:
        return
    station.pending = None
    if data[0] & _EXPEDITED:
        station.pending = _place(data), _expedited(data)


def _take_answer(station: Station, data: bytes) -> bool:
    """Take an answer; True if it tells something new of a TPDO."""
    if len(data) != _SDO_BYTES:
        return False
    command, told = data[0] & _COMMAND, None
    if command == _UPLOADED and data[0] & _EXPEDITED:
        told = _place(data), _expedited(data)
    elif command == _DOWNLOADED and station.pending and station.pending[0] == _place(data):
        told = station.pending
    station.pending = None
    if told is None or station.values.get(told[0]) == told[1]:
        return False
    station.values[told[0]] = told[1]
    return any(base <= told[0][0] < base + len(TPDO_NUMBERS) for base in _COMMUNICATION)


def _place(data: bytes) -> Place:
    return int.from_bytes(data[1:3], "little"), data[3]


def _expedited(data: bytes) -> int:
    return int.from_bytes(data[4 : _SDO_BYTES - (data[0] >> 2 & 3)], "little")


def _tpdos(station: Station) -> tuple[Tpdo, ...]:
    """TPDOs by what is known now (rule 1)."""
    profile = layouts(station.description.profile, station.node_id)
    by_profile = {one.number: one for one in (profile.status, profile.torque, profile.slow)}
    found = []
    for number in TPDO_NUMBERS:
        layout = by_profile.get(number)
        identifier = station.values.get((Object.TPDO + number - 1, 1))
        count = station.values.get((Object.TPDO_MAPPING + number - 1, 0))
        entries = [] if layout is None else [item.entry for item in layout.objects]
        is_told = False
        if count is not None:
            told = [
                station.values.get((Object.TPDO_MAPPING + number - 1, sub))
                for sub in range(1, min(count, MAPPED_MAX) + 1)
            ]
            known = [entry for entry in told if entry is not None]
            is_told = len(known) == len(told)
            entries = known if is_told else entries
            if count > MAPPED_MAX or not all(entry & 0xFF for entry in entries):
                entries = []
        if identifier is None:
            identifier = 0x080 + 0x100 * number + station.node_id
        if not entries or identifier & _INVALID:
            continue
        parts, first_bit = [], 0
        for entry in entries:
            parts.append(Part(entry >> 16, entry >> 8 & 0xFF, entry & 0xFF, first_bit))
            first_bit += entry & 0xFF
        found.append(
            Tpdo(
                number,
                identifier & _IDENTIFIER,
                tuple(parts),
                (first_bit + 7) // 8,
                is_told,
                station.values.get((Object.TPDO + number - 1, 2), 1),
            )
        )
    return tuple(found)


def _take_sample(station: Station, tpdo: Tpdo, frame: BusFrame) -> None:
    station.frame_count += 1
    source = station.description.profile.torque_source
    places = (POSITION.index, POSITION.sub), (source.index, source.sub)
    position, torque = (tpdo.part(place) for place in places)
    if not tpdo.is_synchronous:
        station.asynchronous_count += position is not None or torque is not None
        return
    if station.booted_s is not None and not tpdo.of_recording:
        station.left_out_count += 1
        return
    if len(frame.data) != tpdo.size:
        raise RecordedBusError(
            f"TPDO{tpdo.number} of node {station.node_id} ({tpdo.can_id:03X}h) at "
            f"{frame.time_s:.6f} s has {len(frame.data)} bytes, {_mapping(tpdo)} have {tpdo.size}: "
            "record from power-on, so that the mapping is in the file, or correct the profile"
        )
    if position is not None:
        station.sampled.add(places[0])
        station.position_counts = position.raw(frame.data, signed=True)
    if torque is not None:
        station.sampled.add(places[1])
        station.torque_count = torque.raw(frame.data, signed=source.signed)


def _mapping(tpdo: Tpdo) -> str:
    names = ", ".join(f"{part.object_index:04X}h:{part.sub:02X}" for part in tpdo.parts)
    source = "mapped in the file" if tpdo.of_recording else "mapped by the profile"
    kind = "" if tpdo.is_synchronous else f", transmission type {tpdo.transmission_type}"
    return f"{names} ({source}{kind})"


def _row(sync_s: float, stations: tuple[Station, Station]) -> tuple[float, ...]:
    """Raw row of the SYNC that has passed; the samples are used up."""
    row = [sync_s]
    for station in stations:
        row += station.position_counts, station.torque_count
        station.position_counts = station.torque_count = math.nan
    return tuple(row)


def _check_sources(station: Station) -> None:
    """Position and torque must be in a synchronous TPDO, or have been."""
    source = station.description.profile.torque_source
    for ref, what in (
        ((POSITION.index, POSITION.sub), "the position"),
        ((source.index, source.sub), "the profile's torque_source"),
    ):
        if ref not in station.sampled and not any(
            tpdo.is_synchronous and tpdo.part(ref) for tpdo in station.tpdos
        ):
            mapped = "; ".join(f"TPDO{one.number}: {_mapping(one)}" for one in station.tpdos)
            raise RecordedBusError(
                f"node {station.node_id}: {ref[0]:04X}h:{ref[1]:02X}, {what}, is in no synchronous "
                f"TPDO ({mapped or 'there is none'})"
            )


def _nothing_sampled(stations: tuple[Station, Station], count: int) -> str:
    heard = ", ".join(f"{one.frame_count} frames of node {one.node_id}" for one in stations)
    return (
        f"{count} SYNCs, {heard}, and none with samples of both drives: the node numbers are those "
        "of the axis files, and both drives must be operational"
    )


def _in_si(raw: list[tuple[float, ...]], stations: tuple[Station, Station]) -> list[Row]:
    hip, slide = (_scaling(station) for station in stations)
    first_s = raw[0][0]
    return [
        Row(
            time_s - first_s,
            position_si(hip_counts, hip),
            position_si(slide_counts, slide),
            hip_raw * hip.effort_per_torque_count_si,
            slide_raw * slide.effort_per_torque_count_si,
        )
        for time_s, hip_counts, hip_raw, slide_counts, slide_raw in raw
    ]


def _scaling(station: Station) -> AxisScaling:
    """Factors by what the drive said of its units, else by the axis file (rule 2)."""
    description, motor = station.description, station.description.axis.motor
    base = description.profile.torque_base

    def told(ref: ObjectRef | None, expected: int | None) -> int | None:
        value = expected if ref is None else station.values.get((ref.index, ref.sub), expected)
        if ref is not None and value == 0:
            raise RecordedBusError(
                f"node {station.node_id}: {ref.index:04X}h:{ref.sub:02X} is 0 in the file, so its "
                "torque has no unit: set up the motor data of the drive, and record again"
            )
        return value

    return axis_scaling(
        description,
        base_from_raw(
            description,
            told(base.rated_torque, motor.rated_torque_raw),
            told(base.rated_current, motor.rated_current_raw),
            told(base.torque_constant, motor.torque_constant_raw),
        ),
    )
