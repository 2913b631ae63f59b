"""Friction of the plant: real sticking, breakaway, and the curves that it must follow."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from trainers import (
    DRIVE_INERTIA,
    EFFORT_PER_A,
    FRICTIONS,
    LEG,
    MS,
    order,
    plant_tables,
    run,
    torque,
    trainer,
)

from observer.mechanism.friction import EVERYWHERE, OverPosition, static_friction_of
from observer.mechanism.mechanism import gravity, mass_matrix
from sim_drives.plant.actuation import Actuation
from sim_drives.plant.plant import HIP, SLIDE, Physics, Trainer
from sim_drives.plant.settings import FrictionLaw
from sim_drives.plant.stick_slip import (
    JOINT,
    LAW_CODES,
    Bristles,
    slide_or_stick,
    sliding_friction,
)

BRISTLES = (Bristles(2000.0, 44.7), Bristles(1e5, 316.0))
LAWS = ["paper", "paper_sticking", "lugre"]
RISE_PER_MS = 5e-5
"""Part of the breakaway load in one millisecond; ten times as much far below it."""


def pushed(plant, push, seconds):
    """Let both axes carry `push` beyond weight and springs, renewed every millisecond."""
    for _ in range(round(1000 * seconds)):
        torque(plant, *(gravity(LEG, np.array(plant.truth().position)) + push))
        plant.advance(plant.now_ns + MS)


def on(axis, effort):
    return np.array([effort if i == axis else 0.0 for i in (HIP, SLIDE)])


@pytest.mark.parametrize("axis", [HIP, SLIDE])
def test_an_axis_with_ideal_sticking_does_not_move_at_all_under_nine_tenths_of_breakaway(axis):
    plant = trainer(friction={"law": "paper_sticking"})
    start = plant.truth().position
    load = 0.9 * FRICTIONS[axis].stribeck

    torque(plant, *(gravity(LEG, np.array(start)) + on(axis, load)))
    run(plant, 10.0)

    truth = plant.truth()
    assert truth.position == start
    assert truth.velocity == (0.0, 0.0)
    assert truth.friction[axis] == pytest.approx(load, rel=1e-6)


@pytest.mark.parametrize("axis", [HIP, SLIDE])
def test_bristles_give_way_elastically_and_then_hold(axis):
    plant = trainer(friction={"law": "lugre"})
    start = plant.truth().position
    balance = gravity(LEG, np.array(start))

    for share in np.linspace(0.0, 0.8, 100):
        torque(plant, *(balance + on(axis, share * FRICTIONS[axis].stribeck)))
        run(plant, 0.01)
    run(plant, 1.0)
    settled = plant.truth().position[axis]
    run(plant, 10.0)

    deflection = FRICTIONS[axis].stribeck / BRISTLES[axis].stiffness_si
    assert abs(settled - start[axis]) < 2 * deflection
    assert plant.truth().position[axis] == pytest.approx(settled, abs=0.001 * deflection)


def test_the_papers_law_creeps_where_its_static_curve_balances_the_load():
    """Why the law alone is no model of a machine at rest."""
    plant = trainer(friction={"law": "paper"})

    pushed(plant, on(HIP, 4.0), 8.0)

    speed = plant.truth().velocity[HIP]
    assert 0.002 < speed < FRICTIONS[HIP].transition
    assert static_friction_of(FRICTIONS[HIP], speed) == pytest.approx(4.0, rel=0.05)


@pytest.mark.parametrize(
    ("law", "axis"), [("paper", HIP), ("paper_sticking", SLIDE), ("lugre", HIP)]
)
def test_a_slowly_rising_load_breaks_away_at_the_stribeck_level(law, axis):
    plant = trainer(friction={"law": law})
    slip_speed = 2 * FRICTIONS[axis].peak

    for share in (*np.arange(0.0, 0.8, 10 * RISE_PER_MS), *np.arange(0.8, 1.3, RISE_PER_MS)):
        pushed(plant, on(axis, share * FRICTIONS[axis].stribeck), 0.001)
        if plant.truth().velocity[axis] > slip_speed:
            break

    # What the load gains while the joint gathers speed counts as well.
    assert share == pytest.approx(1.0, abs=0.08)


def pulled_slowly(law):
    """Speeds of the slide behind a spring."""
    plant = trainer(friction={"law": law})
    start = plant.truth().position[SLIDE]
    speeds = []
    for step in range(8000):
        pulled = start + 0.01 * step * 1e-3
        pushed(plant, on(SLIDE, 3000.0 * (pulled - plant.truth().position[SLIDE])), 0.001)
        speeds.append(plant.truth().velocity[SLIDE])
    return speeds


@pytest.mark.parametrize("law", ["paper_sticking", "lugre"])
def test_a_spring_pulled_slowly_moves_the_slide_in_jerks(law):
    speeds = pulled_slowly(law)

    moving = np.array(speeds[4000:]) > FRICTIONS[SLIDE].peak
    stuck = np.abs(speeds[4000:]) < FRICTIONS[SLIDE].transition
    jerks = sum(now and not before for before, now in pairwise(moving))
    assert jerks >= 3
    assert np.mean(stuck) > 0.1


def test_the_papers_law_alone_slides_steadily_where_a_machine_would_jerk():
    assert pulled_slowly("paper")[4000:] == pytest.approx([0.01] * 4000, abs=0.004)


def steady(law, axis, speed):
    joint = np.zeros(1, JOINT)
    joint["velocity"] = speed
    for _ in range(4000):
        friction = sliding_friction(
            LAW_CODES[law], FRICTIONS[axis], BRISTLES[axis], joint[0], 0.00025
        )
    return friction


@settings(derandomize=True, max_examples=12, deadline=None)
@given(st.sampled_from([HIP, SLIDE]), st.floats(0.05, 3.0), st.sampled_from([-1.0, 1.0]))
def test_lugre_slides_steadily_on_its_stribeck_curve(axis, speed, side):
    f = FRICTIONS[axis]

    friction = steady(FrictionLaw.LUGRE, axis, side * speed)

    level = f.coulomb + (f.stribeck - f.coulomb) * math.exp(-((speed / f.peak) ** 2))
    assert friction == pytest.approx(side * (level + f.viscous * speed), rel=1e-6)


@settings(derandomize=True, max_examples=12, deadline=None)
@given(
    st.sampled_from([FrictionLaw.PAPER, FrictionLaw.PAPER_STICKING]),
    st.sampled_from([HIP, SLIDE]),
    st.floats(0.06, 3.0),
    st.sampled_from([-1.0, 1.0]),
)
def test_the_papers_law_slides_steadily_on_equation_13(law, axis, speed, side):
    expected = static_friction_of(FRICTIONS[axis], side * speed)

    assert steady(law, axis, side * speed) == pytest.approx(expected, rel=1e-6)


def one_step(loads, velocities=(0.0, 0.0), stuck=(1, 1)):
    joints = np.zeros(2, JOINT)
    joints["load"], joints["velocity"], joints["stuck"] = loads, velocities, stuck
    m = mass_matrix(LEG, np.array([0.2, 0.5]))
    mass = (m[0, 0], m[0, 1], m[1, 1])
    law = LAW_CODES[FrictionLaw.PAPER_STICKING]
    slide_or_stick(law, FRICTIONS, BRISTLES, joints, mass, 0.00025)
    return joints, m


SHARES = st.floats(-2.0, 2.0).filter(lambda share: abs(abs(share) - 1.0) > 1e-9)


@settings(derandomize=True, max_examples=200, deadline=None)
@given(SHARES, SHARES)
def test_two_coupled_axes_stick_exactly_while_each_load_is_below_its_breakaway(hip, slide):
    loads = (hip * FRICTIONS[HIP].stribeck, slide * FRICTIONS[SLIDE].stribeck)

    joints, _ = one_step(loads)

    if max(abs(hip), abs(slide)) < 1.0:
        assert tuple(joints["next_velocity"]) == (0.0, 0.0)
        assert tuple(joints["friction"]) == pytest.approx(loads)
    else:
        assert np.any(joints["next_velocity"] != 0.0)


@settings(derandomize=True, max_examples=200, deadline=None)
@given(SHARES, SHARES, st.floats(-0.02, 0.02), st.floats(-0.02, 0.02))
def test_a_step_obeys_newton_and_no_axis_that_sticks_needs_more_than_breakaway(
    hip, slide, hip_speed, slide_speed
):
    loads = np.array([hip * FRICTIONS[HIP].stribeck, slide * FRICTIONS[SLIDE].stribeck])

    joints, mass = one_step(loads, (hip_speed, slide_speed), (0, 0))

    change = joints["next_velocity"] - joints["velocity"]
    impulse = 0.00025 * (loads - joints["friction"])
    assert mass @ change == pytest.approx(impulse, abs=1e-12)
    for joint, f in zip(joints, FRICTIONS, strict=True):
        if joint["stuck"]:
            assert joint["next_velocity"] == 0.0
            assert abs(joint["friction"]) <= f.stribeck


@pytest.mark.parametrize("law", LAWS)
def test_a_blocked_rotor_stops_and_stands_against_any_load(law):
    plant = trainer(friction={"law": law})
    pushed(plant, on(HIP, 30.0), 0.05)

    plant.block_rotor(HIP, blocked=True)
    run(plant, 0.001)
    there = plant.truth().position[HIP]
    run(plant, 0.5)

    assert plant.truth().velocity[HIP] == 0.0
    assert plant.truth().position[HIP] == pytest.approx(there, abs=1e-12)
    plant.block_rotor(HIP, blocked=False)
    run(plant, 0.05)
    assert plant.truth().velocity[HIP] > 0.1


def test_friction_rises_along_an_axis_as_its_file_says():
    over = OverPosition(0.5, 0.6), EVERYWHERE
    plant = Trainer(
        plant_tables(), Physics(LEG, FRICTIONS, DRIVE_INERTIA, over), EFFORT_PER_A, 1, start_ns=0
    )
    plant.set_axis(HIP, order(HIP, Actuation.VELOCITY, target_velocity_si=0.2))
    plant.set_axis(SLIDE, order(SLIDE, Actuation.HOLD))
    f, ratios, places = FRICTIONS[HIP], [], []
    for _ in range(3):
        run(plant, 0.4)
        truth = plant.truth()
        ratios.append((truth.friction[HIP] - f.viscous * truth.velocity[HIP]) / f.coulomb)
        places.append(truth.position[HIP])

    assert ratios == pytest.approx([1.0 + 0.5 * (one - 0.6) for one in places], rel=0.02)
    assert max(ratios) - min(ratios) > 0.05
