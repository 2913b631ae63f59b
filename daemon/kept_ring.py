"""Files of the black box: some seconds of a ring around a stop, in the ring's own format.

Such a file has the header of the ring that it was cut from, with `RingHeader.kept` filled in, and
as many slots as its records span, each as large as its largest record needs. So whoever reads a
ring reads it. Names sort by time and say what it is about::

    20261121T111703.250Z_hand_switch_open_1a2b3c4d_12345.ring
    UTC of the stop      cause            boot id  record of the stop
"""

import struct
from collections.abc import Iterator, Sequence
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from daemon.seam import HEADER_SIZE, MAGIC, Kept, RingError, RingHeader, RingReader

FOLDER: Final = "blackbox"
"""In the state directory."""
SUFFIX: Final = ".ring"
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

Slot = tuple[int, bytes]
"""Sequence number, and the record in msgpack."""


class KeptFile(NamedTuple):
    """One file in the folder; without a header it is none of ours, or damaged."""

    path: Path
    size: int
    header: RingHeader | None
    trouble: str = ""

    @property
    def kept(self) -> Kept | None:
        """What it was kept for."""
        return self.header.kept if self.header else None


def trimmed(header: RingHeader, slots: Sequence[Slot]) -> Iterator[bytes]:
    """A ring of exactly these records, piece by piece: head, and slot after slot.

    Args:
        header: what to say at its head.
        slots: at least one, by rising sequence number; gaps stay gaps.

    Raises:
        ValueError: our own bug: no record, or a header that does not fit.
    """
    text = msgspec.msgpack.encode(header)
    if not slots or _PREFIX.size + len(text) > HEADER_SIZE:
        raise ValueError(f"{len(slots)} records under a header of {len(text)} bytes make no ring")
    count = slots[-1][0] - slots[0][0] + 1
    longest = max(len(data) for _, data in slots) + _SLOT.size
    size = -(-longest // _ALIGNMENT) * _ALIGNMENT
    yield (_PREFIX.pack(MAGIC, size, count, len(text)) + text).ljust(HEADER_SIZE, b"\0")
    placed = {seq % count: (seq, data) for seq, data in slots}
    for index in range(count):
        seq, data = placed.get(index, (0, b""))
        yield (_SLOT.pack(seq, len(data)) + data).ljust(size, b"\0")


def name_of(core_boot_id: str, kept: Kept) -> str:
    """The name of a file: by time, cause, core and record."""
    at = datetime.fromtimestamp(kept.stop_utc_ns // 1_000_000 / 1e3, UTC)
    stamp = f"{at:%Y%m%dT%H%M%S}.{at.microsecond // 1000:03d}Z"
    return f"{stamp}_{kept.cause}_{core_boot_id[:_BOOT_ID_LENGTH]}_{kept.stop_seq}{SUFFIX}"


def kept_file(path: Path) -> KeptFile:
    """Look at the head of one file.

    Raises:
        OSError: it cannot be read.
    """
    size = path.stat().st_size
    try:
        with closing(RingReader(path)) as ring:
            return KeptFile(path, size, ring.header)
    except RingError as error:
        return KeptFile(path, size, None, str(error))


def kept_files(folder: Path) -> list[KeptFile]:
    """All files of a black box, oldest first; none if there is no such folder.

    Raises:
        OSError: the folder or a file in it cannot be read.
    """
    return [kept_file(path) for path in sorted(folder.glob(f"*{SUFFIX}"))]
