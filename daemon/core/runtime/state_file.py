"""The state file of the persistent state: read once, written through a memory mapping.

The file is two pages. Each is one line of JSON, filled up with spaces: a number, a checksum, and
the state. The page with the highest number is valid. While the core runs, a write goes to the page
cache, which outlives this process; the gateway flushes it to the disk
(`recorder/state_file_sync.py`), and so does `close`.

A power cut before that leaves, of each 512 bytes, the old ones or the new ones. So:

1.  A page is torn or whole, and its checksum tells which.
2.  The other page is left as it is until this one has rested for SETTLED_NS: the gateway has
    flushed it then, unless the disk is broken. Until then the newest page is written again and
    again. So at most one page is torn.
3.  Beside a torn page the other one is used, and LAST_END_UNKNOWN is latched unless that page has
    a stop. If no page can be read, nothing is known, and LAST_END_UNKNOWN is latched, too.
4.  A page that did not come to the disk at all leaves an older one. It is safe as well: a page
    from a time in which drives were enabled contains LAST_END_UNKNOWN (`latched_stop.py`), and an
    older pose disagrees with the encoder, so that the axis is referenced again.

The first write after a flush may have to wait for the file system: 1 ms on an idle system, 100 ms
beside a process that writes much. So while the drives are enabled only the stop that ends this is
written, and only after its frames have been sent.
"""

import mmap
import os
from pathlib import Path
from typing import Final, NamedTuple, Protocol
from zlib import crc32

import msgspec
from msgspec.structs import replace

from daemon.core.modes.persistent_state import FORMAT, TORN, UNREADABLE, PersistentState
from daemon.ipc.decoding import Count, Decoder, RefusedError
from daemon.ipc.state_file import NAME, PAGE_COUNT, PAGE_SIZE, SIZE
from daemon.system.files import make_folder, sync_folder

SETTLED_NS: Final = 1_000_000_000
"""Time after which a page counts as flushed: the gateway looks five times a second."""


class Page(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A page of the file."""

    number: Count
    crc32: Count
    """Checksum of `number state`, as in the file."""
    state: msgspec.Raw


DECODER: Final = Decoder(msgspec.json.Decoder(PersistentState).decode)
_PAGES: Final = Decoder(msgspec.json.Decoder(Page).decode)


class StateStore(Protocol):
    """Interface of the state file for the loop: `StateFile`, or a list in a test."""

    def write(self, persistent: PersistentState, now_ns: int) -> None:
        """Store the persistent state, without waiting; `now_ns` is monotonic."""
        ...


class StateFile:
    """The state file in the state directory."""

    def __init__(self, state: Path) -> None:
        """Read and map the file; a missing or too short file is created or extended.

        Raises:
            OSError: the directory cannot be created or written, or is full.
        """
        make_folder(state)
        self.path = state / NAME
        is_new = not self.path.exists()
        found = _Found(PersistentState()) if is_new else _read(self.path)
        self.persistent, self._number, self._index, unreadable = found
        self._written_ns: int | None = None
        with self.path.open("ab") as file:
            # Allocate all blocks now: writing to a hole on a full disk would kill the process.
            os.posix_fallocate(file.fileno(), 0, SIZE)
        with self.path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), SIZE)
        for index in range(PAGE_COUNT) if is_new else unreadable:
            self._put(index, self.persistent)
        if is_new:
            self._map.flush()
            sync_folder(state)  # the gateway syncs the content, not the name

    def write(self, persistent: PersistentState, now_ns: int) -> None:
        """As `StateStore.write`.

        Raises:
            ValueError: the state does not fit the page: a programming error.
        """
        has_settled = self._written_ns is None or now_ns - self._written_ns >= SETTLED_NS
        self._written_ns = now_ns
        self._put((self._index + has_settled) % PAGE_COUNT, persistent)

    def _put(self, index: int, persistent: PersistentState) -> None:
        self._index, self._number = index, self._number + 1
        state = msgspec.json.encode(persistent)
        page = Page(self._number, _checksum(self._number, state), msgspec.Raw(state))
        text = msgspec.json.encode(page)
        if len(text) >= PAGE_SIZE:
            raise ValueError(f"axis notes of {len(text)} bytes do not fit {PAGE_SIZE}")
        begin = index * PAGE_SIZE
        self._map[begin : begin + PAGE_SIZE] = text.ljust(PAGE_SIZE - 1) + b"\n"

    def close(self) -> None:
        """Flush the file to the disk and unmap it."""
        self._map.flush()
        self._map.close()


class _Found(NamedTuple):
    """The newest page that can be read."""

    persistent: PersistentState
    number: int = 0
    page: int = 0
    """The page that it is; the other one is written next."""
    unreadable: tuple[int, ...] = ()
    """Pages that cannot be read."""


def _read(path: Path) -> _Found:
    data = path.read_bytes()
    pages = [data[index * PAGE_SIZE :][:PAGE_SIZE].strip(b"\0 \n") for index in range(PAGE_COUNT)]
    found = [_page(text, index) for index, text in enumerate(pages)]
    unreadable = tuple(index for index in range(PAGE_COUNT) if pages[index] and not found[index])
    newest = max((page for page in found if page), key=lambda page: page.number, default=None)
    if newest is None:
        return _Found(UNREADABLE, unreadable=unreadable)
    if not unreadable:
        return newest
    latched = newest.persistent.latched or TORN
    persistent = replace(newest.persistent, damaged=True, latched=latched)
    return newest._replace(persistent=persistent, unreadable=unreadable)


def _page(text: bytes, index: int) -> _Found | None:
    """One page; None if it is empty, torn, or of another version."""
    try:
        page = _PAGES.decode(text)
        if page.crc32 != _checksum(page.number, bytes(page.state)):
            return None
        persistent = DECODER.decode(bytes(page.state))
    except RefusedError:
        return None
    return _Found(persistent, page.number, index) if persistent.format == FORMAT else None


def _checksum(number: int, state: bytes) -> int:
    return crc32(b"%d %b" % (number, state))
