"""Temperatures that no PDO carries: one upload at a time, after the commands, bounded in time."""

import copy
import struct

import pytest
from drive_files import drive, join, table

from drives.canopen.bus import Frame
from drives.cia402.drive import Drive, DriveGroup

NOW = 5_000_000_000
SLOT_CYCLES, QUIET_CYCLES, MISSED_MAX = 25, 5, 3
ASKED = bytes.fromhex("40 01 32 01 00 00 00 00")


def answer(node_id=5, raw=415, start="4B 01 32 01"):
    return Frame(0x580 + node_id, bytes.fromhex(start) + struct.pack("<hH", raw, 0))


def pair():
    return DriveGroup([Drive(drive("hip_epos4"), NOW), Drive(drive("slide_epos4"), NOW)])


class Run:
    """Cycles of a group whose drives answer by SDO what a test says."""

    def __init__(self, group, answers):
        self.group, self.answers, self.sent, self.cycle = group, answers, [], 0

    def run(self, cycles):
        for _ in range(cycles):
            feedbacks = self.group.end_of_window(self.cycle, NOW)
            for frame in self.group.uploads():
                self.sent.append((self.cycle, frame))
                assert not self.group.feed_between(self.answers(frame), NOW)
            self.cycle += 1
        return feedbacks


def test_the_drives_take_turns_and_each_answer_is_its_temperature():
    run = Run(pair(), lambda asked: [answer(asked.can_id - 0x600, 400 + asked.can_id - 0x600)])

    shown = run.run(4 * SLOT_CYCLES)

    assert run.sent == [(turn * SLOT_CYCLES, Frame(0x605 + turn % 2, ASKED)) for turn in range(4)]
    assert [one.temperature_degc for one in shown] == [pytest.approx(40.5), pytest.approx(40.6)]
    assert not any(one.temperature_overdue or one.protocol_error_count for one in shown)


def test_four_drives_take_their_turns_in_order_and_again():
    drives = [
        drive(name) for name in ("hip_epos4", "slide_epos4", "hip_left_epos4", "slide_left_epos4")
    ]
    run = Run(DriveGroup([Drive(one, NOW) for one in drives]), lambda _: [])

    run.run(9 * SLOT_CYCLES)

    assert [frame.can_id - 0x600 for _, frame in run.sent] == [5, 6, 7, 8, 5, 6, 7, 8, 5]


def test_an_answer_after_its_turn_is_no_answer():
    run = Run(pair(), lambda _: [])
    run.run(SLOT_CYCLES + 1)

    run.group.feed_between([answer()], NOW)

    assert run.group.peek(NOW)[0].temperature_degc is None


def test_a_second_answer_to_one_request_is_not_taken():
    run = Run(
        pair(), lambda asked: [answer(asked.can_id - 0x600), answer(asked.can_id - 0x600, 900)]
    )

    assert run.run(2)[0].temperature_degc == pytest.approx(41.5)


def test_only_one_upload_is_outstanding_however_long_its_answer_takes():
    run = Run(pair(), lambda _: [])

    run.run(10 * SLOT_CYCLES)

    at = [cycle for cycle, _ in run.sent]
    assert at == [turn * SLOT_CYCLES for turn in range(10)]


def test_a_drive_that_does_not_answer_has_no_temperature_after_three_turns_and_the_other_one_has():
    silent = set()
    run = Run(
        pair(), lambda asked: [] if asked.can_id in silent else [answer(asked.can_id - 0x600)]
    )
    run.run(2 * SLOT_CYCLES)
    silent.add(0x605)

    last = run.run(2 * MISSED_MAX * SLOT_CYCLES - SLOT_CYCLES)
    assert [one.temperature_degc for one in last] == [pytest.approx(41.5)] * 2
    overdue = run.run(2)

    assert [one.temperature_degc for one in overdue] == [None, pytest.approx(41.5)]
    assert [one.temperature_overdue for one in overdue] == [True, False]
    still = run.run(4 * SLOT_CYCLES)
    assert [one.temperature_overdue for one in still] == [True, False]
    silent.clear()
    again = run.run(2 * SLOT_CYCLES)
    assert [one.temperature_overdue for one in again] == [False, False]


@pytest.mark.parametrize(
    "wrong",
    [
        answer(start="80 01 32 01"),  # an abort
        answer(start="4B 01 32 04"),  # another object, as another client asks for
        answer(start="4F 01 32 01"),  # one byte
        answer(start="41 01 32 01"),  # segmented
        answer(start="42 01 32 04"),  # another object, without a size
        Frame(0x585, bytes.fromhex("4B 01 32 01 9F 01")),  # too short a frame
    ],
)
def test_any_other_answer_is_none(wrong):
    run = Run(pair(), lambda _: [wrong])

    assert not run.run(2 * (MISSED_MAX - 1) * SLOT_CYCLES)[0].temperature_overdue
    run.run(2 * SLOT_CYCLES + 1)
    shown = run.group.peek(NOW)

    assert (shown[0].temperature_degc, shown[0].temperature_overdue) == (None, True)
    assert shown[0].protocol_error_count == 0


def test_an_answer_without_a_request_is_another_client_s():
    group = pair()

    group.feed_between([answer()], NOW)

    assert group.peek(NOW)[0].temperature_degc is None


def test_a_request_waits_while_another_client_uses_the_drive():
    run = Run(pair(), lambda asked: [answer(asked.can_id - 0x600)])
    foreign = Frame(0x605, bytes.fromhex("40 18 10 01 00 00 00 00"))
    run.run(2 * SLOT_CYCLES)
    for _ in range(10):
        assert not run.group.feed_between([foreign], NOW)
        run.run(1)
    run.run(SLOT_CYCLES - 10)

    at = [cycle for cycle, frame in run.sent if frame.can_id == 0x605]
    last = 2 * SLOT_CYCLES + 9
    assert at == [0, last + QUIET_CYCLES - 1]


@pytest.mark.parametrize(
    ("bits", "signed", "start", "raw", "degc"),
    [
        (16, True, "42", b"\xf6\xff", -1.0),  # without a size
        (8, True, "4F", b"\xf6", -1.0),
        (16, False, "4B", b"\xff\xff", 6553.5),
        (32, True, "43", b"\x9c\xff\xff\xff", -10.0),
    ],
)
def test_a_temperature_has_its_width_and_its_sign(bits, signed, start, raw, degc):
    profile = copy.deepcopy(table("profiles/epos4.toml"))
    profile["temperature"] |= {"bits": bits, "signed": signed}
    group = DriveGroup([Drive(join(table("hip_epos4.toml"), profile, "hip"), NOW)])
    data = bytes.fromhex(start + "01 32 01") + raw.ljust(4, b"\xaa")

    run = Run(group, lambda _: [Frame(0x585, data)])
    shown = run.run(2)

    assert shown[0].temperature_degc == pytest.approx(degc)


def test_a_client_that_never_leaves_room_ends_the_measurement_after_ten_seconds():
    run = Run(pair(), lambda asked: [answer(asked.can_id - 0x600)])
    foreign = Frame(0x605, bytes.fromhex("40 18 10 01 00 00 00 00"))
    run.run(2 * SLOT_CYCLES)
    overdue = []
    for _ in range(42 * SLOT_CYCLES):
        run.group.feed_between([foreign], NOW)
        overdue.append(run.run(1)[0].temperature_overdue)

    assert 39 * SLOT_CYCLES <= overdue.index(True) <= 41 * SLOT_CYCLES
    assert all(overdue[overdue.index(True) :])
    assert not run.run(1)[1].temperature_overdue
    assert not run.run(2 * SLOT_CYCLES + 1)[0].temperature_overdue


def test_no_frame_of_an_sdo_asks_for_an_immediate_reaction():
    upload = Drive(drive("hip_epos4"), NOW).upload

    assert upload.on_answer(answer().data, NOW, False) is False
    assert upload.on_foreign_request(ASKED, NOW, False) is False


def test_a_drive_whose_temperature_is_mapped_is_not_asked():
    group = DriveGroup([Drive(drive("hip_generic"), NOW)])

    assert [frame for _ in range(3 * SLOT_CYCLES) for frame in group.uploads()] == []
