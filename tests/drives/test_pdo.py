"""Identifiers, objects and bytes of the PDOs: the numbers of CiA 301 and of `pdo.py`."""

import copy
import struct
from dataclasses import FrozenInstanceError

import pytest
from drive_files import axis_for, drive, join, table

from drives.cia402.pdo import layouts

STATUS = (0x6041_00_10, 0x6064_00_20, 0x6061_00_08)
CONTROL = (0x6040_00_10, 0x6060_00_08, 0x607A_00_20)
PDOS = [
    ("TPDO1", 0x180, 0x1800, 0x1A00, 1, "<Hib", STATUS),
    ("TPDO2", 0x280, 0x1801, 0x1A01, 1, "<hI", (0x6077_00_10, 0x60FD_00_20)),
    ("TPDO3", 0x380, 0x1802, 0x1A02, 10, "<hH", (0x2100_01_10, 0x603F_00_10)),
    ("RPDO1", 0x200, 0x1400, 0x1600, 1, "<Hbi", CONTROL),
    ("RPDO2", 0x300, 0x1401, 0x1601, 1, "<h", (0x6071_00_10,)),
]


@pytest.mark.parametrize("node_id", [1, 5, 127])
def test_every_pdo_is_where_the_standard_has_it_with_its_objects_in_order(node_id):
    found = [
        (
            *(str(pdo), pdo.can_id - node_id, pdo.communication_index, pdo.mapping_index),
            *(pdo.transmission_type, pdo.codec.format, tuple(one.entry for one in pdo.objects)),
        )
        for pdo in layouts(drive("hip_generic").profile, node_id)
    ]

    assert found == PDOS


def test_a_layout_cannot_be_changed():
    status = layouts(drive("hip_generic").profile, 5).status

    for frozen, name in ((status, "can_id"), (status.objects[0], "bits")):
        with pytest.raises(FrozenInstanceError):
            setattr(frozen, name, 0)


@pytest.mark.parametrize("bits", [8, 16, 32])
@pytest.mark.parametrize("signed", [True, False])
def test_an_object_is_packed_with_its_width_and_its_sign_lowest_byte_first(bits, signed):
    profile = copy.deepcopy(table("profiles/generic.toml"))
    profile["torque_source"] |= {"bits": bits, "signed": signed}
    lowest = -(1 << (bits - 1)) if signed else 0
    highest = lowest + (1 << bits) - 1

    torque = layouts(join(axis_for(profile), profile, "hip").profile, 5).torque

    assert torque.size == bits // 8 + 4
    for value in (lowest, highest, 1):
        raw = value.to_bytes(bits // 8, "little", signed=signed) + b"\x04\x03\x02\x01"
        assert torque.codec.pack(value, 0x01020304) == raw
        assert torque.codec.unpack(raw) == (value, 0x01020304)
    for value in (lowest - 1, highest + 1):
        with pytest.raises(struct.error):
            torque.codec.pack(value, 0)
