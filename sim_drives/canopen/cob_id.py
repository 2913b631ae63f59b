"""COB-IDs: objects that hold a CAN identifier and flags (CiA 301 7.3.3, 7.5.2.5, 17, 33).

| bits | meaning |
|---|---|
| 31 | 1: the service does not exist; for SYNC: no meaning |
| 30 | SYNC: the node produces it; TPDO: no remote request; all others 0 |
| 29 | 29-bit identifier; no drive here supports it |
| 11 to 28 | 0 with an 11-bit identifier |
| 0 to 10 | the identifier |
"""

from typing import Final

INVALID: Final = 1 << 31
FLAG_30: Final = 1 << 30
EXTENDED_BITS: Final = 0x3FFF_F800
"""Bits 11 to 29."""
CAN_ID_MASK: Final = 0x7FF
RESTRICTED_IDS: Final = (
    range(0x000, 0x080),
    range(0x101, 0x181),
    range(0x581, 0x600),
    range(0x601, 0x680),
    range(0x6E0, 0x700),
    range(0x701, 0x800),
)
"""Identifiers of NMT and reserved, SDO, heartbeat, LSS: not allowed in a configurable COB-ID."""


def can_id_of(cob_id: int) -> int:
    """The identifier in bits 0 to 10."""
    return cob_id & CAN_ID_MASK


def is_restricted(can_id: int) -> bool:
    """Return whether CiA 301 reserves the identifier for another service."""
    return any(can_id in ids for ids in RESTRICTED_IDS)
