"""Runs of a plant that is exactly the filter's model, with the filter's own noise."""

import numpy as np

from observer.filter.leg_filter import OUT_COVARIANCE, OUT_INNOVATION, OUT_NIS, OUT_SIZE, advance
from observer.filter.leg_memory import START_STD, new_memory
from observer.filter.leg_model import LANES, LegModel, runge_kutta
from observer.filter.leg_observer import setup_of
from observer.jit import kernel
from tests.observer.trainer import HIP, MID_POSE, PROTOTYPE, SLIDE_FRICTION, TUNING

MODEL = LegModel(PROTOTYPE, HIP, SLIDE_FRICTION, 1.0)


@kernel
def _one_step(model, state, effort_hip, effort_slide, points):
    for row in range(8):
        for lane in range(LANES):
            points[row * LANES + lane] = state[row]
    for _ in range(2):
        runge_kutta(model, effort_hip, effort_slide, 0.005, points)
    for row in range(8):
        state[row] = points[row * LANES]


def consistency(runs: int, steps: int, tuning=TUNING) -> tuple[float, float]:
    """Mean NEES and NIS over all runs and steps, without the gate's rejections."""
    setup = setup_of(PROTOTYPE, HIP, SLIDE_FRICTION, tuning)
    total = np.zeros(2)
    for run in range(runs):
        total += _run(setup, np.random.default_rng(100 + run), steps)
    return tuple(total / (runs * steps))


def _run(setup, random, steps):
    buffers, out, plant_points = new_memory(), np.zeros(OUT_SIZE), np.zeros(8 * LANES)
    start = np.concatenate((MID_POSE, np.zeros(6)))
    state = start + random.normal(size=8) * START_STD
    advance(setup, *buffers, tuple(MID_POSE), (0.0, 0.0), (0.0, 0.0), 0.01, 0, out)
    sums = np.zeros(2)
    for k in range(steps):
        # Both axes are kept in motion, back and forth about mid pose.
        swing = 2.0 * np.pi * 0.4 * k * 0.01
        effort = (14.0 * np.cos(swing), 140.0 * np.cos(swing))
        _one_step(MODEL, state, *effort, plant_points)
        state += random.normal(size=8) * TUNING.process_std
        measured = state[:2] + random.normal(size=2) * TUNING.measurement_std
        advance(setup, *buffers, tuple(measured), effort, (0.0, 0.0), 0.01, 0, out)
        sums += _nees(state, out), out[OUT_NIS]
    return sums


def _nees(state, out):
    covariance = np.zeros((8, 8))
    covariance[np.tril_indices(8)] = out[OUT_COVARIANCE:OUT_INNOVATION]
    covariance += np.tril(covariance, -1).T
    error = state - out[:8]
    return error @ np.linalg.solve(covariance, error)
