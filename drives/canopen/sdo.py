"""SDO on the default channel (CiA 301 7.2.4.3): its identifiers, and an upload of one frame each.

The client of bring-up and of the tools is canopen's (`drives/bringup/configurator.py`).
"""

import struct
from typing import Final

from drives.canopen.bus import Frame

SDO_REQUEST_ID: Final = 0x600
SDO_ANSWER_ID: Final = 0x580

_BYTES: Final = 8
_UPLOAD: Final = 0x40
_EXPEDITED: Final = {8: 0x4F, 16: 0x4B, 32: 0x43}
"""First byte of an expedited answer that names its size, by the bits of the object."""
_WITHOUT_SIZE: Final = 0x42


def upload_request(node_id: int, index: int, sub: int) -> Frame:
    """The request to upload one object."""
    return Frame(SDO_REQUEST_ID + node_id, struct.pack("<BHB4x", _UPLOAD, index, sub))


def uploaded(data: bytes, index: int, sub: int, bits: int) -> bytes | None:
    """The value in an answer, `bits` / 8 bytes; None for any other frame than this object's."""
    if len(data) != _BYTES or data[0] not in {_EXPEDITED[bits], _WITHOUT_SIZE}:
        return None
    return data[4 : 4 + bits // 8] if data[1:4] == struct.pack("<HB", index, sub) else None
