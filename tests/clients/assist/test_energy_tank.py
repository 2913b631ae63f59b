"""Friction fed forward never makes a leg give more energy than its tank holds.

Each axis alone, an independent model of it in this file: mass, LuGre bristles (Canudas de Wit
1995), a person's hand that pushes, lets go and brakes, and a drive two cycles late. From any time
on, the hand gets out at most what was in the motion then, and in tank and bristles.
"""

import math
from typing import NamedTuple

import numpy as np
import pytest
from gaitd_assist import Sample, Transparency
from gaitd_assist.transparency import TransparencyRules
from gaitd_client import Assist

STEP_S, CYCLE_STEPS, LATE_CYCLES = 2.5e-4, 40, 2


class Axis(NamedTuple):
    """One axis and its hand, in N, m and kg, or N m, rad and kg m^2."""

    index: int
    mass: float
    coulomb: float
    stribeck: float
    peak: float
    viscous: float
    bristle_stiffness: float
    bristle_damping: float
    moves_from: float
    """Speed from which the observer separates friction from a patient."""
    push: float
    damping: float
    tank_j: float

    @property
    def bristles_j(self) -> float:
        """Energy in the bristles at most."""
        return self.stribeck**2 / self.bristle_stiffness / 2


AXES = (
    Axis(0, 1.5, 6.0, 7.0, 0.05, 0.8, 2000.0, 44.7, 0.01, 20.0, 8.0, 0.2),
    Axis(1, 20.0, 65.0, 75.0, 0.02, 60.0, 1e5, 316.0, 0.005, 220.0, 200.0, 0.5),
)


class NoTank(Transparency):
    """The same law with a tank that is always full."""

    def answer(self, sample, setpoint):
        for tank in self._tanks:
            tank.energy_j = tank._size_j
        return super().answer(sample, setpoint)


def law(kind, ratio=0.8, level_ratio=1.0):
    hip, slide = AXES
    return kind(
        TransparencyRules(
            friction_max=(level_ratio * hip.stribeck, level_ratio * slide.stribeck),
            full_speed=(0.15, 0.06),
            tank_j=(hip.tank_j, slide.tank_j),
            feedforward_ratio=ratio,
            error_ratio=0.2,
        )
    )


def hand(axis, rng, seconds):
    """Effort and damping of the person: pushes, nothing, and brakes."""
    made = []
    while len(made) < seconds / STEP_S:
        push = rng.uniform(-axis.push, axis.push), 0.0
        brake = 0.0, rng.uniform(axis.damping / 16, axis.damping)
        part = [push, (0.0, 0.0), brake][rng.integers(3)]
        made += [part] * int(rng.uniform(0.05, 1.0) / STEP_S)
    return made


def sample(axis, velocity, friction):
    """What the law gets: the other axis rests."""
    velocities, frictions = [0.0, 0.0], [None, None]
    velocities[axis.index], frictions[axis.index] = velocity, friction
    return Sample(
        dt_s=CYCLE_STEPS * STEP_S,
        phase_ratio=None,
        cadence_hz=None,
        error=(0.0, 0.0),
        error_rate=(0.0, 0.0),
        velocity=tuple(velocities),
        friction=tuple(frictions),
        learns=(False, False),
    )


def energy_out_j(axis, controller, estimate_ratio, seed=3, seconds=20.0):
    """The most energy that the person got out from any time on, less what was in motion then.

    Args:
        axis: the one that moves.
        controller: the law.
        estimate_ratio: estimated over true friction.
        seed: of the person.
        seconds: simulated.
    """
    velocity = bristle = estimate = got_j = lowest_j = most_j = 0.0
    sent = [0.0] * (LATE_CYCLES + 1)
    for number, (push, damping) in enumerate(hand(axis, np.random.default_rng(seed), seconds)):
        weakening = math.exp(-((velocity / axis.peak) ** 2))
        level = axis.coulomb + (axis.stribeck - axis.coulomb) * weakening
        rate = velocity - axis.bristle_stiffness * abs(velocity) / level * bristle
        friction = axis.bristle_stiffness * bristle + axis.bristle_damping * rate
        friction += axis.viscous * velocity
        estimate += STEP_S / 0.02 * (estimate_ratio * friction - estimate)
        if number % CYCLE_STEPS == 0:
            known = estimate if abs(velocity) > axis.moves_from else None
            answer = controller.answer(sample(axis, velocity, known), Assist())
            sent = [*sent[1:], answer[axis.index]]
        effort = push - damping * velocity
        before = velocity
        velocity += STEP_S * (effort + sent[0] - friction) / axis.mass
        bristle += STEP_S * rate
        got_j -= effort * STEP_S * (before + velocity) / 2
        lowest_j = min(lowest_j, got_j + axis.mass * velocity**2 / 2)
        most_j = max(most_j, got_j - lowest_j)
    return most_j


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("estimate_ratio", [0.8, 1.0, 1.2, 1.25])
def test_the_leg_gives_no_more_than_the_tank_with_friction_20_percent_wrong(axis, estimate_ratio):
    got_j = energy_out_j(axis, law(Transparency), estimate_ratio)

    assert got_j <= axis.tank_j + axis.bristles_j


@pytest.mark.parametrize("axis", AXES)
def test_without_the_tank_the_same_law_gives_more_where_friction_is_overestimated(axis):
    wrong = {"ratio": 1.3, "level_ratio": 1.7}  # more than a file may ask for
    allowed_j = axis.tank_j + axis.bristles_j

    assert energy_out_j(axis, law(NoTank, **wrong), 1.2) > 5 * allowed_j
    assert energy_out_j(axis, law(Transparency, **wrong), 1.2) <= allowed_j
