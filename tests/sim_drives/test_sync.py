"""SYNC at the virtual drives: length, counter, window, cycle (CiA 301 7.2.5, 1005h-7h, 1019h)."""

import struct

import pytest
from drive_bench import GENERIC, Bench

INVALID = 1 << 31
WRONG_LENGTH = 0x8240
LOST = 0x8100


@pytest.fixture
def mapped(generic):
    """A plain drive, operational; its TPDOs 1 and 2 and RPDOs 1 and 2 are synchronous."""
    generic.go_operational(torque=0x6077_0010)
    generic.forget()
    return generic


def counted(bench, overflow=10, **starts):
    """The same with a counter, and SYNC start values of TPDO 1 and 2."""
    assert bench.write(0x1019, 0, overflow, 1) == 0
    bench.map_pdos(torque=0x6077_0010)
    for index, start in ((0x1800, starts.get("first", 0)), (0x1801, starts.get("second", 0))):
        cob_id = bench.read(index, 1)
        assert bench.write(index, 1, cob_id | INVALID, 4) == 0
        assert bench.write(index, 6, start, 1) == 0
        assert bench.write(index, 1, cob_id, 4) == 0
    bench.nmt(0x01)
    bench.forget()
    return bench


def sync(bench, counter):
    bench.send(0x080, bytes((counter,)))
    bench.run_ms(10)


def codes(bench):
    return [struct.unpack("<H", data[:2])[0] for data in bench.frames(0x085)]


# --- what may be written --------------------------------------------------------------------------


@pytest.mark.parametrize(
    "cob_id",
    [0x4000_0080, 0x2000_0080, 0x0000_0880, 0x1000_0080, 0x000, 0x07F, 0x101, 0x585, 0x605, 0x705],
)
def test_a_drive_is_no_producer_and_takes_no_identifier_of_another_service(generic, cob_id):
    assert generic.write(0x1005, 0, cob_id, 4) == 0x06090030
    assert generic.read(0x1005) == 0x80


def test_another_identifier_for_sync_is_obeyed(mapped):
    assert mapped.write(0x1005, 0, 0x0A0, 4) == 0

    mapped.cycle()
    assert mapped.frames(0x185) == []
    mapped.send(0x0A0)
    mapped.run_ms(5)
    assert len(mapped.frames(0x185)) == 1


@pytest.mark.parametrize(
    ("overflow", "code"),
    [(0, 0), (1, 0x06090030), (2, 0), (240, 0), (241, 0x06090030), (255, 0x06090030)],
)
def test_a_counter_overflows_after_two_to_240(generic, overflow, code):
    assert generic.write(0x1019, 0, overflow, 1) == code


def test_the_counter_is_chosen_before_the_cycle_begins(generic):
    generic.write(0x1006, 0, 10_000, 4)
    assert generic.write(0x1019, 0, 10, 1) == 0x08000022

    generic.write(0x1006, 0, 0, 4)
    assert generic.write(0x1019, 0, 10, 1) == 0


def test_a_start_value_stands_while_the_pdo_is_valid_and_is_a_counter(generic):
    assert generic.write(0x1800, 6, 3, 1) == 0x06090030
    generic.write(0x1800, 1, generic.read(0x1800, 1) | INVALID, 4)
    assert generic.write(0x1800, 6, 241, 1) == 0x06090030
    assert generic.write(0x1800, 6, 240, 1) == 0


def test_an_epos4_has_neither_counter_nor_cycle_nor_window(bench):
    for index in (0x1006, 0x1007, 0x1019):
        assert bench.read_abort(index) == 0x06020000
    assert bench.read_abort(0x1800, 6) == 0x06090011


# --- length and counter ---------------------------------------------------------------------------


@pytest.mark.parametrize("data", [b"\x01", b"\x01\x02", bytes(8)])
def test_a_sync_that_should_have_no_data_and_has_is_reported_and_not_used(bench, data):
    bench.go_operational()
    bench.forget()

    bench.send(0x080, data)
    bench.run_ms(5)
    assert bench.frames(0x085) == [bytes.fromhex("4082100000000000")]
    assert bench.frames(0x185) == []

    bench.cycle()
    assert bench.frames(0x085)[-1] == bytes(8)
    assert len(bench.frames(0x185)) == 1


def test_a_sync_without_the_counter_that_was_agreed_is_reported_and_not_used(generic):
    counted(generic)

    generic.cycle()
    assert codes(generic) == [WRONG_LENGTH]
    assert generic.frames(0x185) == []

    sync(generic, 1)
    assert codes(generic) == [WRONG_LENGTH, 0]
    assert len(generic.frames(0x185)) == 1


def test_a_tpdo_with_a_start_value_begins_at_that_counter(generic):
    counted(generic, first=3)
    seen = []
    for counter in (1, 2, 3, 4, 1, 2):
        sync(generic, counter)
        seen.append((len(generic.frames(0x185)), len(generic.frames(0x285))))

    assert seen == [(0, 1), (0, 2), (1, 3), (2, 4), (3, 5), (4, 6)]


def test_the_sync_of_the_start_value_is_the_first_of_n(generic):
    counted(generic, first=2)
    generic.write(0x1800, 2, 3, 1)
    sent_at = []
    for number in range(1, 10):
        before = len(generic.frames(0x185))
        sync(generic, number)
        sent_at += [number] * (len(generic.frames(0x185)) - before)

    assert sent_at == [4, 7]


def test_two_drives_take_turns_by_their_start_values():
    bench = Bench(hip=GENERIC, slide=GENERIC)
    bench.boot()
    counted(bench, overflow=2, first=1, second=2)
    for index in (0x1800, 0x1801):
        bench.write(index, 2, 2, 1)
    turns = []
    for number in range(6):
        bench.forget()
        sync(bench, number % 2 + 1)
        turns.append([bool(bench.frames(can_id)) for can_id in (0x185, 0x285)])

    assert turns[1:] == [[True, False], [False, True]] * 2 + [[True, False]]


def test_a_start_value_means_nothing_without_a_counter(generic):
    counted(generic, overflow=0, first=3)

    generic.cycle()

    assert len(generic.frames(0x185)) == 1


def test_the_start_is_waited_for_again_after_the_node_is_started_again(generic):
    counted(generic, first=3)
    sync(generic, 3)
    generic.nmt(0x80)
    generic.nmt(0x01)
    generic.forget()

    sync(generic, 4)
    assert generic.frames(0x185) == []


# --- the synchronous window -----------------------------------------------------------------------


def test_what_would_leave_after_the_window_is_not_sent(mapped):
    mapped.write(0x1007, 0, 1000, 4)
    mapped.cycles(3)
    assert len(mapped.frames(0x185)) == len(mapped.frames(0x285)) == 3

    mapped.world.command("late_tpdo right/hip - 1.0")
    mapped.cycles(3)
    assert len(mapped.frames(0x185)) == len(mapped.frames(0x285)) == 3


def test_a_change_that_missed_the_window_is_sent_at_the_next_sync(mapped):
    mapped.write(0x1801, 2, 0, 1)
    mapped.cycle()
    mapped.write(0x1007, 0, 1000, 4)
    mapped.forget()
    mapped.world.command("hand_switch_open right/hip")
    mapped.world.command("late_tpdo right/hip 0.005 5")

    mapped.cycle()
    assert mapped.frames(0x285) == []
    mapped.cycle()
    assert len(mapped.frames(0x285)) == 1


def test_what_comes_after_the_window_is_not_used(mapped):
    mapped.write(0x1007, 0, 2000, 4)

    mapped.send(0x080)
    mapped.run_ms(2)
    mapped.send(0x305, struct.pack("<h", 100))
    mapped.run_ms(0.1)
    mapped.send(0x305, struct.pack("<h", 200))
    mapped.send(0x205, b"\x06")  # too short, but that is not looked at either
    mapped.run_ms(7.9)
    mapped.cycle()

    assert mapped.read(0x6071) == 100
    assert codes(mapped) == []


def test_before_the_first_sync_the_window_is_open(mapped):
    mapped.write(0x1007, 0, 2000, 4)
    mapped.run_ms(50)

    mapped.send(0x305, struct.pack("<h", 100))
    mapped.cycle()

    assert mapped.read(0x6071) == 100


def test_the_window_does_not_touch_what_is_driven_by_events(generic):
    generic.write(0x1007, 0, 1000, 4)
    generic.nmt(0x01)
    generic.send(0x080)
    generic.run_ms(50)
    generic.forget()

    generic.send(0x205, struct.pack("<H", 0x06))
    generic.run_ms(1)

    assert generic.state() == 0x21
    assert len(generic.frames(0x185)) == 1


# --- the cycle ------------------------------------------------------------------------------------


def test_a_sync_that_stays_away_is_reported_after_one_and_a_half_cycles_and_once(mapped):
    mapped.write(0x1006, 0, 10_000, 4)
    mapped.run_ms(100)
    assert codes(mapped) == []  # not before the first

    mapped.cycles(5)
    last_ms = mapped.now_ms - 10
    mapped.run_ms(100)
    assert codes(mapped) == [LOST]
    assert mapped.times_ms(0x085) == [last_ms + 15]

    mapped.cycle()
    assert codes(mapped) == [LOST, 0]


def test_no_sync_is_missed_once_the_cycle_is_zero_or_the_node_stopped(mapped):
    mapped.write(0x1006, 0, 10_000, 4)
    mapped.cycle()
    mapped.write(0x1006, 0, 0, 4)
    mapped.run_ms(100)
    assert codes(mapped) == []

    mapped.write(0x1006, 0, 10_000, 4)
    mapped.cycle()
    mapped.nmt(0x02)
    mapped.run_ms(100)
    mapped.nmt(0x80)
    mapped.run_ms(100)
    assert codes(mapped) == []
