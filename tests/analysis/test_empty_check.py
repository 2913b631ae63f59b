import dataclasses
import math

import numpy as np
import pytest
from empty_runs import empty_run, random_friction, robot_file, shipped_friction
from scipy.optimize import least_squares

from analysis.calibration.empty_check import (
    CANDIDATES,
    _Regression,
    check,
    judge,
    refuse_wrong_branch,
)
from analysis.calibration.motion import prepare
from analysis.calibration.quantities import value_of
from analysis.recording import RecordingError, recording
from daemon.config.edits import replaced


@pytest.fixture(scope="module")
def motion():
    return prepare([empty_run(shipped_friction()).recording])


def test_a_right_machine_gets_no_complaint(motion):
    assert check(robot_file(), motion).well


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_wrong_friction_is_no_wrong_mechanism(seed):
    made = prepare([empty_run(random_friction(seed)).recording])

    assert check(robot_file(), made).well


def explanations(found):
    return {one.words: one.change for one in (found.best, *found.as_good)}


@pytest.mark.parametrize("change_deg", [10.0, -10.0])
def test_a_wrong_recline_is_found(motion, change_deg):
    geometry = robot_file().geometry
    wrong = replaced(robot_file(), {"geometry.recline_deg": geometry.recline_deg + change_deg})

    found = check(wrong, motion)

    assert not found.well
    told = explanations(found)["recline or hip encoder offset"]
    assert told == pytest.approx(-change_deg, abs=1.0)


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("springs.hip.stiffness_nm_per_rad", "hip spring stiffness"),
        ("springs.slide.stiffness_n_per_m", "slide spring stiffness"),
    ],
)
def test_a_spring_twenty_percent_weak_is_found(motion, key, words):
    right = value_of(robot_file(), key)

    found = check(replaced(robot_file(), {key: 0.8 * right}), motion)

    assert not found.well
    assert found.mendable
    assert explanations(found)[words] == pytest.approx(0.2 * right, rel=0.15)


def test_a_wrong_rest_of_a_spring_is_found(motion):
    rest_rad = robot_file().springs.hip.rest_rad

    found = check(replaced(robot_file(), {"springs.hip.rest_rad": rest_rad + 0.15}), motion)

    assert explanations(found)["hip spring rest"] == pytest.approx(-0.15, abs=0.02)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"geometry.recline_deg": 10.0}, "recline or hip encoder offset"),
        ({"geometry.rail_x_m": 0.05}, "slide encoder offset"),
        ({"shoe.mass_kg": 1.0}, "shoe mass"),
        ({"shank.mass_kg": 0.5}, "shank mass"),
        ({"springs.hip.stiffness_nm_per_rad": 6.0, "springs.slide.stiffness_n_per_m": -36.0}, ""),
    ],
)
def test_what_a_fit_of_springs_and_drives_cannot_explain_is_named(motion, changes, words):
    """Fitted: springs and drives that are right, or those that hide the wrong number best."""
    right = robot_file()
    moved = {key: value_of(right, key) + change for key, change in changes.items()}
    wrong = replaced(right, moved)
    fitted = right if not words else with_springs_for(wrong, motion)

    found = judge(wrong, fitted, motion)

    assert found.well is not bool(words)
    assert not words or words in explanations(found)
    assert not words or "by its [uncertainty]" in str(found)


def with_springs_for(robot, motion):
    """The robot with the springs and drives of the least residual."""
    numbers = [one for one in CANDIDATES if one.fitted]
    regression = _Regression(robot, motion)

    def changed(x):
        made = robot
        for one, change in zip(numbers, x, strict=True):
            made = one.changed(made, change * one.scale)
        return made

    found = least_squares(lambda x: regression.differences(changed(x)), np.zeros(len(numbers)))
    return changed(found.x)


def test_the_plausible_explanation_is_preferred(motion):
    """A spring that is 30 % off, which another number far from its own value explains as well."""
    known = check(replaced(robot_file(), {"springs.slide.stiffness_n_per_m": 84.0}), motion).best
    far = dataclasses.replace(known, fall=known.fall + 20.0, change=50.0 * known.allowed)

    assert known.plausible_fall > known.fall - 3.0
    assert far.plausible_fall < known.plausible_fall


def posed(hip_rad: float, slide_m: float):
    run = empty_run(shipped_friction()).recording
    rows = np.column_stack((run.time_s, run.position, run.effort))
    rows[:, 1] += hip_rad - rows[0, 1]
    rows[:, 2] += slide_m - rows[0, 2]
    return prepare([recording("offset.csv", rows)])


def test_a_knee_bent_backwards_is_refused_from_the_first_pose():
    with pytest.raises(RecordingError, match=r"bent backwards by .* wrong branch"):
        refuse_wrong_branch(robot_file(), posed(math.radians(-15.0), 0.60))


def test_a_pose_that_cannot_be_is_refused():
    with pytest.raises(RecordingError, match="do not meet"):
        refuse_wrong_branch(robot_file(), posed(math.radians(-20.0), 0.95))
