"""Segmented SDO transfer of one node, and the parts common to all downloads (CiA 301 7.2.4.3.4, 6).

Rules:
1. Segments carry up to seven bytes, with a toggle bit that alternates from 0. A wrong toggle bit is
   05030000.
2. A length that the object cannot have is aborted as soon as it is known, announced or not
   (`Entry.check_length`). A length other than announced is 06070010, and nothing is stored.
"""

from collections.abc import Callable
from typing import Final

from sim_drives.canopen.aborts import AbortCode, SdoAbortError
from sim_drives.canopen.dictionary import Entry

REQUEST_BYTES: Final = 8
SEGMENT_BYTES: Final = 7
_TOGGLE: Final = 0x10
_LAST: Final = 0x01


class Incoming:
    """Collects the bytes of a download until they are complete."""

    def __init__(
        self, entry: Entry, announced_bytes: int | None, store: Callable[[bytes], None]
    ) -> None:
        """Start a download; `store` receives the complete data, and may abort.

        Raises:
            SdoAbortError: the entry cannot be written, or not with that length.
        """
        if not entry.writable:
            raise SdoAbortError(AbortCode.READ_ONLY)
        if announced_bytes is not None:
            entry.check_length(announced_bytes)
        self._entry = entry
        self._announced_bytes = announced_bytes
        self._store = store
        self.data = bytearray()

    def take(self, part: bytes) -> None:
        """Add the bytes of one segment; up to six of a block's last one may be unused."""
        self.data += part
        if len(self.data) >= self._entry.max_bytes + SEGMENT_BYTES:
            self._entry.check_length(len(self.data))

    def drop(self, count: int) -> None:
        """Remove the last `count` bytes, which are unused."""
        if count:
            del self.data[-count:]

    def store(self) -> None:
        """Store the complete data (rule 2)."""
        if self._announced_bytes not in (None, len(self.data)):
            raise SdoAbortError(AbortCode.LENGTH)
        self._store(bytes(self.data))


def _check_toggle(request: bytes, toggle: int) -> None:
    if request[0] & _TOGGLE != toggle:
        raise SdoAbortError(AbortCode.TOGGLE_BIT)


class SegmentedDownload:
    """The receiving side of a segmented download, after its initiation."""

    takes_every_request = False

    def __init__(self, incoming: Incoming) -> None:
        self._incoming = incoming
        self._toggle = 0
        self.done = False

    def feed(self, request: bytes) -> bytes:
        """Process one segment; return its answer."""
        _check_toggle(request, self._toggle)
        unused = request[0] >> 1 & 7
        self._incoming.take(request[1 : REQUEST_BYTES - unused])
        answer = bytes((0x20 | self._toggle,)) + bytes(SEGMENT_BYTES)
        self._toggle ^= _TOGGLE
        if request[0] & _LAST:
            self.done = True
            self._incoming.store()
        return answer


class SegmentedUpload:
    """The sending side of a segmented upload, after its initiation."""

    takes_every_request = False

    def __init__(self, data: bytes) -> None:
        self._rest = data
        self._toggle = 0
        self.done = False

    def feed(self, request: bytes) -> bytes:
        """Process one request; return its segment."""
        _check_toggle(request, self._toggle)
        part, self._rest = self._rest[:SEGMENT_BYTES], self._rest[SEGMENT_BYTES:]
        self.done = not self._rest
        command = self._toggle | (SEGMENT_BYTES - len(part)) << 1 | (_LAST * self.done)
        self._toggle ^= _TOGGLE
        return bytes((command,)) + part.ljust(SEGMENT_BYTES, b"\0")
