"""Each personality's own units, by physics: counts, rpm, per mille and mA against rad, N·m, m, N.

The expected numbers come from the data sheets' formulas, written out here once more.
"""

import math
import struct

import pytest
from drive_bench import CONFIGS, HIP, SLIDE, Bench, settings

from sim_drives.canopen.dictionary import ObjectDictionary, read_eds
from sim_drives.cia402.personality import commissioned
from sim_drives.cia402.scaling import Scaling, effort_per_a

GENERIC = {"personality": "generic", "eds": "drives/generic402.eds"}
HIP_KT, SLIDE_KT = 0.055736, 0.107746
SLIDE_LEAD_PER_REV = 0.15 / 6


def booted(**changes):
    bench = Bench(hip=changes, slide=changes)
    bench.boot()
    return bench


@pytest.fixture(params=[{}, GENERIC], ids=["epos4", "generic"])
def either(request):
    return booted(**request.param)


def signed(value, bits):
    return value - (1 << bits) if value >> (bits - 1) else value


def test_the_epos4s_rated_torque_is_in_micronewtonmetres_and_follows_from_its_motor_data(bench):
    assert bench.read(0x6076) == 278_680
    assert bench.read(0x6076, 0, 6) == 646_476

    bench.write(0x3001, 5, 107_746, 4)
    bench.write(0x3001, 1, 4760, 4)
    assert bench.read(0x6076) == 512_871  # 4760 mA x 107746 uNm/A, rounded, as in a real DCF


def test_the_plain_drives_rated_torque_is_in_millinewtonmetres(generic):
    assert (generic.read(0x6076), generic.read(0x6075)) == (279, 5000)
    assert (generic.read(0x6076, 0, 6), generic.read(0x6075, 0, 6)) == (646, 6000)


def test_positions_are_counts_at_the_motor_with_the_axiss_sign(either):
    either.plant.position = [0.35, 0.5905]

    assert signed(either.read(0x6064), 32) == round(0.35 / (2 * math.pi) * 100 * 1024)
    assert signed(either.read(0x6064, 0, 6), 32) == -round(0.5905 / SLIDE_LEAD_PER_REV * 512)


@pytest.mark.parametrize(
    ("changes", "hip_raw", "slide_raw"),
    [
        ({}, 1.5 * 100 * 60 / (2 * math.pi), -0.4 / SLIDE_LEAD_PER_REV * 60),
        (GENERIC, 1.5 * 100 / (2 * math.pi) * 1024, -0.4 / SLIDE_LEAD_PER_REV * 512),
    ],
    ids=["rpm", "counts/s"],
)
def test_velocities_are_the_motors_in_the_drives_own_unit(changes, hip_raw, slide_raw):
    bench = booted(**changes)
    bench.plant.velocity = [1.5, 0.4]

    assert signed(bench.read(0x606C), 32) == round(hip_raw)
    assert signed(bench.read(0x606C, 0, 6), 32) == round(slide_raw)


def enabled_torque(bench, torque_hip, torque_slide, source):
    for node_id, torque in ((5, torque_hip), (6, torque_slide)):
        bench.go_operational(node_id, source)
        bench.enable(10, 0, torque, node_id=node_id)
    for _ in range(2):
        for node_id, torque in ((5, torque_hip), (6, torque_slide)):
            bench.send(0x200 + node_id, struct.pack("<Hbi", 0x0F, 10, 0))
            bench.send(0x300 + node_id, struct.pack("<h", torque))
        bench.send(0x080)
        bench.run_ms(10)


def test_an_epos4s_torque_target_is_per_mille_of_6076_and_its_current_reads_in_ma():
    bench = booted()
    enabled_torque(bench, 500, -250, 0x30D1_0220)
    hip_a, slide_a = 0.5 * 5.0, -0.25 * 6.0

    assert bench.plant.effort(0) == pytest.approx(hip_a * HIP_KT * 100, rel=1e-5)
    force_per_a = SLIDE_KT * 2 * math.pi / SLIDE_LEAD_PER_REV
    assert bench.plant.effort(1) == pytest.approx(-slide_a * force_per_a, rel=1e-5)
    assert signed(bench.read(0x6077), 16) == pytest.approx(500, abs=1)


def test_a_plain_drives_torque_target_is_per_mille_of_its_quantised_base():
    bench = booted(**GENERIC)
    enabled_torque(bench, 500, -250, 0x6077_0010)

    # It believes 279 mN·m at 5 A; the motor gives 278.68.
    assert bench.plant.effort(0) == pytest.approx(2.5 * HIP_KT * 100, rel=1e-9)
    told_nm = 0.5 * 0.279
    assert bench.plant.effort(0) / 100 == pytest.approx(told_nm, rel=0.002)
    assert bench.plant.effort(1) > 0  # the slide's drive counts the other way


@pytest.mark.parametrize("axis", [HIP, SLIDE], ids=["hip", "slide"])
@pytest.mark.parametrize("changes", [{}, GENERIC], ids=["epos4", "generic"])
def test_what_is_commanded_comes_back_as_what_is_measured(axis, changes):
    drive = settings(axis, **changes)
    dictionary = ObjectDictionary(read_eds(CONFIGS / drive.eds, drive.node_id))
    for address, value in commissioned(drive).items():
        dictionary.put(*address, value)
    scaling = Scaling(drive, dictionary)

    for permille in (-1500, -1, 1, 333, 2000):
        current_a = scaling.motor_current_a(scaling.effort_si(permille) / effort_per_a(drive))
        assert current_a * scaling.factors.permille_per_a == pytest.approx(permille)
    for position_si in (-0.3, 0.0, 0.71):
        assert scaling.position_si(scaling.counts(position_si)) == pytest.approx(position_si)


def test_limits_reach_the_plant_in_joint_units():
    bench = booted()
    bench.write(0x6080, 0, 3000, 4)
    bench.write(0x6065, 0, 1024, 4)
    bench.write(0x3001, 2, 8000, 4)
    bench.write(0x60C2, 1, 10, 1)
    bench.write(0x6040, 0, 0x06, 2)

    order = bench.plant.orders[0]

    assert order.velocity_limit_si == pytest.approx(3000 / 60 * 2 * math.pi / 100)
    assert order.following_error_si == pytest.approx(2 * math.pi / 100)
    assert order.following_error_time_s == 0.0
    assert order.effort_limit_si == pytest.approx(8.0 * HIP_KT * 100)
    assert order.interpolation_s == pytest.approx(0.01)


def test_the_hardwares_current_limit_is_above_all_objects(generic):
    generic.write(0x6072, 0, 5000, 2)
    generic.write(0x6073, 0, 5000, 2)
    generic.write(0x6066, 0, 40, 2)
    generic.write(0x6040, 0, 0x06, 2)

    assert generic.plant.orders[0].effort_limit_si == pytest.approx(12 * HIP_KT * 100)
    assert generic.plant.orders[0].following_error_time_s == pytest.approx(0.04)


def test_position_limits_of_an_axis_that_counts_backwards_are_put_in_order(bench):
    bench.write(0x607D, 1, -30_000, 4, 6)
    bench.write(0x607D, 2, -1_000, 4, 6)
    bench.write(0x6040, 0, 0x06, 2, 6)

    order = bench.plant.orders[1]

    assert order.position_min_si == pytest.approx(1_000 / 512 * SLIDE_LEAD_PER_REV)
    assert order.position_max_si == pytest.approx(30_000 / 512 * SLIDE_LEAD_PER_REV)


def test_temperatures_are_in_the_drives_own_steps(bench, generic):
    assert bench.read(0x3201, 1) == 314
    assert generic.read(0x2100, 1) == 31


def test_a_position_beyond_32_bits_wraps_as_a_counter_does(bench):
    bench.plant.position[0] = (2**31 + 5) / 102400 * 2 * math.pi

    assert signed(bench.read(0x6064), 32) == -(2**31) + 5


def test_a_drive_that_was_not_told_its_motor_gives_no_torque(bench):
    bench.write(0x3001, 1, 0, 4)
    bench.go_operational()
    bench.enable(10, 0, 500)

    assert bench.read(0x6076) == 0
    assert bench.plant.effort(0) == 0


def test_the_averaged_current_lags_behind_the_actual_one(bench):
    bench.go_operational()
    bench.enable(10, 0, 200)
    bench.cycles(3, 0x0F, 10, 0, 200)

    averaged, actual = bench.read(0x30D1, 1), bench.read(0x30D1, 2)

    assert actual == 1000
    assert 200 < averaged < 900
