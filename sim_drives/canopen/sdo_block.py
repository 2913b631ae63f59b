"""SDO block transfer of one node: many segments, one acknowledgement (CiA 301 7.2.4.3.9 to 15).

Rules, both directions:
1. A sub-block has up to 127 segments of seven bytes, numbered from 1; bit 7 of the number marks the
   last segment of all. The receiver of a sub-block answers with the last number up to which all
   came, and with the size of the next sub-block; segments after that number are sent again,
   numbered from 1.
2. A block size of 0 or above 127 is 05040002. An impossible number is 05040003: for a segment, 0;
   for an acknowledgement, above what has been sent.
3. The CRC (polynomial 1021h, from 0) covers the data alone, and is used if both sides support it.
   A wrong one is 05040004.
Download:
4. While a sub-block is coming, every request but an abort (80h) is one of its segments. One out of
   turn is ignored. The sub-block ends with its last number or with the last segment of all.
5. The end request gives the number of unused bytes in the last segment; only then is the value
   stored.
Upload:
6. Up to the client's protocol switch threshold (0: none), the data go by the ordinary upload.
7. Segments leave SEGMENT_SPACING_NS apart. An acknowledgement that comes early ends the sub-block.
"""

import binascii
import math
from enum import IntEnum
from typing import Final

from sim_drives.canopen.aborts import AbortCode, SdoAbortError
from sim_drives.canopen.sdo_segments import REQUEST_BYTES, SEGMENT_BYTES, Incoming

BLOCK_SEGMENTS_MAX: Final = 127
SEGMENT_SPACING_NS: Final = 200_000
"""Slightly longer than one frame at 1 Mbit/s."""
_LAST: Final = 0x80
_NUMBER: Final = 0x7F


class BlockStep(IntEnum):
    """Lowest two bits of a block transfer's first byte, in both directions."""

    INITIATE = 0
    END = 1
    ACKNOWLEDGE = 2
    START = 3


BLOCK_STEP_MASK: Final = 0x03


def checked_block_size(size: int) -> int:
    """Return the number of segments that a client requests (rule 2)."""
    if not 1 <= size <= BLOCK_SEGMENTS_MAX:
        raise SdoAbortError(AbortCode.BLOCK_SIZE)
    return size


def crc(data: bytes | bytearray) -> int:
    """Compute the CRC of rule 3."""
    return binascii.crc_hqx(data, 0)


class BlockDownload:
    """The receiving side of one block download, after its initiation."""

    def __init__(self, incoming: Incoming, *, with_crc: bool) -> None:
        self._incoming = incoming
        self._with_crc = with_crc
        self._number = 0
        """Number of the last segment of this sub-block that came in sequence."""
        self._all_here = False
        self.done = False

    @property
    def takes_every_request(self) -> bool:
        """True while every request is a segment (rule 4)."""
        return not self._all_here

    def feed(self, request: bytes) -> bytes | None:
        """Process one request of this transfer; return the answer, if there is one."""
        return self._end(request) if self._all_here else self._segment(request)

    def _segment(self, request: bytes) -> bytes | None:
        number, last = request[0] & _NUMBER, bool(request[0] & _LAST)
        if number == 0:
            raise SdoAbortError(AbortCode.SEQUENCE_NUMBER)
        if number == self._number + 1:
            self._number = number
            self._all_here = last
            self._incoming.take(request[1:])
        if not last and number < BLOCK_SEGMENTS_MAX:
            return None
        acknowledged, self._number = self._number, 0
        return bytes((0xA0 | BlockStep.ACKNOWLEDGE, acknowledged, BLOCK_SEGMENTS_MAX)) + bytes(5)

    def _end(self, request: bytes) -> bytes:
        self.done = True
        self._incoming.drop(request[0] >> 2 & 7)
        if self._with_crc and crc(self._incoming.data) != int.from_bytes(request[1:3], "little"):
            raise SdoAbortError(AbortCode.CRC)
        self._incoming.store()
        return bytes((0xA0 | BlockStep.END,)) + bytes(7)


class BlockUpload:
    """The sending side of one block upload, after its initiation."""

    takes_every_request = False

    def __init__(self, data: bytes, block_size: int, *, with_crc: bool) -> None:
        self._data = data
        self._crc = crc(data) if with_crc else 0
        self._segments = max(1, math.ceil(len(data) / SEGMENT_BYTES))
        self._block_size = block_size
        self._acknowledged = 0
        """Number of segments, over all sub-blocks, that the client has acknowledged."""
        self._sent: int | None = None
        """Number of segments of this sub-block; None before the start and after the end."""
        self.done = False

    @property
    def sending(self) -> bool:
        """True while a segment of this sub-block is still to be sent."""
        if self._sent is None:
            return False
        return self._sent < min(self._block_size, self._segments - self._acknowledged)

    def next_segment(self) -> bytes:
        """Return the next segment; only while `sending`."""
        sent = self._sent or 0
        at = self._acknowledged + sent
        self._sent = sent + 1
        last = _LAST * (at + 1 == self._segments)
        part = self._data[at * SEGMENT_BYTES : (at + 1) * SEGMENT_BYTES]
        return bytes((last | self._sent,)) + part.ljust(SEGMENT_BYTES, b"\0")

    def feed(self, request: bytes) -> bytes | None:
        """Process one request of this transfer; return the answer, unless it is segments."""
        ended = self._acknowledged == self._segments
        match request[0] & BLOCK_STEP_MASK:
            case BlockStep.START if self._sent is None and not ended:
                self._sent = 0
            case BlockStep.ACKNOWLEDGE if self._sent is not None:
                return self._acknowledge(self._sent, request[1], request[2])
            case BlockStep.END if ended:
                self.done = True
            case _:
                raise SdoAbortError(AbortCode.COMMAND_SPECIFIER)
        return None

    def _acknowledge(self, sent: int, number: int, block_size: int) -> bytes | None:
        if number > sent:
            raise SdoAbortError(AbortCode.SEQUENCE_NUMBER)
        self._block_size = checked_block_size(block_size)
        self._acknowledged += number
        self._sent = 0
        if self._acknowledged < self._segments:
            return None
        self._sent = None
        unused = self._segments * SEGMENT_BYTES - len(self._data)
        head = bytes((0xC0 | unused << 2 | BlockStep.END,)) + self._crc.to_bytes(2, "little")
        return head.ljust(REQUEST_BYTES, b"\0")
