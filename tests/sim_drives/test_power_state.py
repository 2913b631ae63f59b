"""Power states of the virtual drives, and what leads from one to another: S04, S05, S15, S17.

The table of CiA 402 is played by `tests/conformance/test_power_states_by_a_third_model.py`, the
ramps of the option codes by `test_option_codes.py`.
"""

import pytest
from drive_bench import Bench
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_drives.cia402.power_state import TRANSITIONS, Command, PowerState, command_of
from sim_drives.plant.actuation import Actuation, AxisFlag

SOD, RTSO, SO, OE, QSA, FRA, FAULT = 0x40, 0x21, 0x23, 0x27, 0x07, 0x0F, 0x08
DISABLE, QUICK, SHUTDOWN, SWITCH_ON, ENABLE = range(5)
COLUMN = {
    **dict.fromkeys((0x0, 0x1, 0x4, 0x5, 0x8, 0x9, 0xC, 0xD), DISABLE),
    **dict.fromkeys((0x2, 0x3, 0xA, 0xB), QUICK),
    **dict.fromkeys((0x6, 0xE), SHUTDOWN),
    0x7: SWITCH_ON,
    0xF: ENABLE,
}
"""The sixteen classes of controlword by their lowest four bits, from the patterns of 5.2."""
WAY = {
    SOD: (),
    RTSO: (0x06,),
    SO: (0x06, 0x07),
    OE: (0x06, 0x07, 0x0F),
    QSA: (0x06, 0x07, 0x0F, 0x02),
}


def control(bench, *controlwords):
    for controlword in controlwords:
        assert bench.write(0x6040, 0, controlword, 2) == 0


def drive_in(state, **changes):
    """A fresh drive in a state."""
    bench = Bench(hip=changes)
    bench.boot()
    bench.write(0x605B, 0, 0, 2)
    bench.write(0x605C, 0, 0, 2)
    if (0x605A, 0) in bench.world.node("right/hip").dictionary:
        bench.write(0x605A, 0, 6, 2)
    if state in WAY:
        for controlword in WAY[state]:
            control(bench, controlword)
            bench.run_ms(3 if changes else 0)  # a make whose statusword has a clock of its own
    elif state == FRA:
        control(bench, *WAY[OE])
        bench.plant.velocity[0] = 1.0
        bench.world.command("emcy right/hip - 0x2310")
    else:
        bench.world.command("emcy right/hip - 0x2310")
        bench.run_ms(10)
    assert bench.state() == state
    return bench


@given(st.integers(0, 0xFFFF))
@settings(derandomize=True)
def test_only_the_lowest_four_bits_and_bit_seven_make_a_command(controlword):
    expected = COLUMN[controlword & 0xF]
    command = command_of(controlword)
    if controlword & 0x80 and expected in (SWITCH_ON, ENABLE):
        assert command is None
    else:
        assert command is list(Command)[expected]


def test_power_is_given_by_no_other_way_than_through_switched_on():
    into = {source for (source, _), row in TRANSITIONS.items() if row.target.value == OE}

    assert into == {PowerState.SWITCHED_ON, PowerState.QUICK_STOP_ACTIVE}


def test_a_plain_drive_waits_in_switched_on_for_the_next_controlword(generic):
    control(generic, 0x06, 0x0F)
    assert generic.state() == SO

    control(generic, 0x0F)
    assert generic.state() == OE


# --- faults -----------------------------------------------------------------------------------


def test_a_fault_is_told_once_with_code_register_and_history(bench):
    bench.world.command("emcy right/hip - 0x2310")
    bench.run_ms(100)

    assert bench.frames(0x085) == [bytes.fromhex("1023020000000000")]
    assert bench.read(0x603F) == 0x2310
    assert (bench.read(0x1003, 0), bench.read(0x1003, 1)) == (1, 0x2310)
    assert bench.read(0x1001) == 0x02
    assert bench.state() == FAULT


def test_the_history_keeps_the_newest_first_and_is_emptied_by_zero(bench):
    for code in (0x2310, 0x4310, 0x7305):
        bench.world.command(f"emcy right/hip 0.001 {code:#x}")
        bench.run_ms(5)

    assert [bench.read(0x1003, sub) for sub in range(4)] == [3, 0x7305, 0x4310, 0x2310]
    bench.write(0x1003, 0, 0, 1)
    assert bench.read(0x1003, 0) == 0
    assert bench.read_abort(0x1003, 1) == 0x08000024


def test_emergencies_keep_their_distance(generic):
    bench = generic
    bench.write(0x1015, 0, 100, 2)  # 10 ms
    for code in (0x2310, 0x4310, 0x7305):
        bench.world.command(f"emcy right/hip - {code:#x}")
    bench.run_ms(50)

    first, second, third = bench.times_ms(0x085)
    assert (second - first, third - second) == (10, 10)


def test_an_open_sto_takes_the_torque_at_once_and_refuses_the_reset_until_it_is_released():
    bench = drive_in(OE)
    bench.plant.velocity[0] = 1.0

    bench.world.command("sto_open right/hip")
    assert bench.plant.orders[0].actuation is Actuation.COAST
    bench.run_ms(5)
    assert bench.state() == FAULT
    assert bench.frames(0x085) == [bytes.fromhex("888a200000000000")]
    assert not bench.read(0x60FD) >> 17 & 1
    assert not bench.statusword() & 0x10

    control(bench, 0x00, 0x80)
    assert bench.state() == FAULT
    bench.world.command("clear sto_open right/hip")
    control(bench, 0x00, 0x80)
    assert bench.state() == SOD


def test_an_sto_that_opens_during_a_fault_ramp_ends_the_ramp():
    bench = drive_in(FRA)

    bench.world.command("sto_open right/hip")
    assert bench.plant.orders[0].actuation is Actuation.COAST
    bench.run_ms(2)

    assert bench.state() == FAULT


def test_a_fault_during_the_self_test_is_still_a_fault_after_it():
    bench = Bench()
    bench.run_ms(150)

    bench.world.command("emcy right/hip - 0x2310")
    bench.run_ms(300)

    assert bench.state() == FAULT


# --- option codes -----------------------------------------------------------------------------

GENERIC = {"personality": "generic", "eds": "drives/generic402.eds"}
COUNTS_PER_RAD = 1024 * 100 / 6.283185307


def moving_generic():
    bench = Bench(hip=GENERIC)
    bench.boot()
    bench.write(0x6084, 0, round(5 * COUNTS_PER_RAD), 4)
    bench.write(0x6085, 0, round(20 * COUNTS_PER_RAD), 4)
    control(bench, 0x06, 0x07, 0x0F)
    bench.plant.velocity[0] = 1.0
    return bench


def test_quick_stop_option_zero_takes_the_torque_away():
    bench = moving_generic()
    bench.write(0x605A, 0, 0, 2)

    control(bench, 0x02)

    assert bench.state() == SOD
    assert bench.plant.orders[0].actuation is Actuation.COAST


@pytest.mark.parametrize(("option", "state"), [(2, SOD), (6, OE)])
def test_a_quick_stop_is_left_to_enabled_only_where_the_option_stays(option, state):
    bench = moving_generic()
    bench.write(0x605A, 0, option, 2)

    control(bench, 0x02)
    bench.run_ms(200)
    control(bench, 0x0F)

    assert bench.state() == state


def test_enable_ends_the_slow_down_of_disable():
    bench = moving_generic()
    control(bench, 0x07)
    bench.run_ms(50)

    control(bench, 0x0F)
    bench.run_ms(500)

    assert bench.state() == OE


def test_disable_voltage_lets_a_moving_axis_coast_at_once():
    bench = moving_generic()

    control(bench, 0x00)

    assert bench.state() == SOD
    assert bench.plant.orders[0].actuation is Actuation.COAST


# --- modes and limits -------------------------------------------------------------------------


def test_a_mode_is_shown_one_sync_after_it_was_applied(bench):
    bench.go_operational()
    bench.cycles(2, 0x06, 0)
    bench.forget()

    bench.cycles(4, 0x06, 8)

    assert [data[6] for data in bench.frames(0x185)] == [0, 0, 8, 8]


def test_a_mode_that_is_not_supported_is_ignored_in_a_pdo_and_the_rest_is_taken(bench):
    bench.go_operational()
    bench.cycles(3, 0x06, 10)

    bench.cycles(3, 0x06, 3, 4242)

    assert bench.read(0x6061) == 10
    assert bench.read(0x607A) == 4242


def test_a_cyclic_mode_follows_only_what_was_commanded(bench):
    bench.write(0x6060, 0, 8, 1)
    bench.run_ms(10)
    control(bench, 0x06, 0x07, 0x0F)

    assert not bench.statusword() & 0x1000
    assert bench.plant.orders[0].actuation is Actuation.HOLD

    bench.write(0x607A, 0, 3000, 4)
    assert bench.statusword() & 0x1000
    assert bench.plant.orders[0].actuation is Actuation.POSITION


def blocked(bench, torque):
    """Enabled in cyclic position where it is, with a window of 50 counts, and blocked."""
    bench.write(0x6065, 0, 50, 4)
    bench.go_operational(torque=torque)
    start = bench.read(0x6064)
    bench.enable(8, start)
    bench.world.command("blocked_rotor right/hip")
    bench.forget()
    return start


def test_a_following_error_is_fault_8611_with_its_bit_and_reaction(bench):
    start = blocked(bench, 0x30D1_0220)

    bench.cycles(4, 0x0F, 8, start + 50)
    assert bench.frames(0x085) == []
    bench.cycles(2, 0x0F, 8, start + 51)  # an EPOS4's 6066h is 0

    assert bench.frames(0x085) == [bytes.fromhex("1186200000000000")]
    assert bench.state() == FAULT
    assert bench.statusword() & 0x2000


def test_a_following_error_may_last_as_long_as_6066_says(generic):
    generic.write(0x6066, 0, 20, 2)
    start = blocked(generic, 0x6077_0010)

    generic.cycles(2, 0x0F, 8, start + 51)
    assert generic.frames(0x085) == []
    generic.cycles(3, 0x0F, 8, start + 51)

    assert generic.frames(0x085) == [bytes.fromhex("1186210000000000")]
    assert generic.state() == FAULT


def test_a_window_of_all_ones_watches_nothing(bench):
    bench.write(0x6065, 0, 0xFFFFFFFF, 4)
    bench.go_operational()
    start = bench.read(0x6064)
    bench.enable(8, start)
    bench.world.command("blocked_rotor right/hip")

    bench.cycles(20, 0x0F, 8, start + 20000)

    assert bench.state() == OE


def test_a_pushed_limit_switch_is_reported_in_the_drives_direction():
    bench = Bench(slide={"limit_switch": "fault"})
    bench.boot()
    control_slide = [(0x6040, 0, word, 2, 6) for word in (0x06, 0x07, 0x0F)]
    for write in control_slide:
        bench.write(*write)
    bench.plant.raised[1] |= AxisFlag.END_STOP_POSITIVE
    bench.run_ms(20)

    assert bench.read(0x60FD, 0, 6) & 3 == 1  # the slide's drive counts the other way
    assert bench.read(0x603F, 0, 6) == 0x8A80


def test_a_torque_target_beyond_the_limit_is_cut_and_said():
    bench = drive_in(OE)
    bench.write(0x3001, 2, 1000, 4)
    bench.go_operational()
    bench.enable(10, 0, 400)
    bench.cycles(3, 0x0F, 10, 0, 400)

    assert bench.read(0x30D1, 2) == 1000
    assert bench.statusword() & 0x0800


# --- origin -----------------------------------------------------------------------------------


def test_an_absolute_encoder_is_referenced_from_the_start_and_cannot_be_homed(bench):
    assert bench.statusword() & 0x8000
    assert not bench.read(0x6502) & 1 << 5


def test_an_incremental_encoder_counts_from_power_on_and_is_referenced_by_homing():
    bench = Bench(hip={"encoder": "incremental"})
    bench.boot()
    assert bench.read(0x6064) == 0
    assert not bench.statusword() & 0x8000

    bench.write(0x30B0, 0, 1234, 4)
    bench.write(0x6098, 0, 37, 1)
    bench.write(0x6060, 0, 6, 1)
    bench.run_ms(10)
    control(bench, 0x06, 0x07, 0x0F)
    assert bench.statusword() & 0x3400 == 0x0400  # not started
    control(bench, 0x1F)

    assert bench.statusword() & 0xB400 == 0x9400  # done, and referenced
    assert bench.read(0x6064) == 1234


def test_a_reboot_loses_the_origin_of_an_incremental_encoder():
    bench = Bench(hip={"encoder": "incremental"})
    bench.boot()
    bench.write(0x6060, 0, 6, 1)
    bench.run_ms(10)
    control(bench, 0x06, 0x07, 0x0F, 0x1F)
    bench.plant.position[0] += 0.1

    bench.world.command("reboot right/hip")
    bench.boot()

    assert bench.read(0x6064) == 0
    assert not bench.statusword() & 0x8000
