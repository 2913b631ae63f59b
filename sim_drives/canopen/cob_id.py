"""COB-IDs, the objects that hold an identifier and flags (CiA 301 7.3.3, 7.5.2.5, 17, 33).

| bits | meaning |
|---|---|
| 31 | 1: the service does not exist; of SYNC: no meaning |
| 30 | of SYNC: produces it; of a TPDO: no remote request; of all others 0 |
| 29 | identifier of 29 bits; no drive here has that |
| 11 to 28 | 0 with an identifier of 11 bits |
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
"""NMT and reserved, SDO, heartbeat, LSS: no service whose COB-ID can be set has one of these."""


def can_id_of(cob_id: int) -> int:
    """Bits 0 to 10."""
    return cob_id & CAN_ID_MASK


def is_restricted(can_id: int) -> bool:
    """Whether CiA 301 keeps the identifier for another service."""
    return any(can_id in ids for ids in RESTRICTED_IDS)
