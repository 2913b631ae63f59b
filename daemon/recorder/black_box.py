"""The black box: around each stop, some seconds of records are copied from the ring to the disk.

A stop is

    a newly latched verdict, or another one in its place
    records that stop while the gateway runs (`core_silent`): killed, hanging, or ended normally
    the end of a ring that is found without its core (`core_ended`)

and each is kept with BEFORE_NS before it and AFTER_NS after it. Further stops in the seconds after
a stop go into the same file, as long as that spans no more than SPAN_NS. Nothing is kept twice: a
record in a file is identified by its core and its number.

Rings are read here from their oldest record on, whatever the rest of the gateway has read. So a
gateway that was not running finds the stops of that time. One that starts after both have ended
finds the ring of that core: at its place, or renamed by the core that has started since
(`transport.PREVIOUS_RING_NAME`); that file is removed when everything to keep is on the disk.

Nothing here waits or raises: each turn reads a bounded number of records, and the disk has a thread
of its own. The core is never touched. Time is an argument.
"""

import contextlib
import queue
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Protocol

from daemon.gateway.core_view import SILENCE_NS
from daemon.ipc.decoding import RefusedError
from daemon.ipc.ring_clip import ClipWriter
from daemon.ipc.transport import PREVIOUS_RING_NAME, SLOT_COUNT, Kept, RingError, RingReader
from daemon.recorder.clip_store import ClipStore
from daemon.recorder.disk import Disk
from daemon.recorder.ring_follower import RecordHeader, RingFollower, Stop, header_of

BEFORE_NS: Final = 15_000_000_000
AFTER_NS: Final = 5_000_000_000
SPAN_NS: Final = 25_000_000_000
"""Maximum span of a file. A ring holds 30 s: the rest is time to copy it."""
LATE_NS: Final = 1_000_000_000
"""Time after which records that should follow a stop are not waited for any more."""
PIECE_COUNT: Final = 100
"""Records that are read, or copied, in one turn: this takes less than a millisecond."""
ALSO_MAX: Final = 16
HANDED_MAX: Final = 64
WHAT: Final = "black box"


@dataclass(slots=True, eq=False)
class Window:
    """Records to be kept around a stop, and those of them that have been copied."""

    follower: RingFollower
    stop: Stop
    first: int
    last: int
    due_ns: int
    """Time at which it is copied, even if records are missing."""
    also: list[str] = field(default_factory=list)
    active: bool = False
    """The drives were enabled on purpose in one of these records."""
    copied: ClipWriter | None = None
    """None as long as nothing is copied."""
    next_seq: int = 0
    """Number of the record to copy next."""

    def fits(self, follower: RingFollower, stop: Stop, last: int) -> bool:
        """True if another stop, with the records until `last`, fits into the same file."""
        span = SPAN_NS // follower.ring.header.period_ns
        same = follower.boot_id == self.follower.boot_id and self.first <= stop.seq <= self.last
        return same and self.copied is None and last - self.first <= span

    def copy(self, count: int) -> bool:
        """Copy up to `count` more records; true when all are copied."""
        if self.copied is None:
            # Records that arrive later are not added to the clip.
            self.next_seq, self.last = self.first, min(self.last, self.follower.newest)
            ring = self.follower.ring
            # A window never has more records than the ring has slots.
            room_count = min(self.last - self.first + 1, ring.slot_count)
            self.copied = ClipWriter(room_count * ring.slot_size)
        end = min(self.next_seq + count, self.last + 1)
        for seq in range(self.next_seq, end):
            data = self.follower.ring.raw(seq)
            if data is not None:
                self.copied.add(seq, data)
                with contextlib.suppress(RefusedError):
                    self.active = self.active or header_of(data).mode.active
        self.next_seq = end
        return end > self.last

    def description(self, copied: ClipWriter) -> Kept:
        """The description of these records for the file's header."""
        stop = self.stop
        return Kept(
            cause=stop.cause,
            drive=stop.drive,
            stop_seq=stop.seq,
            stop_utc_ns=stop.utc_ns,
            first_seq=copied.first_seq,
            last_seq=copied.last_seq,
            active=self.active,
            also=tuple(self.also[:ALSO_MAX]),
        )


class Listener(Protocol):
    """Receiver of the present core's records; `audit_log.RequestLog`."""

    def core(self, boot_id: str, present: bool) -> None:
        """A core was found, or its records stopped or arrive again."""
        ...

    def record(self, header: RecordHeader) -> None:
        """A new record has arrived."""
        ...


class BlackBox:
    """Reads the rings, finds the stops, gives their records to the disk."""

    def __init__(self, runtime: Path, clips: ClipStore, disk: Disk, listener: Listener) -> None:
        self._renamed_file = runtime / PREVIOUS_RING_NAME
        self._clips, self._disk, self._listener = clips, disk, listener
        self._follower: RingFollower | None = None
        self._previous: list[RingFollower] = []
        """Rings of previous cores, as long as there is something to do with them."""
        self._windows: list[Window] = []
        self._received_ns: int | None = None
        """Time of the newest record's arrival; None: no records arrive."""
        self._reported_present = False
        self._handed: deque[tuple[str, int, int]] = deque(maxlen=HANDED_MAX)
        """Core, first and last record of what was given to the disk and may not be written yet."""
        self._unwritten: set[str] = set()
        """Cores of which a file could not be written."""
        self._begun = False
        self._damaged: list[str] = []
        self._written: queue.SimpleQueue[str] = queue.SimpleQueue()

    def turn(self, ring: RingReader | None, now_ns: int) -> None:
        """Process new records of the present core's ring, and continue copying."""
        if not self._begun:
            self._begun = True
            self._find_renamed()
        if ring is not None and (self._follower is None or ring is not self._follower.ring):
            self._begin_core(ring)
        for follower in (*self._previous, self._follower):
            if follower is not None:
                self._read(follower, now_ns)
        self._copy(now_ns, PIECE_COUNT)

    def new_files(self) -> list[str]:
        """Names of files written to the disk since the last call."""
        return [self._written.get_nowait() for _ in range(self._written.qsize())]

    def damaged(self) -> list[str]:
        """Descriptions of data that could not be read, since the last call."""
        damaged, self._damaged = self._damaged, []
        return damaged

    def close(self, now_ns: int) -> None:
        """Copy all open windows at once as they are now: no further turn follows."""
        for follower in (*self._previous, self._follower):
            if follower is not None:
                for _, stop in follower.advance(SLOT_COUNT):
                    if stop:
                        self._stopped(follower, stop, now_ns)
        for window in self._windows:
            window.due_ns = now_ns
        while self._windows:
            self._copy(now_ns, PIECE_COUNT)

    # --- rings --------------------------------------------------------------------------------

    def _begin_core(self, ring: RingReader) -> None:
        """Switch to the ring of a new core."""
        before, self._follower = self._follower, RingFollower.starting_at(ring)
        self._received_ns, self._reported_present = None, False
        if before is not None:
            before.live = False
            self._previous.append(before)
            self._find_renamed()

    def _find_renamed(self) -> None:
        """Find the ring that the present core has renamed; it may be one that is already open."""
        known = {follower.boot_id: follower for follower in self._previous}
        try:
            ring = RingReader(self._renamed_file)
        except FileNotFoundError:
            return
        except (OSError, RingError) as error:
            self._damaged.append(f"the ring of the previous core cannot be read: {error}")
            # Removed, because an unreadable file would block the next ring.
            self._remove(self._renamed_file)
            return
        follower = known.get(ring.header.core_boot_id)
        if follower is None:
            follower = RingFollower.starting_at(ring, live=False)
            self._previous.append(follower)
        follower.renamed_file = self._renamed_file

    def _read(self, follower: RingFollower, now_ns: int) -> None:
        seq, new = follower.seq, follower.live and follower.caught_up
        for header, stop in follower.advance(PIECE_COUNT):
            if new:
                self._pass_on(follower, header)
            if stop:
                self._stopped(follower, stop, now_ns)
        if follower.seq > seq:
            if follower.live:
                self._received_ns = now_ns
            return
        if not follower.live:
            self._finish(follower, now_ns)
        elif self._received_ns is not None and now_ns - self._received_ns > SILENCE_NS:
            # Check first that not more than a whole ring of records was missed.
            follower.newest = max(follower.newest, follower.ring.newest_seq())
            if follower.caught_up:
                self._received_ns, self._reported_present = None, False
                self._listener.core(follower.boot_id, False)
                self._ended(follower, now_ns)

    def _pass_on(self, follower: RingFollower, header: RecordHeader) -> None:
        """Pass on a record that has just arrived; older ones are not passed on."""
        follower.has_grown = True
        if not self._reported_present:
            self._reported_present = True
            self._listener.core(follower.boot_id, True)
        self._listener.record(header)

    def _finish(self, follower: RingFollower, now_ns: int) -> None:
        """Close a ring without a core after all of it has been read."""
        self._ended(follower, now_ns)
        if any(window.follower is follower for window in self._windows):
            return
        self._previous.remove(follower)
        if follower.renamed_file is not None:
            self._remove(follower.renamed_file, follower.boot_id)

    def _remove(self, path: Path, boot_id: str = "") -> None:
        """Remove the file once all of its records to keep are on the disk, and only then."""

        def remove() -> None:
            if boot_id not in self._unwritten:
                path.unlink(missing_ok=True)

        self._disk.submit(WHAT, remove)

    # --- stops --------------------------------------------------------------------------------

    def _ended(self, follower: RingFollower, now_ns: int) -> None:
        stop = follower.end()
        if stop is None:
            return
        self._stopped(follower, stop, now_ns)
        if not follower.has_grown:
            # This ring received no records while the gateway ran: none are expected.
            for window in (one for one in self._windows if one.follower is follower):
                window.due_ns = now_ns

    def _stopped(self, follower: RingFollower, stop: Stop, now_ns: int) -> None:
        """Keep a stop, in its own file or in a window still open, unless it is kept already."""
        period_ns = follower.ring.header.period_ns
        last, due_ns = stop.seq + AFTER_NS // period_ns, now_ns + AFTER_NS + LATE_NS
        for window in self._windows:
            if window.fits(follower, stop, last):
                window.also.append(stop.cause)
                window.last, window.due_ns = last, due_ns
                return
        if not self._covered(follower.boot_id, stop.seq):
            first = max(stop.seq - BEFORE_NS // period_ns, 1)
            self._windows.append(Window(follower, stop, first, last, due_ns))

    def _covered(self, boot_id: str, seq: int) -> bool:
        """True if this record is on the disk, or about to be written."""
        on_its_way = any(
            boot_id == handed and first <= seq <= last for handed, first, last in self._handed
        )
        return on_its_way or self._clips.covers(boot_id, seq)

    def _copy(self, now_ns: int, count: int) -> None:
        """Copy the oldest window whose records are all there, or will not arrive any more."""
        for window in self._windows:
            follower = window.follower
            whole = follower.seq >= window.last or (not follower.live and follower.caught_up)
            if window.copied is not None or whole or now_ns >= window.due_ns:
                if window.copy(count):
                    self._windows.remove(window)
                    self._put(window)
                return

    def _put(self, window: Window) -> None:
        copied = window.copied
        if not copied:
            return
        header, kept = window.follower.ring.header, window.description(copied)
        self._handed.append((header.core_boot_id, kept.first_seq, kept.last_seq))

        def write() -> None:
            self._unwritten.add(header.core_boot_id)
            with contextlib.closing(copied):
                self._written.put(self._clips.write(header, kept, copied).name)
            self._unwritten.discard(header.core_boot_id)

        if not self._disk.submit(WHAT, write):
            copied.close()
            self._unwritten.add(header.core_boot_id)
