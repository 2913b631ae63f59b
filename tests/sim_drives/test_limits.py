"""Limits, offsets and set points of the cyclic modes, on the real mechanics where they move."""

import math
import struct

import pytest
from drive_bench import Bench
from trainers import QUIET, order, torque, trainer

from sim_drives.plant.actuation import Actuation, AxisFlag
from sim_drives.plant.plant import HIP, SLIDE

COUNTS_PER_RAD = 1024 * 100 / (2 * math.pi)
MS = 1_000_000
GENERIC = {"personality": "generic", "eds": "drives/generic402.eds"}


def on_the_trainer(mode, hip_deg=0.0, **changes):
    """Both axes enabled, the slide holding, the hip in `mode` without a target yet."""
    plant = trainer(
        sensor=QUIET, start={"hip": {"position_deg": hip_deg}, "slide": {"position_m": 0.5}}
    )
    bench = Bench(hip=changes, plant=plant)
    bench.boot()
    for node_id, wanted in ((6, 8), (5, mode)):
        bench.write(0x6065, 0, 0xFFFFFFFF, 4, node_id)
        bench.write(0x6060, 0, wanted, 1, node_id)
        bench.run_ms(10)
        for controlword in (0x06, 0x07, 0x0F, 0x0F):
            bench.write(0x6040, 0, controlword, 2, node_id)
    bench.run_ms(100)
    assert bench.state() == bench.state(6) == 0x27
    return bench


def signed(value):
    return value - (1 << 32) if value >> 31 else value


# --- the speed limit in torque mode -----------------------------------------------------------


@pytest.mark.parametrize("wanted_nm", [25.0, 45.0, 65.0])
def test_the_speed_limit_in_torque_mode_is_not_passed_by_more_than_seven_per_cent(wanted_nm):
    plant = trainer(
        sensor=QUIET, start={"hip": {"position_deg": -10.0}, "slide": {"position_m": 0.5}}
    )
    plant.set_axis(SLIDE, order(SLIDE, Actuation.HOLD))
    plant.set_axis(
        HIP,
        order(HIP, Actuation.TORQUE, target_effort_si=wanted_nm, velocity_limit_si=0.5),
    )
    speeds = []
    while plant.truth().position[HIP] < 0.5:
        plant.advance(plant.now_ns + MS)
        speeds.append(plant.truth().velocity[HIP])

    assert max(speeds) < 0.5 * 1.07
    assert speeds[-1] == pytest.approx(0.5, rel=0.02)
    assert plant.flags(HIP) & AxisFlag.SPEED_LIMITED


def test_the_speed_limit_brakes_a_load_that_pushes_against_the_torque():
    push = {"kind": "steady", "at_s": 0.2, "until_s": 9.0, "rise_s": 0.3, "fall_s": 0.0}
    effort = push | {"hip": {"torque_nm": 55.0}, "slide": {"force_n": 0.0}}
    script = {"start": "a", "activation_s": 0.0, "programme": [{"name": "a", "effort": [effort]}]}
    plant = trainer(
        sensor=QUIET,
        start={"hip": {"position_deg": -10.0}, "slide": {"position_m": 0.5}},
        patient=script,
    )
    plant.set_axis(SLIDE, order(SLIDE, Actuation.HOLD))
    plant.set_axis(HIP, order(HIP, Actuation.TORQUE, target_effort_si=-10.0, velocity_limit_si=0.4))
    fastest = 0.0
    while plant.truth().position[HIP] < 0.5:
        plant.advance(plant.now_ns + MS)
        fastest = max(fastest, plant.truth().velocity[HIP])

    assert 0.35 < fastest < 0.4 * 1.05


def test_below_the_speed_limit_the_torque_is_exactly_what_was_asked():
    plant = trainer(sensor=QUIET)
    for _ in range(30):
        torque(plant, 12.0, 40.0)
        plant.advance(plant.now_ns + MS)

    assert plant.truth().effort == pytest.approx((12.0, 40.0), rel=1e-6)


def test_the_limiter_says_so_in_the_statusword():
    bench = on_the_trainer(10)
    bench.write(0x6080, 0, 200, 4)  # rpm: 0.21 rad/s at the joint
    bench.write(0x6071, 0, 1500, 2)
    bench.run_ms(500)

    assert bench.plant.truth().velocity[0] == pytest.approx(200 / 60 * 2 * math.pi / 100, rel=0.03)
    assert bench.statusword() & 0x0800


# --- limit switches and position limits -------------------------------------------------------


@pytest.mark.parametrize(
    ("flag", "code"), [(AxisFlag.END_STOP_NEGATIVE, 0x8A80), (AxisFlag.END_STOP_POSITIVE, 0x8A81)]
)
def test_a_limit_switch_that_closes_is_a_fault_and_the_axis_can_be_driven_off_it(flag, code):
    bench = Bench(hip={"limit_switch": "fault"})
    bench.boot()
    for controlword in (0x06, 0x07, 0x0F):
        bench.write(0x6040, 0, controlword, 2)
    bench.plant.raised[0] |= flag
    bench.run_ms(20)
    assert (bench.state(), bench.read(0x603F)) == (0x08, code)

    for controlword in (0x00, 0x80, 0x06, 0x07, 0x0F):
        bench.write(0x6040, 0, controlword, 2)
    bench.run_ms(20)
    assert bench.state() == 0x27
    bench.plant.raised[0] &= ~flag
    bench.run_ms(20)
    bench.plant.raised[0] |= flag
    bench.run_ms(20)
    assert bench.state() == 0x08


def test_a_limit_switch_that_is_only_reported_is_a_bit_and_no_more(bench):
    for controlword in (0x06, 0x07, 0x0F):
        bench.write(0x6040, 0, controlword, 2)
    bench.plant.raised[0] |= AxisFlag.END_STOP_POSITIVE
    bench.run_ms(20)

    assert bench.read(0x60FD) & 3 == 2
    assert bench.state() == 0x27


def test_an_axis_without_a_reference_is_not_judged_by_its_position_limits():
    bench = Bench(hip={"encoder": "incremental", "position_limit": "fault"})
    bench.boot()
    bench.write(0x607D, 2, 2000, 4)
    bench.write(0x607D, 1, 1000, 4)
    for controlword in (0x06, 0x07, 0x0F):
        bench.write(0x6040, 0, controlword, 2)
    bench.run_ms(50)
    assert bench.state() == 0x27

    bench.write(0x6098, 0, 37, 1)
    bench.write(0x6060, 0, 6, 1)
    bench.run_ms(10)
    bench.write(0x6040, 0, 0x1F, 2)
    bench.run_ms(20)
    assert bench.read(0x603F) == 0x8A82


def test_the_inputs_show_home_switch_and_interlock():
    plain = {"personality": "generic", "eds": "drives/generic402.eds"}
    bench = Bench(hip={**plain, "home_switch": {"from_si": 0.15, "to_si": 0.25}})
    bench.boot()
    assert bench.read(0x60FD) & 0x3000C == 0x30004

    bench.world.command("sto_open right/hip")
    bench.plant.position[0] = 0.4
    assert bench.read(0x60FD) & 0x3000C == 0x10008


# --- offsets, cyclic velocity -----------------------------------------------------------------


def test_the_torque_offset_adds_to_the_target_in_cyclic_torque():
    bench = on_the_trainer(10)
    bench.write(0x6071, 0, 300, 2)
    bench.write(0x60B2, 0, -100, 2)
    bench.run_ms(20)

    assert bench.plant.truth().effort[0] == pytest.approx(0.2 * 5.0 * 5.5736, rel=0.01)


def test_the_torque_offset_takes_work_from_the_loops_in_cyclic_position():
    bench = on_the_trainer(8)
    bench.write(0x607A, 0, signed(bench.read(0x6064)), 4)
    bench.run_ms(500)
    integral = bench.plant._state.loops[0]["integral"]
    held_nm = bench.plant.truth().effort[0]
    bench.write(0x60B2, 0, 200, 2)
    bench.run_ms(1000)

    loops_nm = bench.plant._state.loops[0]["integral"] - integral
    change_nm = bench.plant.truth().effort[0] - held_nm
    assert abs(change_nm) < 2.0  # what friction holds
    assert change_nm - loops_nm == pytest.approx(0.2 * 5.0 * 5.5736, abs=0.1)


MAKES = {
    "epos4": ({}, 0x30D1_0220),
    "elmo_gold": ({"personality": "elmo_gold", "eds": "drives/elmo_gold.eds"}, 0x6078_0010),
    "generic": (GENERIC, 0x6077_0010),
}


@pytest.fixture(params=MAKES.values(), ids=MAKES)
def positioned(request):
    """A drive of each make in cyclic position, at its target, and where that is."""
    changes, torque = request.param
    bench = Bench(hip=changes)
    bench.boot()
    bench.write(0x6065, 0, 1000, 4)
    bench.write(0x6066, 0, 0, 2)
    bench.go_operational(torque=torque)
    start = signed(bench.read(0x6064))
    bench.enable(8, start)
    return bench, start


def test_the_position_offset_adds_to_the_target_in_cyclic_position(positioned):
    bench, start = positioned
    assert bench.write(0x60B0, 0, 200, 4) == 0
    bench.cycles(20, 0x0F, 8, start)

    assert signed(bench.read(0x6064)) == pytest.approx(start + 200, abs=1)
    assert signed(bench.read(0x607A)) == start
    assert signed(bench.read(0x6062)) == start + 200
    bench.write(0x60B0, 0, -200, 4)
    bench.cycles(20, 0x0F, 8, start)
    assert signed(bench.read(0x6064)) == pytest.approx(start - 200, abs=1)


def test_the_position_offset_is_no_target(positioned):
    bench, start = positioned
    bench.cycles(3, 0x00, 8, start)
    bench.nmt(0x80)
    bench.nmt(0x01)
    bench.write(0x60B0, 0, 200, 4)
    for controlword in (0x00, 0x06, 0x07, 0x0F, 0x0F):
        bench.write(0x6040, 0, controlword, 2)
        bench.run_ms(20)

    assert bench.state() == 0x27
    assert signed(bench.read(0x6064)) == pytest.approx(start, abs=1)
    assert not bench.statusword() & 0x1000


def test_the_following_error_counts_from_the_target_with_its_offset(positioned):
    bench, start = positioned
    bench.world.command("blocked_rotor right/hip")
    bench.write(0x60B0, 0, 900, 4)
    bench.cycles(4, 0x0F, 8, start)
    assert bench.state() == 0x27
    assert signed(bench.read(0x60F4)) == pytest.approx(900, abs=1)
    bench.write(0x60B0, 0, 1001, 4)
    bench.cycles(4, 0x0F, 8, start)

    assert bench.read(0x603F) == 0x8611


def test_the_position_limit_clips_the_target_with_its_offset(positioned):
    bench, start = positioned
    bench.write(0x607D, 2, start + 300, 4)
    bench.write(0x607D, 1, start - 300, 4)
    bench.write(0x60B0, 0, 500, 4)
    bench.cycles(30, 0x0F, 8, start)

    assert signed(bench.read(0x6064)) == pytest.approx(start + 300, abs=1)
    assert bench.statusword() & 0x0800


def test_a_target_with_its_offset_beyond_the_position_limit_can_be_a_fault():
    bench = Bench(hip={"position_limit": "fault"})
    bench.boot()
    bench.go_operational()
    start = signed(bench.read(0x6064))
    bench.write(0x607D, 2, start + 300, 4)
    bench.enable(8, start)
    bench.write(0x60B0, 0, 301, 4)
    bench.cycles(4, 0x0F, 8, start)

    assert bench.read(0x603F) == 0x8A82


def test_the_position_offset_survives_reset_communication_and_no_power_off(positioned):
    bench, _ = positioned
    bench.write(0x60B0, 0, 200, 4)
    bench.nmt(0x82)
    bench.run_ms(400)
    assert bench.read(0x60B0) == 200

    bench.world.command("reboot right/hip")
    bench.run_ms(400)
    assert bench.read(0x60B0) == 0


def test_position_limits_that_are_both_zero_are_none():
    for kind in ("clip", "fault"):
        bench = Bench(hip={"position_limit": kind})
        bench.boot()
        assert bench.read(0x607D, 1) == bench.read(0x607D, 2) == 0
        bench.go_operational()
        start = signed(bench.read(0x6064))
        bench.enable(8, start)
        bench.cycles(30, 0x0F, 8, start + 300)

        assert bench.state() == 0x27
        assert not bench.statusword() & 0x0800
        assert signed(bench.read(0x6064)) == pytest.approx(start + 300, abs=1)


def test_the_velocity_offset_adds_to_the_speed_in_cyclic_position():
    bench = on_the_trainer(8)
    there = signed(bench.read(0x6064))
    bench.write(0x607A, 0, there, 4)
    bench.run_ms(300)
    bench.write(0x60B1, 0, 100, 4)  # rpm: 0.105 rad/s at the joint
    bench.run_ms(1000)

    # The position loop, 25 1/s, holds against it: so far away does the axis stand.
    ahead_rad = 100 / 60 * 2 * math.pi / 100 / 25.0
    moved = signed(bench.read(0x6064)) - there
    assert moved / COUNTS_PER_RAD == pytest.approx(ahead_rad, rel=0.1)


def test_cyclic_velocity_follows_its_target_and_offset_once_there_is_one():
    bench = on_the_trainer(9)
    assert bench.read(0x6502) >> 8 & 1
    assert not bench.statusword() & 0x1000

    bench.write(0x60FF, 0, 300, 4)
    bench.write(0x60B1, 0, 100, 4)
    bench.run_ms(300)

    assert bench.statusword() & 0x1000
    assert signed(bench.read(0x606C)) == pytest.approx(400, abs=8)


# --- the interpolation time -------------------------------------------------------------------


def swept(interpolation_ms):
    """Largest speed of the set point within 10 ms of a step of the target, rad/s."""
    bench = on_the_trainer(8)
    bench.write(0x60C2, 1, interpolation_ms, 1)
    here = signed(bench.read(0x6064))
    bench.write(0x607A, 0, here, 4)
    bench.run_ms(20)
    bench.write(0x607A, 0, here + 200, 4)
    fastest = 0.0
    for _ in range(10):
        bench.run_ms(1)
        fastest = max(fastest, abs(bench.plant._state.loops[0]["set_speed"]))
    return fastest


def test_without_an_interpolation_time_the_set_point_steps_and_with_one_it_goes_on_a_line():
    step_rad = 200 / COUNTS_PER_RAD

    assert swept(0) == pytest.approx(step_rad / 1e-3, rel=0.01)
    assert swept(10) == pytest.approx(step_rad / 10e-3, rel=0.01)


def test_an_epos4_whose_interpolation_time_is_shorter_than_the_sync_period_misses_its_target():
    bench = Bench()
    bench.boot()
    bench.write(0x60C2, 1, 5, 1)
    bench.go_operational()
    here = signed(bench.read(0x6064))
    for controlword in (0x06, 0x07, 0x0F, 0x0F):
        bench.cycles(2, controlword, 8, here)
    bench.run_ms(50)

    assert bench.state() == 0x08
    assert bench.read(0x603F) == 0x8250


def test_a_missing_pdo_of_one_number_is_not_ended_by_another():
    bench = Bench(hip=GENERIC)
    bench.boot()
    bench.map_pdos(torque=0x6077_0010)
    bench.write(0x1401, 5, 30, 2)
    bench.nmt(0x01)
    bench.cycles(2, 0x06)
    bench.forget()
    for _ in range(10):
        bench.send(0x080)
        bench.send(0x205, struct.pack("<Hbi", 0x06, 10, 0))
        bench.run_ms(10)

    assert [data[:2] for data in bench.frames(0x085)] == [b"\x50\x82"]


@pytest.mark.parametrize("kind", [{}, GENERIC])
def test_a_lowest_position_above_the_highest_is_refused_whichever_comes_first(kind):
    bench = Bench(hip=kind)
    bench.boot()
    assert (bench.write(0x607D, 1, -1000, 4), bench.write(0x607D, 2, 2000, 4)) == (0, 0)

    assert bench.write(0x607D, 1, 2001, 4) == 0x06090036
    assert bench.write(0x607D, 2, -1001, 4) == 0x06090036
    assert (signed(bench.read(0x607D, 1)), bench.read(0x607D, 2)) == (-1000, 2000)
