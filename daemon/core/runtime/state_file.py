"""The state file of the persistent state: read once, written through a memory mapping.

The file is one page of JSON, filled up with spaces. While the core runs, a write goes to the page
cache, which outlives this process; the gateway flushes it to the disk
(`recorder/state_file_sync.py`), and so does `close`. A power cut before that leaves an older page.
An older pose disagrees with the encoder: the axis is referenced again. An older page from a time in
which drives were enabled contains LAST_END_UNKNOWN (`latched_stop.py`), and an unreadable page is
treated in the same way: no wrong pose is accepted, and no stop is lost.

The first write after a flush may have to wait for the file system: 1 ms on an idle system, 100 ms
beside a process that writes much. So while the drives are enabled only the stop that ends this is
written, and only after its frames have been sent.
"""

import mmap
import os
from pathlib import Path
from typing import Final, Protocol

import msgspec

from daemon.core.modes.persistent_state import FORMAT, UNREADABLE, PersistentState
from daemon.ipc.decoding import Decoder, RefusedError
from daemon.ipc.state_file import NAME, SIZE
from daemon.system.files import sync_folder

DECODER: Final = Decoder(msgspec.json.Decoder(PersistentState).decode)


class StateStore(Protocol):
    """Interface of the state file for the loop: `StateFile`, or a list in a test."""

    def write(self, persistent: PersistentState) -> None:
        """Store the persistent state, without waiting."""
        ...


class StateFile:
    """The state file in the state directory."""

    def __init__(self, state: Path) -> None:
        """Read and map the file; a missing or too short file is created or extended.

        Raises:
            OSError: the directory cannot be created or written, or is full.
        """
        state.mkdir(parents=True, exist_ok=True)
        self.path = state / NAME
        self.persistent, new = _read(self.path), not self.path.exists()
        with self.path.open("ab") as file:
            # Allocate all blocks now: writing to a hole on a full disk would kill the process.
            os.posix_fallocate(file.fileno(), 0, SIZE)
        with self.path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), SIZE)
        if new:
            self.write(self.persistent)
            sync_folder(state)  # the gateway syncs the content, not the name

    def write(self, persistent: PersistentState) -> None:
        """As `StateStore.write`.

        Raises:
            ValueError: the state does not fit the page: a programming error.
        """
        text = msgspec.json.encode(persistent)
        if len(text) >= SIZE:
            raise ValueError(f"axis notes of {len(text)} bytes do not fit {SIZE}")
        self._map[:SIZE] = text.ljust(SIZE - 1) + b"\n"

    def close(self) -> None:
        """Flush the file to the disk and unmap it."""
        self._map.flush()
        self._map.close()


def _read(path: Path) -> PersistentState:
    if not path.exists():
        return PersistentState()
    try:
        persistent = DECODER.decode(path.read_bytes().strip(b"\0 \n"))
    except RefusedError:
        return UNREADABLE
    return persistent if persistent.format == FORMAT else UNREADABLE
