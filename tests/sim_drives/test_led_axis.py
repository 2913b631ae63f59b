"""An axis whose drive is on the bench: the plant moves it as told, and the other one feels it."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from trainers import LEG, MS, PASSIVE, order, trainer

from observer.mechanism.friction import FrictionParameters
from observer.mechanism.mechanism import gravity
from sim_drives.plant.actuation import Actuation
from sim_drives.plant.led import COASTED_CYCLES
from sim_drives.plant.plant import HIP, SLIDE
from tests.observer.mechanics import kinetic_energy, potential_energy

CYCLE_S = 0.01
LAG_S = 0.02
SMOOTH = LEG._replace(hip_damping=0.0, knee_damping=0.0, ankle_damping=0.0, slide_joint_damping=0.0)
NO_FRICTION = tuple(FrictionParameters(1e-6, 1e-7, 0.0, 0.01, 0.05, 0.03, 0.02) for _ in range(2))
START = (0.244, 0.5905)


def led(leg=SMOOTH, frictions=NO_FRICTION, **changes):
    start = {
        "hip": {"position_deg": math.degrees(START[HIP])},
        "slide": {"position_m": START[SLIDE]},
    }
    plant = trainer(leg, frictions, start=start, patient=PASSIVE, **changes)
    plant.lead(HIP, CYCLE_S)
    force_n = gravity(leg, np.array(START))[SLIDE]
    plant.set_axis(SLIDE, order(SLIDE, Actuation.TORQUE, target_effort_si=float(force_n)))
    return plant, force_n


def cycle(plant, position):
    """One cycle from a SYNC on; the position of its sample arrives 3 ms later."""
    sync_ns = plant.now_ns
    for until_ns in (sync_ns + 3 * MS, sync_ns + 10 * MS):
        while plant.now_ns < until_ns:
            plant.advance(until_ns)
        if position is not None:
            plant.follow(HIP, sync_ns, position)


def hip(time_s):
    return START[HIP] + 0.12 * (1.0 - math.cos(2.0 * math.pi * 0.6 * time_s))


def slope(function, at, step=1e-5):
    return (function(at + step) - function(at - step)) / (2.0 * step)


def slide_by_lagrange(force_n, times_s):
    """The slide alone under a force, beside a hip that moves as `hip`: Lagrange's equation of the
    second coordinate, of energies, with the momentum as state.
    """

    def pose(time_s, slide_m):
        return np.array([hip(time_s), slide_m])

    def rates(time_s, state):
        slide_m, momentum = state
        q, unit = pose(time_s, slide_m), np.eye(2)
        m11, m22 = (2.0 * kinetic_energy(SMOOTH, q, e) for e in unit)
        m12 = kinetic_energy(SMOOTH, q, np.ones(2)) - 0.5 * (m11 + m22)
        turn = slope(hip, time_s)
        speed = (momentum - m12 * turn) / m22
        dq = np.array([turn, speed])

        def lagrangian(at_m):
            there = pose(time_s, at_m)
            return kinetic_energy(SMOOTH, there, dq) - potential_energy(SMOOTH, there)

        return speed, slope(lagrangian, slide_m) + force_n

    done = solve_ivp(rates, (0.0, times_s[-1]), (START[SLIDE], 0.0), t_eval=times_s, rtol=1e-8)
    return done.y[0]


def test_the_slide_beside_a_led_hip_moves_as_lagrange_says():
    plant, force_n = led()
    moved = []
    for number in range(100):
        # The SYNC's sample is what the plant plays 20 ms later.
        cycle(plant, hip(number * CYCLE_S + LAG_S))
        truth = plant.truth()
        moved.append((*truth.position, truth.velocity[HIP]))
    times_s = np.arange(1, 101) * CYCLE_S

    hips, slides, turns = np.array(moved).T
    expected = slide_by_lagrange(force_n, times_s)
    assert hips == pytest.approx([hip(time_s) for time_s in times_s], abs=5e-5)
    assert turns == pytest.approx([slope(hip, time_s) for time_s in times_s], abs=5e-3)
    assert np.ptp(expected) > 0.05
    assert slides == pytest.approx(expected, abs=1e-4)


def test_the_load_that_a_led_axis_would_carry_is_its_contact():
    plant, _ = led()
    for _ in range(30):
        cycle(plant, START[HIP])

    hip_nm, _ = gravity(SMOOTH, np.array(plant.truth().position))
    assert plant.truth().contact[HIP] == pytest.approx(hip_nm, abs=0.5)
    assert plant.truth().effort[HIP] == 0.0


def test_lost_samples_are_bridged_and_after_a_silence_the_axis_rests():
    plant, _ = led()
    speed = 0.5
    for number in range(40):
        lost = 20 <= number < 20 + COASTED_CYCLES
        cycle(plant, None if lost else START[HIP] + speed * number * CYCLE_S)
        if number > 5:
            assert plant.truth().velocity[HIP] == pytest.approx(speed, rel=0.02)
    for _ in range(COASTED_CYCLES + 1):
        cycle(plant, None)
    rest = plant.truth()
    cycle(plant, None)

    assert rest.velocity[HIP] == 0.0
    assert plant.truth().position[HIP] == rest.position[HIP]


def test_a_position_that_no_motor_has_moved_to_is_approached_and_ends_at_the_end_stop():
    plant, _ = led()
    cycle(plant, START[HIP])
    fastest = 0.0
    for _ in range(200):
        cycle(plant, 55.0)  # an encoder that has not been homed
        fastest = max(fastest, abs(plant.truth().velocity[HIP]))

    assert fastest < 0.51
    assert plant.truth().position[HIP] == pytest.approx(math.radians(43.0), abs=1e-9)
