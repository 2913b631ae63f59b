"""The passive baseline: errors of the machine's file that a minute with a passive patient finds."""

import numpy as np
import pytest
from gaitd_toml import load_toml
from msgspec.structs import replace
from sessions import CONFIGS

from daemon.config.robot import (
    considered,
    friction_parameters,
    frictional,
    leg_parameters,
    observer_tuning,
)
from daemon.config.settings import Robot
from observer.baseline import (
    FADE_S,
    KEPT_MIN,
    LONG_AGO,
    OTHER_DAY_STD,
    THETA_MAX,
    Baseline,
    NotPassiveError,
    Since,
    Unfit,
    baseline_of,
    is_other_gait,
    known,
)
from observer.filter.leg_observer import setup_of, with_baseline
from observer.filter.status import Status, Validity
from observer.mechanism.mechanism import gravity
from observer.offline.batch import Columns, run
from observer.offline.smooth_batch import run_smoothed
from tests.observer.trainer import encoded, gait, rms, simulate

ROBOT = load_toml(CONFIGS / "robot.toml", Robot)
LEG = leg_parameters(ROBOT)
FRICTION = friction_parameters(ROBOT)
FRICTIONAL = frictional(ROBOT)
TUNING = observer_tuning(ROBOT)
SETUP = setup_of(LEG, *FRICTION, TUNING, considered(ROBOT))
MINUTE_HZ, WORK_HZ = 0.35, 0.25


def heavier(ratio):
    """The leg of a patient who weighs more, in the same springs."""
    patient = replace(ROBOT.patient, mass_kg=ratio * ROBOT.patient.mass_kg)
    return leg_parameters(replace(ROBOT, patient=patient))


MACHINES = {
    "as its file": (LEG, FRICTION, (0.0, 0.0)),
    "a leg 15 % lighter": (heavier(0.85), FRICTION, (0.0, 0.0)),
    "a hip spring 10 % stiffer": (
        LEG._replace(hip_stiffness=1.1 * LEG.hip_stiffness),
        FRICTION,
        (0.0, 0.0),
    ),
    "an offset of 1 N m": (LEG, FRICTION, (1.0, 0.0)),
}


def played(machine, seconds, cadence_hz, patient=None, seed=1):
    """A gait on a machine, what a master records of it, and the true effort of its patient."""
    leg, friction, offset = machine
    times = (np.arange(int(100 * seconds)) + 1) * 0.01
    path = gait(LEG, times, cadence_hz)
    truth = simulate(
        leg,
        len(times),
        reference=path,
        start=path[0],
        patient=patient,
        drive=np.array([gravity(LEG, pose) for pose in path]),
        hip=friction[0],
        slide=friction[1],
    )
    columns = encoded(truth, seed)
    return Columns(columns.time_s, columns.position, columns.effort + offset), truth.state[:, 6:8]


def minute(machine, patient=None):
    columns, _ = played(machine, 36, MINUTE_HZ, patient)
    return baseline_of(run_smoothed(SETUP, columns), columns, FRICTIONAL)


def working(time_s):
    turns = 2.0 * np.pi * WORK_HZ * time_s
    return np.column_stack((8.0 * np.sin(turns), 42.0 * np.cos(turns)))


def errors(setup, columns, true):
    """Error of the patient and its sigma where the estimate is valid, past the first seconds."""
    found = run(setup, columns)
    rows = (columns.time_s > 4.0) & (found.validity == Validity.OK).all(axis=1)
    return (found.state[:, 6:8] - true)[rows], found.std[rows, 6:8]


@pytest.mark.parametrize("name", [name for name in MACHINES if name != "as its file"])
def test_errors_of_the_file_are_found_and_taken_off_at_another_cadence(name):
    machine = MACHINES[name]
    columns, true = played(machine, 20, WORK_HZ, working, seed=2)
    shown = Columns(columns.time_s, columns.position, columns.effort - machine[2])
    best, _ = errors(setup_of(machine[0], *machine[1], TUNING), shown, true)
    bare, bare_std = errors(SETUP, columns, true)

    setup = with_baseline(SETUP, known(minute(machine), Since()))
    left, std = errors(setup, columns, true)

    assert (rms(left) <= 1.3 * rms(best)).all()
    assert (rms(left) <= np.maximum(rms(bare), 1.3 * rms(best))).all()
    assert (np.abs(left) > 3.0 * std).mean() <= 0.01
    assert (rms(std) < 0.35 * rms(bare_std)).all()


def test_what_is_published_of_smoother_and_filter_says_that_it_is_relative():
    columns, _ = played(MACHINES["an offset of 1 N m"], 20, WORK_HZ)
    setup = with_baseline(SETUP, known(minute(MACHINES["an offset of 1 N m"]), Since()))

    for estimates_of in (run, run_smoothed):
        bare, clean = estimates_of(SETUP, columns), estimates_of(setup, columns)
        rows = columns.time_s > 4.0
        assert np.median(bare.state[rows, 6]) < -0.8
        assert abs(np.median(clean.state[rows, 6])) < 0.1
        by_parts = clean.state[rows, 6:8] - clean.state[rows, 4:6]
        np.testing.assert_allclose(clean.net[rows], by_parts, atol=1e-9)
        # What moves the machine and what it is judged by is the filter's own.
        for one in ("innovation", "nis", "validity"):
            np.testing.assert_array_equal(getattr(clean, one), getattr(bare, one))
        np.testing.assert_array_equal(clean.status, bare.status | Status.BASELINE)


def test_a_patient_who_pushes_alike_in_each_stride_is_taken_off_and_sigma_keeps_more():
    def pushing(time_s):
        turns = 2.0 * np.pi * MINUTE_HZ * time_s
        return np.column_stack((3.0 * np.sin(3.0 * turns), 0.0 * turns))

    assert minute(MACHINES["as its file"]).kept_std == KEPT_MIN
    assert minute(MACHINES["as its file"], pushing).kept_std[0] > 3.0 * KEPT_MIN[0]


def test_a_patient_who_works_now_and_then_gives_no_baseline():
    def erratic(time_s):
        works = np.floor(time_s / 5.0) % 2.0
        return np.column_stack((3.0 * works, 0.0 * works))

    with pytest.raises(NotPassiveError) as refused:
        minute(MACHINES["as its file"], erratic)

    found = refused.value
    assert (found.why, found.axis, found.limit) == (Unfit.NOT_PASSIVE, 0, 0.5)
    assert found.value > 1.0


@pytest.mark.parametrize(
    ("push", "axis"),
    [
        (lambda turns: (16.0 + 0.0 * turns, 0.0 * turns), 0),
        (lambda turns: (0.0 * turns, 40.0 + 0.0 * turns), 1),
    ],
    ids=["at the hip", "at the slide"],
)
def test_a_push_that_only_an_error_far_from_the_file_explains_gives_no_baseline(push, axis):
    def pushing(time_s):
        return np.column_stack(push(2.0 * np.pi * MINUTE_HZ * time_s))

    with pytest.raises(NotPassiveError) as refused:
        minute(MACHINES["as its file"], pushing)

    found = refused.value
    assert (found.why, found.axis, found.limit) == (Unfit.IMPLAUSIBLE, axis, THETA_MAX)
    assert found.value > THETA_MAX


def test_an_estimate_that_is_no_number_gives_no_baseline():
    columns, _ = played(MACHINES["as its file"], 36, MINUTE_HZ)
    smooth = run_smoothed(SETUP, columns)
    smooth.state[2000, 6] = np.nan

    with pytest.raises(NotPassiveError) as refused:
        baseline_of(smooth, columns, FRICTIONAL)

    assert refused.value.why is Unfit.IMPLAUSIBLE


def test_too_few_strides_and_an_axis_that_is_hardly_known_give_no_baseline():
    columns, _ = played(MACHINES["as its file"], 36, MINUTE_HZ)
    smooth = run_smoothed(SETUP, columns)
    short = Columns(columns.time_s[:1500], columns.position[:1500], columns.effort[:1500])

    with pytest.raises(NotPassiveError) as refused:
        baseline_of(run_smoothed(SETUP, short), short, FRICTIONAL)
    assert (refused.value.why, refused.value.limit) == (Unfit.FEW_STRIDES, 8)

    smooth.validity[:, 1] = Validity.SPLIT_UNOBSERVABLE
    with pytest.raises(NotPassiveError) as refused:
        baseline_of(smooth, columns, FRICTIONAL)
    assert (refused.value.why, refused.value.axis, refused.value.value) == (
        *(Unfit.FEW_SAMPLES, 1, 0),
    )


BASELINE = Baseline(
    np.array([1.0, -2.0]), 0.25 * np.eye(2), (0.2, 1.5), (False, True), 12, 0.3, 0.7
)


@pytest.mark.parametrize(
    ("age_s", "left"), [(-5.0, 0.0), (0.0, 0.0), (0.5 * FADE_S, 0.25), (FADE_S, 1.0), (1e9, 1.0)]
)
def test_what_is_known_of_friction_fades_to_the_file_s_and_the_rest_stays(age_s, left):
    now = known(BASELINE, Since(age_s))

    covariance = now.root @ now.root.T
    np.testing.assert_allclose(covariance[:2, :2], np.diag([0.25, 0.25 + left]))
    assert now.taken
    np.testing.assert_array_equal(now.theta[:3], [1.0, -2.0, 0.0])
    np.testing.assert_array_equal(now.kept_std, [0.2, 1.5])
    other = known(BASELINE, Since(age_s, other_gait=True))
    np.testing.assert_array_equal(other.kept_std, [0.4, 3.0])
    np.testing.assert_array_equal(other.root, now.root)


def test_on_another_day_no_parameter_is_as_sure_as_it_was():
    soon, faded = known(BASELINE, Since(other_day=True)), known(BASELINE, LONG_AGO)

    for now, friction in ((soon, OTHER_DAY_STD**2), (faded, 1.0)):
        covariance = (now.root @ now.root.T)[:2, :2]
        np.testing.assert_allclose(covariance, np.diag([0.25 + OTHER_DAY_STD**2, 0.25 + friction]))
        np.testing.assert_array_equal(now.kept_std, [0.4, 3.0])


@pytest.mark.parametrize(
    ("cadence_hz", "swing_rad", "other"),
    [
        (0.3, 0.7, False),
        (0.32, 0.75, False),
        (0.34, 0.7, True),
        (0.27, 0.7, True),
        (0.3, 0.8, True),
        (0.3, 0.6, True),
    ],
)
def test_another_cadence_or_swing_is_another_gait(cadence_hz, swing_rad, other):
    assert is_other_gait(BASELINE, cadence_hz, swing_rad) is other
