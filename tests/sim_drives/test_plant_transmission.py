"""A drive that moves its joint through a spring, or across a gap."""

import math

import numpy as np
import pytest
from trainers import (
    DRIVE_INERTIA,
    EFFORT_PER_A,
    FRICTIONS,
    LEG,
    QUIET,
    merged,
    plant_tables,
    run,
    torque,
    trainer,
)

from observer.mechanism.friction import FrictionParameters
from sim_drives.plant.plant import HIP, SLIDE, Physics, PlantError, Trainer
from tests.observer.mechanics import kinetic_energy, potential_energy

STIFFNESS = 800.0, 4e4
SOFT = {
    "hip": {"stiffness_nm_per_rad": STIFFNESS[HIP], "damping_nm_s_per_rad": 0.0},
    "slide": {"stiffness_n_per_m": STIFFNESS[SLIDE], "damping_n_s_per_m": 0.0},
}
NO_DAMPERS = LEG._replace(
    hip_damping=0.0, knee_damping=0.0, ankle_damping=0.0, slide_joint_damping=0.0
)
NEARLY_NO_FRICTION = tuple(
    FrictionParameters(*f)._replace(stribeck=1e-6, coulomb=1e-7, viscous=0.0) for f in FRICTIONS
)


def soft(*given, **changes):
    return trainer(*given, sensor=QUIET, transmission=merged(SOFT, changes))


def shaft(plant, axis=HIP):
    """Position of the shaft, as its encoder shows it, and its speed."""
    sample = plant.sample(axis)
    return sample.position_si, sample.velocity_si


def test_a_shaft_before_a_blocked_joint_swings_with_its_own_inertia():
    plant = soft()
    plant.block_rotor(HIP, True)
    torque(plant, 4.0, 0.0)
    start, _ = shaft(plant)

    turns = []
    for _ in range(1000):
        run(plant, 0.001)
        turns.append(shaft(plant)[0] - start)

    wound_up = 4.0 / STIFFNESS[HIP]
    assert np.mean(turns) == pytest.approx(wound_up, rel=0.03)
    assert max(turns) == pytest.approx(2.0 * wound_up, rel=0.03)
    risen = np.flatnonzero(np.diff((np.array(turns) > wound_up).astype(int)) == 1)
    period_s = 2.0 * math.pi * math.sqrt(DRIVE_INERTIA[HIP] / STIFFNESS[HIP])
    assert 0.001 * np.diff(risen).mean() == pytest.approx(period_s, rel=0.01)


def test_energy_of_leg_shafts_and_springs_is_the_work_of_the_drives():
    plant = soft(NO_DAMPERS, NEARLY_NO_FRICTION)
    torque(plant, 3.0, 20.0)

    left = []
    for _ in range(60):
        truth, work = plant.truth(), plant.work()
        q, dq = np.array(truth.position), np.array(truth.velocity)
        energy = kinetic_energy(LEG, q, dq) + potential_energy(LEG, q)
        for axis in (HIP, SLIDE):
            position, velocity = shaft(plant, axis)
            energy += 0.5 * DRIVE_INERTIA[axis] * (velocity**2 - dq[axis] ** 2)
            energy += 0.5 * STIFFNESS[axis] * (position - q[axis]) ** 2
        left.append(energy - work["drives"])
        run(plant, 0.005)

    assert work["drives"] > 0.5
    assert left == pytest.approx([left[0]] * 60, abs=0.01)


def test_a_shaft_turns_freely_inside_its_gap():
    gap_rad = 0.02
    plant = soft(hip={"backlash_rad": gap_rad})
    torque(plant, 2.0, 0.0)
    (start, _), joint = shaft(plant), plant.truth().position[HIP]

    through_s = math.sqrt(gap_rad * DRIVE_INERTIA[HIP] / 2.0)
    run(plant, 0.9 * through_s)

    assert shaft(plant)[0] - start == pytest.approx(0.5 * gap_rad * 0.81, rel=0.03)
    assert plant.truth().position[HIP] == pytest.approx(joint, abs=2e-4)
    run(plant, 0.4)
    assert plant.truth().position[HIP] != pytest.approx(joint, abs=2e-4)


def test_a_shaft_without_inertia_is_refused_with_its_key():
    with pytest.raises(PlantError, match=r"`transmission\.slide` needs a drive with inertia"):
        Trainer(
            plant_tables(transmission={"slide": SOFT["slide"]}),
            Physics(LEG, FRICTIONS, (0.35, 0.0)),
            EFFORT_PER_A,
            seed=1,
            start_ns=0,
        )
