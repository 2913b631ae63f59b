"""Option codes 6007h and 605Ah to 605Eh on the real mechanics: the slope, the end, the torque."""

import math

import numpy as np
import pytest
from drive_bench import Bench
from trainers import QUIET, trainer

SOD, RTSO, SO, OE, QSA, FAULT = 0x40, 0x21, 0x23, 0x27, 0x07, 0x08
GENERIC = {"personality": "generic", "eds": "drives/generic402.eds"}
ELMO = {"personality": "elmo_gold", "eds": "drives/elmo_gold.eds"}
COUNTS_PER_RAD = 1024 * 100 / (2 * math.pi)
SLOW_RAD_PER_S2, QUICK_RAD_PER_S2 = 1.5, 4.0
LIMIT_NM = 12 * 5.5736


def swinging(changes=GENERIC, **options):
    """Enabled in cyclic velocity, the hip at about 0.8 rad/s; the slide is held."""
    plant = trainer(
        sensor=QUIET, start={"hip": {"position_deg": 0.0}, "slide": {"position_m": 0.5}}
    )
    bench = Bench(hip=changes, slide=changes, plant=plant)
    bench.boot()
    bench.write(0x6084, 0, round(SLOW_RAD_PER_S2 * COUNTS_PER_RAD), 4)
    bench.write(0x6085, 0, round(QUICK_RAD_PER_S2 * COUNTS_PER_RAD), 4)
    for name, value in options.items():
        assert bench.write(int(name[1:], 16), 0, value, 2) == 0
    for node_id in (6, 5):
        bench.write(0x6065, 0, 0xFFFFFFFF, 4, node_id)
        bench.write(0x6060, 0, 9 if node_id == 5 else 8, 1, node_id)
        bench.run_ms(10)
        for controlword in (0x06, 0x07, 0x0F, 0x0F):
            bench.write(0x6040, 0, controlword, 2, node_id)
            bench.run_ms(4)
    bench.write(0x60FF, 0, round(0.8 * COUNTS_PER_RAD), 4)
    bench.run_ms(300)
    assert plant.truth().velocity[0] == pytest.approx(0.8, abs=0.02)
    return bench


def stop(bench, within_ms=1500):
    """Speeds and efforts of the hip, one each millisecond, until it stands or loses its torque."""
    rows = []
    for _ in range(within_ms):
        truth = bench.plant.truth()
        rows.append((truth.velocity[0], truth.effort[0]))
        if abs(truth.velocity[0]) < 0.02:
            break
        bench.run_ms(1)
    return np.array(rows)


def slope(rows):
    """Deceleration while the speed is between 0.7 and 0.1 rad/s."""
    middle = rows[(rows[:, 0] < 0.7) & (rows[:, 0] > 0.1), 0]
    return -np.polyfit(np.arange(len(middle)) * 1e-3, middle, 1)[0]


def ends_in(bench, state):
    bench.run_ms(60)
    assert bench.state() == state
    standing = state in (OE, QSA)
    torque = abs(bench.plant.truth().effort[0])
    assert torque > 0.5 if standing else torque == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize(
    ("option", "expected", "state"),
    [
        (1, SLOW_RAD_PER_S2, SOD),
        (2, QUICK_RAD_PER_S2, SOD),
        (5, SLOW_RAD_PER_S2, QSA),
        (6, QUICK_RAD_PER_S2, QSA),
    ],
)
def test_a_quick_stops_slope_is_that_of_its_object_and_without_power_there_is_no_torque(
    option, expected, state
):
    bench = swinging(x605A=option)
    bench.write(0x6040, 0, 0x02, 2)

    assert slope(stop(bench)) == pytest.approx(expected, rel=0.05)
    ends_in(bench, state)


@pytest.mark.parametrize(("option", "state"), [(3, SOD), (4, SOD), (7, QSA), (8, QSA)])
def test_a_quick_stop_at_the_limit_brakes_with_the_largest_torque(option, state):
    bench = swinging(x605A=option)
    bench.write(0x6040, 0, 0x02, 2)
    rows = stop(bench)

    assert len(rows) < 60
    assert rows[5:20, 1].min() == pytest.approx(-LIMIT_NM, rel=1e-3)
    ends_in(bench, state)


@pytest.mark.parametrize(
    ("option", "controlword", "state"), [("x605B", 0x06, RTSO), ("x605C", 0x07, SO)]
)
def test_shutdown_and_disable_brake_on_the_slow_ramp_or_let_go_at_once(option, controlword, state):
    bench = swinging(**{option: 1})
    bench.write(0x6040, 0, controlword, 2)
    assert slope(stop(bench)) == pytest.approx(SLOW_RAD_PER_S2, rel=0.05)
    ends_in(bench, state)

    bench = swinging(**{option: 0})
    bench.write(0x6040, 0, controlword, 2)
    bench.run_ms(10)
    assert bench.plant.truth().effort[0] == pytest.approx(0, abs=1e-6)
    assert bench.state() == state


@pytest.mark.parametrize(
    ("option", "expected"), [(1, SLOW_RAD_PER_S2), (2, QUICK_RAD_PER_S2), (3, None), (4, None)]
)
def test_halt_in_cyclic_velocity_brakes_on_its_ramp_stays_enabled_and_goes_on(option, expected):
    bench = swinging(x605D=option)
    bench.write(0x6040, 0, 0x10F, 2)
    rows = stop(bench)

    if expected is None:
        assert rows[:, 1].min() == pytest.approx(-LIMIT_NM, rel=1e-3)
    else:
        assert slope(rows) == pytest.approx(expected, rel=0.05)
    bench.run_ms(300)
    ends_in(bench, OE)
    assert bench.statusword() & 0x1400 == 0x0400
    bench.write(0x6040, 0, 0x0F, 2)
    bench.run_ms(200)
    assert bench.plant.truth().velocity[0] > 0.5
    assert bench.statusword() & 0x1400 == 0x1000


@pytest.mark.parametrize("option", [0, 1, 2, 3, 4])
def test_a_fault_reaction_brakes_as_605e_says_and_ends_without_torque(option):
    bench = swinging(x605E=option)
    bench.world.command("emcy right/hip - 0x2310")
    rows = stop(bench, 40 if option == 0 else 1500)

    if option == 0:
        assert rows[5:, 1] == pytest.approx(0, abs=1e-3)
    elif option in (1, 2):
        assert slope(rows) == pytest.approx(
            (SLOW_RAD_PER_S2, QUICK_RAD_PER_S2)[option - 1], rel=0.05
        )
    else:
        assert rows[:, 1].min() == pytest.approx(-LIMIT_NM, rel=1e-3)
    ends_in(bench, FAULT)


@pytest.mark.parametrize(
    ("reaction", "expected", "state"),
    [(0, None, OE), (1, QUICK_RAD_PER_S2, FAULT), (2, 0.0, SOD), (3, QUICK_RAD_PER_S2, QSA)],
)
def test_a_lost_connection_acts_as_6007_says(reaction, expected, state):
    bench = swinging(x6007=reaction, x605A=6)
    bench.write(0x1029, 1, 1, 1)
    bench.nmt(0x01)
    bench.world.command("emcy right/hip 0.01 0x8130")
    bench.run_ms(20)

    if expected:
        assert slope(stop(bench)) == pytest.approx(expected, rel=0.05)
        ends_in(bench, state)
    else:
        assert bench.state() == state
        assert (bench.plant.truth().effort[0] == pytest.approx(0, abs=1e-6)) is (state == SOD)


# --- which codes a make of drive knows --------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "legal"),
    [
        ({}, {0x605A: {6}, 0x605B: {0, 1}, 0x605C: {0, 1}, 0x605E: {0, 1, 2}}),
        (
            GENERIC,
            {0x605A: set(range(9)), 0x605B: {0, 1}, 0x605D: {1, 2, 3, 4}, 0x605E: set(range(5))},
        ),
        (ELMO, {0x605A: set(range(9)), 0x605C: {0, 1}, 0x605D: {1, 2}, 0x605E: {0, 1, 2}}),
    ],
    ids=["epos4", "generic", "elmo"],
)
def test_a_code_that_the_make_does_not_know_is_out_of_range(changes, legal):
    bench = Bench(hip=changes)
    bench.boot()

    for index, codes in (legal | {0x6007: {0, 1, 2, 3}}).items():
        for code in range(-2, 11):
            allowed = {0} if code in codes else {0x06090030, 0x06090031, 0x06090032}
            assert bench.write(index, 0, code, 2) in allowed, f"{index:04X}h = {code}"


def test_an_epos4_of_this_firmware_has_no_halt_option_and_halts_on_the_slow_ramp(bench):
    assert bench.read_abort(0x605D) == 0x06020000

    bench.write(0x6084, 0, 4775, 4)  # rpm/s of the motor: 5 rad/s² at the joint
    for controlword in (0x06, 0x07, 0x0F):
        bench.write(0x6040, 0, controlword, 2)
    bench.plant.velocity[0] = 1.0
    bench.write(0x6040, 0, 0x10F, 2)
    bench.run_ms(100)

    assert bench.plant.velocity[0] == pytest.approx(0.5, abs=0.01)
    assert bench.state() == OE
