"""A virtual machine's disk with a write cache that a power cut empties, in parts.

Killing QEMU loses the guest's memory and with it its page cache. It loses nothing that the guest
has handed to its disk, because the host keeps that: such a disk would have no cache of its own. So
QEMU writes a log of all writes and flushes as well (blklogwrites, in the format of Linux'
dm-log-writes), and `cut` makes the image of the next boot from the image of the boot before and
from this log: everything up to the last flush, and of the writes after it a random part, as a disk
may write its cache in any order. A flush that the service forgets is seen in that way; without one
the data is lost at every second cut.
"""

import random
import shutil
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

SECTOR = 512
MAGIC = 0x6A736677736872
SUPER = struct.Struct("<QQQI")
ENTRY = struct.Struct("<QQQQ")
FLUSH, FUA, DISCARD = 1, 2, 4
LOG_BYTES = 4 << 30
"""Sparse: a boot writes some megabytes."""


class Write(NamedTuple):
    """An entry of the log."""

    begin: int
    data: bytes
    flags: int


class Cut(NamedTuple):
    """What a cut has left."""

    written_count: int
    """Writes and flushes since the boot."""
    unflushed_count: int
    """Those after the last flush."""
    lost_count: int
    """Those of them that are not on the disk."""


class LossyDisk:
    """An image, and the log of the boot that is under way."""

    def __init__(self, image: Path, size_bytes: int) -> None:
        self.image = image
        self._before, self._log = image.with_suffix(".before"), image.with_suffix(".log")
        with image.open("xb") as file:
            file.truncate(size_bytes)

    def begin(self) -> str:
        """Begin a boot; QEMU's options."""
        shutil.copyfile(self.image, self._before)
        with self._log.open("wb") as file:
            file.truncate(LOG_BYTES)
        # The host keeps its power: it need not flush, and a flush does not wait for its disk.
        file = "-blockdev driver=file,cache.no-flush=on"
        return (
            f" {file},node-name=image,filename={self.image}"
            f" {file},node-name=log,filename={self._log}"
            " -blockdev driver=blklogwrites,node-name=disk,file=image,log=log"
            f",log-sector-size={SECTOR} -device virtio-blk-pci,drive=disk"
        )

    def written_count(self) -> int:
        """Writes and flushes since the boot."""
        return sum(1 for _ in self._writes())

    def cut(self, chance: random.Random, at_write: int | None = None) -> Cut:
        """The power is cut: make the image of what the disk has then.

        Args:
            chance: chooses what is lost.
            at_write: so many writes after the boot; None: at the end of the log.
        """
        writes = list(self._writes())[:at_write]
        flushed = max((n for n, one in enumerate(writes, 1) if one.flags & FLUSH), default=0)
        # The kill may have torn the last entry.
        last = len(writes) - 1
        lost = {
            number
            for number in range(flushed, len(writes))
            if number == last or (not writes[number].flags & FUA and chance.random() < 0.5)
        }
        shutil.copyfile(self._before, self.image)
        with self.image.open("r+b") as file:
            for number, one in enumerate(writes):
                if number not in lost:
                    file.seek(one.begin)
                    file.write(one.data)
        return Cut(len(writes), len(writes) - flushed, len(lost))

    def _writes(self) -> Iterator[Write]:
        """The log's entries; the count in its head may be older than the last ones."""
        with self._log.open("rb") as log:
            magic, _, _, sector_bytes = SUPER.unpack(log.read(SUPER.size))
            assert (magic, sector_bytes) == (MAGIC, SECTOR)
            log.seek(SECTOR)
            while True:
                begin, count, flags, _ = ENTRY.unpack(log.read(SECTOR)[: ENTRY.size])
                if not count and not flags:
                    return
                data = b"" if flags & DISCARD else log.read(count * SECTOR)
                yield Write(begin * SECTOR, data, flags)
