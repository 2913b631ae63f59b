"""Bus-off, error-passive, identifier collisions, and EPOS4's 8250h in cyclic position mode."""

import struct

import pytest
from drive_bench import GENERIC, Bench

CSP = 8


def codes(bench):
    return [struct.unpack("<H", data[:2])[0] for data in bench.frames(0x085)]


def reset_fault(bench):
    bench.cycles(2, 0x00)
    bench.cycles(2, 0x80)
    bench.cycles(2, 0x00)


@pytest.fixture
def enabled(bench):
    """An EPOS4-like drive in cyclic torque."""
    bench.go_operational()
    bench.enable()
    bench.forget()
    return bench


@pytest.fixture
def plain(generic):
    """A plain drive in cyclic torque; 6007h and 1029h as one would set them."""
    generic.go_operational(torque=0x6077_0010)
    generic.write(0x6007, 0, 3, 2)
    generic.write(0x605A, 0, 6, 2)
    generic.enable()
    generic.forget()
    return generic


# --- bus-off --------------------------------------------------------------------------------------


def test_a_drive_that_is_off_the_bus_is_deaf_and_silent_and_stops_by_itself(enabled):
    enabled.write(0x1017, 0, 20, 2)
    enabled.forget()
    enabled.world.command("bus_off right/hip")
    before = len(enabled.plant.history)

    enabled.cycles(20, 0x0F)

    assert enabled.trace == []
    assert len(enabled.plant.history) > before
    assert enabled.plant.velocity[0] == 0


def test_an_epos4_says_that_it_was_off_the_bus_when_it_is_back(enabled):
    enabled.write(0x1029, 1, 1, 1)
    enabled.world.command("bus_off right/hip 0.1")
    enabled.cycles(20)

    assert codes(enabled) == [0x81FD]
    assert enabled.state() == 0x08
    assert enabled.read(0x1003, 0) == 1

    reset_fault(enabled)
    assert enabled.state() == 0x40
    assert codes(enabled) == [0x81FD, 0]


def test_a_plain_drive_says_that_it_has_recovered_and_is_well_again(plain):
    plain.write(0x1029, 1, 1, 1)
    plain.world.command("bus_off right/hip 0.1")
    plain.cycles(20)

    assert codes(plain) == [0x8140, 0]
    assert plain.state() == 0x07  # 6007h: quick stop


@pytest.mark.parametrize(("behaviour", "state"), [(0, 0x7F), (1, 0x05), (2, 0x04)])
def test_after_a_bus_off_the_nmt_state_is_what_1029h_says(plain, behaviour, state):
    plain.write(0x1029, 1, behaviour, 1)
    plain.write(0x1017, 0, 20, 2)
    plain.world.command("bus_off right/hip 0.1")
    plain.cycles(20)

    assert plain.frames(0x705)[-1] == bytes((state,))


# --- error-passive --------------------------------------------------------------------------------


def test_an_error_passive_epos4_is_reset_only_after_reset_communication(enabled):
    enabled.world.command("bus_passive right/hip 0.05")
    enabled.cycles(10)
    assert codes(enabled) == [0x8120]
    assert enabled.state() == 0x08
    reset_fault(enabled)
    assert enabled.state() == 0x08

    enabled.nmt(0x82)
    enabled.run_ms(100)
    enabled.go_operational()
    reset_fault(enabled)
    assert enabled.state() == 0x40


def test_an_error_passive_plain_drive_reports_it_while_it_lasts_and_stays_operational(plain):
    plain.world.command("bus_passive right/hip 0.05")
    plain.cycles(10)

    assert codes(plain) == [0x8120, 0]
    plain.cycle()
    assert len(plain.frames(0x185)) == 11


# --- collisions -----------------------------------------------------------------------------------


@pytest.mark.parametrize("can_id", [0x585, 0x705, 0x085, 0x185, 0x285])
def test_a_plain_drive_reports_a_frame_with_an_identifier_of_its_own_once(plain, can_id):
    for _ in range(3):
        plain.send(can_id, bytes(8))
        plain.cycle(0x0F)

    assert codes(plain) == [0x8150]
    assert plain.state() == 0x27
    assert plain.statusword() & 0x80

    plain.nmt(0x82)
    plain.run_ms(50)
    assert plain.read(0x1001) == 0


def test_an_epos4_takes_a_foreign_frame_of_its_tpdo_for_a_failed_connection(enabled):
    enabled.send(0x185, bytes(7))
    enabled.send(0x185, bytes(7))
    enabled.cycles(5, 0x0F)

    assert codes(enabled) == [0x8150]
    assert enabled.state() == 0x08
    reset_fault(enabled)
    assert enabled.state() == 0x40


@pytest.mark.parametrize("can_id", [0x585, 0x705, 0x085, 0x385, 0x186, 0x706])
def test_an_epos4_does_not_mind_other_foreign_frames(enabled, can_id):
    enabled.send(can_id, bytes(8))
    enabled.cycles(2, 0x0F)

    assert codes(enabled) == []


# --- positions that do not come in time -----------------------------------------------------------


def following(period=10, **drive):
    """A drive that follows positions, with this interpolation period in ms."""
    bench = Bench(hip=drive)
    bench.boot()
    torque = 0x6077_0010 if drive else 0x30D1_0220
    bench.go_operational(torque=torque)
    bench.write(0x60C2, 1, period, 1)
    bench.write(0x6007, 0, 3, 2)
    bench.here = bench.read(0x6064)
    bench.enable(CSP, bench.here)
    bench.cycles(10, 0x0F, CSP, bench.here)
    bench.forget()
    return bench


def test_an_epos4_that_gets_no_position_for_one_cycle_stops_with_8250():
    bench = following()
    last_ms = bench.now_ms
    bench.send(0x080)  # applies the last one
    bench.run_ms(10)
    bench.send(0x080)  # nothing has come for this one
    bench.run_ms(2)
    assert codes(bench) == []
    bench.run_ms(8)

    assert codes(bench) == [0x8250]
    assert bench.times_ms(0x085) == [last_ms + 15]
    assert bench.state() in (0x0F, 0x08)
    bench.cycles(20)
    assert bench.state() == 0x08

    reset_fault(bench)
    assert bench.state() == 0x40
    assert codes(bench) == [0x8250, 0]


def test_a_sync_that_stays_away_starves_the_interpolation_too():
    bench = following()
    bench.send(0x080)
    bench.send(0x205, struct.pack("<Hbi", 0x0F, CSP, bench.here))
    bench.run_ms(20)

    assert codes(bench) == [0x8250]


def test_positions_that_come_every_cycle_are_in_time():
    bench = following()
    bench.cycles(100, 0x0F, CSP, bench.here)

    assert codes(bench) == []


def test_without_an_interpolation_period_no_position_is_missed():
    bench = following(period=0)
    bench.run_ms(500)

    assert codes(bench) == []


def test_in_cyclic_torque_no_position_is_missed(enabled):
    enabled.write(0x60C2, 1, 10, 1)
    enabled.cycles(10, 0x0F)
    enabled.run_ms(500)

    assert codes(enabled) == []


def test_a_plain_drive_does_not_mind_a_skipped_position():
    bench = following(**GENERIC)
    bench.run_ms(500)

    assert codes(bench) == []


def test_a_drive_that_is_stopped_on_purpose_misses_nothing():
    bench = following()
    bench.cycles(3, 0x02, CSP, bench.here)
    bench.run_ms(500)

    assert codes(bench) == []
