"""What an Elmo-like drive does differently from an EPOS4-like one."""

import math
import struct

import pytest
from drive_bench import Bench

ELMO = {"personality": "elmo_gold", "eds": "drives/elmo_gold.eds"}
SOD, RTSO, SO, OE, QSA = 0x40, 0x21, 0x23, 0x27, 0x07
COUNTS_PER_RAD = 1024 * 100 / (2 * math.pi)
RANGE, STATE = 0x06090030, 0x08000022


@pytest.fixture
def elmo():
    made = Bench(hip=ELMO, slide=ELMO)
    made.boot()
    return made


def control(bench, *controlwords):
    for controlword in controlwords:
        assert bench.write(0x6040, 0, controlword, 2) == 0
        bench.run_ms(3)


def signed(value, bits=32):
    return value - (1 << bits) if value >> (bits - 1) else value


def test_enabling_stops_in_switched_on_until_0f_comes_again(elmo):
    control(elmo, 0x06, 0x0F)
    assert elmo.state() == SO

    control(elmo, 0x0F)
    assert elmo.state() == OE


def test_a_cyclic_0f_from_ready_to_switch_on_enables_within_two_cycles(elmo):
    elmo.go_operational(torque=0x6078_0010)
    elmo.cycles(3, 0x06)

    elmo.cycle(0x0F)
    elmo.cycle(0x0F)
    assert elmo.state() == SO
    elmo.cycle(0x0F)
    assert elmo.state() == OE


def test_it_comes_with_the_defaults_of_its_public_configuration(elmo):
    expected = {
        (0x1018, 1): 0x9A,
        (0x1018, 2): 0x30923,
        (0x1018, 3): 0x103F6,
        (0x1017, 0): 0,
        (0x1029, 1): 1,
        (0x6007, 0): 1,
        (0x605A, 0): 2,
        (0x605D, 0): 2,
        (0x605E, 0): 2,
        (0x60C2, 1): 1,
        (0x1600, 1): 0x60400010,
        (0x1800, 2): 255,
        (0x1A00, 1): 0x60410010,
        (0x1A03, 0): 0,
        (0x6065, 0): 0,
        (0x6085, 0): 2_000_000_000,
        (0x6098, 0): 0,
    }

    assert {address: elmo.read(*address) for address in expected} == expected
    assert signed(elmo.read(0x607D, 1)) == -900_000_000


def test_its_default_mapping_works_without_any_configuration(elmo):
    elmo.nmt(0x01)
    elmo.send(0x205, struct.pack("<H", 0x06))
    elmo.run_ms(4)

    words = [struct.unpack("<H", data)[0] & 0x6F for data in elmo.frames(0x185)]
    assert words == [SOD, RTSO]


def test_pdos_that_are_delivered_valid_and_empty_say_and_do_nothing(elmo):
    elmo.nmt(0x01)
    elmo.send(0x305, bytes(8))
    elmo.cycles(3)

    assert elmo.read(0x1802, 1) == 0x4000_0385
    assert [elmo.frames(can_id) for can_id in (0x285, 0x385, 0x485, 0x085)] == [[], [], [], []]


def test_its_time_stamp_counts_microseconds(elmo):
    assert elmo.read(0x2041) == pytest.approx(elmo.now_ms * 1000, abs=2000)


def test_its_rpdos_have_no_watchdog(elmo):
    assert elmo.read(0x1400, 0) == 2
    assert elmo.read_abort(0x1400, 5) == 0x06090011


@pytest.mark.parametrize(
    ("index", "legal", "illegal"),
    [
        (0x605A, (0, 1, 2, 5, 6, 8), (9,)),
        (0x605B, (0, 1), (-1, 2)),
        (0x605C, (0, 1), (-1, 2)),
        (0x605D, (1, 2), (0, 3)),
        (0x605E, (0, 1, 2), (-1, 3)),
        (0x6007, (0, 1, 2, 3), (-1, 4)),
        (0x1029, (0, 1, 2), (3,)),
    ],
)
def test_its_option_codes_take_their_legal_values_alone(elmo, index, legal, illegal):
    sub, size = (1, 1) if index == 0x1029 else (0, 2)
    for value in legal:
        assert elmo.write(index, sub, value, size) == 0
    for value in illegal:
        assert elmo.write(index, sub, value, size) >> 16 == 0x0609


def test_current_and_torque_are_per_mille_of_6075(elmo):
    elmo.go_operational(torque=0x6078_0010)
    elmo.enable(10, 0, 500)
    elmo.cycles(2, 0x0F, 10, 0, 500)

    assert (elmo.read(0x6075), elmo.read(0x6076)) == (5000, 279)
    current_a = elmo.plant.effort(0) / 100 / 0.055736
    assert current_a == pytest.approx(0.5 * 5.0, rel=1e-6)
    assert elmo.read(0x6078) == pytest.approx(current_a / 5.0 * 1000, abs=1)
    assert elmo.read(0x6077) == 500


def test_its_torque_counts_the_rated_current_whatever_its_rated_torque_says(elmo):
    elmo.write(0x6076, 0, 10_000, 4)
    elmo.go_operational(torque=0x6078_0010)
    elmo.enable(10, 0, 500)
    elmo.cycles(2, 0x0F, 10, 0, 500)

    assert elmo.plant.effort(0) / 100 / 0.055736 == pytest.approx(2.5, rel=1e-6)


def test_temperature_is_in_whole_degrees(elmo):
    assert elmo.read(0x22A2) == 31


# --- a controlword out of place ---------------------------------------------------------------


def test_a_controlword_out_of_place_is_refused_by_sdo_with_a_warning_until_a_better_one(elmo):
    assert elmo.write(0x6040, 0, 0x0F, 2) == RANGE
    elmo.run_ms(3)

    assert elmo.state() == SOD
    assert elmo.statusword() & 0x80
    assert elmo.frames(0x085)[-1][:2] == b"\x00\x63"
    control(elmo, 0x06)
    assert elmo.state() == RTSO
    assert not elmo.statusword() & 0x80
    assert elmo.frames(0x085)[-1] == bytes(8)


def test_a_controlword_out_of_place_in_a_pdo_is_one_emcy_and_the_rest_is_taken(elmo):
    elmo.go_operational(torque=0x6078_0010)
    elmo.forget()

    elmo.cycles(5, 0x07, 8, 4242)

    assert elmo.state() == SOD
    assert [data[:2] for data in elmo.frames(0x085)] == [b"\x00\x63"]
    assert elmo.read(0x607A) == 4242
    assert elmo.read(0x6040) == 0


def test_what_an_ordinary_master_sends_is_never_out_of_place(elmo):
    elmo.write(0x605A, 0, 6, 2)
    elmo.go_operational(torque=0x6078_0010)
    elmo.forget()
    for controlword in (0x00, 0x02, 0x06, 0x07, 0x0F, 0x0F, 0x02, 0x02, 0x0F, 0x07, 0x06, 0x00):
        elmo.cycles(2, controlword)

    assert elmo.frames(0x085) == []


# --- the statusword's own clock ---------------------------------------------------------------


def test_the_statusword_is_renewed_every_three_milliseconds():
    bench = Bench(hip=ELMO)
    bench.boot()
    bench.run_ms(3 - bench.now_ms % 3)
    bench.run_ms(0.5)

    bench.write(0x6040, 0, 0x06, 2)
    assert bench.state() == SOD
    bench.run_ms(2.4)
    assert bench.state() == SOD
    bench.run_ms(0.2)
    assert bench.state() == RTSO


def test_an_epos4s_statusword_is_renewed_at_once(bench):
    bench.write(0x6040, 0, 0x06, 2)
    assert bench.state() == RTSO


# --- units ------------------------------------------------------------------------------------


def test_position_polarity_turns_positions_and_targets_round_and_leaves_the_joint_alone(elmo):
    before = signed(elmo.read(0x6064))
    assert elmo.write(0x607E, 0, 0x80, 1) == 0
    assert signed(elmo.read(0x6064)) == -before

    elmo.go_operational(torque=0x6078_0010)
    elmo.write(0x6065, 0, 0xFFFFFFFF, 4)
    elmo.enable(8, -before - 100)
    elmo.cycles(30, 0x0F, 8, -before - 100)
    assert elmo.plant.position[0] == pytest.approx((before + 100) / COUNTS_PER_RAD, abs=1e-4)


def test_velocity_polarity_turns_speeds_round(elmo):
    elmo.plant.velocity[0] = 1.0
    straight = signed(elmo.read(0x606C))
    elmo.write(0x607E, 0, 0x40, 1)

    assert straight == round(COUNTS_PER_RAD)
    assert signed(elmo.read(0x606C)) == -straight
    assert signed(elmo.read(0x6064)) > 0


def test_encoder_resolution_gear_and_feed_make_units_of_ones_own(elmo):
    elmo.plant.position[0] = 1.0
    elmo.plant.velocity[0] = 0.5
    for index, sub, value in ((0x608F, 1, 1024), (0x6091, 1, 100), (0x6092, 1, 360_000)):
        assert elmo.write(index, sub, value, 4) == 0

    assert signed(elmo.read(0x6064)) == pytest.approx(math.degrees(1.0) * 1000, abs=4)
    assert signed(elmo.read(0x606C)) == pytest.approx(math.degrees(0.5) * 1000, abs=4)


def test_units_are_locked_while_the_power_stage_is_on(elmo):
    control(elmo, 0x06, 0x07, 0x0F)

    assert elmo.write(0x607E, 0, 0x80, 1) == STATE
    assert elmo.write(0x608F, 1, 1024, 4) == STATE


def test_polarity_has_two_bits_and_no_more(elmo):
    assert elmo.write(0x607E, 0, 0x20, 1) == RANGE


def test_a_unit_of_zero_is_refused(elmo):
    for index in (0x608F, 0x6091):
        for sub in (1, 2):
            assert elmo.write(index, sub, 0, 4) == RANGE
    assert elmo.write(0x6092, 1, 0, 4) == RANGE
    assert elmo.write(0x6092, 2, 0, 4) == 0x06090032


# --- stops and losses -------------------------------------------------------------------------


def test_its_quick_stop_by_default_ends_without_torque(elmo):
    control(elmo, 0x06, 0x07, 0x0F)
    elmo.plant.velocity[0] = 0.5
    control(elmo, 0x02)
    elmo.run_ms(200)

    assert elmo.state() == SOD
    assert elmo.plant.velocity[0] == 0


def test_a_lost_master_is_a_fault_by_default_and_the_network_state_stays():
    bench = Bench(hip=ELMO)
    bench.boot()
    bench.write(0x1016, 1, 1 << 16 | 100, 4)
    bench.write(0x1017, 0, 100, 2)
    bench.go_operational(torque=0x6078_0010)
    bench.enable()
    bench.send(0x701, b"\x05")
    bench.forget()
    bench.run_ms(200)

    assert bench.state() == 0x08
    assert bench.frames(0x085)[0][:2] == b"\x30\x81"
    assert bench.frames(0x705)[-1] == b"\x05"
    bench.send(0x701, b"\x05")
    bench.write(0x6040, 0, 0x80, 2)
    bench.run_ms(3)
    assert bench.state() == SOD  # no reset communication needed
