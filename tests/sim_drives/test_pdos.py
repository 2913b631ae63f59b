"""PDOs: mapping rules, lengths, watchdog, synchronous and event-driven: S08, S09, S18, 5.5.6,
5.5.7."""

import struct
from itertools import pairwise

import pytest
from drive_bench import MS, Bench
from hypothesis import given, settings
from hypothesis import strategies as st

INVALID = 1 << 31
NO_REMOTE = 1 << 30


@pytest.fixture
def mapped(bench):
    bench.go_operational()
    bench.forget()
    return bench


# --- what may be written ----------------------------------------------------------------------


def freed(bench, index=0x1800):
    """A PDO made invalid and empty."""
    bench.write(index, 1, bench.read(index, 1) | INVALID, 4)
    bench.write(index + 0x200, 0, 0, 1)
    return bench


def test_a_valid_pdo_refuses_its_mapping(bench):
    assert bench.write(0x1A00, 0, 0, 1) == 0x06010000
    assert bench.write(0x1A00, 1, 0x6041_0010, 4) == 0x06010000


def test_entries_are_refused_while_they_are_counted(bench):
    bench.write(0x1800, 1, bench.read(0x1800, 1) | INVALID, 4)

    assert bench.write(0x1A00, 1, 0x6064_0020, 4) == 0x06010000


@pytest.mark.parametrize(
    ("entry", "code"),
    [
        (0x5FFF_0010, 0x06020000),
        (0x1018_0920, 0x06090011),
        (0x6065_0020, 0x06040041),
        (0x6040_0010, 0x06040041),
        (0x6041_0020, 0x06040041),
        (0x6041_0010, 0),
        (0, 0),
    ],
)
def test_an_entry_must_name_an_object_that_may_be_sent_with_its_own_length(bench, entry, code):
    assert freed(bench).write(0x1A00, 1, entry, 4) == code


def test_what_a_drive_measures_cannot_be_commanded(bench):
    assert freed(bench, 0x1400).write(0x1600, 1, 0x6064_0020, 4) == 0x06040041


def test_more_than_eight_bytes_do_not_fit(bench):
    freed(bench)
    for slot, entry in enumerate((0x6064_0020, 0x606C_0020, 0x6061_0008), 1):
        assert bench.write(0x1A00, slot, entry, 4) == 0

    assert bench.write(0x1A00, 0, 3, 1) == 0x06040042
    assert bench.write(0x1A00, 0, 2, 1) == 0
    for count in (13, 254, 255):  # the last two would be multiplexed PDOs
        assert bench.write(0x1A00, 0, count, 1) == 0x06090031


def test_an_empty_entry_cannot_be_counted(bench):
    freed(bench)
    bench.write(0x1A00, 1, 0, 4)

    assert bench.write(0x1A00, 0, 1, 1) == 0x06040041


@pytest.mark.parametrize("can_id", [0x000, 0x001, 0x080, 0x101, 0x585, 0x605, 0x6E0, 0x705, 0x7FF])
def test_a_pdo_cannot_take_the_identifier_of_another_service(bench, can_id):
    freed(bench)
    bench.write(0x1A00, 1, 0x6041_0010, 4)
    bench.write(0x1A00, 0, 1, 1)

    assert bench.write(0x1800, 1, can_id | NO_REMOTE, 4) == 0x06090030
    assert bench.write(0x1800, 1, 0x1A5 | NO_REMOTE, 4) == 0


@pytest.mark.parametrize("bits", [1 << 11, 1 << 28, 1 << 29])
def test_a_cob_id_has_no_extended_part(bench, bits):
    assert bench.write(0x1800, 1, 0x185 | bits | NO_REMOTE | INVALID, 4) == 0x06090030


def test_a_pdo_without_objects_cannot_be_made_valid(bench):
    assert freed(bench).write(0x1800, 1, 0x185 | NO_REMOTE, 4) == 0x06090030


@pytest.mark.parametrize("kind", [241, 252, 253])
def test_a_transmission_type_that_is_reserved_or_remote_is_refused(bench, kind):
    assert bench.write(0x1800, 2, kind, 1) == 0x06090030


def test_the_inhibit_time_stands_while_the_pdo_is_valid(bench):
    assert bench.write(0x1800, 3, 50, 2) == 0x06090030
    assert bench.write(0x1800, 3, 10, 2) == 0


def test_an_epos4_wants_the_old_identifier_made_invalid_first(bench):
    assert bench.write(0x1800, 1, 0x1A5 | NO_REMOTE | INVALID, 4) == 0x06010000
    assert bench.write(0x1800, 1, 0x185 | NO_REMOTE | INVALID, 4) == 0
    assert bench.write(0x1800, 1, 0x1A5 | NO_REMOTE, 4) == 0


def test_a_plain_drive_takes_a_new_identifier_together_with_invalid(generic):
    assert generic.write(0x1800, 1, 0x1A5 | NO_REMOTE, 4) == 0x06090030
    assert generic.write(0x1800, 1, 0x1A5 | NO_REMOTE | INVALID, 4) == 0


@pytest.mark.parametrize("flags", [0, INVALID])
def test_a_tpdo_cannot_allow_the_remote_frames_that_no_drive_here_answers(bench, generic, flags):
    for drive in (bench, generic):
        assert drive.read(0x1800, 1) & NO_REMOTE
        assert drive.write(0x1800, 1, 0x185 | flags, 4) == 0x06090030
        assert drive.write(0x1400, 1, 0x205 | INVALID, 4) == 0


def test_an_epos4_boots_with_its_first_pdos_alone_and_the_first_rpdo_could_command_it(bench):
    bench.nmt(0x01)
    for can_id in (0x305, 0x405, 0x505):
        bench.send(can_id, struct.pack("<Hi", 0x06, 0))
    bench.run_ms(1)
    assert bench.state() == 0x40
    assert [bench.read(0x1800 + number, 1) >> 31 for number in range(4)] == [0, 1, 1, 1]

    bench.send(0x205, struct.pack("<H", 0x06))
    bench.run_ms(1)
    assert bench.state() == 0x21


# --- synchronous ------------------------------------------------------------------------------


def test_a_synchronous_tpdo_comes_at_every_nth_sync_counted_from_start(bench):
    bench.map_pdos()
    bench.write(0x1800, 2, 3, 1)
    for _ in range(2):
        bench.nmt(0x80)
        bench.nmt(0x01)
        bench.forget()

        bench.cycles(10)

        assert len(bench.frames(0x185)) == 3
        assert len(bench.frames(0x285)) == 10


def test_the_answers_to_a_sync_come_within_their_delays_and_in_their_order(mapped):
    for _ in range(50):
        at_ms = mapped.now_ms
        mapped.cycle()
        first, second = mapped.times_ms(0x185)[-1] - at_ms, mapped.times_ms(0x285)[-1] - at_ms
        assert 0.1 <= first <= second <= 0.6


def test_shuffled_answers_come_in_any_order():
    bench = Bench(hip={"tpdo_shuffled": True})
    bench.boot()
    bench.go_operational()
    bench.forget()

    bench.cycles(50)

    orders = [timed.can_id for timed in bench.trace if timed.can_id in (0x185, 0x285)]
    assert {tuple(orders[at : at + 2]) for at in range(0, 100, 2)} == {
        (0x185, 0x285),
        (0x285, 0x185),
    }


def test_what_a_tpdo_says_was_sampled_at_its_sync(mapped):
    mapped.plant.velocity[0] = 1.0
    mapped.cycle()
    at_sync = mapped.plant.position[0]

    mapped.send(0x080)
    mapped.run_ms(5)

    counts = struct.unpack("<i", mapped.frames(0x185)[-1][2:6])[0]
    assert counts == round(at_sync / 6.283185307179586 * 102400)


def test_an_rpdo_acts_at_the_next_sync_and_whole(mapped):
    mapped.enable(10)
    orders = len(mapped.plant.history)

    mapped.send(0x205, struct.pack("<Hbi", 0x0F, 10, 0))
    mapped.send(0x305, struct.pack("<h", 250))
    mapped.run_ms(9)
    assert len(mapped.plant.history) == orders

    mapped.send(0x080)
    assert len(mapped.plant.history) == orders + 1
    assert mapped.plant.orders[0].target_effort_si == pytest.approx(0.25 * 27.868)


def test_a_target_never_parts_from_the_controlword_of_its_cycle(mapped):
    """Enabled by the very PDO that carries its first target: no order in between has another."""
    start = mapped.read(0x6064)
    mapped.cycles(2, 0x06, 8, start)
    mapped.cycles(2, 0x07, 8, start)
    mapped.plant.history.clear()

    mapped.cycles(2, 0x0F, 8, start + 10)

    targets = [order.target_position_si for _, axis, order in mapped.plant.history if axis == 0]
    assert targets == [pytest.approx((start + 10) * 6.283185307179586 / 102400)]


def test_the_newest_of_two_rpdos_counts(mapped):
    for torque in (100, 200):
        mapped.send(0x305, struct.pack("<h", torque))
    mapped.cycle()

    assert mapped.read(0x6071) == 200


def test_a_pdo_that_waited_when_the_node_left_operational_is_void(mapped):
    mapped.send(0x305, struct.pack("<h", 123))
    mapped.nmt(0x80)
    mapped.nmt(0x01)
    mapped.cycle()

    assert mapped.read(0x6071) == 0


# --- event-driven -----------------------------------------------------------------------------


def test_an_event_driven_tpdo_comes_on_change_and_not_sooner_than_its_inhibit_time(bench):
    bench.nmt(0x01)
    assert len(bench.frames(0x185)) == 1  # once on entering operational
    bench.run_ms(50)
    assert len(bench.frames(0x185)) == 1

    for word in (0x06, 0x07, 0x0F):
        bench.send(0x205, struct.pack("<H", word))
    bench.run_ms(5)

    words = [struct.unpack("<H", data)[0] & 0x6F for data in bench.frames(0x185)[1:]]
    times = bench.times_ms(0x185)
    assert words[0] == 0x21
    assert words[-1] == 0x27
    assert times[-1] - times[-2] >= 1.0


def test_an_event_timer_repeats_a_tpdo(generic):
    bench = generic
    bench.write(0x1800, 5, 25, 2)
    bench.nmt(0x01)

    bench.run_ms(100)

    times = bench.times_ms(0x185)
    assert [after - before for before, after in pairwise(times)] == [25] * 4


def test_type_zero_waits_for_the_sync_after_a_change(bench):
    bench.map_pdos()
    for number in (0x1800, 0x1801):
        bench.write(number, 2, 0, 1)
    bench.nmt(0x01)
    bench.cycles(3)
    assert len(bench.frames(0x285)) == 1

    bench.world.command("hand_switch_open right/hip")
    bench.run_ms(50)
    assert len(bench.frames(0x285)) == 1
    bench.cycles(3)
    assert len(bench.frames(0x285)) == 2


def test_an_event_driven_rpdo_acts_at_once(bench):
    bench.nmt(0x01)
    bench.send(0x205, struct.pack("<H", 0x06))

    assert bench.state() == 0x21


# --- lengths and the watchdog -----------------------------------------------------------------


def test_a_short_rpdo_is_reported_and_not_used(mapped):
    mapped.send(0x205, b"\x06")
    mapped.cycle()

    assert mapped.frames(0x085) == [bytes.fromhex("1082100000000000")]
    assert mapped.read(0x6040) == 0
    assert mapped.statusword() & 0x80


def test_a_long_rpdo_is_reported_and_its_beginning_used(mapped):
    mapped.send(0x205, struct.pack("<Hbi", 0x06, 10, 77) + b"\xff")
    mapped.cycle()

    assert mapped.frames(0x085)[0] == bytes.fromhex("2082100000000000")
    assert (mapped.read(0x6040), mapped.read(0x607A)) == (0x06, 77)


def test_a_good_rpdo_ends_the_report_of_a_short_one(mapped):
    mapped.send(0x205, b"\x06")
    mapped.run_ms(1)
    mapped.cycles(1, 0x06)

    assert mapped.frames(0x085)[-1] == bytes(8)
    assert not mapped.statusword() & 0x80


def test_a_sync_that_is_too_long_is_reported(mapped):
    mapped.send(0x080, b"\x01\x02")
    mapped.run_ms(1)

    assert mapped.frames(0x085) == [bytes.fromhex("4082100000000000")]


def test_a_good_rpdo_does_not_end_the_report_of_another_that_is_short(mapped):
    for _ in range(3):
        mapped.send(0x205, b"\x06")
        mapped.send(0x305, struct.pack("<h", 0))
        mapped.cycle()
    assert mapped.frames(0x085) == [bytes.fromhex("1082100000000000")]

    mapped.cycles(1, 0x06)
    assert mapped.frames(0x085)[1:] == [bytes(8)]


def test_a_report_ends_with_the_pdo_that_it_was_about(mapped):
    mapped.send(0x205, b"\x06")
    mapped.write(0x1400, 1, 0x205 | INVALID, 4)
    mapped.run_ms(1)

    assert mapped.frames(0x085) == [bytes.fromhex("1082100000000000"), bytes(8)]


def test_what_waits_for_a_sync_is_void_once_its_pdo_is_mapped_anew(mapped):
    mapped.send(0x305, struct.pack("<h", 123))
    freed(mapped, 0x1401)
    mapped.write(0x1601, 1, 0x607A_0020, 4)
    mapped.write(0x1601, 0, 1, 1)
    mapped.write(0x1401, 1, 0x305, 4)
    position = mapped.read(0x607A)

    mapped.cycle()

    assert (mapped.read(0x6071), mapped.read(0x607A)) == (0, position)


def test_an_rpdo_that_is_there_no_more_is_not_missed(generic):
    generic.go_operational(torque=0x6077_0010)
    generic.write(0x1400, 5, 30, 2)
    generic.cycles(3, 0x00)
    generic.write(0x1400, 1, 0x205 | INVALID, 4)
    generic.run_ms(200)

    assert generic.frames(0x085) == []


def test_an_event_timer_that_is_written_in_operational_begins_then(generic):
    bench = generic
    bench.nmt(0x01)
    bench.run_ms(100)
    bench.forget()
    start_ms = bench.now_ms

    bench.write(0x1800, 5, 20, 2)
    bench.run_ms(65)
    assert [at - start_ms for at in bench.times_ms(0x185)] == [20, 40, 60]

    bench.write(0x1800, 2, 1, 1)
    bench.forget()
    bench.run_ms(100)
    assert bench.frames(0x185) == []


def test_missing_rpdos_are_reported_after_their_time(generic):
    generic.go_operational(torque=0x6077_0010)
    generic.write(0x6007, 0, 3, 2)
    generic.write(0x605A, 0, 6, 2)
    generic.write(0x1029, 1, 1, 1)
    generic.write(0x1400, 5, 30, 2)
    generic.run_ms(100)
    assert generic.frames(0x085) == []  # not before the first

    generic.enable()
    last_ms = generic.now_ms - 8
    generic.run_ms(100)
    assert generic.frames(0x085) == [bytes.fromhex("5082110000000000")]
    assert 30 <= generic.times_ms(0x085)[0] - last_ms <= 40
    assert generic.state() == 0x07

    generic.cycles(2, 0x02)
    assert generic.frames(0x085)[-1] == bytes(8)


IDS = st.sampled_from([0x000, 0x080, 0x205, 0x305, 0x605, 0x701]) | st.integers(0, 0x7FF)


@given(words=st.lists(st.tuples(IDS, st.binary(max_size=8)), max_size=30))
@settings(derandomize=True, max_examples=60, deadline=None)
def test_no_frame_whatever_it_says_stops_the_virtual_drives(words):
    bench = Bench()
    bench.boot()
    bench.go_operational()
    for can_id, data in words:
        bench.send(can_id, data)
        bench.run_ms(1)

    assert bench.world.now_ns == 400 * MS + len(words) * MS
