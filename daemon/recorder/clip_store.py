"""The folder of the black box: adds files atomically and removes the least valuable ones.

A file appears whole or not at all: it is written under another name, synced to the disk, renamed.
When there are too many files, or they are too large together, files in which the drives were never
enabled are removed first, and of these the oldest; the newest file is never removed. A file that
cannot be read is renamed when the gateway starts, and reported.
"""

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

import msgspec

from daemon.ipc.ring_clip import (
    DAMAGED_SUFFIX,
    PART_SUFFIX,
    ClipFile,
    ClipWriter,
    clip_files,
    name_of,
    order_of,
    trimmed,
)
from daemon.ipc.transport import Kept, RingHeader
from daemon.system.files import make_folder, sync_folder

FILES_MAX: Final = 60
BYTES_MAX: Final = 256 * 1024 * 1024
CHUNK_BYTES: Final = 64 * 1024


class ClipStore:
    """The gateway's list of the folder's files. `write` runs in the disk's thread."""

    def __init__(
        self, folder: Path, files_max: int = FILES_MAX, bytes_max: int = BYTES_MAX
    ) -> None:
        """List the existing files; a missing folder is made with the first file."""
        self.folder = folder
        self._files_max, self._bytes_max = files_max, bytes_max
        self._files: tuple[ClipFile, ...] = ()
        self._number = 0
        """Number of the newest file."""
        self.trouble = ""
        self.damaged: list[str] = []
        """Files that cannot be read, and whether they were renamed."""
        try:
            self._files = tuple(map(self._checked, clip_files(folder)))
            self._number = max((file.kept.number for file in self._files if file.kept), default=0)
        except OSError as error:
            self.trouble = f"{folder}: {error.strerror}"

    def _checked(self, file: ClipFile) -> ClipFile:
        """The file, renamed if it cannot be read and has not been renamed before."""
        path = file.path
        if not file.trouble or path.suffix == DAMAGED_SUFFIX:
            return file
        aside = path.with_name(path.name + DAMAGED_SUFFIX)
        what = file.trouble.removeprefix(f"{path}: ")
        try:
            path.rename(aside)
        except OSError as error:
            self.damaged.append(f"{path.name} {what}; it cannot be set aside: {error.strerror}")
            return file
        self.damaged.append(f"{path.name} {what}; it was set aside as {aside.name}")
        return file._replace(path=aside)

    def covers(self, core_boot_id: str, seq: int) -> bool:
        """True if some file holds this record."""
        return any(
            file.core_boot_id == core_boot_id and kept.first_seq <= seq <= kept.last_seq
            for file in self._files
            if (kept := file.kept)
        )

    def write(self, header: RingHeader, kept: Kept, cutting: ClipWriter) -> Path:
        """Write a file into the folder, and remove files beyond the limits.

        Raises:
            OSError: the disk is full, cannot be written, or fails.
        """
        make_folder(self.folder)
        kept = msgspec.structs.replace(kept, number=self._number + 1)
        path = self.folder / name_of(header.core_boot_id, kept)
        header = msgspec.structs.replace(header, kept=kept)
        part = path.with_suffix(PART_SUFFIX)
        try:
            size = _write(part, trimmed(header, cutting))
            part.replace(path)
        except OSError:
            part.unlink(missing_ok=True)
            raise
        sync_folder(self.folder)
        self._number = kept.number
        known = tuple(file for file in self._files if file.path != path)
        self._files = (*known, ClipFile.of(path, size, header))
        self._make_room()
        return path

    def _make_room(self) -> None:
        for part in self.folder.glob(f"*{PART_SUFFIX}"):
            part.unlink(missing_ok=True)
        for file in surplus(self._files, self._files_max, self._bytes_max):
            file.path.unlink(missing_ok=True)
            self._files = tuple(one for one in self._files if one is not file)


def surplus(files: Sequence[ClipFile], files_max: int, bytes_max: int) -> list[ClipFile]:
    """The files to remove so that the others fit; the last of `files` is the newest."""
    count, size = len(files), sum(file.size for file in files)
    gone: list[ClipFile] = []
    for file in sorted(files[:-1], key=_worth):
        if count <= files_max and size <= bytes_max:
            break
        count, size = count - 1, size - file.size
        gone.append(file)
    return gone


def _worth(file: ClipFile) -> tuple[bool, int, str]:
    kept = file.kept
    return (kept is not None and kept.active, *order_of(file))


def _write(path: Path, pieces: Iterable[bytes]) -> int:
    """Write and sync a file in small chunks, so that the loop is not delayed; returns its size."""
    # Records of a patient: for the service's user and group only.
    file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o640)
    try:
        rest = b""
        for piece in pieces:
            rest += piece
            while len(rest) >= CHUNK_BYTES:
                rest = rest[os.write(file, rest) :]
        while rest:
            rest = rest[os.write(file, rest) :]
        os.fsync(file)
        return os.fstat(file).st_size
    finally:
        os.close(file)
