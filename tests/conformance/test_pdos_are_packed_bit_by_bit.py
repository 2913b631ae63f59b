"""PDO layouts of every drive file against CiA 301's rule for mapped objects, done bit by bit.

CiA 301 7.2.2: the objects follow one another in the order of the mapping entries, each with as many
bits as its entry says, the least significant first; a byte is filled from its bit 0.
"""

import pytest
from drive_files import FOLDER, drive, table
from hypothesis import given, settings
from hypothesis import strategies as st

from drives.canopen.bus import Frame
from drives.cia402.drive import Drive, DriveGroup
from drives.cia402.pdo import layouts
from drives.signals import DriveCommand, OperationMode, PowerRequest

AXES = sorted(path.stem for path in FOLDER.glob("*.toml") if "profile" in table(path.name))
FRAMES = [(name, pdo) for name in AXES for pdo in layouts(drive(name).profile, 5)]


def packed(values):
    """(bits, value) in the order of the mapping: the bytes of the PDO."""
    stream = [value >> number & 1 for bits, value in values for number in range(bits)]
    return bytes(
        sum(bit << place for place, bit in enumerate(stream[start : start + 8]))
        for start in range(0, len(stream), 8)
    )


def any_values(pdo):
    return st.tuples(
        *(
            st.integers(-(1 << item.bits - 1), (1 << item.bits - 1) - 1)
            if item.signed
            else st.integers(0, (1 << item.bits) - 1)
            for item in pdo.objects
        )
    )


def test_there_is_something_to_pack():
    assert len(AXES) >= 4
    assert len(FRAMES) >= 5 * 4


@pytest.mark.parametrize(("name", "pdo"), FRAMES, ids=[f"{name} {pdo}" for name, pdo in FRAMES])
@settings(max_examples=25)
@given(data=st.data())
def test_what_is_packed_is_the_mapped_objects_bit_by_bit(name, pdo, data):
    values = data.draw(any_values(pdo))
    bits = [item.bits for item in pdo.objects]

    frame = packed(zip(bits, values, strict=True))

    assert pdo.codec.pack(*values) == frame
    assert pdo.codec.unpack(frame) == values
    assert 1 <= len(frame) == pdo.size <= 8


@pytest.mark.parametrize(("name", "pdo"), FRAMES, ids=[f"{name} {pdo}" for name, pdo in FRAMES])
def test_what_is_written_into_the_mapping_is_what_is_packed(name, pdo):
    for item in pdo.objects:
        index, sub, bits = item.entry >> 16, item.entry >> 8 & 0xFF, item.entry & 0xFF

        assert (index, sub, bits) == (item.index, item.sub, item.bits)
        assert bits in (8, 16, 32)


@given(
    word=st.integers(0, 0xFFFF),
    position=st.integers(-(2**31), 2**31 - 1),
    torque=st.integers(-(2**31), 2**31 - 1),
    target=st.integers(-(2**31), 2**31 - 1),
    permille=st.integers(-(2**15), 2**15 - 1),
)
def test_feedback_and_command_of_a_drive_pass_through_its_bytes(
    word, position, torque, target, permille
):
    group = DriveGroup([Drive(drive("hip_epos4"), 0)])
    status = packed(((16, word), (32, position), (8, 10)))
    group.feed([Frame(0x185, status), Frame(0x285, packed(((32, torque), (32, 0x0003_0000))))], 1)

    (feedback,) = group.end_of_window(1, 1)
    command = DriveCommand(
        PowerRequest.QUICK_STOP, OperationMode.CYCLIC_SYNC_TORQUE, target, permille
    )
    control, effort = group.frames([command])

    assert feedback.fresh
    assert (feedback.statusword, feedback.mode_display) == (word, 10)
    assert (feedback.position_counts, feedback.torque_raw) == (position, torque)
    assert control[:2] == (0x205, packed(((16, 0x0002), (8, 10), (32, target))))
    assert effort[:2] == (0x305, packed(((16, permille),)))
