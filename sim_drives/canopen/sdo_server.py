"""The SDO server of one node (CiA 301 7.2.4): receives eight-byte requests, sends answers.

Rules:
1. Up to four bytes travel expedited, more in segments (`sdo_segments.py`), many in blocks
   (`sdo_block.py`).
2. A new initiate of either kind replaces an unfinished transfer, except while the sub-block of a
   block download is coming, when every request is one of its segments.
3. Every abort carries the index and sub-index of the transfer that it ends; for a segment without
   a transfer, those of the last transfer.
4. After any abort, by either side, the server is idle. A client's abort is not answered.
5. A transfer whose client sends nothing for TIMEOUT_NS is aborted: 05040000.
6. A request that is not eight bytes long is not answered.
"""

from collections.abc import Mapping
from enum import IntEnum
from functools import partial
from types import MappingProxyType
from typing import Final

from drives.canopen.frame import Frame
from sim_drives.canopen.aborts import AbortCode, SdoAbortError
from sim_drives.canopen.context import NodeContext
from sim_drives.canopen.dictionary import Address, Entry
from sim_drives.canopen.sdo_block import (
    BLOCK_SEGMENTS_MAX,
    BLOCK_STEP_MASK,
    SEGMENT_SPACING_NS,
    BlockDownload,
    BlockStep,
    BlockUpload,
    checked_block_size,
)
from sim_drives.canopen.sdo_segments import (
    REQUEST_BYTES,
    Incoming,
    SegmentedDownload,
    SegmentedUpload,
)
from sim_drives.canopen.timers import MILLISECOND

SDO_REQUEST_ID: Final = 0x600
SDO_ANSWER_ID: Final = 0x580
TIMEOUT_NS: Final = 1000 * MILLISECOND
ABORT: Final = 0x80
_EXPEDITED: Final = 0x02
_SIZE_INDICATED: Final = 0x01
_BLOCK_SIZE_INDICATED: Final = 0x02
_BLOCK_CRC: Final = 0x04
_BLOCK_DOWNLOAD_END: Final = 0x01


class _Command(IntEnum):
    """Client command specifiers: the upper three bits of the first byte."""

    DOWNLOAD_SEGMENT = 0
    DOWNLOAD_INITIATE = 1
    UPLOAD_INITIATE = 2
    UPLOAD_SEGMENT = 3
    ABORT = 4
    BLOCK_UPLOAD = 5
    BLOCK_DOWNLOAD = 6
    RESERVED = 7


Transfer = SegmentedDownload | SegmentedUpload | BlockDownload | BlockUpload
TRANSFER_OF: Final[Mapping[_Command, type[Transfer]]] = MappingProxyType(
    {
        _Command.DOWNLOAD_SEGMENT: SegmentedDownload,
        _Command.UPLOAD_SEGMENT: SegmentedUpload,
        _Command.BLOCK_DOWNLOAD: BlockDownload,
        _Command.BLOCK_UPLOAD: BlockUpload,
    }
)
"""The transfer that a request continues, if it does not begin one."""


class SdoServer:
    """Serves one dictionary to one client at a time."""

    def __init__(self, node_id: int, context: NodeContext) -> None:
        self._answer_id = SDO_ANSWER_ID + node_id
        self._dictionary, self._line, self._timers = context
        self._address: Address = (0, 0)
        self._transfer: Transfer | None = None

    def reset(self) -> None:
        """Drop the transfer: the service is no longer available."""
        self._transfer = None
        self._timers.cancel(SdoServer)

    def receive(self, request: bytes) -> None:
        """Process one request, and send its answer if it has one."""
        if len(request) != REQUEST_BYTES:
            return
        if self._is_abort(request[0]):
            self.reset()
            return
        try:
            answer = self._serve(request)
        except SdoAbortError as abort:
            self._abort(abort.code)
            return
        if answer is not None:
            self._send(answer)
        self._go_on()

    def _is_abort(self, head: int) -> bool:
        everything_is_a_segment = self._transfer is not None and self._transfer.takes_every_request
        return head == ABORT if everything_is_a_segment else head >> 5 == _Command.ABORT

    def _serve(self, request: bytes) -> bytes | None:
        transfer = self._transfer
        if transfer is not None and transfer.takes_every_request:
            return transfer.feed(request)
        command = _Command(request[0] >> 5)
        match command:
            case _Command.DOWNLOAD_INITIATE:
                return self._initiate_download(request)
            case _Command.UPLOAD_INITIATE:
                return self._initiate_upload(request)
            case _Command.BLOCK_DOWNLOAD if not request[0] & _BLOCK_DOWNLOAD_END:
                return self._initiate_block_download(request)
            case _Command.BLOCK_UPLOAD if request[0] & BLOCK_STEP_MASK == BlockStep.INITIATE:
                return self._initiate_block_upload(request)
            case _Command.RESERVED:
                self._address = _address(request)
                raise SdoAbortError(AbortCode.COMMAND_SPECIFIER)
            case _:
                if transfer is None or not isinstance(transfer, TRANSFER_OF[command]):
                    raise SdoAbortError(AbortCode.COMMAND_SPECIFIER)
                return transfer.feed(request)

    # --- after a request --------------------------------------------------------------------------

    def _go_on(self) -> None:
        """Send the next segment of a block, or wait for the client (rule 5)."""
        transfer, now_ns = self._transfer, self._line.now_ns
        if transfer is None or transfer.done:
            self.reset()
        elif isinstance(transfer, BlockUpload) and transfer.sending:
            self._send(transfer.next_segment())
            self._timers.start(SdoServer, now_ns + SEGMENT_SPACING_NS, self._go_on)
        else:
            self._timers.start(
                SdoServer, now_ns + TIMEOUT_NS, lambda: self._abort(AbortCode.TIMEOUT)
            )

    def _abort(self, code: AbortCode) -> None:
        self.reset()
        self._send(self._initiated(ABORT, code.to_bytes(4, "little")))

    def _send(self, answer: bytes) -> None:
        self._line.send(Frame(self._answer_id, answer))

    def _initiated(self, command: int, payload: bytes = b"") -> bytes:
        index, subindex = self._address
        head = bytes((command, index & 0xFF, index >> 8, subindex))
        return head + payload.ljust(4, b"\0")

    # --- initiates --------------------------------------------------------------------------------

    def _begin(self, request: bytes) -> None:
        self._address, self._transfer = _address(request), None

    def _initiate_upload(self, request: bytes) -> bytes:
        self._begin(request)
        return self._upload(self._dictionary.upload(*self._address))

    def _upload(self, data: bytes) -> bytes:
        if 0 < len(data) <= 4:
            return self._initiated(0x43 | (4 - len(data)) << 2, data)
        self._transfer = SegmentedUpload(data)
        return self._initiated(0x41, len(data).to_bytes(4, "little"))

    def _initiate_block_upload(self, request: bytes) -> bytes:
        self._begin(request)
        block_size, threshold_bytes = checked_block_size(request[4]), request[5]
        data = self._dictionary.upload(*self._address)
        if threshold_bytes and len(data) <= threshold_bytes:
            return self._upload(data)
        self._transfer = BlockUpload(data, block_size, with_crc=bool(request[0] & _BLOCK_CRC))
        return self._initiated(
            0xC0 | _BLOCK_CRC | _BLOCK_SIZE_INDICATED, len(data).to_bytes(4, "little")
        )

    def _initiate_download(self, request: bytes) -> bytes:
        self._begin(request)
        if request[0] & _EXPEDITED:
            self._dictionary.download(*self._address, self._expedited_data(request))
        else:
            incoming = self._incoming(request, indicated=bool(request[0] & _SIZE_INDICATED))
            self._transfer = SegmentedDownload(incoming)
        return self._initiated(0x60)

    def _initiate_block_download(self, request: bytes) -> bytes:
        self._begin(request)
        incoming = self._incoming(request, indicated=bool(request[0] & _BLOCK_SIZE_INDICATED))
        self._transfer = BlockDownload(incoming, with_crc=bool(request[0] & _BLOCK_CRC))
        return self._initiated(0xA0 | _BLOCK_CRC, bytes((BLOCK_SEGMENTS_MAX,)))

    def _incoming(self, request: bytes, *, indicated: bool) -> Incoming:
        return Incoming(
            self._entry(),
            int.from_bytes(request[4:8], "little") if indicated else None,
            partial(self._dictionary.download, *self._address),
        )

    def _expedited_data(self, request: bytes) -> bytes:
        if request[0] & _SIZE_INDICATED:
            return request[4 : 8 - (request[0] >> 2 & 3)]
        return request[
            4 : 4 + (self._entry().size_bytes or 4)
        ]  # not given: the object's own length

    def _entry(self) -> Entry:
        return self._dictionary.entry(*self._address)


def _address(request: bytes) -> Address:
    return int.from_bytes(request[1:3], "little"), request[3]
