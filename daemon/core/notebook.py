"""The file of the axis notes: read once, written through a mapping, so no cycle waits for a disk.

The file is one page of JSON, filled up with spaces. While the core runs, a write goes to the page
cache; `close` brings it to the disk. A power cut before that leaves an older pose, with which the
encoder then disagrees: the axis is referenced again, and nothing is believed that is not so.
"""

import mmap
from pathlib import Path
from typing import Final, Protocol

import msgspec

from daemon.core.axis_notes import FORMAT, Notes

NAME: Final = "axes.json"
SIZE: Final = 8192


class NoteKeeper(Protocol):
    """What the loop needs: `Notebook`, or a list in a test."""

    def write(self, notes: Notes) -> None:
        """Keep them, without waiting."""
        ...


class Notebook:
    """The file in the state directory."""

    def __init__(self, state: Path) -> None:
        """Read and map the file; one that is missing or too short is made.

        Raises:
            OSError: the directory cannot be made or written.
        """
        state.mkdir(parents=True, exist_ok=True)
        self.path = state / NAME
        self.notes = _read(self.path)
        with self.path.open("ab") as file:
            file.truncate(max(file.tell(), SIZE))
        with self.path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), SIZE)

    def write(self, notes: Notes) -> None:
        """As `NoteKeeper.write`.

        Raises:
            ValueError: our own bug: they do not fit the page.
        """
        text = msgspec.json.encode(notes)
        if len(text) >= SIZE:
            raise ValueError(f"axis notes of {len(text)} bytes do not fit {SIZE}")
        self._map[:SIZE] = text.ljust(SIZE - 1) + b"\n"

    def close(self) -> None:
        """Bring it to the disk and let go."""
        self._map.flush()
        self._map.close()


def _read(path: Path) -> Notes:
    if not path.exists():
        return Notes()
    text = path.read_bytes().strip(b"\0 \n")
    if not text:
        return Notes()
    try:
        notes = msgspec.json.decode(text, type=Notes)
    except (msgspec.MsgspecError, UnicodeDecodeError):
        return Notes(damaged=True)
    return notes if notes.format == FORMAT else Notes(damaged=True)
