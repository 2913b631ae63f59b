"""Every fault's effect on the bus, by script and by command."""

import struct

import pytest
from drive_bench import Bench

from sim_drives.faults import RULES, FaultCommandError, help_text, parse_command
from sim_drives.settings import FaultKind, FaultSettings


@pytest.fixture
def running(bench):
    for node_id in (5, 6):
        bench.go_operational(node_id)
    bench.cycles(2)
    bench.forget()
    return bench


def positions(bench):
    return [struct.unpack("<i", data[2:6])[0] for data in bench.frames(0x185)]


def test_every_kind_has_a_rule_and_its_line_of_help():
    assert set(RULES) == set(FaultKind)
    assert all(f"{kind.value}:" in help_text() for kind in FaultKind)


def test_lost_tpdos_are_missing_and_the_others_come(running):
    running.world.command("lost_tpdo right/hip 0.03 2")

    running.cycles(5)

    assert len(running.frames(0x185)) == 5
    assert len(running.frames(0x285)) == 2
    assert len(running.frames(0x286)) == 5


def test_all_tpdos_can_get_lost(running):
    running.world.command("lost_tpdo right/hip")
    running.cycles(3)
    running.world.command("clear lost_tpdo right/hip")
    running.cycles(3)

    assert len(running.frames(0x185)) == len(running.frames(0x285)) == 3


def test_late_tpdos_come_later_by_what_was_asked(running):
    running.world.command("late_tpdo right/hip - 7")
    at_ms = running.now_ms

    running.cycle()

    assert 7.1 <= running.times_ms(0x185)[0] - at_ms <= 7.6
    assert 0.1 <= running.times_ms(0x186)[0] - at_ms <= 0.6


def test_a_silent_drive_says_nothing_and_still_listens(running):
    running.write(0x1017, 0, 20, 2)
    running.world.command("silent right/hip 0.095")
    running.forget()

    running.cycles(9, 0x06)
    assert running.frames(0x185) == running.frames(0x705) == []
    running.cycles(3)

    assert len(running.frames(0x185)) == 2  # it ended 95 ms after a SYNC
    assert running.state() == 0x21


def test_an_unplugged_drive_hears_nothing_and_misses_its_master(running):
    running.write(0x1016, 1, 1 << 16 | 100, 4)
    running.send(0x701, b"\x05")
    running.world.command("unplugged right/hip 0.3")
    for _ in range(40):
        running.send(0x701, b"\x05")
        running.cycle(0x06)

    assert running.frames(0x085) == []
    assert running.read(0x1003, 1) == 0x8130


def test_an_emcy_is_a_fault_for_as_long_as_its_cause_lasts(running):
    running.world.command("emcy right/hip 0.2 0x2310")
    running.cycles(5)

    assert running.frames(0x085) == [bytes.fromhex("1023020000000000")]
    assert running.frames(0x086) == []
    assert running.state() == 0x08


def test_a_frozen_encoder_repeats_its_count_while_the_axis_moves(running):
    running.cycle()
    running.world.command("frozen_encoder right/hip 0.05")
    running.plant.velocity[0] = 1.0
    running.cycles(4)
    assert len(set(positions(running))) == 1

    running.cycles(3)
    assert len(set(positions(running))) > 2


def test_a_glitch_spoils_one_sample(running):
    running.cycle()
    running.world.command("encoder_glitch right/hip - 5000")
    running.cycles(3)

    first, glitched, *rest = positions(running)
    assert glitched == first + 5000
    assert rest == [first, first]


def test_a_glitch_with_a_duration_spoils_all_samples_until_then(running):
    running.world.command("encoder_glitch right/hip 0.025 -70")
    running.cycles(5)

    found = positions(running)
    assert [value - found[-1] for value in found] == [-70, -70, -70, 0, 0]


def test_a_reboot_is_a_boot_up_message_out_of_turn_and_a_lost_configuration(running):
    running.world.command("reboot right/hip 0.05")
    running.run_ms(500)
    running.cycles(2)

    assert running.frames(0x705) == [b"\x00"]
    assert running.frames(0x185) == []
    assert len(running.frames(0x186)) == 2
    assert running.read(0x1A00, 0) == 1


def test_a_rebooting_drive_gives_no_torque_and_no_answer(running):
    running.enable(10, 0, 300)
    assert running.plant.effort(0) > 0

    running.world.command("reboot right/hip 1")
    running.run_ms(10)

    assert running.plant.effort(0) == 0
    assert running.ask(0x605, bytes.fromhex("4018100100000000")) == []


def test_a_blocked_rotor_stands_whatever_the_torque_is(running):
    running.enable(10, 0, 300)
    running.world.command("blocked_rotor right/hip 0.1")
    before = running.plant.position[0]
    running.cycles(5, 0x0F, 10, 0, 300)
    assert running.plant.position[0] == before

    running.cycles(20, 0x0F, 10, 0, 300)
    assert running.plant.position[0] > before


def test_the_hand_switch_is_a_bit_of_the_inputs_and_the_drive_leaves_it_at_that(running):
    running.enable(10)
    running.world.command("hand_switch_open *")
    running.cycle(0x0F)

    for node_id in (5, 6):
        inputs = struct.unpack("<I", running.frames(0x280 + node_id)[-1][4:8])[0]
        assert inputs >> 16 & 3 == 2
    assert running.state() == 0x27


def test_the_sto_of_every_drive_opens_with_a_star(running):
    running.world.command("sto_open *")
    running.cycles(2)

    assert [running.state(node_id) for node_id in (5, 6)] == [0x08, 0x08]


def test_an_sto_that_is_open_at_power_on_is_a_fault_after_the_self_test():
    bench = Bench(faults=[FaultSettings(at_s=0.0, drive="*", kind=FaultKind.STO_OPEN)])
    bench.boot()

    assert bench.state() == 0x08


def test_a_script_begins_and_ends_its_faults_at_their_times():
    script = [
        FaultSettings(at_s=0.5, drive="right/hip", kind=FaultKind.SILENT, duration_s=0.2),
        FaultSettings(at_s=0.8, drive="*", kind=FaultKind.EMCY, duration_s=0.1, value=0x4310),
    ]
    bench = Bench(faults=script)
    bench.boot()
    bench.write(0x1017, 0, 10, 2)

    bench.run_ms(600)

    beats = [time for time in bench.times_ms(0x705) if time > 400]
    assert [time for time in beats if 500 < time < 700] == []
    assert bench.times_ms(0x085) == bench.times_ms(0x086) == [800]


def test_the_end_of_an_older_fault_does_not_end_a_newer_one(running):
    running.world.command("silent right/hip 0.05")
    running.cycles(2)
    running.world.command("silent right/hip 0.1")
    running.forget()

    running.cycles(8)
    assert running.frames(0x185) == []
    running.cycles(4)
    assert len(running.frames(0x185)) == 2


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("", "expected KIND DRIVE"),
        ("silent", "expected KIND DRIVE"),
        ("asleep right/hip", "unknown kind 'asleep'; known: lost_tpdo"),
        ("silent left/hip", "unknown drive 'left/hip'; known: right/hip, right/slide, *"),
        ("silent right/hip soon", "duration 'soon' is no number"),
        ("silent right/hip -1", "duration '-1' must be above 0"),
        ("silent right/hip nan", "is not finite"),
        ("silent right/hip 1 2", "silent has no value"),
        ("emcy right/hip 1", "emcy needs a value: error code"),
        ("emcy right/hip 1 0x12345", "not within 1 to 65535"),
        ("emcy right/hip 1 abc", "value 'abc' is no number"),
        ("lost_tpdo right/hip 1 7", "not within 0 to 4"),
        ("clear silent right/hip 3", "expected KIND DRIVE"),
        ("silent right/hip 1 0 0", "expected KIND DRIVE"),
    ],
)
def test_a_command_that_makes_no_sense_says_why(bench, line, said):
    with pytest.raises(FaultCommandError, match=said.replace("*", r"\*")):
        bench.world.command(line)


def test_a_script_with_an_unknown_drive_is_refused_at_the_start():
    fault = FaultSettings(at_s=1.0, drive="left/hip", kind=FaultKind.SILENT)

    with pytest.raises(FaultCommandError, match="left/hip"):
        Bench(faults=[fault])


def test_a_value_may_be_hexadecimal_and_an_end_open():
    order = parse_command("emcy right/hip - 0x8130")

    assert (order.duration_s, order.value, order.clear) == (None, 0x8130, False)


def test_a_lost_connection_by_command_acts_like_one(generic):
    generic.write(0x6007, 0, 3, 2)
    generic.go_operational(torque=0x6077_0010)
    generic.write(0x605A, 0, 6, 2)
    generic.enable()

    generic.world.command("emcy right/hip 0.1 0x8130")
    assert generic.state() == 0x07
    generic.run_ms(200)

    assert generic.frames(0x085)[-1] == bytes(8)
