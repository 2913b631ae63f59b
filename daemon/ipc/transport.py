"""The IPC channel between core and gateway: a ring of records in a file, and two datagram sockets.

From the core: every `CycleRecord` goes into the next slot of a ring in a memory-mapped file (on
a tmpfs), and eight bytes over AF_UNIX wake the gateway. To the core: one `GatewayState` per
datagram. Layout of the ring file, little endian::

    0     8  magic b"GAITDRB2"
    8     4  slot size in bytes
    12    4  slot count
    16    4  length of the header text
    20    -  header text: `RingHeader` as msgpack, up to HEADER_SIZE
    HEADER_SIZE + (seq % slot count) * slot size:
          0  8  record seq, written last; 0 while the slot is being written
          8  4  length
          12 -  record as msgpack

A reader reads seq, copies, and reads seq again: if the slot was overwritten meanwhile the numbers
differ. The file outlives both processes: it is the black box. Sequence numbers begin at 1.

A core that starts renames the previous core's ring, so that it survives without a running gateway.
The gateway later copies what must be kept of it and removes it (`recorder/black_box.py`). Until
then it stays and later rings are not renamed: it holds what stopped the machine first.
"""

import contextlib
import mmap
import os
import socket
import struct
from pathlib import Path
from typing import Annotated, Final, Protocol

import msgspec
from gaitd_names import EventCode
from msgspec import Meta
from msgspec.structs import replace

from daemon.ipc import starting
from daemon.ipc.decoding import INTEGER_MAX, Count, Decoder, RefusedError
from daemon.ipc.record import CycleRecord, GatewayState
from daemon.ipc.report import Event

MAGIC: Final = b"GAITDRB2"
HEADER_SIZE: Final = 16384
SLOT_SIZE: Final = 7488
"""Size of a slot in bytes: for the largest record, with two legs and all events and emergencies."""
SLOT_COUNT: Final = 3000
"""30 s of 10 ms."""

_PREFIX: Final = struct.Struct("<8sIII")
_SLOT: Final = struct.Struct("<QI")
_SEQ: Final = struct.Struct("<Q")

_OVERWRITTEN_SOON: Final = 100
"""The oldest slots of a full ring are skipped, because the core is about to overwrite them."""

RING_NAME: Final = "records.ring"
PREVIOUS_RING_NAME: Final = "records.aside"
"""The previous core's ring, until the gateway has processed it."""
GATEWAY_SOCKET_NAME: Final = "gateway.sock"
CORE_SOCKET_NAME: Final = "core.sock"
STATE_SIZE_MAX: Final = 8192
DRAIN_COUNT_MAX: Final = 128
"""Datagrams read by one drain, of some hundred that a socket's queue may hold: an endless sender
must not delay the cycle. The next drains read the rest, a stop among it too."""
_SOCKET_MODE: Final = 0o660


class RingError(Exception):
    """A file is not a readable ring; the message names the file and the fault."""


class Kept(msgspec.Struct, frozen=True):
    """Why some seconds of a ring were kept as a file of their own; see `ring_clip.py`."""

    cause: str
    """Name of the cause of the stop, or how the records ended: CORE_SILENT, CORE_ENDED."""
    drive: str
    stop_seq: Count
    """Number of the record of the stop."""
    stop_utc_ns: Count
    first_seq: Count
    last_seq: Count
    active: bool
    """The drives were enabled on purpose in some of these records."""
    also: tuple[str, ...] = ()
    """Further causes of stops within these records, in their order."""
    number: Count = 0
    """Rises from file to file of a folder, whatever the clock showed; 0: unknown."""


class RingHeader(msgspec.Struct, frozen=True):
    """Constant data of a core's run, written once at the head of the ring."""

    core_boot_id: str
    start_utc_ns: Count
    period_ns: Annotated[int, Meta(gt=0, le=INTEGER_MAX)]
    trainer: str
    drive_names: tuple[str, ...]
    leg_names: Annotated[tuple[str, ...], Meta(min_length=1)]
    config_hashes: dict[str, str]
    """SHA-256 of each configuration file, by the path it was read from."""
    version: str
    robot: dict[str, object]
    """robot.toml as it was read, so that a recording is complete."""
    limits: dict[str, object]
    """limits.toml as it was read."""
    guidance: dict[str, object] = {}
    """[gait.impedance] of the trainer file as it was read."""
    kept: Kept | None = None
    """Set in a file of the black box; None in the ring of a core."""


class RingWriter:
    """The core's end of the ring. `write` takes a few microseconds, never blocks, never raises."""

    def __init__(self, path: Path, header: RingHeader) -> None:
        """Create the file anew and map it.

        Raises:
            OSError: the directory does not exist, cannot be written, or is full.
        """
        text = msgspec.msgpack.encode(header)
        if _PREFIX.size + len(text) > HEADER_SIZE:
            raise ValueError(f"ring header of {len(text)} bytes does not fit {HEADER_SIZE}")
        temporary = path.with_suffix(".new")
        size = HEADER_SIZE + SLOT_COUNT * SLOT_SIZE
        try:
            with temporary.open("wb") as file:
                file.write(_PREFIX.pack(MAGIC, SLOT_SIZE, SLOT_COUNT, len(text)) + text)
                # Allocate all blocks now: writing to a hole on a full disk would kill the core
                # later.
                os.posix_fallocate(file.fileno(), 0, size)
        except OSError:
            temporary.unlink(missing_ok=True)
            raise
        with temporary.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), size)
        # A reader that has the old ring open keeps it; a new reader finds the whole new one.
        aside = path.with_name(PREVIOUS_RING_NAME)
        if path.exists() and not aside.exists():
            path.rename(aside)
        temporary.replace(path)
        self._encoder = msgspec.msgpack.Encoder()
        self.shortened_count = 0
        """Records that were too large or could not be encoded, and were written without texts."""

    def write(self, record: CycleRecord) -> None:
        """Put a record into its slot, sequence number last.

        A record that does not fit is written without its texts, emergencies and strides: the rest
        of the cycle matters more.
        """
        data = self._encoded(record)
        if data is None:
            self.shortened_count += 1
            data = self._encoded(without_texts(record))
        if data is None:
            return
        offset = HEADER_SIZE + (record.seq % SLOT_COUNT) * SLOT_SIZE
        _SLOT.pack_into(self._map, offset, 0, len(data))
        self._map[offset + _SLOT.size : offset + _SLOT.size + len(data)] = data
        _SEQ.pack_into(self._map, offset, record.seq)

    def _encoded(self, record: CycleRecord) -> bytes | None:
        """The record in msgpack; None if it is too large or cannot be encoded."""
        try:
            data = self._encoder.encode(record)
        except (ValueError, OverflowError):
            return None
        return data if len(data) <= SLOT_SIZE - _SLOT.size else None

    def close(self) -> None:
        """Unmap; the file stays."""
        self._map.close()


def without_texts(record: CycleRecord) -> CycleRecord:
    """The record without everything of variable size: texts, emergencies, strides."""
    request, refusal = record.request, record.request.refusal
    if refusal is not None:
        request = replace(request, refusal=replace(refusal, said=""))
    return replace(
        record,
        verdict=replace(record.verdict, said=""),
        events=tuple(replace(one, said="") for one in record.events),
        request=request,
        drives=tuple(replace(one, emergency_text="", emergencies=()) for one in record.drives),
        legs=tuple(replace(one, stride=None) for one in record.legs),
    )


class RingReader:
    """A reader of a ring, live or from a file: `slot_count` slots of `slot_size` bytes."""

    def __init__(self, path: Path) -> None:
        """Open and check the file.

        Raises:
            FileNotFoundError: there is none yet.
            RingError: it is not a ring of this version.
        """
        with path.open("rb") as file:
            self.inode = os.fstat(file.fileno()).st_ino
            try:
                self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
            except ValueError as error:
                raise RingError(f"{path}: is empty, not a ring of records") from error
        if len(self._map) < HEADER_SIZE:
            raise RingError(f"{path}: {len(self._map)} bytes are too few for a ring of records")
        magic, self.slot_size, self.slot_count, length = _PREFIX.unpack_from(self._map, 0)
        if magic != MAGIC:
            raise RingError(f"{path}: begins with {magic!r}, a ring of records with {MAGIC!r}")
        if self.slot_size < _SLOT.size or not self.slot_count:
            raise RingError(f"{path}: its header says {self.slot_count} slots, so it has no room")
        if len(self._map) < HEADER_SIZE + self.slot_size * self.slot_count:
            raise RingError(f"{path}: shorter than its header says")
        text = self._map[_PREFIX.size : _PREFIX.size + length]
        try:
            self.header = Decoder(msgspec.msgpack.Decoder(RingHeader).decode).decode(text)
        except RefusedError as error:
            raise RingError(f"{path}: header cannot be read: {error}") from error
        self._decoder = Decoder(msgspec.msgpack.Decoder(CycleRecord).decode)
        self.damaged_count = 0
        """Records that were there and could not be read."""

    def newest_seq(self) -> int:
        """The highest sequence number in the ring, 0 if there is none."""
        return max(self._seq_at(slot) for slot in range(self.slot_count))

    def read(self, seq: int) -> CycleRecord | None:
        """The record with this number; None if it is not there (yet, or any more), or damaged."""
        data = self.raw(seq)
        return None if data is None else self.record(seq, data)

    def record(self, seq: int, data: bytes) -> CycleRecord | None:
        """Decode the bytes that `raw` returned; None, and counted, if the record is damaged."""
        try:
            record = self._decoder.decode(data)
        except RefusedError:
            record = None
        if record is None or record.seq != seq:
            self.damaged_count += 1
            return None
        return record

    def raw(self, seq: int) -> bytes | None:
        """The record's msgpack bytes; None if it is not there, empty if its length is damaged."""
        offset = HEADER_SIZE + (seq % self.slot_count) * self.slot_size
        found, length = _SLOT.unpack_from(self._map, offset)
        if found != seq:
            return None
        if length > self.slot_size - _SLOT.size:
            return b""
        data = self._map[offset + _SLOT.size : offset + _SLOT.size + length]
        if _SEQ.unpack_from(self._map, offset)[0] != seq:
            return None
        return data

    def oldest_seq(self, newest: int) -> int:
        """The lowest number that can still be in the ring besides the newest."""
        return max(newest - self.slot_count + 1, 1)

    def since(self, seq: int) -> list[CycleRecord]:
        """All readable records after `seq`, oldest first."""
        seqs = sorted(self._seq_at(slot) for slot in range(self.slot_count))
        found = (self.read(number) for number in seqs if number > seq)
        return [record for record in found if record is not None]

    def close(self) -> None:
        """Unmap the file."""
        self._map.close()

    def _seq_at(self, slot: int) -> int:
        """The number in a slot; 0 if there is none, or one that belongs into another slot."""
        seq: int = _SEQ.unpack_from(self._map, HEADER_SIZE + slot * self.slot_size)[0]
        return seq if seq % self.slot_count == slot else 0


class RareNotice:
    """Limits reports of a repeated fault: due at the first time and at each tenfold count."""

    def __init__(self) -> None:
        self._reported_count = 0

    def due(self, count: int) -> bool:
        """True if a report is due.

        Args:
            count: of all times so far; a lower count than before means that counting began anew.
        """
        self._reported_count = min(self._reported_count, count)
        if count <= 10 * self._reported_count:
            return False
        self._reported_count = count
        return True


def _bound_socket(path: Path) -> socket.socket:
    path.unlink(missing_ok=True)
    bound = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
    bound.setblocking(False)
    bound.bind(str(path))
    # Core and gateway have the same group. The group may not write their other files (UMask= of
    # the units), but a process needs write permission on a socket to send a datagram to it.
    path.chmod(_SOCKET_MODE)
    return bound


class Datagrams:
    """One end of the two AF_UNIX datagram sockets; sending never blocks and never raises.

    A peer that is missing, or whose queue is full, is not an error here: silence is detected by
    age (in the core by the age of the gateway state, in the gateway by the age of the record).
    """

    def __init__(self, own: Path, peer: Path) -> None:
        """Bind our own socket, replacing a left-over one.

        Raises:
            OSError: the directory does not exist or cannot be written.
        """
        self._socket = _bound_socket(own)
        self.crowded_count = 0
        """Drains that may have left datagrams in the queue."""
        self._own = own
        self._peer = str(peer)

    def fileno(self) -> int:
        """File descriptor for poll()."""
        return self._socket.fileno()

    def send(self, data: bytes) -> bool:
        """Send one datagram; False if the peer did not take it."""
        try:
            self._socket.sendto(data, self._peer)
        except OSError:
            return False
        return True

    def drain(self) -> list[bytes]:
        """Datagrams that wait, oldest first, DRAIN_COUNT_MAX at most."""
        waiting: list[bytes] = []
        with contextlib.suppress(BlockingIOError):
            while len(waiting) < DRAIN_COUNT_MAX:
                waiting.append(self._socket.recv(STATE_SIZE_MAX))
        self.crowded_count += len(waiting) == DRAIN_COUNT_MAX
        return waiting

    def close(self) -> None:
        """Close and remove our own socket."""
        self._socket.close()
        self._own.unlink(missing_ok=True)


class IpcChannel(Protocol):
    """The core's end of the IPC channel: `CoreChannel`, or a list in a test."""

    def publish(self, record: CycleRecord) -> object:
        """Publish a record."""
        ...

    def receive(self) -> list[GatewayState]:
        """All gateway states that wait."""
        ...

    def take_notices(self) -> list[Event]:
        """Notices about the IPC channel for the operator that have not been published yet."""
        ...


class CoreChannel:
    """The core's end of the IPC channel: records out, gateway states in."""

    def __init__(self, runtime: Path, header: RingHeader) -> None:
        """Create ring and socket in the runtime directory."""
        self._ring = RingWriter(runtime / RING_NAME, header)
        self._datagrams = Datagrams(runtime / CORE_SOCKET_NAME, runtime / GATEWAY_SOCKET_NAME)
        self._decoder = Decoder(msgspec.msgpack.Decoder(GatewayState).decode)
        self._refusal = ""
        """Why the newest refused datagram was not a valid gateway state."""
        self._refused, self._shortened, self._crowded = RareNotice(), RareNotice(), RareNotice()

    @property
    def refused_count(self) -> int:
        """Datagrams that were not a valid gateway state; they are counted and ignored."""
        return self._decoder.refused_count

    def fileno(self) -> int:
        """File descriptor for poll(): readable when the gateway has sent its state."""
        return self._datagrams.fileno()

    def publish(self, record: CycleRecord) -> bool:
        """Write a record and wake the gateway; False if no gateway was there."""
        self._ring.write(record)
        return self._datagrams.send(_SEQ.pack(record.seq))

    def receive(self) -> list[GatewayState]:
        """The gateway states that wait, oldest first; stop counts must be read from all of them."""
        gateway_states: list[GatewayState] = []
        for data in self._datagrams.drain():
            try:
                gateway_states.append(self._decoder.decode(data))
            except RefusedError as error:
                self._refusal = str(error)
        return gateway_states

    def take_notices(self) -> list[Event]:
        """New faults of the channel, for the operator."""
        shortened_count = self._ring.shortened_count
        crowded_count = self._datagrams.crowded_count
        notices: list[Event] = []
        if self._refused.due(self.refused_count):
            count = self.refused_count
            notices.append(Event(EventCode.STATES_REFUSED, values=(count,), said=self._refusal))
        if self._shortened.due(shortened_count):
            notices.append(Event(EventCode.RECORDS_SHORTENED, values=(shortened_count,)))
        if self._crowded.due(crowded_count):
            notices.append(Event(EventCode.STATES_CROWDED, values=(crowded_count,)))
        return notices

    def close(self) -> None:
        """Close the channel; the ring file stays."""
        self._ring.close()
        self._datagrams.close()


class GatewayChannel:
    """The gateway's end of the IPC channel; the core may end and start again."""

    def __init__(self, runtime: Path) -> None:
        """Bind the wake socket; the ring is opened when there is one."""
        self._path, self._runtime = runtime / RING_NAME, runtime
        self._datagrams = Datagrams(runtime / GATEWAY_SOCKET_NAME, runtime / CORE_SOCKET_NAME)
        self._encoder = msgspec.msgpack.Encoder()
        self._ring: RingReader | None = None
        self._seq = 0
        self._damaged = RareNotice()
        # Records of a ring that existed before this gateway are not read; a later ring is read from
        # its start. A file that cannot be read is reported by `records` until a core replaces it.
        with contextlib.suppress(RingError):
            self._open_ring()
        if self._ring is not None:
            self._seq = self._ring.newest_seq()

    @property
    def header(self) -> RingHeader | None:
        """Header of the ring that is open now, None before the first core."""
        return self._ring.header if self._ring else None

    @property
    def starting(self) -> bool:
        """True while a core starts, and writes no records yet."""
        return starting.starting(self._runtime)

    @property
    def ring(self) -> RingReader | None:
        """The ring that is open now; holders can still read it after a new core's ring appears."""
        return self._ring

    def fileno(self) -> int:
        """File descriptor for poll(): readable when the core has written."""
        return self._datagrams.fileno()

    def records(self) -> list[CycleRecord]:
        """All records since the last call, oldest first; opens the ring of a new core.

        Raises:
            RingError: the file exists but is not a valid ring.
        """
        woken = [_SEQ.unpack(data)[0] for data in self._datagrams.drain() if len(data) == _SEQ.size]
        known = self._ring
        found = self._forward(known) if known and woken else []
        # If the last wake-up is that of the last record, it came from the known core, and the file
        # need not be checked. This saves time, because a subscriber waits for the sample.
        if found and woken[-1] == self._seq:
            return found
        self._open_ring()
        if self._ring is None or not woken:
            return []
        if self._ring is not known:
            found = self._forward(self._ring)
        # The socket's queue is short, and its wake-ups may be those of a previous core: they only
        # show that there is something to read. A record that is missing while a later one exists
        # will not arrive.
        if not found and max(woken) > self._seq:
            newest = self._ring.newest_seq()
            self._seq = max(newest - SLOT_COUNT + _OVERWRITTEN_SOON, self._seq)
            while not (found := self._forward(self._ring)) and self._seq < newest:
                self._seq += 1
        return found

    def _forward(self, ring: RingReader) -> list[CycleRecord]:
        """All records that follow the last one read, without a gap; damaged ones are left out."""
        found: list[CycleRecord] = []
        while (data := ring.raw(self._seq + 1)) is not None:
            self._seq += 1
            record = ring.record(self._seq, data)
            if record is not None:
                found.append(record)
        return found

    def take_unread(self) -> int:
        """Count of records that could not be read, if it is to be reported now; or 0."""
        if self._ring is None or not self._damaged.due(self._ring.damaged_count):
            return 0
        return self._ring.damaged_count

    def send(self, gateway_state: GatewayState) -> bool:
        """Send the gateway state to the core; False if no core took it."""
        return self._datagrams.send(self._encoder.encode(gateway_state))

    def close(self) -> None:
        """Close the ring and the sockets."""
        if self._ring:
            self._ring.close()
        self._datagrams.close()

    def _open_ring(self) -> None:
        """Open the ring, or the new one if a core has started since."""
        try:
            inode = self._path.stat().st_ino
        except FileNotFoundError:
            return
        if self._ring is None or self._ring.inode != inode:
            # The previous ring is unmapped when its last holder releases it.
            self._ring = RingReader(self._path)
            self._seq = 0
