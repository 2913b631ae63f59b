"""The file of the request log: lines of JSON are appended and never changed.

Lines wait in memory until the disk's thread has written them and called fsync, all waiting lines
together. Bytes that a full disk did not take are tried again with the next lines. Lines are lost
only when too many wait.

When a file is large enough it is renamed with a number (`requests.000001.jsonl`) and a new one
begins. The oldest files are removed.

A power cut may leave the last line torn: it is not JSON, and the next gateway begins a new line
after it. Lines have no hashes. A chain of hashes without a key is no proof, because anyone who can
write the file can compute it again; where proof is needed, forward the lines to another computer.
"""

import os
import re
from collections import deque
from pathlib import Path
from typing import Any, Final

import msgspec

from daemon.ipc.decoding import Decoder, RefusedError
from daemon.system.files import make_folder, sync_folder

ANYTHING: Final[Decoder[Any]] = Decoder(msgspec.json.decode)
"""Decoder of JSON of any form."""
NAME: Final = "requests.jsonl"
FILE_BYTES_MAX: Final = 4 * 1024 * 1024
FILES_MAX: Final = 25
LINES_WAITING_MAX: Final = 20_000
LINES_AT_ONCE: Final = 1000

_NUMBERED: Final = re.compile(r"requests\.(\d{6,9})\.jsonl", re.ASCII)


def numbered(folder: Path) -> list[Path]:
    """The files that are full, oldest first; files with other names are ignored."""
    ours = (path for path in folder.glob("requests.*.jsonl") if _NUMBERED.fullmatch(path.name))
    return sorted(ours, key=_number_of)


def _number_of(path: Path) -> int:
    return int(path.name.split(".")[1])


def files_of(folder: Path) -> list[Path]:
    """All files of a log, oldest first."""
    newest = folder / NAME
    return [*numbered(folder), *([newest] if newest.exists() else [])]


def lines_of(folder: Path) -> list[bytes]:
    """All lines of a log; the last one of a gateway may be torn.

    Raises:
        OSError: a file cannot be read.
    """
    return [line for path in files_of(folder) for line in path.read_bytes().splitlines()]


def fields_of(line: bytes) -> dict[str, Any] | None:
    """The fields of a line; None if it is torn."""
    try:
        found = ANYTHING.decode(line)
    except RefusedError:
        return None
    return found if isinstance(found, dict) else None


class RequestFile:
    """The log's files. `add` is called in the loop, `flush` in the disk's thread."""

    def __init__(
        self, folder: Path, bytes_max: int = FILE_BYTES_MAX, files_max: int = FILES_MAX
    ) -> None:
        self._folder, self._path = folder, folder / NAME
        self._bytes_max, self._files_max = bytes_max, files_max
        self._waiting: deque[bytes] = deque()
        self._rest = b""
        """Lines taken from those that wait, whose bytes are not all in the file yet."""
        self._file = -1

    def add(self, line: bytes) -> None:
        """Add a line to those that wait."""
        self._waiting.append(line)

    @property
    def has_room(self) -> bool:
        """True if another line may wait."""
        return len(self._waiting) < LINES_WAITING_MAX

    @property
    def waits(self) -> bool:
        """True if there is something to flush."""
        return bool(self._waiting or self._rest)

    def flush(self) -> None:
        """Write the lines that wait, and sync them to the disk.

        Raises:
            OSError: the disk is full, cannot be written, or fails; no line is lost by that.
        """
        while self.waits:
            if not self._rest:
                self._open()
                count = min(len(self._waiting), LINES_AT_ONCE)
                lines = b"".join(self._waiting.popleft() + b"\n" for _ in range(count))
                self._rest = lines if self._is_ended() else b"\n" + lines
            while self._rest:
                self._rest = self._rest[os.write(self._file, self._rest) :]
            os.fsync(self._file)

    def close(self) -> None:
        """Close the file; only when no flush runs any more."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _open(self) -> None:
        """Open the file; a new one if it is full or has been moved away."""
        if self._file >= 0:
            now = os.fstat(self._file)
            if now.st_nlink and now.st_size < self._bytes_max:
                return
            self.close()
        make_folder(self._folder)
        if self._path.exists() and self._path.stat().st_size >= self._bytes_max:
            self._number()
        flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC
        self._file = os.open(self._path, flags, 0o640)
        sync_folder(self._folder)

    def _is_ended(self) -> bool:
        """True if the file is empty or ends with a newline, as it does unless a line is torn."""
        size = os.fstat(self._file).st_size
        return not size or os.pread(self._file, 1, size - 1) == b"\n"

    def _number(self) -> None:
        full = numbered(self._folder)
        number = _number_of(full[-1]) + 1 if full else 1
        self._path.rename(self._folder / f"requests.{number:06d}.jsonl")
        for path in full[: len(full) + 2 - self._files_max]:
            path.unlink()
