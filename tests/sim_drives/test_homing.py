"""Homing: each method's way on the real mechanics, and the statusword all along it."""

import math

import pytest
from drive_bench import GENERIC, Bench
from trainers import QUIET, trainer

from sim_drives.plant.actuation import AxisFlag

COUNTS_PER_RAD = 1024 * 100 / (2 * math.pi)
NOT_STARTED, SEARCHING, ATTAINED, DONE = 0x0400, 0x0000, 0x1000, 0x1400
FAILING, FAILED = 0x2000, 0x2400
HOMING_BITS = 0x3400
LOWER_STOP_RAD = math.radians(-23.0)
UPPER_STOP_RAD = math.radians(43.0)
INCREMENTAL = {"encoder": "incremental"}
ELMO = {"personality": "elmo_gold", "eds": "drives/elmo_gold.eds"}


def control(bench, *controlwords, node_id=5):
    for controlword in controlwords:
        assert bench.write(0x6040, 0, controlword, 2, node_id) == 0


def bits(bench):
    return bench.statusword() & HOMING_BITS


def position(bench):
    raw = bench.read(0x6064)
    return raw - (1 << 32) if raw >> 31 else raw


def homing_bench(method, plant=None, **changes):
    """Enabled in homing mode, about to start; the slide holds the leg."""
    bench = Bench(hip=INCREMENTAL | changes, plant=plant)
    bench.boot()
    for node_id in (6, 5):
        bench.write(0x6065, 0, 0xFFFFFFFF, 4, node_id)
    assert bench.write(0x6098, 0, method, 1) == 0
    bench.write(0x6060, 0, 6, 1)
    bench.run_ms(10)
    for node_id in (6, 5):
        control(bench, 0x06, 0x07, 0x0F, 0x0F, node_id=node_id)
    bench.run_ms(300)
    assert bench.state() == bench.state(6) == 0x27
    return bench


def on_the_trainer(method, start_deg=14.0, **changes):
    plant = trainer(
        sensor=QUIET, start={"hip": {"position_deg": start_deg}, "slide": {"position_m": 0.5}}
    )
    bench = homing_bench(method, plant, **changes)
    bench.write(0x6099, 1, 300, 4)  # rpm of the motor: 0.31 rad/s at the joint
    bench.write(0x6099, 2, 60, 4)
    return bench


def run_until(bench, wanted, within_s=30.0):
    """The homing bits as they follow one another, without repetitions, up to `wanted`."""
    seen = [bits(bench)]
    for _ in range(round(within_s * 200)):
        if seen[-1] in wanted:
            return seen
        bench.run_ms(5)
        if bits(bench) != seen[-1]:
            seen.append(bits(bench))
    raise AssertionError(f"bits {[hex(word) for word in seen]} after {within_s} s")


def origin_rad(bench):
    """Joint angle at which 6064h reads 0: rotary, sign +1."""
    return bench.plant.truth().position[0] - position(bench) / COUNTS_PER_RAD


# --- the ways ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("method", "stop_rad"),
    [
        (17, LOWER_STOP_RAD),
        (-3, UPPER_STOP_RAD),
    ],
)
def test_a_switch_or_a_stop_is_found_by_moving_there(method, stop_rad):
    bench = on_the_trainer(method)
    bench.write(0x30B2, 0, 11_500, 2)

    control(bench, 0x1F)
    seen = run_until(bench, (DONE, FAILED))

    assert seen == [SEARCHING, ATTAINED, DONE]
    assert origin_rad(bench) == pytest.approx(stop_rad, abs=0.02)
    assert abs(bench.plant.truth().velocity[0]) < 0.02


@pytest.mark.parametrize(
    ("method", "start_deg", "direction"), [(33, 14.0, -1), (34, 14.0, +1), (34, -1.0, +1)]
)
def test_the_next_index_in_the_methods_direction_is_the_reference(method, start_deg, direction):
    bench = on_the_trainer(method, start_deg)
    begun_turns = bench.plant.truth().position[0] * 100 / (2 * math.pi)

    control(bench, 0x1F)
    run_until(bench, (DONE, FAILED))

    index = math.floor(begun_turns) if direction < 0 else math.ceil(begun_turns)
    assert origin_rad(bench) * 100 / (2 * math.pi) == pytest.approx(index, abs=0.002)


@pytest.mark.parametrize(
    ("method", "stop_rad", "inwards"),
    [
        (1, LOWER_STOP_RAD, +1),
        (-1, UPPER_STOP_RAD, -1),
    ],
)
def test_a_switch_or_stop_with_index_takes_the_first_index_inside_of_it(method, stop_rad, inwards):
    bench = on_the_trainer(method)
    bench.write(0x30B2, 0, 11_500, 2)

    control(bench, 0x1F)
    run_until(bench, (DONE, FAILED))

    origin_turns = origin_rad(bench) * 100 / (2 * math.pi)
    assert origin_turns == pytest.approx(round(origin_turns), abs=0.002)
    beyond_turns = (origin_turns - stop_rad * 100 / (2 * math.pi)) * inwards
    assert -0.2 < beyond_turns <= 1.0


@pytest.mark.parametrize(
    ("method", "changes", "home"), [(37, {}, 0x30B0), (35, GENERIC, 0x607C), (37, GENERIC, 0x607C)]
)
def test_the_present_position_becomes_the_home_position_without_motion(method, changes, home):
    bench = homing_bench(method, **changes)
    assert bench.write(home, 0, 1234, 4) == 0
    there = bench.plant.position[0]

    control(bench, 0x1F)

    assert bits(bench) == DONE
    assert position(bench) == 1234
    bench.run_ms(500)
    assert bench.plant.position[0] == there


@pytest.mark.parametrize(
    ("method", "low_rad", "high_rad", "turns_round"),
    [
        (23, 0.40, 0.45, False),
        (27, 0.40, 0.45, True),
        (27, 0.10, 0.40, False),
    ],
)
def test_the_home_switchs_edge_is_found_from_below_above_and_inside_or_by_turning_round(
    method, low_rad, high_rad, turns_round
):
    bench = on_the_trainer(method, home_switch={"from_si": low_rad, "to_si": high_rad})
    start_rad = bench.plant.truth().position[0]
    edge_rad = low_rad if method == 23 else high_rad
    away = (start_rad > high_rad) if method == 23 else (start_rad < low_rad)
    assert away is turns_round

    control(bench, 0x1F)
    seen = run_until(bench, (DONE, FAILED))

    assert seen[-1] == DONE
    assert origin_rad(bench) == pytest.approx(edge_rad, abs=2e-3)


def test_an_axis_that_counts_backwards_searches_in_its_own_direction():
    plant = trainer(
        sensor=QUIET, start={"hip": {"position_deg": 0.0}, "slide": {"position_m": 0.4}}
    )
    bench = Bench(slide=INCREMENTAL, plant=plant)
    bench.boot()
    bench.write(0x6098, 0, 18, 1, 6)  # positive for this drive: the slide's negative end
    bench.write(0x6060, 0, 6, 1, 6)
    bench.write(0x6099, 1, 300, 4, 6)
    bench.run_ms(10)
    for node_id in (5, 6):
        control(bench, 0x06, 0x07, 0x0F, node_id=node_id)
    control(bench, 0x1F, node_id=6)
    bench.run_ms(10_000)

    assert bench.statusword(6) & HOMING_BITS == DONE
    assert plant.truth().position[1] == pytest.approx(-0.02, abs=0.01)


# --- 30B0h, 30B1h -----------------------------------------------------------------------------


def test_the_axis_moves_on_by_30b1_away_from_what_it_found_and_there_reads_30b0():
    bench = on_the_trainer(-3)
    bench.write(0x30B2, 0, 11_500, 2)
    bench.write(0x30B1, 0, 3000, 4)
    bench.write(0x30B0, 0, 500, 4)

    control(bench, 0x1F)
    seen = run_until(bench, (DONE, FAILED))

    assert seen == [SEARCHING, ATTAINED, DONE]
    goal_rad = UPPER_STOP_RAD - 3000 / COUNTS_PER_RAD
    assert origin_rad(bench) + 500 / COUNTS_PER_RAD == pytest.approx(goal_rad, abs=0.02)
    assert position(bench) == pytest.approx(500, abs=200)


def test_the_method_that_an_elmo_is_delivered_with_is_no_homing():
    bench = Bench(hip=INCREMENTAL | ELMO)
    bench.boot()
    assert bench.read(0x6098) == 0
    bench.write(0x6060, 0, 6, 1)
    for controlword in (0x06, 0x07, 0x0F, 0x1F):
        bench.run_ms(10)
        control(bench, controlword)
    bench.run_ms(50)

    assert bench.statusword() & (HOMING_BITS | 0x8000) == NOT_STARTED


def test_a_plain_drive_has_neither_the_stop_methods_nor_their_objects():
    bench = Bench(hip=INCREMENTAL | {"personality": "generic", "eds": "drives/generic402.eds"})
    bench.boot()

    for method in (-1, -2, -3, -4):
        assert bench.write(0x6098, 0, method, 1) == 0x06090030
    for index in (0x30B0, 0x30B1, 0x30B2):
        assert bench.read_abort(index) == 0x06020000


# --- the current towards a stop ---------------------------------------------------------------


def test_the_current_towards_a_stop_never_exceeds_its_threshold():
    bench = on_the_trainer(-4)
    bench.write(0x30B2, 0, 3000, 2)
    control(bench, 0x1F)
    largest_a = 0.0

    while bits(bench) == SEARCHING:
        bench.run_ms(2)
        largest_a = max(largest_a, abs(bench.plant.truth().effort[0]) / 5.5736)

    assert bits(bench) in (ATTAINED, DONE)
    assert 2.8 < largest_a <= 3.0 + 1e-9


def test_a_threshold_too_low_finds_its_stop_where_the_axis_stands():
    bench = on_the_trainer(-4)
    bench.write(0x30B2, 0, 50, 2)

    control(bench, 0x1F)
    run_until(bench, (DONE, FAILED))

    assert bench.plant.truth().position[0] > math.radians(5)


# --- start, halt, interruption ----------------------------------------------------------------


def test_entering_homing_mode_clears_the_bit_that_meant_follows():
    bench = Bench(hip=INCREMENTAL)
    bench.boot()
    bench.go_operational()
    bench.enable(8, 0)
    assert bench.statusword() & 0x1000

    bench.cycles(4, 0x0F, 6)

    assert bench.read(0x6061) == 6
    assert bits(bench) == NOT_STARTED


def test_homing_begins_at_the_rising_edge_alone():
    bench = homing_bench(33)
    control(bench, 0x1F)
    run_until(bench, (DONE,))
    there = position(bench)

    control(bench, 0x1F)
    bench.run_ms(50)
    assert (bits(bench), position(bench)) == (DONE, there)

    control(bench, 0x0F, 0x1F)
    assert bits(bench) == SEARCHING


def test_a_bit_4_that_was_up_before_homing_mode_starts_nothing():
    bench = Bench(hip=INCREMENTAL)
    bench.boot()
    control(bench, 0x06, 0x07, 0x0F, 0x1F)
    bench.write(0x6060, 0, 6, 1)
    bench.run_ms(20)

    assert bits(bench) == NOT_STARTED


def test_halt_interrupts_and_only_a_new_edge_begins_anew():
    bench = homing_bench(17)
    control(bench, 0x1F)
    bench.run_ms(300)
    assert bench.plant.velocity[0] < 0

    control(bench, 0x11F)
    bench.run_ms(300)
    assert bench.plant.velocity[0] == 0
    assert bits(bench) == NOT_STARTED

    control(bench, 0x1F)
    bench.run_ms(300)
    assert (bench.plant.velocity[0], bits(bench)) == (0, NOT_STARTED)
    control(bench, 0x0F, 0x1F)
    bench.run_ms(300)
    assert (bench.plant.velocity[0] < 0, bits(bench)) == (True, SEARCHING)


@pytest.mark.parametrize("controlword", [0x02, 0x00, 0x07])
def test_what_ends_operation_enabled_ends_the_search(controlword):
    bench = homing_bench(17)
    control(bench, 0x1F)
    bench.run_ms(200)

    control(bench, controlword)
    bench.run_ms(2000)

    assert bench.state() != 0x27
    assert not bench.statusword() & 0x8000
    assert bench.plant.velocity[0] == pytest.approx(0, abs=0.11)
    control(bench, 0x00, 0x06, 0x07, 0x0F)
    assert bits(bench) == NOT_STARTED


def test_another_mode_ends_the_search():
    bench = homing_bench(17)
    control(bench, 0x1F)
    bench.write(0x6060, 0, 8, 1)
    bench.run_ms(500)

    assert bench.plant.velocity[0] == 0
    assert not bench.statusword() & 0xB000


# --- failures ---------------------------------------------------------------------------------


def test_an_axis_that_is_blocked_ends_in_a_homing_error_and_not_in_a_fault():
    bench = homing_bench(17)
    control(bench, 0x1F)
    bench.run_ms(200)
    bench.world.command("blocked_rotor right/hip")

    seen = run_until(bench, (FAILED,), within_s=3)

    assert seen[0] == SEARCHING
    assert bench.state() == 0x27
    assert not bench.statusword() & 0x8000
    control(bench, 0x0F, 0x1F)
    assert bits(bench) == SEARCHING


def test_a_search_whose_time_runs_out_comes_to_rest_as_an_error():
    bench = homing_bench(17, homing_time_s=2.0)
    control(bench, 0x1F)
    bench.run_ms(1990)
    assert bits(bench) == SEARCHING

    assert run_until(bench, (FAILED,), within_s=1)[-2:] == [FAILING, FAILED]
    assert bench.plant.velocity[0] == 0


def test_an_index_that_never_comes_is_an_error_after_one_and_a_half_turns():
    bench = homing_bench(34)
    bench.write(0x6099, 2, 60, 4)
    bench.world.command("frozen_encoder right/hip")
    control(bench, 0x1F)

    run_until(bench, (FAILED,), within_s=5)

    turns = (bench.plant.position[0] - 0.2) * 100 / (2 * math.pi)
    assert turns < 2


def test_a_limit_switch_ahead_of_an_index_search_is_an_error():
    bench = homing_bench(33)
    control(bench, 0x1F)
    bench.run_ms(20)
    bench.plant.raised[0] |= AxisFlag.END_STOP_NEGATIVE

    assert run_until(bench, (DONE, FAILED), within_s=1)[-1] == FAILED


def test_a_failed_homing_leaves_the_old_reference_alone():
    bench = homing_bench(37)
    control(bench, 0x1F)
    assert bench.statusword() & 0x8000
    bench.write(0x6098, 0, 17, 1)
    bench.world.command("blocked_rotor right/hip")

    control(bench, 0x0F, 0x1F)
    run_until(bench, (FAILED,), within_s=3)

    assert position(bench) == 0
    assert bench.statusword() & 0x8000


# --- absolute encoders ------------------------------------------------------------------------


def test_an_absolute_encoder_homes_where_the_settings_say_so_until_it_loses_its_power():
    bench = homing_bench(37, encoder="absolute", homes=True)
    before = position(bench)
    assert bench.read(0x6502) & 1 << 5
    assert bench.statusword() & 0x8000

    control(bench, 0x1F)
    assert (position(bench), bits(bench)) == (0, DONE)
    bench.world.command("reboot right/hip")
    bench.boot()

    assert position(bench) == before
