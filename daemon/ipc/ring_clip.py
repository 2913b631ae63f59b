"""Files of the black box: some seconds of a ring around a stop, in the ring's own format.

Such a file has the header of the ring that it was cut from, with `RingHeader.kept` filled in, and
as many slots as its records span, each as large as its largest record needs. So whoever reads a
ring reads it. Names sort by time and say what it is about::

    20261121T111703.250Z_hand_switch_open_1a2b3c4d_12345.ring
    UTC of the stop      cause            boot id  record of the stop
"""

import mmap
import struct
from array import array
from collections.abc import Iterator
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, NamedTuple, Self

import msgspec

from daemon.ipc.transport import HEADER_SIZE, MAGIC, Kept, RingError, RingHeader, RingReader

FOLDER: Final = "blackbox"
"""In the state directory."""
SUFFIX: Final = ".ring"
DAMAGED_SUFFIX: Final = ".damaged"
"""Of a file that could not be read when the gateway started: left for who can mend it."""
PART_SUFFIX: Final = ".part"
"""Of a file that is being written; one that is found at a start is of no use."""

CORE_SILENT: Final = "core_silent"
"""Records stopped coming while the gateway watched: killed, hanging, or ended in good order."""
CORE_ENDED: Final = "core_ended"
"""A ring was found whose core is gone, and nobody had watched its end."""

_PREFIX: Final = struct.Struct("<8sIII")
_SLOT: Final = struct.Struct("<QI")
_ALIGNMENT: Final = 8
_BOOT_ID_LENGTH: Final = 8


class KeptFile(NamedTuple):
    """What the gateway remembers of one file in the folder, so not its whole header."""

    path: Path
    size: int
    core_boot_id: str = ""
    period_ns: int = 0
    kept: Kept | None = None
    """What it was kept for; None: it is none of ours, the ring of a core, or damaged."""
    trouble: str = ""
    """Why it cannot be read."""

    @classmethod
    def of(cls, path: Path, size: int, header: RingHeader) -> Self:
        """A file with this header."""
        return cls(path, size, header.core_boot_id, header.period_ns, header.kept)


class Cutting:
    """Records that are taken out of a ring, in msgpack, until they are in a file.

    They lie one behind the other in a mapping that goes back to the system whole. A window has some
    thousands of them: as objects of their own, stop after stop, they would leave a process' memory
    in shreds.
    """

    def __init__(self, room_bytes: int) -> None:
        """Room for some records; what is not used costs nothing."""
        size = max(room_bytes, mmap.PAGESIZE)
        self._map = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
        self._ends = array("Q")
        """Where each record ends, from the first one on; one that is missing is empty."""
        self.first_seq = 0
        """0: there is none."""
        self.longest_bytes = 0

    def add(self, seq: int, data: bytes) -> None:
        """Take one more; their numbers rise, and what is left out stays a gap."""
        self.first_seq = self.first_seq or seq
        begin = self._ends[-1] if self._ends else 0
        gap = seq - self.first_seq - len(self._ends)
        self._ends.extend(array("Q", [begin]) * gap)
        end = begin + len(data)
        self._map[begin:end] = data
        self._ends.append(end)
        self.longest_bytes = max(self.longest_bytes, len(data))

    @property
    def last_seq(self) -> int:
        """The last record."""
        return self.first_seq + len(self._ends) - 1

    def __len__(self) -> int:
        """How many records it spans, gaps among them."""
        return len(self._ends)

    def raw(self, seq: int) -> bytes:
        """A record between the first and the last; empty if it is missing."""
        number = seq - self.first_seq
        begin = self._ends[number - 1] if number else 0
        return self._map[begin : self._ends[number]]

    def close(self) -> None:
        """Give the memory back."""
        self._map.close()


def trimmed(header: RingHeader, cutting: Cutting) -> Iterator[bytes]:
    """A ring of exactly these records, piece by piece: head, and slot after slot.

    Args:
        header: what to say at its head.
        cutting: at least one record; gaps stay gaps.

    Raises:
        ValueError: our own bug: no record, or a header that does not fit.
    """
    text, count, first_seq = msgspec.msgpack.encode(header), len(cutting), cutting.first_seq
    if not count or _PREFIX.size + len(text) > HEADER_SIZE:
        raise ValueError(f"{count} records under a header of {len(text)} bytes make no ring")
    size = -(-(cutting.longest_bytes + _SLOT.size) // _ALIGNMENT) * _ALIGNMENT
    yield (_PREFIX.pack(MAGIC, size, count, len(text)) + text).ljust(HEADER_SIZE, b"\0")
    for index in range(count):
        # The only one of these numbers that belongs into this slot.
        seq = first_seq + (index - first_seq) % count
        data = cutting.raw(seq)
        yield (_SLOT.pack(seq if data else 0, len(data)) + data).ljust(size, b"\0")


def name_of(core_boot_id: str, kept: Kept) -> str:
    """The name of a file: by time, cause, core and record."""
    at = datetime.fromtimestamp(kept.stop_utc_ns // 1_000_000 / 1e3, UTC)
    stamp = f"{at:%Y%m%dT%H%M%S}.{at.microsecond // 1000:03d}Z"
    return f"{stamp}_{kept.cause}_{core_boot_id[:_BOOT_ID_LENGTH]}_{kept.stop_seq}{SUFFIX}"


def kept_file(path: Path) -> KeptFile:
    """Look at the head of one file; one that cannot be read says why.

    Raises:
        OSError: it is not there.
    """
    size = path.stat().st_size
    try:
        with closing(RingReader(path)) as ring:
            return KeptFile.of(path, size, ring.header)
    except RingError as error:
        return KeptFile(path, size, trouble=str(error))
    except OSError as error:
        return KeptFile(path, size, trouble=f"{path}: {error.strerror}")


def kept_files(folder: Path) -> list[KeptFile]:
    """All files of a black box, oldest first; none if there is no such folder.

    Raises:
        OSError: the folder cannot be read.
    """
    named = (*folder.glob(f"*{SUFFIX}"), *folder.glob(f"*{SUFFIX}{DAMAGED_SUFFIX}"))
    return [kept_file(path) for path in sorted(named) if path.is_file()]
