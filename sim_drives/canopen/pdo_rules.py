"""Rules for writing a PDO's parameters and mapping (CiA 301 7.5.2.35 to 38).

Rules (numbers are SDO abort codes):
1. Mapping entries are written only while the PDO is invalid (bit 31 of the COB-ID) and its number
   of mapped objects is 0; that number only while the PDO is invalid. Otherwise 06010000.
2. An entry names an object that exists (06020000, 06090011), may be mapped in this direction, and
   has the entry's length (06040041).
3. Together they fit into eight bytes (06040042), and none of the counted ones is empty (06040041).
4. A COB-ID has no bits 11 to 29; one that becomes valid is not reserved by CiA 301 for another
   service and needs at least one mapped object (06090030). It does not change while the PDO is
   valid: 06090030 if it stays valid. A drive that locks it answers 06010000 also when the same
   write makes it invalid; then the old COB-ID has to be written with bit 31 first. No drive here
   answers remote frames, so a TPDO that allows them (bit 30 = 0) is 06090030. A PDO that is
   delivered valid and without a mapped object is neither sent nor received.
5. Transmission types 241 to 253 are not supported, nor a SYNC start value above 240; inhibit time
   and SYNC start value do not change while the PDO is valid (06090030).
6. There are no multiplexed PDOs (a count of 254 or 255 is 06090031), so no drive here sends 8230h.
"""

import struct
from dataclasses import dataclass
from enum import Enum
from typing import Final, NamedTuple

from sim_drives.canopen.aborts import AbortCode, SdoAbortError
from sim_drives.canopen.cob_id import EXTENDED_BITS, FLAG_30, INVALID, can_id_of, is_restricted
from sim_drives.canopen.dictionary import Address, ObjectDictionary
from sim_drives.canopen.objects import Object

PDO_COUNT: Final = 4
UNSUPPORTED_TYPES: Final = range(241, 254)
PDO_MAX_BITS: Final = 64
SUB_COB_ID: Final = 1
SUB_TYPE: Final = 2
SUB_INHIBIT: Final = 3
SUB_EVENT_TIMER: Final = 5
SUB_SYNC_START: Final = 6
SYNC_START_MAX: Final = 240
NOT_FOR_PDOS: Final = (0x080, 0x100, 0x700)
"""Identifiers of SYNC and TIME; the last belongs to no node."""


class Direction(Enum):
    """PDO direction seen from the drive; the value is the index of the first PDO's parameters."""

    RECEIVE = Object.RPDO
    TRANSMIT = Object.TPDO


MAPPING_OFFSET: Final = 0x200


class Layout(NamedTuple):
    """Layout of a PDO's bytes."""

    packing: struct.Struct
    addresses: tuple[Address, ...]


@dataclass(frozen=True, slots=True)
class PdoObjects:
    """The dictionary addresses of one PDO, and the guards of these objects."""

    dictionary: ObjectDictionary
    direction: Direction
    number: int
    """PDO number, 0 to 3."""
    locked_while_valid: bool

    @property
    def parameters(self) -> int:
        """Index of the communication parameters."""
        return self.direction.value + self.number

    @property
    def mapping(self) -> int:
        """Index of the mapping."""
        return self.parameters + MAPPING_OFFSET

    @property
    def cob_id(self) -> int:
        """COB-ID with its flag bits."""
        return self.dictionary.value(self.parameters, SUB_COB_ID)

    @property
    def can_id(self) -> int:
        """CAN identifier without flag bits."""
        return can_id_of(self.cob_id)

    @property
    def valid(self) -> bool:
        """True if the PDO exists."""
        return not self.cob_id & INVALID

    @property
    def used(self) -> bool:
        """True if the PDO exists and has a mapped object."""
        return self.valid and self.dictionary.value(self.mapping, 0) > 0

    def layout(self) -> Layout:
        """Return the mapped objects in order; rule 3 was checked when their number was written."""
        addresses = tuple(
            _mapped_address(self.dictionary.value(self.mapping, slot))
            for slot in range(1, self.dictionary.value(self.mapping, 0) + 1)
        )
        codes = "".join(self.dictionary.entry(*address).type_code for address in addresses)
        return Layout(struct.Struct("<" + codes), addresses)

    def install_guards(self) -> None:
        """Install the rules as guards of the dictionary."""
        self.dictionary.guard(self.parameters, self._check_parameter)
        self.dictionary.guard(self.mapping, self._check_mapping)

    def _check_parameter(self, subindex: int, value: int) -> None:
        if subindex == SUB_COB_ID:
            self._check_cob_id(value)
        if subindex in (SUB_INHIBIT, SUB_SYNC_START) and self._is_locked(subindex, value):
            raise SdoAbortError(AbortCode.RANGE)
        if (subindex == SUB_TYPE and value in UNSUPPORTED_TYPES) or (
            subindex == SUB_SYNC_START and value > SYNC_START_MAX
        ):
            raise SdoAbortError(AbortCode.RANGE)

    def _is_locked(self, subindex: int, value: int) -> bool:
        return self.valid and value != self.dictionary.value(self.parameters, subindex)

    def _check_cob_id(self, value: int) -> None:
        stays_valid = not value & INVALID
        can_id = can_id_of(value)
        if self.valid and can_id != self.can_id:
            if self.locked_while_valid:
                raise SdoAbortError(AbortCode.UNSUPPORTED_ACCESS)
            if stays_valid:
                raise SdoAbortError(AbortCode.RANGE)
        becomes_valid = stays_valid and not self.valid
        # a drive whose file has its TPDOs open to remote requests accepts such an identifier
        forbids_remote = self.dictionary.value(self.parameters, SUB_COB_ID) & FLAG_30
        is_open = not value & FLAG_30
        allows_remote = self.direction is Direction.TRANSMIT and is_open and forbids_remote
        if (
            allows_remote
            or value & EXTENDED_BITS
            or (becomes_valid and not self._may_be_valid(can_id))
        ):
            raise SdoAbortError(AbortCode.RANGE)

    def _may_be_valid(self, can_id: int) -> bool:
        reserved = can_id in NOT_FOR_PDOS or is_restricted(can_id)
        return not reserved and self.dictionary.value(self.mapping, 0) > 0

    def _check_mapping(self, subindex: int, value: int) -> None:
        if self.valid or (subindex and self.dictionary.value(self.mapping, 0)):
            raise SdoAbortError(AbortCode.UNSUPPORTED_ACCESS)
        if subindex:
            self._check_entry(value)
        else:
            self._check_count_entry(value)

    def _check_entry(self, value: int) -> None:
        if value == 0:
            return
        entry = self.dictionary.entry(*_mapped_address(value))
        transmits = self.direction is Direction.TRANSMIT
        mappable = entry.mappable_out if transmits else entry.mappable_in
        if not mappable or entry.size_bytes * 8 != _mapped_bits(value):
            raise SdoAbortError(AbortCode.NOT_MAPPABLE)

    def _check_count_entry(self, count: int) -> None:
        entries = [self.dictionary.value(self.mapping, slot) for slot in range(1, count + 1)]
        if not all(entries):
            raise SdoAbortError(AbortCode.NOT_MAPPABLE)
        if sum(_mapped_bits(entry) for entry in entries) > PDO_MAX_BITS:
            raise SdoAbortError(AbortCode.PDO_TOO_LONG)


def _mapped_address(entry: int) -> Address:
    return entry >> 16, entry >> 8 & 0xFF


def _mapped_bits(entry: int) -> int:
    return entry & 0xFF
