"""Steps of whatever can come: no number that is none, no covariance that is not one."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from observer.filter.leg_observer import setup_of
from observer.filter.status import Status, Validity
from observer.mechanism.mechanism import gravity
from observer.offline import batch
from observer.offline.batch import Columns
from tests.observer.trainer import (
    EXOSKELETON,
    GEOMETRY,
    HIP,
    MID_POSE,
    SLIDE_FRICTION,
    TUNING,
    balanced,
    gait,
    with_patient,
)

SHIPPED = TUNING._replace(velocity_gated=True, patient_noise_max_ratio=20.0)
STEEP = HIP._replace(transition=0.004, peak=0.02, edge=0.012, time_constant_s=0.005)
LEGS = {
    "empty": balanced(EXOSKELETON),
    "50 kg": balanced(with_patient(EXOSKELETON, GEOMETRY, 50.0, 1.6)),
    "80 kg": balanced(with_patient(EXOSKELETON, GEOMETRY, 80.0, 1.78)),
    "110 kg": balanced(with_patient(EXOSKELETON, GEOMETRY, 110.0, 1.9)),
}
ROWS = [20_000, pytest.param(250_000, marks=pytest.mark.thorough)]
"""Rows of each of the four legs: a million in all."""


def rough(leg, rows, seed):
    """A walk with rests and end stops, into which everything falls that can go wrong."""
    random = np.random.default_rng(seed)
    time_s = np.arange(rows) * 0.01
    stride = gait(leg, np.minimum(time_s[:4000] % 40.0, 20.0), 0.25)
    position = np.tile(stride, (rows // len(stride) + 1, 1))[:rows].copy()
    position[(time_s % 60.0) > 55.0] = (np.radians(-20.0), 0.02)  # at its end stops
    position += random.normal(size=(rows, 2)) * (5e-5, 2.5e-5)
    effort = random.normal(size=(rows, 2)) * (3.0, 30.0) + gravity(leg, MID_POSE)

    def some(share, shape=rows):
        return random.random(shape) < share

    hit = some(3e-3)  # glitches of 1e-3 to 1 rad and m
    size = 10.0 ** random.uniform(-3.0, 0.0, (rows, 2)) * random.choice((-1.0, 1.0), (rows, 2))
    position[hit] += size[hit]
    position[some(1e-2, (rows, 2))] = np.nan  # one axis is missing
    for begin in random.integers(0, rows, rows // 2000):  # gaps of up to a second
        position[begin : begin + random.integers(2, 100)] = np.nan
    for begin in random.integers(0, rows, rows // 5000):  # offsets that stay for a while
        position[begin : begin + random.integers(20, 300)] += random.normal(size=2) * 0.05
    effort[some(1e-3)] *= 1e4
    effort[some(1e-3, (rows, 2))] = np.nan
    effort[some(1e-4, (rows, 2))] = np.inf
    position[some(1e-4)] = (1.5, -3.0)  # nowhere
    step_s = np.full(rows, 0.01) + random.normal(size=rows) * 2e-4
    step_s[some(1e-3)] = 0.0
    step_s[some(1e-3)] = -0.02
    step_s[some(1e-3)] = 0.04
    step_s[some(1e-4)] = 3600.0
    return Columns(np.cumsum(step_s), position, effort)


def unscaled_least_eigenvalues(estimates, rows):
    """Smallest eigenvalue of the correlation matrices at some rows."""
    covariance = np.zeros((len(rows), 8, 8))
    low = np.tril_indices(8)
    covariance[:, low[0], low[1]] = covariance[:, low[1], low[0]] = estimates.covariance[rows]
    std = np.sqrt(np.einsum("kii->ki", covariance))
    return np.linalg.eigvalsh(covariance / (std[:, :, None] * std[:, None, :]))[:, 0]


def assert_sound(estimates):
    """What must hold of any estimates whatever."""
    begun = int(np.argmax(np.isfinite(estimates.state[:, 0])))
    numbers = (estimates.state, estimates.std, estimates.covariance, estimates.net)
    for values in (*numbers, estimates.net_std):
        assert np.isfinite(values[begun:]).all()
    assert (estimates.std[begun:] > 0.0).all()
    valid = (estimates.status & Status.VALID) > 0
    assert not np.any(valid & (estimates.validity == Validity.BAD).any(axis=1))
    assert not valid[:begun].any()
    least = unscaled_least_eigenvalues(estimates, np.arange(begun, len(valid), 97))
    assert least.min() > 0.0
    assert np.median(least) > 1e-6


@pytest.mark.parametrize("rows", ROWS)
@pytest.mark.parametrize("name", LEGS)
def test_rough_steps_leave_every_number_a_number(name, rows):
    leg = LEGS[name]
    estimates = batch.run(setup_of(leg, HIP, SLIDE_FRICTION, SHIPPED), rough(leg, rows, len(name)))

    assert_sound(estimates)
    valid = (estimates.status & Status.VALID) > 0
    assert 0.05 < np.mean(valid) < 0.95
    seen = np.bitwise_or.reduce(estimates.status)
    for bit in (Status.GATED, Status.LATE, Status.PREDICT_ONLY, Status.OUT_OF_WORKSPACE):
        assert seen & bit, bit


def test_steep_friction_survives_the_same():
    leg = LEGS["80 kg"]
    steep = SHIPPED._replace(substeps=5)
    estimates = batch.run(setup_of(leg, STEEP, SLIDE_FRICTION, steep), rough(leg, 20_000, 3))

    assert_sound(estimates)


def test_a_calm_stretch_after_the_rough_one_is_valid_and_right_again():
    leg = LEGS["80 kg"]
    columns = rough(leg, 10_000, 5)
    rows = 500
    calm = np.tile(MID_POSE, (rows, 1))
    random = np.random.default_rng(6).normal(size=(rows, 2)) * (5e-5, 2.5e-5)
    estimates = batch.run(
        setup_of(leg, HIP, SLIDE_FRICTION, SHIPPED),
        Columns(
            np.concatenate((columns.time_s, columns.time_s[-1] + np.arange(1, rows + 1) * 0.01)),
            np.vstack((columns.position, calm + random)),
            np.vstack((columns.effort, np.tile(gravity(leg, MID_POSE), (rows, 1)))),
        ),
    )

    last = slice(-200, None)
    assert ((estimates.status[last] & Status.VALID) > 0).all()
    assert np.all(np.abs(estimates.net[last]).max(axis=0) <= (1.0, 10.0))
    assert np.allclose(estimates.state[last, :2], MID_POSE, atol=3e-4)


anything = st.floats(allow_nan=True, allow_infinity=True, width=64)
plausible = st.floats(-0.5, 1.2)


@settings(derandomize=True, max_examples=150, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.one_of(plausible, anything),
            st.one_of(plausible, anything),
            anything,
            anything,
            st.one_of(st.just(0.01), anything),
        ),
        max_size=60,
    )
)
@example([(0.0, 0.0, 0.0, 0.0, 9e307), (0.0, 0.0, 0.0, 0.0, 9e307), (0.0, 0.0, 0.0, 0.0, 0.01)])
def test_no_recording_whatever_makes_an_estimate_unsound(samples):
    rows = np.array([(*MID_POSE, 0.0, 0.0, 0.01), *samples], dtype=np.float64)
    with np.errstate(all="ignore"):
        time_s = np.cumsum(np.nan_to_num(rows[:, 4], nan=0.0, posinf=1e6, neginf=-1e6))
    leg = LEGS["80 kg"]
    estimates = batch.run(
        setup_of(leg, HIP, SLIDE_FRICTION, SHIPPED), Columns(time_s, rows[:, :2], rows[:, 2:4])
    )

    for values in (estimates.state, estimates.std, estimates.covariance, estimates.net_std):
        assert np.isfinite(values).all()
