"""Hand guiding in its numbers: damping, springs at the ends, and the way from hold to its end."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from config_files import CONFIGS
from gaitd_names import ProgressCode, Stage
from gaitd_toml import load_toml
from safety_inputs import LIMITS, slide_ends

from daemon.config.robot import leg_parameters
from daemon.config.settings import Robot, Trainer
from daemon.core.exercises import hand_guiding
from daemon.core.exercises.exercise import LegSample, LegStart, Reference
from daemon.core.exercises.hand_guiding import Guiding, HandGuiding, bending, leading_in, slowing
from daemon.core.motion.gait_shape import gait_shape
from daemon.ipc.record import ModeRequest
from daemon.ipc.report import Progress
from observer.mechanism.mechanism import singularity_ratio

LEG = leg_parameters(load_toml(CONFIGS / "robot.toml", Robot))
TRAINER = load_toml(CONFIGS / "demo.toml", Trainer)
SLIDE = LIMITS._replace(position_min_si=0.1, position_max_si=1.0)
GUIDING = Guiding(3.0, 0.3, 30.0, 40.0), Guiding(30.0, 0.2, 350.0, 250.0)
STOP_RATIO = 0.15
SAMPLE = LegSample(
    position=(0.2, 0.5),
    velocity=(0.0, 0.0),
    excess=(0.0, 0.0),
    fresh=(True, True),
    in_torque_mode=True,
    mode_changing=False,
)
START = LegStart(
    name="right",
    axis_names=("right/hip", "right/slide"),
    parameters=LEG,
    shape=gait_shape(TRAINER.gait),
    limits=(LIMITS, SLIDE),
    friction=(),
    over=(),
    effort_offset=(0.0, 0.0),
    phase_offset_strides=0.0,
    pose=(0.2, 0.5),
)


def begun(**changes):
    config = SimpleNamespace(
        hand_guiding=TRAINER.hand_guiding,
        thresholds=SimpleNamespace(singularity_stop_ratio=STOP_RATIO),
    )
    (exercise,) = HandGuiding.begin([START], ModeRequest(), config)
    return replace(exercise, **changes)


def test_it_has_the_settings_of_the_trainer_file():
    made = begun()

    assert (made.guiding, made.limits, made.leg) == (GUIDING, (LIMITS, SLIDE), LEG)
    assert (made.start, made.stretched_stop_ratio, made.duration_s) == ((0.2, 0.5), 0.15, 120.0)
    assert (made.stage, made.continues_effort_at_stages) == (Stage.PREPARING, True)


@pytest.mark.parametrize(
    ("before", "in_torque_mode", "after"),
    [
        ((Stage.PREPARING, 5.0), False, (Stage.PREPARING, 5.01)),
        ((Stage.PREPARING, 5.0), True, (Stage.PLAYING, 0.0)),
        ((Stage.PLAYING, 5.0), True, (Stage.PLAYING, 5.01)),
        ((Stage.PLAYING, 119.985), True, (Stage.PLAYING, 119.995)),
        ((Stage.PLAYING, 119.99), True, (Stage.OVER, 0.0)),
        ((Stage.PREPARING, 119.995), True, (Stage.OVER, 0.0)),
    ],
)
def test_it_begins_in_torque_mode_and_ends_after_its_time(before, in_torque_mode, after):
    now = begun(stage=before[0], elapsed_s=before[1])

    later = now.advance(SAMPLE._replace(in_torque_mode=in_torque_mode), 0.01)

    assert (later.stage, later.elapsed_s) == (after[0], pytest.approx(after[1]))


def test_its_progress_is_the_time_that_is_left_once_the_leg_may_be_moved():
    for stage in (Stage.PREPARING, Stage.OVER):
        waiting = begun(stage=stage, elapsed_s=2.0)
        assert waiting.progress() == Progress(ProgressCode.EXERCISING, "", (2.0,))
    playing = begun(stage=Stage.PLAYING, elapsed_s=20.0)
    assert playing.progress() == Progress(ProgressCode.GUIDED_BY_HAND, "", (100.0,))


@pytest.mark.parametrize(
    ("position_si", "velocity_si", "effort_si"),
    [
        (0.2, 0.0, 0.0),
        (0.2, 0.3, -0.9),
        (0.2, -0.3, 0.9),
        (0.2, 0.5, -1.5 - 6.0),
        (0.2, -0.5, 1.5 + 6.0),
        (0.675, 0.3, -0.9 - 4.5),  # half into the margin: more damping from half the speed on
        (0.675, -0.3, 0.9),
        (-0.275, -0.3, 0.9 + 4.5),
        (-0.275, 0.3, -0.9),
        (0.8, 0.3, -0.9 - 9.0),
    ],
)
def test_a_slow_motion_is_damped_a_little_and_one_that_is_fast_or_near_an_end_more(
    position_si, velocity_si, effort_si
):
    assert slowing(GUIDING[0], position_si, velocity_si, LIMITS) == pytest.approx(effort_si)


@pytest.mark.parametrize(
    ("position_si", "effort_si"),
    [(0.2, 0.0), (0.65, 0.0), (0.675, -20.0), (0.7, -40.0), (-0.25, 0.0), (-0.3, 40.0)],
)
def test_a_spring_leads_back_out_of_the_margins(position_si, effort_si):
    assert leading_in(GUIDING[0], position_si, LIMITS) == pytest.approx(effort_si)


def stretched_to(ratio, hip_rad=0.2):
    """The slide position at which the leg is stretched to this ratio."""
    return slide_ends(LEG, hip_rad, ratio)[1]


@pytest.mark.parametrize(
    ("hip_rad", "ratio", "share"),
    [
        *((0.2, 0.31, 0.0), (0.2, 0.3, 0.0), (0.2, 0.225, 0.5), (0.2, 0.15, 1.0)),
        (0.69, 0.225, 0.5),  # here both slopes are negative, and the spring of the slide bounds
    ],
)
def test_before_the_stretched_pose_both_axes_bend_the_leg_by_no_more_than_their_springs(
    hip_rad, ratio, share
):
    position = hip_rad, stretched_to(ratio, hip_rad)

    efforts = np.array(bending(LEG, GUIDING, STOP_RATIO, position))

    shares = np.abs(efforts) / (40.0, 250.0)
    assert max(shares) == pytest.approx(share, abs=1e-6)
    if share:
        bent = np.array(position) + 1e-6 * efforts / np.linalg.norm(efforts)
        assert singularity_ratio(LEG, bent) > singularity_ratio(LEG, np.array(position))
        slopes = [
            singularity_ratio(LEG, np.array(position) + step)
            - singularity_ratio(LEG, np.array(position) - step)
            for step in (np.array([1e-3, 0.0]), np.array([0.0, 1e-3]))
        ]
        assert efforts[0] / efforts[1] == pytest.approx(slopes[0] / slopes[1])


def test_an_axis_that_does_not_bend_the_leg_has_no_effort_to_bend_it(monkeypatch):
    monkeypatch.setattr(hand_guiding, "singularity_ratio", lambda leg, pose: 0.725 - pose[1])

    assert bending(LEG, GUIDING, STOP_RATIO, (0.2, 0.5)) == (0.0, pytest.approx(-125.0))


def test_the_leg_is_held_at_first_and_then_carried_damped_and_led():
    moving = SAMPLE._replace(position=(0.2, stretched_to(0.225)), velocity=(0.3, 0.1))
    in_margin = LIMITS._replace(position_max_si=0.225), SLIDE

    held = begun().targets(moving)
    guided = begun(stage=Stage.PLAYING, limits=in_margin).targets(moving)

    assert held == Reference((0.2, 0.5), (0.0, 0.0), (0.0, 0.0), guided=True)
    bent = bending(LEG, GUIDING, STOP_RATIO, moving.position)
    assert guided == Reference(
        moving.position,
        (0.0, 0.0),
        (pytest.approx(-0.9 - 4.5 - 20.0 + bent[0]), pytest.approx(-3.0 + bent[1])),
        guided=False,
    )
    assert math.hypot(*bent) > 1.0
