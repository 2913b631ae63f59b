"""The file of the axis notes: read once, written through a mapping.

The file is one page of JSON, filled up with spaces. While the core runs, a write goes to the page
cache, which outlives this process; the gateway brings it to the disk
(`recorder/state_file_sync.py`), and `close` does. A power cut before that leaves an older page. An
older pose is one that the encoder disagrees with: the axis is referenced again. An older page of a
time in which drives were enabled says that nobody knows how it ended (`latching.py`), and a page
that cannot be read says so too: nothing is believed that is not so, and no stop is forgotten.

The first write after the page was brought to the disk may have to wait for the file system: 1 ms
where it is quiet, 100 ms beside somebody who writes much. So while the drives are enabled one thing
alone is written, the stop that ends it, and only when its frames have left.
"""

import mmap
import os
from pathlib import Path
from typing import Final, Protocol

import msgspec

from daemon.core.modes.persistent_state import FORMAT, UNREADABLE, Notes
from daemon.ipc.decoding import Decoder, RefusedError
from daemon.ipc.state_file import NAME, SIZE

NOTES: Final = Decoder(msgspec.json.Decoder(Notes).decode)


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
            OSError: the directory cannot be made or written, or is full.
        """
        state.mkdir(parents=True, exist_ok=True)
        self.path = state / NAME
        self.notes, new = _read(self.path), not self.path.exists()
        with self.path.open("ab") as file:
            # All of it now: a hole that finds the disk full later kills who writes into it.
            os.posix_fallocate(file.fileno(), 0, SIZE)
        with self.path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), SIZE)
        if new:
            self.write(self.notes)

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
    try:
        notes = NOTES.decode(path.read_bytes().strip(b"\0 \n"))
    except RefusedError:
        return UNREADABLE
    return notes if notes.format == FORMAT else UNREADABLE
