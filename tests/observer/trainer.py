"""A leg to observe: parameters of observer.md 2.4, and a plant that the filter does not share.

The plant takes steps of 0.1 ms with the full dynamics, end stops, and the paper's friction or
bristles (LuGre). It shares the mechanism's closed form with the observer, which is proven against
an independent derivation in test_mechanism.py.
"""

import math
from typing import NamedTuple

import numpy as np

from observer.filter.considered import known_of
from observer.filter.leg_model import Integrator
from observer.filter.leg_observer import ObserverTuning
from observer.jit import kernel
from observer.mechanism.friction import FrictionParameters, friction_after
from observer.mechanism.linkage import bounded_acceleration
from observer.mechanism.mechanism import gravity, slide_position_for_knee
from observer.mechanism.parameters import (
    Dampers,
    Geometry,
    LegParameters,
    Link,
    Slide,
    Spring,
    leg_parameters,
    with_patient,
)
from observer.offline.batch import Columns

RECLINE = math.radians(60.0)
GEOMETRY = Geometry(0.4361, 0.43788, 0.25, RECLINE, 0.612102355, -0.699807621, RECLINE)
EXOSKELETON = (
    Link(4.0, 0.45, math.radians(4.0), 4.0 * (0.30 * 0.4361) ** 2),
    Link(2.5, 0.50, math.radians(-5.0), 2.5 * (0.30 * 0.43788) ** 2),
    Link(3.0, 0.50, math.radians(20.0), 3.0 * (0.40 * 0.25) ** 2),
)
SLIDE = Slide(4.0, 6.0)
HIP_DRIVE_INERTIA = 0.35
DAMPERS = Dampers(0.5, 0.3, 0.3, 0.2)
MID_POSE = np.array([math.radians(14.0), 0.59])

HIP = FrictionParameters(7.0, 6.0, 0.8, 0.01, 0.05, 0.03, 0.02)
SLIDE_FRICTION = FrictionParameters(75.0, 65.0, 60.0, 0.004, 0.02, 0.012, 0.02)
PROCESS = (1e-6, 1e-6, 1e-3, 5e-4, 0.1, 1.0, 0.1, 1.0)
ENTIRE = known_of(np.ones(1), 1e-12 * np.eye(1), np.zeros(2))
"""A baseline that knows the only parameter to be off by one standard deviation."""
TUNING = ObserverTuning(
    process_std=PROCESS,
    measurement_std=(5.8e-5, 2.5e-5),
    coriolis=True,
    velocity_gated=False,
    integrator=Integrator.RK4,
    substeps=2,
    gate_nis=60.0,
)


def composed(links: tuple[Link, Link, Link], springs: tuple[Spring, Spring]) -> LegParameters:
    return leg_parameters(GEOMETRY, links, SLIDE, HIP_DRIVE_INERTIA, springs, DAMPERS)


def balanced(links: tuple[Link, Link, Link]) -> LegParameters:
    """Soft springs whose preload carries the leg at mid pose."""
    hip, slide = gravity(composed(links, (Spring(), Spring())), MID_POSE)
    springs = Spring(20.0, MID_POSE[0] + hip / 20.0), Spring(120.0, MID_POSE[1] + slide / 120.0)
    return composed(links, springs)


PROTOTYPE = balanced(EXOSKELETON)
PATIENT = balanced(with_patient(EXOSKELETON, GEOMETRY, 80.0, 1.78))

HIP_MEAN = 13.98
HIP_HARMONICS = (
    *((20.129, -3.2), (-4.62, -3.167), (-0.231, 1.455)),
    *((0.862, 0.542), (-0.141, -0.711), (-0.192, 0.405)),
)
KNEE_MEAN = 22.349
KNEE_HARMONICS = (
    *((-7.272, -21.49), (-8.112, 11.93), (0.464, 2.284)),
    *((-0.658, -0.091), (-1.743, -1.124), (0.073, 0.062)),
)


def series(mean, harmonics, phase):
    turns = 2.0 * np.pi * np.asarray(phase)
    waves = (
        a * np.cos((k + 1) * turns) + b * np.sin((k + 1) * turns)
        for k, (a, b) in enumerate(harmonics)
    )
    return np.radians(mean + sum(waves))


def gait(leg: LegParameters, time_s, cadence_hz: float):
    """Hip angle and slide position over time, (n, 2), of the normative gait."""
    phase = time_s * cadence_hz
    hip = series(HIP_MEAN, HIP_HARMONICS, phase)
    knee = series(KNEE_MEAN, KNEE_HARMONICS, phase)
    slide = [slide_position_for_knee(leg, a, b) for a, b in zip(hip, knee, strict=True)]
    return np.column_stack((hip, slide))


class Bristles(NamedTuple):
    """LuGre: stiffness, damping, and the static law's levels; one axis."""

    stiffness: float
    damping: float
    breakaway: float
    coulomb: float
    viscous: float
    stribeck_speed: float


HIP_BRISTLES = Bristles(2e3, 20.0, 7.0, 6.0, 0.8, 0.05)
SLIDE_BRISTLES = Bristles(1e5, 600.0, 75.0, 65.0, 60.0, 0.02)


class Truth(NamedTuple):
    """At the end of each cycle: state in the observer's order, and the plant's own efforts."""

    time_s: np.ndarray
    state: np.ndarray
    """(n, 8); friction and patient are those of the last 0.1 ms."""
    drive: np.ndarray
    """(n, 2): what the drives exerted during the cycle that ends here."""


@kernel
def bristle_step(b, z, v, dt):
    level = b.coulomb + (b.breakaway - b.coulomb) * math.exp(-((v / b.stribeck_speed) ** 2))
    # z' = v - |v| stiffness / level z, exact for constant v: bristles are stiff
    rate = abs(v) * b.stiffness / level
    bent = v / rate if rate * dt > 1e-9 else 0.0
    z_after = bent + (z - bent) * math.exp(-rate * dt) if bent != 0.0 else z + v * dt
    return z_after, b.stiffness * z_after + b.damping * (z_after - z) / dt + b.viscous * v


@kernel
def _simulate(
    leg,
    hip,
    slide,
    bristles1,
    bristles2,
    is_lugre,
    start,
    drive,
    gains,
    reference,
    reference_rate,
    patient,
    steps,
    dt,
    low,
    high,
    states,
    drives,
):
    q1, q2, v1, v2 = start[0], start[1], 0.0, 0.0
    f1 = f2 = z1 = z2 = 0.0
    step = 0
    for row in range(states.shape[0]):
        u1 = drive[row, 0] + gains[0] * (reference[row, 0] - q1)
        u1 += gains[1] * (reference_rate[row, 0] - v1)
        u2 = drive[row, 1] + gains[2] * (reference[row, 1] - q2)
        u2 += gains[3] * (reference_rate[row, 1] - v2)
        p1 = p2 = 0.0
        for _ in range(steps[row]):
            p1, p2 = patient[step, 0], patient[step, 1]
            step += 1
            stop1 = -2e4 * (max(q1 - high[0], 0.0) + min(q1 - low[0], 0.0))
            stop2 = -2e5 * (max(q2 - high[1], 0.0) + min(q2 - low[1], 0.0))
            if stop1 != 0.0:
                stop1 -= 60.0 * v1
            if stop2 != 0.0:
                stop2 -= 600.0 * v2
            a1, a2, _ = bounded_acceleration(
                leg, q1, q2, v1, v2, u1 + p1 - f1 + stop1, u2 + p2 - f2 + stop2, 1.0
            )
            v1 += dt * a1
            v2 += dt * a2
            q1 += dt * v1
            q2 += dt * v2
            if is_lugre:
                z1, f1 = bristle_step(bristles1, z1, v1, dt)
                z2, f2 = bristle_step(bristles2, z2, v2, dt)
            else:
                f1 = friction_after(hip, f1, v1, dt)
                f2 = friction_after(slide, f2, v2, dt)
        states[row, 0], states[row, 1], states[row, 2], states[row, 3] = q1, q2, v1, v2
        states[row, 4], states[row, 5], states[row, 6], states[row, 7] = f1, f2, p1, p2
        drives[row, 0], drives[row, 1] = u1, u2


STEP = 1e-4
LOW = np.array([math.radians(-20.0), 0.0])
HIGH = np.array([math.radians(40.0), 0.95])
GUIDANCE = (400.0, 15.0, 8000.0, 250.0)
"""Impedance: N m/rad, N m s/rad, N/m, N s/m."""


def active(time_s):
    """A patient who works through a gait at 0.25 Hz: N m and N, (n, 2)."""
    return np.column_stack(
        (6.0 * np.sin(np.pi * time_s / 2.0), 30.0 * np.cos(np.pi * time_s / 2.0))
    )


def simulate(
    leg,
    cycles,
    *,
    drive=None,
    reference=None,
    patient=None,
    start=MID_POSE,
    lugre=False,
    steps=None,
    hip=HIP,
    slide=SLIDE_FRICTION,
) -> Truth:
    """Drive the plant, which rests at `start`, for a number of cycles of 10 ms.

    Args:
        leg: the plant's mechanism.
        cycles: how many.
        drive: open-loop effort for each cycle, (cycles, 2).
        reference: positions that an impedance guides to, (cycles, 2).
        patient: time (n) -> effort (n, 2).
        start: where it rests.
        lugre: bristles instead of the paper's friction.
        steps: of 0.1 ms in each cycle; 100 if None.
        hip, slide: the paper's friction.
    """
    steps = np.full(cycles, 100) if steps is None else steps
    fine = (np.arange(steps.sum()) + 0.5) * STEP
    time_s = np.cumsum(steps) * STEP
    states, drives = np.empty((cycles, 8)), np.empty((cycles, 2))
    guided = reference is not None
    path = reference if guided else np.zeros((cycles, 2))
    _simulate(
        leg,
        hip,
        slide,
        HIP_BRISTLES,
        SLIDE_BRISTLES,
        lugre,
        np.asarray(start, dtype=float),
        np.zeros((cycles, 2)) if drive is None else drive,
        GUIDANCE if guided else (0.0, 0.0, 0.0, 0.0),
        path,
        np.gradient(path, time_s, axis=0) if guided else np.zeros((cycles, 2)),
        np.zeros((len(fine), 2)) if patient is None else patient(fine),
        steps,
        STEP,
        LOW,
        HIGH,
        states,
        drives,
    )
    return Truth(time_s, states, drives)


QUANTUM = np.array([1e-4, 5e-5])
NOISE = np.array([5e-5, 2e-5])


def encoded(truth: Truth, seed: int = 1) -> Columns:
    """What a master would record of it: encoders with noise and quantum, efforts as exerted."""
    noise = np.random.default_rng(seed).normal(size=(len(truth.time_s), 2)) * NOISE
    counts = np.round((truth.state[:, :2] + noise) / QUANTUM)
    return Columns(truth.time_s, counts * QUANTUM, truth.drive)


def rms(values, axis=0):
    return np.sqrt(np.mean(np.square(values), axis=axis))


def moving(truth: Truth):
    """Rows and axes where the gate is open, (n, 2)."""
    speeds = np.abs(truth.state[:, 2:4])
    return speeds > np.array([HIP.edge, SLIDE_FRICTION.edge])
