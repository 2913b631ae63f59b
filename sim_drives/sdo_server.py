"""The SDO server of one node: a request of eight bytes in, at most one answer out (CiA 301 7.2.4).

Rules:
1. Up to four bytes travel expedited, more in segments of seven with an alternating toggle bit.
2. A new initiate of either kind replaces a transfer that has not ended.
3. Block transfer is not supported: 05040001.
4. Every abort carries the index and sub-index of the transfer that it ends; when a segment comes
   that belongs to none, those of the last transfer.
5. After any abort, of either side, the server is free.
6. A toggle bit out of turn is 05030000. Data of another length than announced is 06070010.
"""

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final

from sim_drives.aborts import AbortCode, SdoAbortError
from sim_drives.dictionary import STRING_MAX_BYTES, Address, ObjectDictionary

REQUEST_BYTES: Final = 8
SEGMENT_BYTES: Final = 7
_TOGGLE: Final = 0x10
_EXPEDITED: Final = 0x02
_SIZE_INDICATED: Final = 0x01
_LAST_SEGMENT: Final = 0x01


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


@dataclass(slots=True)
class _Transfer:
    """A segmented transfer under way."""

    download: bool
    data: bytearray = field(default_factory=bytearray)
    """Received so far, or still to be sent."""
    announced_bytes: int | None = None
    toggle: int = 0


class SdoServer:
    """Serves one dictionary to one client at a time."""

    def __init__(self, dictionary: ObjectDictionary) -> None:
        self._dictionary = dictionary
        self._address: Address = (0, 0)
        self._transfer: _Transfer | None = None

    def reset(self) -> None:
        """Forget a transfer: the node has been reset."""
        self._transfer = None

    def feed(self, request: bytes) -> bytes | None:
        """Answer one request; None for a client's abort and for what is not eight bytes long."""
        if len(request) != REQUEST_BYTES:
            return None
        command = _Command(request[0] >> 5)
        if command is _Command.ABORT:
            self._transfer = None
            return None
        try:
            return self._serve(command, request)
        except SdoAbortError as abort:
            self._transfer = None
            return self._abort(abort.code)

    def _serve(self, command: _Command, request: bytes) -> bytes:
        match command:
            case _Command.DOWNLOAD_INITIATE:
                return self._initiate_download(request)
            case _Command.UPLOAD_INITIATE:
                return self._initiate_upload(request)
            case _Command.DOWNLOAD_SEGMENT:
                return self._download_segment(request)
            case _Command.UPLOAD_SEGMENT:
                return self._upload_segment(request)
            case _:
                self._address = _address(request)
                raise SdoAbortError(AbortCode.COMMAND_SPECIFIER)

    def _abort(self, code: AbortCode) -> bytes:
        return self._response(0x80, code.to_bytes(4, "little"))

    def _response(self, command: int, payload: bytes = b"") -> bytes:
        index, subindex = self._address
        head = bytes((command, index & 0xFF, index >> 8, subindex))
        return head + payload.ljust(4, b"\0")

    def _initiate_upload(self, request: bytes) -> bytes:
        self._address, self._transfer = _address(request), None
        data = self._dictionary.upload(*self._address)
        if 0 < len(data) <= 4:
            return self._response(0x43 | (4 - len(data)) << 2, data)
        self._transfer = _Transfer(download=False, data=bytearray(data))
        return self._response(0x41, len(data).to_bytes(4, "little"))

    def _upload_segment(self, request: bytes) -> bytes:
        transfer = self._segment_of(request, download=False)
        part = bytes(transfer.data[:SEGMENT_BYTES])
        del transfer.data[:SEGMENT_BYTES]
        last = not transfer.data
        if last:
            self._transfer = None
        command = transfer.toggle | (SEGMENT_BYTES - len(part)) << 1 | (_LAST_SEGMENT * last)
        transfer.toggle ^= _TOGGLE
        return bytes((command,)) + part.ljust(SEGMENT_BYTES, b"\0")

    def _initiate_download(self, request: bytes) -> bytes:
        self._address, self._transfer = _address(request), None
        if request[0] & _EXPEDITED:
            self._dictionary.download(*self._address, self._expedited_data(request))
            return self._response(0x60)
        entry = self._dictionary.entry(*self._address)
        if not entry.writable:
            raise SdoAbortError(AbortCode.READ_ONLY)
        announced = int.from_bytes(request[4:8], "little")
        self._transfer = _Transfer(
            download=True, announced_bytes=announced if request[0] & _SIZE_INDICATED else None
        )
        if announced > STRING_MAX_BYTES and self._transfer.announced_bytes is not None:
            raise SdoAbortError(AbortCode.OUT_OF_MEMORY)
        return self._response(0x60)

    def _expedited_data(self, request: bytes) -> bytes:
        if request[0] & _SIZE_INDICATED:
            return request[4 : 8 - (request[0] >> 2 & 3)]
        size = self._dictionary.entry(*self._address).size_bytes  # not said: the object's own
        return request[4 : 4 + (size or 4)]

    def _download_segment(self, request: bytes) -> bytes:
        transfer = self._segment_of(request, download=True)
        unused = request[0] >> 1 & 7
        transfer.data += request[1 : REQUEST_BYTES - unused]
        if len(transfer.data) > STRING_MAX_BYTES:
            raise SdoAbortError(AbortCode.OUT_OF_MEMORY)
        answer = bytes((0x20 | transfer.toggle,)) + bytes(SEGMENT_BYTES)
        transfer.toggle ^= _TOGGLE
        if request[0] & _LAST_SEGMENT:
            self._finish_download(transfer)
        return answer

    def _finish_download(self, transfer: _Transfer) -> None:
        self._transfer = None
        if transfer.announced_bytes not in (None, len(transfer.data)):
            raise SdoAbortError(AbortCode.LENGTH)
        self._dictionary.download(*self._address, bytes(transfer.data))

    def _segment_of(self, request: bytes, *, download: bool) -> _Transfer:
        transfer = self._transfer
        if transfer is None or transfer.download != download:
            raise SdoAbortError(AbortCode.COMMAND_SPECIFIER)
        if request[0] & _TOGGLE != transfer.toggle:
            raise SdoAbortError(AbortCode.TOGGLE_BIT)
        return transfer


def _address(request: bytes) -> Address:
    return int.from_bytes(request[1:3], "little"), request[3]
