"""Every fault's effect on the bus, by script and by command."""

import math
import re
import struct
from pathlib import Path

import pytest
from drive_bench import Bench
from trainers import QUIET, trainer

from sim_drives.faults.rules import RULES
from sim_drives.faults.script import FaultCommandError, help_text, parse_command
from sim_drives.settings import FaultKind, FaultSettings

DOCS = Path(__file__).resolve().parents[2] / "docs"


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


@pytest.mark.parametrize(("number", "base", "size"), [(1, 0x180, 7), (2, 0x280, 8)])
def test_the_bytes_of_a_tpdo_can_all_be_ones(running, number, base, size):
    other = 0x180 + 0x280 - base
    running.world.command(f"tpdo_all_ones right/hip 0.03 {number}")

    running.cycles(5)

    ones = [data == b"\xff" * size for data in running.frames(base + 5)]
    assert ones == [True, True, True, False, False]
    for can_id in (other + 5, base + 6, other + 6):
        assert not any(set(data) == {0xFF} for data in running.frames(can_id))
    assert running.read(0x60FD) & 0x3000F == 0x30000  # what the drive knows is as before


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


def test_the_hand_switch_is_a_bit_of_the_inputs_and_the_drive_leaves_it_at_that(running):
    running.enable(10)
    running.world.command("hand_switch_open *")
    running.cycle(0x0F)

    for node_id in (5, 6):
        inputs = struct.unpack("<I", running.frames(0x280 + node_id)[-1][4:8])[0]
        assert inputs >> 16 & 3 == 2
    assert running.state() == 0x27


def test_a_warning_is_told_and_the_drive_goes_on_until_it_is_told_to_be_over(running):
    running.enable(10)
    running.world.command("emcy_warning right/hip 0.05 0xFF01")
    running.cycle(0x0F)

    assert running.frames(0x085)[-1][:2] == b"\x01\xff"
    assert running.state() == 0x27
    running.cycles(10, 0x0F)
    assert running.frames(0x085)[-1][:2] == bytes(2)
    assert running.state() == 0x27


@pytest.mark.parametrize(("value", "bits"), [(-1, 0b01), (1, 0b10)])
def test_a_limit_switch_that_is_held_is_a_bit_of_the_inputs_wherever_the_joint_is(
    running, value, bits
):
    running.world.command(f"limit_switch_on right/hip 0.03 {value}")
    running.cycle()
    held = struct.unpack("<I", running.frames(0x285)[-1][4:8])[0]
    running.cycles(5)
    free = struct.unpack("<I", running.frames(0x285)[-1][4:8])[0]

    assert held & 0b11 == bits
    assert free & 0b11 == 0


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


# --- drives that are built, wired or made wrongly ---------------------------------------------


@pytest.fixture
def jointed():
    """On the real mechanics, enabled in cyclic torque; the slide is held."""
    made = Bench(
        plant=trainer(
            sensor=QUIET, start={"hip": {"position_deg": 14.0}, "slide": {"position_m": 0.5}}
        )
    )
    made.boot()
    for node_id in (5, 6):
        made.write(0x6065, 0, 0xFFFFFFFF, 4, node_id)
        made.go_operational(node_id)
    made.enable(8, node_id=6)
    made.enable(10)
    made.cycles(20, 0x0F, 10, 0, 300)
    return made


def shown_counts(bench):
    return struct.unpack("<i", struct.pack("<I", bench.read(0x6064)))[0]


def real_counts(bench):
    return bench.plant.truth().position[0] / (2 * math.pi) * 102_400


def speed_after(bench, cycles, torque):
    before = bench.plant.truth().velocity[0]
    bench.cycles(cycles, 0x0F, 10, 0, torque)
    return bench.plant.truth().velocity[0] - before


def test_a_motor_with_the_wrong_sign_moves_the_joint_the_other_way_and_its_encoder_is_right(
    jointed,
):
    rightly = speed_after(jointed, 3, 1000)
    jointed.cycles(60, 0x0F, 10, 0, 300)

    jointed.world.command("wrong_sign right/hip")
    wrongly = speed_after(jointed, 3, 1000)

    assert rightly > 0.1 > -0.1 > wrongly
    assert jointed.read(0x30D1, 2) == pytest.approx(5000, abs=50)
    truth = jointed.plant.truth()
    assert truth.effort[0] == pytest.approx(-27.87, rel=0.01)
    assert shown_counts(jointed) == pytest.approx(real_counts(jointed), abs=1)


def test_a_reversed_encoder_goes_on_where_it_is_and_counts_the_other_way(jointed):
    shown, real = shown_counts(jointed), real_counts(jointed)
    jointed.world.command("encoder_reversed right/hip")
    assert shown_counts(jointed) == pytest.approx(shown, abs=1)

    jointed.cycles(10, 0x0F, 10, 0, 1000)
    moved = real_counts(jointed) - real

    assert abs(moved) > 200
    assert shown_counts(jointed) - shown == pytest.approx(-moved, abs=2)
    jointed.world.command("clear encoder_reversed right/hip")
    assert shown_counts(jointed) == pytest.approx(real_counts(jointed), abs=1)


def test_a_current_sensor_with_an_offset_shows_what_was_ordered_and_gives_less(jointed):
    jointed.world.command("torque_offset right/hip - 500")
    jointed.cycles(3, 0x0F, 10, 0, 600)

    assert jointed.read(0x30D1, 2) == pytest.approx(3000, abs=10)
    assert jointed.plant.truth().effort[0] == pytest.approx(2.5 * 5.5736, rel=0.01)


def test_a_current_sensor_with_an_offset_shows_it_without_power_too(jointed):
    jointed.world.command("torque_offset right/hip - -500")
    jointed.cycles(5, 0x00)

    assert jointed.read(0x30D1, 2) == pytest.approx(2**32 - 500, abs=2)
    assert jointed.plant.truth().effort[0] == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("level", [0, 1])
def test_a_home_switch_can_stick_either_way(level):
    bench = Bench(hip={"home_switch": {"from_si": 0.0, "to_si": 0.25}})
    bench.boot()
    bench.plant.position[0] = 0.1 if level == 0 else 0.5
    assert bench.read(0x60FD) >> 2 & 1 == 1 - level

    bench.world.command(f"home_switch_stuck right/hip 1 {level}")
    assert bench.read(0x60FD) >> 2 & 1 == level

    bench.run_ms(1001)
    assert bench.read(0x60FD) >> 2 & 1 == 1 - level


def test_a_stuck_brake_holds_the_axis_also_when_a_jam_is_over(running):
    running.enable(10, 0, 300)
    running.world.command("brake_stuck right/hip")
    running.world.command("blocked_rotor right/hip 0.02")
    before = running.plant.position[0]
    running.cycles(10, 0x0F, 10, 0, 300)
    assert running.plant.position[0] == before

    running.world.command("clear brake_stuck right/hip")
    running.cycles(10, 0x0F, 10, 0, 300)
    assert running.plant.position[0] > before


def test_a_drive_that_ignores_the_quick_stop_shows_it_and_goes_on(running):
    running.world.command("ignores_quick_stop right/hip")
    running.enable(10, 0, 300)
    speed = running.plant.velocity[0]

    running.cycles(20, 0x02, 10, 0, 300)

    assert running.state() == 0x07
    assert running.plant.velocity[0] > speed
    assert not running.statusword() & 0x400
    running.world.command("clear ignores_quick_stop right/hip")
    running.run_ms(500)
    assert running.plant.velocity[0] == 0


def test_a_deaf_drive_hears_neither_sync_nor_sdo_and_its_heartbeat_goes_on(running):
    running.write(0x1017, 0, 20, 2)
    running.world.command("deaf right/hip 0.2")
    running.forget()
    running.cycles(10, 0x06)

    assert running.frames(0x185) == []
    assert running.ask(0x605, bytes.fromhex("4018100100000000")) == []
    assert len(running.frames(0x705)) == 5
    running.run_ms(120)
    assert running.state() == 0x40


def test_a_slow_drive_takes_so_much_longer_for_each_transition(running):
    running.world.command("slow_state right/hip - 200")
    begun_ms = running.now_ms
    for controlword, state in ((0x06, 0x21), (0x07, 0x23), (0x0F, 0x27), (0x02, 0x07)):
        asked_ms = running.now_ms
        while running.state() != state:
            running.cycle(controlword)
            assert running.now_ms - begun_ms < 2000
        assert 200 <= running.now_ms - asked_ms <= 230


def test_a_refused_object_aborts_its_writes_and_no_others(running):
    running.world.command("refuses_object right/hip - 0x6065")

    assert running.write(0x6065, 0, 1000, 4) == 0x08000020
    assert running.write(0x6084, 0, 1000, 4) == 0
    assert running.read(0x6065) == 2000
    running.world.command("clear refuses_object right/hip")
    assert running.write(0x6065, 0, 1000, 4) == 0


def test_another_drive_in_its_place_boots_with_another_identity_until_it_is_put_back(running):
    own = [running.read(0x1018, sub) for sub in range(1, 5)]
    running.world.command("wrong_identity right/hip - 0x65510000")
    running.run_ms(400)

    assert running.frames(0x705) == [b"\x00"]
    other = [running.read(0x1018, sub) for sub in range(1, 5)]
    assert other == [own[0], 0x65510000, own[2], own[3] + 1]
    running.nmt(0x81)
    running.run_ms(400)
    assert running.read(0x1018, 2) == 0x65510000

    running.world.command("clear wrong_identity right/hip")
    running.run_ms(400)
    assert [running.read(0x1018, sub) for sub in range(1, 5)] == own


def test_another_serial_number_alone_is_enough(running):
    product, serial = running.read(0x1018, 2), running.read(0x1018, 4)
    running.world.command("wrong_identity right/hip")
    running.run_ms(400)

    assert (running.read(0x1018, 2), running.read(0x1018, 4)) == (product, serial + 1)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("", "expected KIND DRIVE"),
        ("silent", "expected KIND DRIVE"),
        ("asleep right/hip", "unknown kind 'asleep'; known: lost_tpdo"),
        ("silent left/hip", "unknown drive 'left/hip'; known: right/hip, right/slide, *"),
        ("silent right/hip soon", "duration 'soon' is no number"),
        ("silent right/hip -1", "duration '-1' must be 0.001 to 1e+06 s"),
        ("silent right/hip 5e-324", "duration '5e-324' must be 0.001"),
        ("emcy right/slide 0x2310 2", "duration '0x2310' is no time in s; expected KIND DRIVE"),
        ("emcy right/slide 8976 2", "value 2 (error code) is not within 256 to 65535"),
        ("lost_tpdo right/slide 2 0.5", "value 0.5 (TPDO number, 0: all) is not whole"),
        ("silent right/hip nan", "is not finite"),
        ("silent right/hip 1 2", "silent has no value"),
        ("emcy right/hip 1", "emcy needs a value: error code"),
        ("emcy right/hip 1 0x12345", "not within 256 to 65535"),
        ("emcy right/hip 1 abc", "value 'abc' is no number"),
        ("lost_tpdo right/hip 1 7", "not within 0 to 4"),
        ("clear silent right/hip 3", "expected KIND DRIVE"),
        ("silent right/hip 1 0 0", "expected KIND DRIVE"),
    ],
)
def test_a_command_that_makes_no_sense_says_why(bench, line, said):
    with pytest.raises(FaultCommandError, match=re.escape(said)):
        bench.world.command(line)


def test_a_script_with_an_unknown_drive_is_refused_at_the_start():
    fault = FaultSettings(at_s=1.0, drive="left/hip", kind=FaultKind.SILENT)

    with pytest.raises(FaultCommandError, match="left/hip"):
        Bench(faults=[fault])


def test_a_value_may_be_hexadecimal_and_an_end_open():
    order = parse_command("emcy right/hip - 0x8130")

    assert (order.duration_s, order.value, order.clear) == (None, 0x8130, False)


def test_the_documents_have_the_form_of_a_fault_and_only_faults_that_are_possible():
    texts = [page.read_text(encoding="utf-8") for page in DOCS.glob("*.md")]
    shown = {line for text in texts for line in re.findall(r'inject[( ]"([^"]+)"', text)}

    assert {"help", "silent right/hip 0.5"} <= shown
    for line in shown - {"help", "clear KIND DRIVE"}:
        parse_command(line)
    assert any("`KIND DRIVE [DURATION_S [VALUE]]`" in text for text in texts)
