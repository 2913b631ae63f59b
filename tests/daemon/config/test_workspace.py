"""Stopping paths and drift: laws for any start, and what is known of this machine."""

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest
from config_files import CONFIGS
from gaitd_toml import load_toml
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.config.edits import replaced
from daemon.config.robot import friction_parameters, leg_parameters
from daemon.config.settings import Robot
from daemon.preflight.load import load
from daemon.preflight.motion import decelerations, limit_box
from daemon.preflight.workspace import (
    COAST_STEP_S,
    REACTION_S,
    Box,
    Extent,
    Motion,
    coasting_path,
    drift,
    extent_of,
    gait_motions,
    ramp_path,
    sweep_coasting,
)
from observer.mechanism.mechanism import WorkspaceError, singularity_ratio

DEMO = load(CONFIGS / "demo.toml")
LEG = leg_parameters(DEMO.robot)
FRICTIONS = friction_parameters(DEMO.robot)
BOX = limit_box(DEMO.limits)
RAMPS = decelerations(DEMO.limits)
GAIT = DEMO.trainer.gait

speeds = st.tuples(st.floats(-4, 4), st.floats(-3.5, 3.5))
inside = st.tuples(st.floats(0.0, 0.5), st.floats(0.2, 0.7))


def test_the_gait_covers_what_the_reference_says():
    """observer.md 2.5: phi -9.7..32.0 deg, s 0.053..0.931 m, |sin| >= 0.640."""
    extent = extent_of(LEG, [motion.position for motion in gait_motions(LEG, GAIT, 0.5, 400)])

    assert np.degrees([extent.low[0], extent.high[0]]) == pytest.approx([-9.7, 32.0], abs=0.05)
    assert (extent.low[1], extent.high[1]) == pytest.approx((0.053, 0.931), abs=5e-4)
    assert extent.least_singularity_ratio == pytest.approx(0.640, abs=5e-4)


def test_the_gait_is_as_fast_as_the_reference_says():
    """observer.md 2.5: peak speeds at 0.5 Hz 2.45 rad/s and 2.38 m/s."""
    motions = gait_motions(LEG, GAIT, 0.5, 400)

    peaks = [max(abs(motion.velocity[axis]) for motion in motions) for axis in (0, 1)]

    assert peaks == pytest.approx([2.45, 2.38], abs=0.005)


def test_a_gait_beyond_the_mechanism_is_an_error_and_no_number():
    stretched = replaced(GAIT, {"knee.mean_deg": 120.0})

    with pytest.raises(WorkspaceError):
        gait_motions(LEG, stretched, 0.5)


@settings(derandomize=True, deadline=None)
@given(inside, speeds)
def test_a_ramp_ends_where_reaction_and_braking_distance_say(position, velocity):
    *_, end = ramp_path(Motion(position, velocity), RAMPS)

    for at, start, speed, deceleration in zip(end, position, velocity, RAMPS, strict=True):
        distance = speed * REACTION_S + math.copysign(speed**2, speed) / (2 * deceleration)
        assert at == pytest.approx(start + distance, abs=1e-9)


@settings(derandomize=True, deadline=None)
@given(inside, speeds)
def test_no_axis_turns_round_on_its_ramp(position, velocity):
    path = ramp_path(Motion(position, velocity), RAMPS)

    for axis, speed in enumerate(velocity):
        assert (np.diff(path[:, axis]) * math.copysign(1.0, speed) >= -1e-12).all()


@settings(derandomize=True, deadline=None, max_examples=30)
@given(inside, st.floats(0.1, 1.0))
def test_a_steeper_ramp_never_reaches_farther(position, ratio):
    gentle = tuple(ratio * deceleration for deceleration in RAMPS)
    motion = Motion(position, (1.5, 1.0))

    *_, near = ramp_path(motion, RAMPS)
    *_, far = ramp_path(motion, (gentle[0], gentle[1]))

    assert all(a <= b + 1e-12 for a, b in zip(near, far, strict=True))


@pytest.mark.parametrize("axis", [0, 1])
def test_an_axis_that_coasts_from_rest_at_the_balanced_pose_stays_there(axis):
    start = 0.24399703, 0.59050555

    *_, end = coasting_path(LEG, FRICTIONS[axis], start, (0.0, 0.0), RAMPS, axis)

    assert end[:2] == pytest.approx(start, abs=1e-3)


@pytest.mark.parametrize("axis", [0, 1])
def test_friction_brings_a_coasting_axis_to_rest_and_the_other_is_where_its_ramp_ends(axis):
    motion = Motion((0.24399703, 0.59050555), (0.8, -0.5))

    *_, before, end = coasting_path(LEG, FRICTIONS[axis], *motion, RAMPS, axis)
    *_, ramp_end = ramp_path(motion, RAMPS)

    assert abs(end[2 + axis]) < 0.01
    assert end[1 - axis] == pytest.approx(ramp_end[1 - axis])
    step = end[axis] - before[axis]
    assert abs(step) < 0.01 * COAST_STEP_S + 1e-9


def test_without_power_the_balanced_leg_creeps_less_than_a_degree():
    result = drift(LEG, FRICTIONS, (0.24399703, 0.59050555), BOX)

    assert abs(math.degrees(result.end[0] - result.start[0])) < 1.0
    assert not result.reached_limit


def test_without_power_the_leg_moves_as_far_as_the_design_warns():
    """Design 3: the patient's leg moved up to 23 deg at 1.3 rad/s, with springs of that kind."""
    drifts = [
        drift(LEG, FRICTIONS, motion.position, BOX) for motion in gait_motions(LEG, GAIT, 0.5)
    ]

    farthest_deg = max(math.degrees(abs(one.end[0] - one.start[0])) for one in drifts)
    fastest = max(one.speed_max[0] for one in drifts)

    assert 8.0 < farthest_deg < 23.0
    assert 0.4 < fastest < 1.3


def test_the_empty_machine_with_a_patients_springs_rises_to_its_stop():
    """Design 3: the empty machine rose to its stop."""
    full = load_toml(CONFIGS / "robot.toml", Robot)
    leg = leg_parameters(msgspec.structs.replace(full, patient=None))

    result = drift(leg, FRICTIONS, (0.24399703, 0.59050555), BOX)

    assert result.reached_limit
    assert result.end[0] == pytest.approx(BOX.high[0], abs=0.02)
    assert result.speed_max[0] > 2.0


def test_the_speed_at_which_a_coasting_axis_meets_its_end_is_told():
    full = load_toml(CONFIGS / "robot.toml", Robot)
    leg = leg_parameters(msgspec.structs.replace(full, patient=None))
    motions = gait_motions(leg, GAIT, 0.25)

    sweep = sweep_coasting(leg, FRICTIONS, motions, RAMPS, BOX, 0)

    assert sweep.end_speed[0] > 2.0
    assert sweep.extent.high[0] <= BOX.high[0]


@settings(derandomize=True, deadline=None)
@given(st.lists(inside, min_size=1, max_size=20))
def test_an_extent_holds_all_its_poses_and_its_worst_ratio(poses):
    extent = extent_of(LEG, poses)

    assert all(Box(extent.low, extent.high).holds(pose) for pose in poses)
    ratios = [singularity_ratio(LEG, np.array(pose)) for pose in poses]
    assert extent.least_singularity_ratio == min(ratios)


def test_an_extent_is_inside_a_box_only_as_a_whole():
    box = Box((0.0, 0.0), (1.0, 1.0))

    assert Extent((0.1, 0.1), (0.9, 0.9), 1.0).inside(box)
    assert not Extent((0.1, -0.1), (0.9, 0.9), 1.0).inside(box)
    assert not Extent((0.1, 0.1), (0.9, 1.1), 1.0).inside(box)


def test_this_file_reads_the_configuration_that_is_shipped():
    assert Path(DEMO.file.path) == CONFIGS / "demo.toml"
