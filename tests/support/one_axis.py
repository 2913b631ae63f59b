"""A recording of one slow, precise axis: no spring, a constant force, an encoder far better than
the file says, a drive that ripples. Its rise near zero is wider than the file's by far.
"""

import math

import numpy as np
from empty_runs import robot_file

from analysis.recording import recording
from analysis.replay import Source
from daemon.config.edits import replaced
from daemon.config.settings import Robot
from gaitd_lab.studies.real_data.emps import one_axis

MASS_KG = 95.0
COULOMB_N = 20.5
VISCOUS_N_S_PER_M = 203.0
CONSTANT_N = -3.2
TRANSITION_M_PER_S = 0.008
TIME_CONSTANT_S = 0.006
ENCODER_M = 2e-7
RIPPLE_N = 2.0
"""Standard deviation of a row's mean."""
SPEEDS_M_PER_S = (0.2, 0.12, 0.2, 0.06, 0.16, 0.03)
ACCELERATION_M_PER_S2 = 1.5
SLIDE_M = 0.59
RANGE_M = 0.12
HIP_RAD = 0.2440
STEP_S = 1e-3
STEPS = 10
"""In a row."""


def one_axis_file(
    *, coulomb_n: float, viscous_n_s_per_m: float, mass_kg: float, encoder_m: float = 2.5e-5
) -> Robot:
    """The robot file of a weightless leg on a heavy slide, with springs of stiffness 0."""
    robot = one_axis(
        robot_file(), coulomb_n=coulomb_n, viscous_n_s_per_m=viscous_n_s_per_m, mass_kg=mass_kg
    )
    return replaced(robot, {"observer.slide.measurement_position_m": encoder_m})


def one_axis_run(duration_s: float = 25.0, seed: int = 1) -> Source:
    """Moves there and back at several speeds, under a stiff position control."""
    rng = np.random.default_rng(seed)
    count = round(duration_s / (STEP_S * STEPS))
    position_m, asked_n = one_axis_samples(count, rng)
    rows = np.empty((count, 5))
    rows[:, 0] = np.arange(1, count + 1) * (STEP_S * STEPS)
    rows[:, 1], rows[:, 3] = HIP_RAD, 0.0
    rows[:, 2] = position_m[STEPS::STEPS]
    rows[:, 4] = asked_n.reshape(count, STEPS).mean(axis=1)
    rows[:, 2] += rng.normal(size=count) * ENCODER_M
    return Source(recording("one_axis.csv", rows), None, "", None)


def one_axis_samples(count, rng, pulses_n=None):
    """Positions before and after each millisecond of `count` rows, and the forces asked for.

    `pulses_n` is added to what the control asks, and is part of the result.
    """
    pulses_n = np.zeros(count * STEPS) if pulses_n is None else pulses_n
    ripple = rng.normal(size=(count, STEPS)).ravel() * RIPPLE_N * math.sqrt(STEPS)
    position, velocity, friction = SLIDE_M, 0.0, 0.0
    goal, goal_speed, side, moves = SLIDE_M, 0.0, 1.0, 0
    change = ACCELERATION_M_PER_S2 * STEP_S
    positions, asked = np.empty(count * STEPS + 1), np.empty(count * STEPS)
    positions[0] = position
    for step, pulse in enumerate(pulses_n):
        wanted = side * SPEEDS_M_PER_S[moves % len(SPEEDS_M_PER_S)]
        goal_speed += max(-change, min(change, wanted - goal_speed))
        goal += STEP_S * goal_speed
        if side * (goal - SLIDE_M) > RANGE_M:
            side, moves = -side, moves + 1
        asked[step] = 16000.0 * (goal - position) + 2500.0 * (goal_speed - velocity) + pulse
        law = COULOMB_N * math.tanh(velocity / TRANSITION_M_PER_S)
        law += VISCOUS_N_S_PER_M * velocity
        friction += STEP_S / TIME_CONSTANT_S * (law - friction)
        acting = asked[step] + ripple[step] - friction - CONSTANT_N
        velocity += STEP_S * acting / MASS_KG
        position += STEP_S * velocity
        positions[step + 1] = position
    return positions, asked
