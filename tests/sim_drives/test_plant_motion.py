"""The plant as a machine: end stops, the drives' own loops, power off, noise, and no luck in it."""

import math

import numpy as np
import pytest
from trainers import (
    EFFORT_PER_A,
    FRICTIONS,
    LEG,
    MS,
    QUIET,
    SECOND,
    merged,
    order,
    programme,
    run,
    torque,
    trainer,
)

from observer.mechanism.friction import FrictionParameters
from observer.mechanism.mechanism import gravity
from sim_drives.plant.actuation import Actuation, AxisFlag
from sim_drives.plant.plant import COASTING, HIP, SLIDE
from tests.observer.mechanics import kinetic_energy, potential_energy

NEARLY_NO_FRICTION = tuple(
    FrictionParameters(*f)._replace(stribeck=1e-6, coulomb=1e-7, viscous=0.0) for f in FRICTIONS
)


def balanced(plant):
    """Efforts that carry the leg where it is."""
    return gravity(LEG, np.array(plant.truth().position))


def test_without_power_and_with_friction_the_leg_loses_energy_all_the_time():
    plant = trainer(start={"hip": {"position_deg": 25.0}, "slide": {"position_m": 0.6}})
    plant.set_axis(HIP, COASTING)
    plant.set_axis(SLIDE, COASTING)

    energies = []
    for _ in range(200):
        run(plant, 0.01)
        truth = plant.truth()
        q, dq = np.array(truth.position), np.array(truth.velocity)
        energies.append(kinetic_energy(LEG, q, dq) + potential_energy(LEG, q))

    # The paper's dynamic friction gives back a little of what it took (observer.md, audit 19).
    assert np.all(np.diff(energies) <= 5e-3)
    assert energies[-1] < energies[0] - 0.5


def test_without_friction_and_dampers_energy_stays():
    plant = trainer(
        LEG._replace(hip_damping=0.0, knee_damping=0.0, ankle_damping=0.0, slide_joint_damping=0.0),
        NEARLY_NO_FRICTION,
        start={"hip": {"position_deg": 20.0}, "slide": {"position_m": 0.62}},
    )
    plant.set_axis(HIP, COASTING)
    plant.set_axis(SLIDE, COASTING)

    energies, speeds = [], []
    for _ in range(100):
        truth = plant.truth()
        q, dq = np.array(truth.position), np.array(truth.velocity)
        energies.append(kinetic_energy(LEG, q, dq) + potential_energy(LEG, q))
        speeds.append(np.abs(dq).max())
        run(plant, 0.01)

    assert max(speeds) > 0.1
    assert energies == pytest.approx([energies[0]] * 100, abs=0.02)


@pytest.mark.parametrize(("axis", "side"), [(HIP, 1), (SLIDE, 1), (SLIDE, -1)])
def test_an_end_stop_holds_against_a_drive_that_pushes_into_it(axis, side):
    plant = trainer()
    push = (40.0 * side, 0.0) if axis == HIP else (0.0, 300.0 * side)
    for _ in range(3000):
        torque(plant, *(balanced(plant) + push))
        plant.advance(plant.now_ns + MS)

    truth = plant.truth()
    assert abs(truth.velocity[axis]) < 0.02
    limits = {HIP: (math.radians(-27), math.radians(47)), SLIDE: (-0.04, 0.99)}[axis]
    assert limits[0] < truth.position[axis] < limits[1]
    assert any(abs(contact) > 1.0 for contact in truth.contact)


def test_current_follows_a_step_with_the_lag_of_its_loop():
    plant = trainer(sensor=merged(QUIET, {}))
    step_nm = 10.0
    torque(plant, step_nm, 0.0)
    after = []
    for k in range(1, 9):
        plant.advance(k * 500_000)
        after.append(plant.sample(HIP).current_a * EFFORT_PER_A[HIP] / step_nm)

    assert after[0] < 0.9
    assert after[-1] == pytest.approx(1.0, abs=0.01)
    assert all(np.diff(after) >= 0)


def test_in_cyclic_position_the_current_at_a_sync_is_not_the_mean_since_the_sync_before():
    plant = trainer(sensor=merged(QUIET, {}))
    sampled, means = [], []
    before = plant.truth()
    for k in range(1, 200):
        wave = 0.5905 + 0.05 * math.sin(2 * math.pi * 1.0 * k * 0.01)
        plant.set_axis(
            SLIDE,
            order(SLIDE, Actuation.POSITION, target_position_si=wave, interpolation_s=0.01,
                  following_error_si=1.0, following_error_time_s=1.0,
                  position_min_si=0.0, position_max_si=0.95),
        )  # fmt: skip
        run(plant, 0.01)
        truth = plant.truth()
        sampled.append(plant.sample(SLIDE).current_a * EFFORT_PER_A[SLIDE])
        means.append((truth.effort_impulse[SLIDE] - before.effort_impulse[SLIDE]) / 0.01)
        before = truth

    difference = np.array(sampled[50:]) - np.array(means[50:])
    assert np.sqrt(np.mean(difference**2)) > 1.0


def test_a_ramp_stops_with_its_deceleration_and_says_so():
    plant = trainer()
    for _ in range(400):
        torque(plant, *(balanced(plant) + np.array((0.0, 160.0))))
        plant.advance(plant.now_ns + MS)
    begun = plant.truth()
    plant.set_axis(SLIDE, order(SLIDE, Actuation.RAMP, deceleration_si=5.0))
    plant.set_axis(HIP, order(HIP, Actuation.RAMP, deceleration_si=5.0))

    while not plant.flags(SLIDE) & AxisFlag.STANDSTILL:
        plant.advance(plant.now_ns + SECOND)

    took_s = (plant.now_ns - begun.time_ns) * 1e-9
    assert begun.velocity[SLIDE] > 0.3
    ramp_s = begun.velocity[SLIDE] / 5.0
    assert ramp_s < took_s < ramp_s + 0.1


def story(seed, pieces_ns):
    push = {"kind": "sine", "hip.torque_nm": 5.0, "slide.force_n": 20.0, "frequency_hz": 0.5}
    phases = {"hip.phase_deg": 0.0, "slide.phase_deg": 0.0}
    plant = trainer(seed=seed, patient=programme(push | phases))
    torque(plant, 9.0, 90.0)
    for _ in range(SECOND // pieces_ns):
        until_ns = plant.now_ns + pieces_ns
        while plant.now_ns < until_ns:
            plant.advance(until_ns)
    return plant.truth(), plant.sample(HIP), plant.sample(SLIDE)


def test_time_in_one_go_or_in_pieces_gives_the_same_bits():
    assert story(1, SECOND) == story(1, 10 * MS) == story(1, MS)


def test_a_seed_is_the_only_luck_there_is():
    assert story(4, 10 * MS) == story(4, 10 * MS)
    assert story(4, 10 * MS)[1] != story(5, 10 * MS)[1]


def test_half_the_step_changes_little():
    def position(step_us):
        plant = trainer(step={"physics_us": step_us, "drive_loop_us": 1000})
        torque(plant, 14.0, 150.0)
        run(plant, 0.5)
        return np.array(plant.truth().position)

    assert position(250) == pytest.approx(position(125), abs=2e-4)
