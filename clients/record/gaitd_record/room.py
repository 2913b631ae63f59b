"""The limit of a folder of recordings, and what happens at the limit or on a full disk."""

import contextlib
import os
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import Final, NamedTuple

from gaitd_record.errors import FullError
from gaitd_record.finish import remove
from gaitd_record.leg_table import STREAM
from gaitd_record.recording import MESSAGES, PART

BYTES_PER_MB: Final = 1_000_000
FREE_MIN_MB: Final = 64
"""Free space of the disk; less is as a full one, so that a recording can still be finished."""


class WhenFull(StrEnum):
    """What happens at the limit."""

    END = "end"
    """The recording ends; nothing is deleted."""
    DELETE_OLDEST = "delete-oldest"
    """Finished recordings are deleted, the oldest first."""


class Room(NamedTuple):
    """Room for recordings."""

    folder: Path
    limit_mb: int
    """Size of all recordings in the folder together."""
    when_full: WhenFull = WhenFull.END

    def check(self) -> list[Path]:
        """Make room where that is wanted.

        Returns: the recordings that were deleted.

        Raises:
            FullError: there is none; with its reason.
        """
        deleted: list[Path] = []
        while lack := self._lack():
            oldest = self._oldest() if self.when_full is WhenFull.DELETE_OLDEST else None
            if oldest is None:
                raise FullError(f"{self.folder}: {lack}")
            remove(oldest)
            deleted.append(oldest)
        return deleted

    def _lack(self) -> str:
        """Return why there is no room; empty: there is."""
        sizes = {file: found.st_size for file, found in self._files()}
        # At the end the estimates are on the disk twice for some seconds.
        twice = sum(size for file, size in sizes.items() if file.suffix == STREAM)
        total_mb = (sum(sizes.values()) + twice) / BYTES_PER_MB
        if total_mb > self.limit_mb:
            return f"its recordings have {total_mb:.0f} MB, allowed are {self.limit_mb} MB"
        disk = os.statvfs(self.folder)
        free_mb = (disk.f_bavail * disk.f_frsize - twice) / BYTES_PER_MB
        if free_mb < FREE_MIN_MB:
            return (
                f"its disk has {free_mb:.0f} MB for recordings, at least {FREE_MIN_MB} are needed"
            )
        return ""

    def _oldest(self) -> Path | None:
        finished = {
            file.parent: found.st_mtime_ns
            for file, found in self._files()
            if file.name == MESSAGES and not file.parent.name.endswith(PART)
        }
        return min(finished, key=finished.__getitem__, default=None)

    def _files(self) -> Iterator[tuple[Path, os.stat_result]]:
        """Yield the files of all recordings; one that is being finished changes meanwhile."""
        for folder, _, names in os.walk(self.folder):
            for name in names if MESSAGES in names else ():
                file = Path(folder) / name
                with contextlib.suppress(FileNotFoundError):
                    yield file, file.stat()
