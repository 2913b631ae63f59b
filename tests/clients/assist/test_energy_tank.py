"""Friction fed forward never makes a leg give more energy than its tank holds.

One axis, an independent model of it in this file: mass, LuGre bristles (Canudas de Wit 1995), a
person's hand that pushes, lets go and brakes, and a drive two cycles late. From any time on, the
hand gets out at most what was in the motion then, and in tank and bristles.
"""

import math

import numpy as np
import pytest
from gaitd_assist import Sample, Transparency
from gaitd_assist.transparency import TransparencyRules
from gaitd_client import Assist

MASS_KG_M2, STEP_S, CYCLE_STEPS = 1.5, 2.5e-4, 40
COULOMB_NM, STRIBECK_NM, PEAK_RAD_PER_S, VISCOUS = 6.0, 7.0, 0.05, 0.8
BRISTLE_NM_PER_RAD, BRISTLE_NM_S_PER_RAD = 2000.0, 44.7
LATE_CYCLES = 2


class NoTank(Transparency):
    """The same law with a tank that is always full."""

    def answer(self, sample, setpoint):
        for tank in self._tanks:
            tank.energy_j = tank._size_j
        return super().answer(sample, setpoint)


def law(kind, ratio=0.8, level_nm=STRIBECK_NM):
    return kind(
        TransparencyRules(
            friction_max=(level_nm, 75.0),
            full_speed=(0.15, 0.06),
            tank_j=(0.2, 0.5),
            feedforward_ratio=ratio,
            error_ratio=0.2,
        )
    )


def hand(rng, seconds):
    """Effort in N m and damping in N m s/rad of the person: pushes, nothing, and brakes."""
    made = []
    while len(made) < seconds / STEP_S:
        push = rng.uniform(-20, 20), 0.0
        part = [push, (0.0, 0.0), (0.0, rng.uniform(0.5, 8))][rng.integers(3)]
        made += [part] * int(rng.uniform(0.05, 1.0) / STEP_S)
    return made


def energy_out_j(controller, estimate_ratio, seed, seconds=20.0):
    """The most energy that the person got out from any time on, less what was in motion then.

    Args:
        controller: the law.
        estimate_ratio: estimated over true friction.
        seed: of the person.
        seconds: simulated.
    """
    velocity = bristle = estimate = got_j = lowest_j = most_j = 0.0
    sent = [0.0] * (LATE_CYCLES + 1)
    for number, (push, damping) in enumerate(hand(np.random.default_rng(seed), seconds)):
        level = COULOMB_NM + (STRIBECK_NM - COULOMB_NM) * math.exp(
            -((velocity / PEAK_RAD_PER_S) ** 2)
        )
        rate = velocity - BRISTLE_NM_PER_RAD * abs(velocity) / level * bristle
        friction = BRISTLE_NM_PER_RAD * bristle + BRISTLE_NM_S_PER_RAD * rate + VISCOUS * velocity
        estimate += STEP_S / 0.02 * (estimate_ratio * friction - estimate)
        if number % CYCLE_STEPS == 0:
            sample = Sample(
                dt_s=CYCLE_STEPS * STEP_S,
                phase_ratio=None,
                cadence_hz=None,
                error=(0.0, 0.0),
                error_rate=(0.0, 0.0),
                velocity=(velocity, 0.0),
                friction=(estimate if abs(velocity) > 0.01 else None, None),
                learns=(False, False),
            )
            sent = [*sent[1:], controller.answer(sample, Assist()).hip_nm]
        effort = push - damping * velocity
        before = velocity
        velocity += STEP_S * (effort + sent[0] - friction) / MASS_KG_M2
        bristle += STEP_S * rate
        got_j -= effort * STEP_S * (before + velocity) / 2
        lowest_j = min(lowest_j, got_j + MASS_KG_M2 * velocity**2 / 2)
        most_j = max(most_j, got_j - lowest_j)
    return most_j


TANK_J = 0.2
BRISTLES_J = STRIBECK_NM**2 / BRISTLE_NM_PER_RAD / 2


@pytest.mark.parametrize("estimate_ratio", [0.8, 1.0, 1.2, 1.25])
def test_the_leg_gives_no_more_than_the_tank_with_friction_20_percent_wrong(estimate_ratio):
    got_j = energy_out_j(law(Transparency), estimate_ratio, seed=3)

    assert got_j <= TANK_J + BRISTLES_J


def test_without_the_tank_the_same_law_gives_more_where_friction_is_overestimated():
    wrong = {"ratio": 1.3, "level_nm": 12.0}  # more than a file may ask for

    assert energy_out_j(law(NoTank, **wrong), 1.2, seed=3) > 5 * (TANK_J + BRISTLES_J)
    assert energy_out_j(law(Transparency, **wrong), 1.2, seed=3) <= TANK_J + BRISTLES_J
