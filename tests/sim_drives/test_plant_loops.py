"""The drives' own loops and what they flag; stops that keep the mechanism inside its workspace."""

import math

import numpy as np
import pytest
from trainers import EFFORT_PER_A, LEG, MS, QUIET, SECOND, order, run, torque, trainer

from observer.mechanism.mechanism import gravity, singularity_ratio
from sim_drives.plant.actuation import Actuation, AxisFlag
from sim_drives.plant.plant import COASTING, HIP, SLIDE, PlantError

AXES = (HIP, SLIDE)


def held(plant, axis):
    plant.set_axis(axis, order(axis, Actuation.HOLD))


def moving(plant, speed_up_s=0.3):
    """A hip on its way up."""
    for _ in range(round(speed_up_s * 1000)):
        balance = gravity(LEG, np.array(plant.truth().position))
        torque(plant, balance[HIP] + 14.0, balance[SLIDE])
        plant.advance(plant.now_ns + MS)
    assert plant.truth().velocity[HIP] > 0.3


@pytest.mark.parametrize("law", ["paper", "paper_sticking", "lugre"])
def test_a_held_axis_stays_where_it_was_against_a_load(law):
    push = {"kind": "steady", "at_s": 0.5, "until_s": 9.0, "rise_s": 0.2, "fall_s": 0.0}
    load = push | {"hip": {"torque_nm": 25.0}, "slide": {"force_n": 150.0}}
    script = {"start": "a", "activation_s": 0.0, "programme": [{"name": "a", "effort": [load]}]}
    plant = trainer(friction={"law": law}, patient=script)
    start = plant.truth().position
    for axis in AXES:
        held(plant, axis)

    run(plant, 5.0)

    assert plant.truth().position == pytest.approx(start, abs=1e-3)
    assert all(plant.flags(axis) == AxisFlag.STANDSTILL for axis in AXES)


def test_a_position_target_is_reached_on_a_line_over_the_interpolation_time():
    plant = trainer()
    held(plant, SLIDE)
    start = plant.truth().position[HIP]
    target = order(HIP, Actuation.POSITION, target_position_si=start + 0.2, interpolation_s=1.0)
    plant.set_axis(HIP, target)

    run(plant, 0.5)
    half = plant.truth().position[HIP]
    run(plant, 1.5)

    assert half == pytest.approx(start + 0.1, abs=0.01)
    assert plant.truth().position[HIP] == pytest.approx(start + 0.2, abs=1e-3)


def test_the_same_order_again_changes_nothing():
    def position(repeated):
        plant = trainer()
        target = order(HIP, Actuation.POSITION, target_position_si=0.4, interpolation_s=0.5)
        plant.set_axis(HIP, target)
        for _ in range(40):
            if repeated:
                plant.set_axis(HIP, target)
            run(plant, 0.01)
        return plant.truth().position

    assert position(repeated=True) == position(repeated=False)


def test_a_target_outside_its_limits_is_clipped_and_said_so():
    plant = trainer()
    target = order(
        HIP, Actuation.POSITION, target_position_si=0.6, position_max_si=0.3, interpolation_s=0.5
    )
    plant.set_axis(HIP, target)

    run(plant, 2.0)

    assert plant.flags(HIP) & AxisFlag.TARGET_CLIPPED
    assert plant.truth().position[HIP] == pytest.approx(0.3, abs=1e-3)


def test_a_following_error_is_raised_after_its_time_and_ends_the_advance():
    plant = trainer()
    plant.block_rotor(HIP, blocked=True)
    watched = order(
        HIP,
        Actuation.POSITION,
        target_position_si=plant.truth().position[HIP] + 0.1,
        following_error_si=0.05,
        following_error_time_s=0.02,
    )
    plant.set_axis(HIP, watched)

    while plant.now_ns < SECOND and not plant.flags(HIP) & AxisFlag.FOLLOWING_ERROR:
        plant.advance(SECOND)

    assert 20 * MS <= plant.now_ns < 35 * MS
    plant.set_axis(HIP, COASTING)
    assert not plant.flags(HIP) & AxisFlag.FOLLOWING_ERROR


def test_a_second_ramp_says_standstill_anew():
    plant = trainer()
    for _ in range(2):
        held(plant, HIP)
        plant.set_axis(HIP, order(HIP, Actuation.RAMP))
        assert plant.flags(HIP) == AxisFlag.NONE
        reached_ns = plant.advance(plant.now_ns + SECOND)
        assert plant.flags(HIP) == AxisFlag.STANDSTILL
        assert reached_ns < 2 * SECOND


def test_an_order_that_follows_another_within_a_tick_begins_where_the_axis_is():
    plant = trainer()
    held(plant, SLIDE)
    moving(plant)
    plant.set_axis(HIP, order(HIP, Actuation.RAMP))
    run(plant, 0.5)
    there = plant.truth().position[HIP]

    torque(plant, 30.0, 0.0)
    plant.set_axis(HIP, order(HIP, Actuation.RAMP))
    run(plant, 0.5)

    assert plant.truth().position[HIP] == pytest.approx(there, abs=2e-3)


def test_a_ramp_in_which_the_torque_does_not_suffice_takes_longer():
    def stopping_s(limit_nm):
        plant = trainer()
        held(plant, SLIDE)
        moving(plant)
        ramp = order(HIP, Actuation.RAMP, deceleration_si=50.0, effort_limit_si=limit_nm)
        plant.set_axis(HIP, ramp)
        begun_ns = plant.now_ns
        while not plant.flags(HIP) & AxisFlag.STANDSTILL:
            plant.advance(plant.now_ns + SECOND)
        return (plant.now_ns - begun_ns) * 1e-9

    assert stopping_s(4.0) > 1.5 * stopping_s(60.0)


def test_torque_never_exceeds_its_limit():
    plant = trainer(sensor=QUIET)
    plant.set_axis(HIP, order(HIP, Actuation.TORQUE, target_effort_si=60.0, effort_limit_si=10.0))

    run(plant, 0.05)

    assert plant.sample(HIP).current_a * EFFORT_PER_A[HIP] == pytest.approx(10.0, rel=1e-6)


def test_a_drive_without_power_gives_no_torque():
    plant = trainer(sensor=QUIET)
    torque(plant, 20.0, 100.0)
    run(plant, 0.01)
    for axis in AXES:
        plant.set_axis(axis, COASTING)

    run(plant, 0.02)

    assert plant.truth().effort == pytest.approx((0.0, 0.0), abs=1e-9)


def test_a_motor_warms_towards_what_its_copper_loss_asks():
    motor = {"hip": {"thermal_time_constant_s": 1.0}}
    plant = trainer(motor=motor, sensor=QUIET)
    plant.block_rotor(HIP, blocked=True)
    current_a = 10.0
    torque(plant, current_a * EFFORT_PER_A[HIP], 0.0)
    cold = plant.sample(HIP).temperature_degc

    run(plant, 1.0)
    after_one = plant.sample(HIP).temperature_degc
    run(plant, 9.0)

    rise = plant.sample(HIP).temperature_degc - cold
    assert cold == 25.0
    assert rise == pytest.approx(current_a**2 * 0.6 * 3.0, rel=0.01)
    assert after_one - cold == pytest.approx((1 - math.exp(-1)) * rise, rel=0.01)


@pytest.mark.parametrize("direction_deg", range(0, 360, 45))
def test_no_push_takes_the_mechanism_to_its_singularity(direction_deg):
    plant = trainer()
    angle = math.radians(direction_deg)
    torque(plant, 60.0 * math.cos(angle), 500.0 * math.sin(angle))

    nearest = 1.0
    for _ in range(300):
        plant.advance(plant.now_ns + 5 * MS)
        nearest = min(nearest, singularity_ratio(LEG, np.array(plant.truth().position)))

    assert nearest > 0.115  # `stops.ankle.edge_ratio` is 0.12
    assert np.all(np.isfinite(plant.truth().position))
    assert plant.work()["contact"] <= 0.0


def test_a_start_pose_that_the_leg_cannot_take_is_refused_with_its_key():
    with pytest.raises(PlantError, match=r"start.*edge_ratio"):
        trainer(start={"hip": {"position_deg": -20.0}, "slide": {"position_m": 0.9}})
    with pytest.raises(PlantError, match=r"start\.slide\.position_m"):
        trainer(start={"slide": {"position_m": 1.5}})


def test_loops_that_do_not_fit_the_physics_step_are_refused_with_their_key():
    with pytest.raises(PlantError, match=r"step\.drive_loop_us"):
        trainer(step={"physics_us": 300, "drive_loop_us": 1000})


def test_time_does_not_run_backwards():
    plant = trainer()
    plant.advance(SECOND)

    with pytest.raises(ValueError, match="cannot go back"):
        plant.advance(SECOND - 1)


def test_between_two_grid_points_a_sample_moves_on_with_the_axis():
    plant = trainer(sensor=QUIET)
    moving(plant)
    plant.advance(plant.now_ns)
    first = plant.sample(HIP)
    plant.advance(plant.now_ns + 100_000)

    second = plant.sample(HIP)

    assert second.position_si - first.position_si == pytest.approx(
        1e-4 * first.velocity_si, rel=0.02
    )


def test_latch_jitter_delays_a_sample_by_at_most_what_is_configured():
    sensor = QUIET | {"latch_jitter_us": 200.0}
    plant = trainer(sensor=sensor)
    moving(plant)
    truth = plant.truth()
    speed = truth.velocity[HIP]

    delays_s = [(plant.sample(HIP).position_si - truth.position[HIP]) / speed for _ in range(500)]

    assert min(delays_s) >= -1e-9
    assert 1.5e-4 < max(delays_s) < 2.1e-4
