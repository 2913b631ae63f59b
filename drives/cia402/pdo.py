"""PDOs as fixed structs: which objects are in which frame; nothing is decided in the cycle.

All PDOs are synchronous. RPDO1 holds controlword, mode and target position together, so that a
drive never sees one without the others. Unused PDOs are switched off at bring-up.

    TPDO1  180h+id  6041 statusword, 6064 position, 6061 mode display   every SYNC
    TPDO2  280h+id  the profile's torque source, 60FD inputs            every SYNC
    TPDO3  380h+id  the profile's temperature, 603F error code; or one  every tenth SYNC
    RPDO1  200h+id  6040 controlword, 6060 mode, 607A target position   acts at the next SYNC
    RPDO2  300h+id  6071 target torque                                  acts at the next SYNC
"""

import struct
from dataclasses import dataclass
from typing import Final, NamedTuple

from drives.canopen.objects import Object
from drives.cia402.profile import DriveProfile
from drives.cia402.torque import ObjectRef

SLOW_SYNC_DIVIDER: Final = 10
"""TPDO3 comes with every tenth SYNC."""

_FORMAT: Final = {
    (8, False): "B",
    (8, True): "b",
    (16, False): "H",
    (16, True): "h",
    (32, False): "I",
    (32, True): "i",
}


@dataclass(frozen=True, slots=True)
class MappedObject:
    """One object of a PDO."""

    index: int
    sub: int
    bits: int
    signed: bool

    @property
    def entry(self) -> int:
        """The mapping entry as 1600h and 1A00h hold it (CiA 301 7.5.2.36)."""
        return self.index << 16 | self.sub << 8 | self.bits


CONTROLWORD: Final = MappedObject(Object.CONTROLWORD, 0, 16, signed=False)
STATUSWORD: Final = MappedObject(Object.STATUSWORD, 0, 16, signed=False)
MODE: Final = MappedObject(Object.MODE, 0, 8, signed=True)
MODE_DISPLAY: Final = MappedObject(Object.MODE_DISPLAY, 0, 8, signed=True)
POSITION: Final = MappedObject(Object.POSITION, 0, 32, signed=True)
TARGET_POSITION: Final = MappedObject(Object.TARGET_POSITION, 0, 32, signed=True)
INPUTS: Final = MappedObject(Object.INPUTS, 0, 32, signed=False)
ERROR_CODE: Final = MappedObject(Object.ERROR_CODE, 0, 16, signed=False)


@dataclass(frozen=True, slots=True)
class PdoLayout:
    """One PDO of one node: its identifier, its objects, and the struct that packs them."""

    number: int
    """1..4, as in TPDO1."""
    transmit: bool
    """True for a TPDO (sent by the drive)."""
    can_id: int
    transmission_type: int
    objects: tuple[MappedObject, ...]
    codec: struct.Struct

    @property
    def communication_index(self) -> int:
        """1800h.. or 1400h..: identifier, type, timers."""
        return (Object.TPDO if self.transmit else Object.RPDO) + self.number - 1

    @property
    def mapping_index(self) -> int:
        """1A00h.. or 1600h..: the objects."""
        return (Object.TPDO_MAPPING if self.transmit else Object.RPDO_MAPPING) + self.number - 1

    @property
    def size(self) -> int:
        """Length in bytes."""
        return self.codec.size

    def __str__(self) -> str:
        return f"{'T' if self.transmit else 'R'}PDO{self.number}"


class DrivePdos(NamedTuple):
    """All PDOs of one drive."""

    status: PdoLayout
    """TPDO1: statusword, position, mode display."""
    torque: PdoLayout
    """TPDO2: torque source, inputs."""
    slow: PdoLayout
    """TPDO3: temperature and error code, or one of them."""
    control: PdoLayout
    """RPDO1: controlword, mode, target position."""
    target_torque: PdoLayout
    """RPDO2."""


def layouts(profile: DriveProfile, node_id: int) -> DrivePdos:
    """Compile the PDOs of one drive."""
    source = _mapped(profile.torque_source)
    temperature = profile.temperature
    slow = [_mapped(temperature)] if temperature is not None and temperature.mapped else []
    if profile.pdo.error_code:
        slow.append(ERROR_CODE)
    return DrivePdos(
        status=_layout(1, node_id, (STATUSWORD, POSITION, MODE_DISPLAY), transmit=True),
        torque=_layout(2, node_id, (source, INPUTS), transmit=True),
        slow=_layout(3, node_id, tuple(slow), transmit=True, type_=SLOW_SYNC_DIVIDER),
        control=_layout(1, node_id, (CONTROLWORD, MODE, TARGET_POSITION), transmit=False),
        target_torque=_layout(2, node_id, (_mapped(profile.target_torque),), transmit=False),
    )


def _mapped(ref: ObjectRef) -> MappedObject:
    return MappedObject(ref.index, ref.sub, ref.bits, ref.signed)


def _layout(
    number: int, node_id: int, objects: tuple[MappedObject, ...], *, transmit: bool, type_: int = 1
) -> PdoLayout:
    codec = struct.Struct("<" + "".join(_FORMAT[item.bits, item.signed] for item in objects))
    can_id = (0x080 if transmit else 0x100) + 0x100 * number + node_id
    return PdoLayout(number, transmit, can_id, type_, objects, codec)
