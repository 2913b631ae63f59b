"""A transmission that gives way: sigma holds what the encoder does not show."""

import math
from functools import partial

import numpy as np
import pytest

from observer.filter.leg_observer import TuningError, check_tuning, setup_of
from observer.mechanism.mechanism import gravity
from observer.offline.batch import Columns, run
from observer.offline.smooth_batch import run_smoothed
from tests.observer.trainer import HIP, MID_POSE, PATIENT, SLIDE_FRICTION, TUNING

SHIPPED = TUNING._replace(velocity_gated=True, patient_noise_max_ratio=20.0)
ROWS = 400
TIME_S = 0.01 * (np.arange(ROWS) + 1)
NEITHER = (0.0, 0.0)


def seen_with(columns, compliance=NEITHER, backlash=NEITHER, estimates_of=run):
    tuning = SHIPPED._replace(compliance=compliance, backlash=backlash)
    return estimates_of(setup_of(PATIENT, HIP, SLIDE_FRICTION, tuning), columns)


def stuck(axis, windup):
    """A leg that rests in its friction while a drive pulls one way, and then the other.

    Its friction is what the drive exerts beyond gravity, and its patient is passive. The encoder
    shows the windup.
    """
    wave = (5.0, 50.0)[axis] * np.sin(2.0 * math.pi * (TIME_S - 1.0)) * (TIME_S > 1.0)
    load = gravity(PATIENT, MID_POSE)
    position, effort = np.tile(MID_POSE, (ROWS, 1)), np.tile(load, (ROWS, 1))
    effort[:, axis] += wave
    position[:, axis] += [windup(one) for one in effort[:, axis]]
    rng = np.random.default_rng(1)
    noisy = position + rng.normal(size=position.shape) * SHIPPED.measurement_std
    return Columns(TIME_S, noisy, effort), wave


def spring(compliance, effort):
    return compliance * effort


def gap(backlash, effort):
    """The gap is open below 2 N m, where the joint's friction does not press it close."""
    return 0.5 * backlash * min(max(0.5 * effort, -1.0), 1.0)


def wrong_of(seen, axis, friction):
    """Shares of the rows in which friction and patient are further off than three sigma."""
    errors = np.abs(seen.state[:, [4 + axis, 6 + axis]] - np.array([friction, 0.0 * friction]).T)
    return np.mean((errors > 3.0 * seen.std[:, [4 + axis, 6 + axis]])[TIME_S > 1.5], axis=0)


GIVES_WAY = {
    "an elastic hip": (0, {"compliance": (1 / 800.0, 0.0)}, partial(spring, 1 / 800.0)),
    "an elastic slide": (1, {"compliance": (0.0, 1 / 8e3)}, partial(spring, 1 / 8e3)),
    "a loose hip": (0, {"backlash": (0.005, 0.0)}, partial(gap, 0.005)),
}


@pytest.mark.parametrize("estimates_of", [run, run_smoothed])
@pytest.mark.parametrize("name", GIVES_WAY)
def test_a_joint_that_sticks_while_its_drive_gives_way_is_inside_sigma(name, estimates_of):
    axis, keys, windup = GIVES_WAY[name]
    columns, friction = stuck(axis, windup)

    rigid, known = (
        wrong_of(seen_with(columns, estimates_of=estimates_of, **one), axis, friction)
        for one in ({}, keys)
    )

    assert rigid.max() > 0.1
    assert known.max() <= 0.01


def test_a_transmission_widens_sigma_of_friction_patient_and_net_and_nothing_else():
    columns, _ = stuck(0, partial(spring, 1 / 800.0))
    rigid = seen_with(columns)
    soft = seen_with(columns, (1 / 800.0, 1 / 8e3), (0.005, 0.001))

    for name in ("state", "innovation", "nis", "net", "status", "validity"):
        np.testing.assert_array_equal(getattr(soft, name), getattr(rigid, name))
    np.testing.assert_array_equal(soft.std[:, :4], rigid.std[:, :4])
    later = TIME_S > 1.2
    assert (soft.std[later, 4::2] > rigid.std[later, 4::2]).all()
    assert (soft.net_std[later, 0] > rigid.net_std[later, 0]).all()


@pytest.mark.parametrize("name", ["compliance", "backlash"])
def test_what_gives_way_the_wrong_way_is_refused(name):
    tuning = TUNING._replace(**{name: (0.0, -0.1)})
    with pytest.raises(TuningError, match=f"{name} of the slide = -0.1: must be a number in 0.0"):
        check_tuning(PATIENT, HIP, SLIDE_FRICTION, tuning)
