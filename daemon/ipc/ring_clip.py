"""Files of the black box: some seconds of a ring around a stop, in the ring's own format.

Such a file has the header of the ring that it was cut from, with `RingHeader.kept` filled in, and
as many slots as its records span, each as large as its largest record needs. So every reader of
rings can read it. Names sort by time and contain the cause::

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
"""Folder in the state directory."""
SUFFIX: Final = ".ring"
DAMAGED_SUFFIX: Final = ".damaged"
"""Suffix of a file that could not be read when the gateway started; it is left for repair."""
PART_SUFFIX: Final = ".part"
"""Suffix of a file that is being written; one that is found at a start is useless."""

CORE_SILENT: Final = "core_silent"
"""Records stopped arriving while the gateway ran: the core was killed, hung, or ended normally."""
CORE_ENDED: Final = "core_ended"
"""A ring was found whose core has ended, while no gateway was running."""

_PREFIX: Final = struct.Struct("<8sIII")
_SLOT: Final = struct.Struct("<QI")
_ALIGNMENT: Final = 8
_BOOT_ID_LENGTH: Final = 8


class ClipFile(NamedTuple):
    """The part of a file's header that the gateway keeps in memory for each file of the folder."""

    path: Path
    size: int
    core_boot_id: str = ""
    period_ns: int = 0
    kept: Kept | None = None
    """Why the file was kept; None: it is another file, the ring of a core, or damaged."""
    trouble: str = ""
    """Why the file cannot be read."""

    @classmethod
    def of(cls, path: Path, size: int, header: RingHeader) -> Self:
        """A file with this header."""
        return cls(path, size, header.core_boot_id, header.period_ns, header.kept)


class ClipWriter:
    """Records copied out of a ring, in msgpack, until they are written into a file.

    They are stored in one memory mapping, which is returned to the system as a whole. A window has
    some thousands of records: as single objects they would fragment the process's memory, stop
    after stop.
    """

    def __init__(self, room_bytes: int) -> None:
        """Reserve memory for records; unused pages cost nothing."""
        size = max(room_bytes, mmap.PAGESIZE)
        self._map = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE)
        self._ends = array("Q")
        """End offset of each record, from the first one on; a missing record has no bytes."""
        self.first_seq = 0
        """0: there is none."""
        self.longest_bytes = 0

    def add(self, seq: int, data: bytes) -> None:
        """Add a record; numbers must rise, and numbers left out stay gaps."""
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
        """Number of the last record."""
        return self.first_seq + len(self._ends) - 1

    def __len__(self) -> int:
        """Number of records spanned, gaps included."""
        return len(self._ends)

    def raw(self, seq: int) -> bytes:
        """A record between the first and the last; empty if it is missing."""
        number = seq - self.first_seq
        begin = self._ends[number - 1] if number else 0
        return self._map[begin : self._ends[number]]

    def close(self) -> None:
        """Release the memory."""
        self._map.close()


def trimmed(header: RingHeader, cutting: ClipWriter) -> Iterator[bytes]:
    """A ring of exactly these records, piece by piece: header, and slot after slot.

    Args:
        header: header of the new ring.
        cutting: at least one record; gaps stay gaps.

    Raises:
        ValueError: a bug of ours: no record, or a header that does not fit.
    """
    text, count, first_seq = msgspec.msgpack.encode(header), len(cutting), cutting.first_seq
    if not count or _PREFIX.size + len(text) > HEADER_SIZE:
        raise ValueError(f"a ring cannot hold {count} records and a header of {len(text)} bytes")
    size = -(-(cutting.longest_bytes + _SLOT.size) // _ALIGNMENT) * _ALIGNMENT
    yield (_PREFIX.pack(MAGIC, size, count, len(text)) + text).ljust(HEADER_SIZE, b"\0")
    for index in range(count):
        # The only one of these sequence numbers that is stored in this slot.
        seq = first_seq + (index - first_seq) % count
        data = cutting.raw(seq)
        yield (_SLOT.pack(seq if data else 0, len(data)) + data).ljust(size, b"\0")


def name_of(core_boot_id: str, kept: Kept) -> str:
    """The name of a file: made from time, cause, core and record."""
    at = datetime.fromtimestamp(kept.stop_utc_ns // 1_000_000 / 1e3, UTC)
    stamp = f"{at:%Y%m%dT%H%M%S}.{at.microsecond // 1000:03d}Z"
    return f"{stamp}_{kept.cause}_{core_boot_id[:_BOOT_ID_LENGTH]}_{kept.stop_seq}{SUFFIX}"


def clip_file(path: Path) -> ClipFile:
    """Read the header of one file; `trouble` says why it cannot be read.

    Raises:
        OSError: the file does not exist.
    """
    size = path.stat().st_size
    try:
        with closing(RingReader(path)) as ring:
            return ClipFile.of(path, size, ring.header)
    except RingError as error:
        return ClipFile(path, size, trouble=str(error))
    except OSError as error:
        return ClipFile(path, size, trouble=f"{path}: {error.strerror}")


def clip_files(folder: Path) -> list[ClipFile]:
    """All files of a black box, in the order in which they were kept; none without a folder.

    Raises:
        OSError: the folder cannot be read.
    """
    named = (*folder.glob(f"*{SUFFIX}"), *folder.glob(f"*{SUFFIX}{DAMAGED_SUFFIX}"))
    return sorted((clip_file(path) for path in named if path.is_file()), key=order_of)


def order_of(file: ClipFile) -> tuple[int, str]:
    """Sorts files by their numbers: a clock without a battery may have been behind."""
    return (file.kept.number if file.kept else 0, file.path.name)
