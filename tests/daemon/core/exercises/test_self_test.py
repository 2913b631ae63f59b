"""The self-test of one leg in its numbers: way, phases, sums and what they say of the machine."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from config_files import CONFIGS
from gaitd_names import Failure, Finding, MotionPhase, ProgressCode, RefusalCode, Stage
from gaitd_toml import load_toml
from safety_inputs import LIMITS

from daemon.config.robot import friction_parameters, leg_parameters
from daemon.config.settings import Robot, Trainer
from daemon.core.exercises.exercise import LegSample, LegStart
from daemon.core.exercises.self_test import AxisResult, SelfTest, Sums, Way, total_s
from daemon.core.motion.gait_shape import gait_shape
from daemon.ipc.record import ModeRequest
from daemon.ipc.report import Progress, Refusal
from observer.mechanism.friction import OverPosition, at_position, static_friction_of
from observer.mechanism.mechanism import singularity_ratio

ROBOT = load_toml(CONFIGS / "robot.toml", Robot)
TRAINER = load_toml(CONFIGS / "demo.toml", Trainer)
FRICTION = friction_parameters(ROBOT)
OVER = OverPosition(0.5, 0.1), OverPosition(-0.8, 0.6)
CONFIG = SimpleNamespace(
    self_test=TRAINER.self_test, thresholds=SimpleNamespace(singularity_stop_ratio=0.15)
)
HIP = LIMITS  # -0.3 .. 0.7 rad, with margins of 0.05
SLIDE = LIMITS._replace(position_min_si=0.1, position_max_si=0.8)
HIP_WAY, SLIDE_WAY = math.radians(4.0), 0.04
NAMES = "right/hip", "right/slide"
START = LegStart(
    name="right",
    axis_names=NAMES,
    parameters=leg_parameters(ROBOT),
    shape=gait_shape(TRAINER.gait),
    limits=(HIP, SLIDE),
    friction=FRICTION,
    over=OVER,
    effort_offset=(1.0, -8.0),
    phase_offset_strides=0.0,
    pose=(0.2, 0.5),
)
DT_S = 0.01
RUNS = replace(
    SelfTest(
        start=(0.2, 0.5),
        ways=(
            Way(NAMES[0], 0.08, 0.2, friction_si=6.0, load_tolerance_si=8.0, effort_offset_si=1.0),
            Way(NAMES[1], -0.04, 0.1, 60.0, load_tolerance_si=80.0, effort_offset_si=-8.0),
        ),
        ratios=(0.5, 1.6),
        wait_s=0.0,
    ),
    stage=Stage.PLAYING,
)
"""Each axis takes 0.6 s for a way, so 1.8 s with its rests; both 3.6 s."""


@pytest.mark.parametrize(
    ("limits", "pose", "directions"),
    [
        ((HIP, SLIDE), (0.2, 0.5), (1.0, 1.0)),
        ((HIP, SLIDE), (0.65 - HIP_WAY - 1e-9, 0.5), (1.0, 1.0)),
        ((HIP, SLIDE), (0.65 - HIP_WAY + 1e-3, 0.5), (-1.0, 1.0)),
        ((HIP, SLIDE), (-0.25, 0.5), (1.0, 1.0)),
        ((HIP, SLIDE), (-0.25 - 1e-3, 0.5), (0.0, 0.0)),
        ((HIP, SLIDE), (0.2, 0.75 - SLIDE_WAY), (1.0, 1.0)),
        ((HIP, SLIDE), (0.2, 0.75 - SLIDE_WAY + 1e-3), (1.0, -1.0)),
        ((HIP, SLIDE._replace(position_max_si=0.58, position_min_si=0.42)), (0.2, 0.5), (1.0, 0.0)),
        ((HIP, SLIDE._replace(position_max_si=1.5)), (0.2, 0.88), (1.0, -1.0)),  # stretched
        ((HIP, SLIDE._replace(position_max_si=1.5)), (0.2, 1.1), (0.0, 0.0)),
    ],
)
def test_each_axis_takes_the_first_direction_with_room_for_its_whole_way(limits, pose, directions):
    leg = START._replace(limits=limits, pose=pose)
    (test,) = SelfTest.begin([leg], ModeRequest(), CONFIG)

    def friction(axis, speed, way):
        middle = pose[axis] + directions[axis] * way / 2
        return static_friction_of(at_position(FRICTION[axis], OVER[axis], middle), speed)

    expected = [
        Way(
            *(NAMES[0], directions[0] * HIP_WAY, 0.1),
            *(friction(0, 0.1, HIP_WAY), 8.0, 1.0),
        ),
        Way(
            *(NAMES[1], directions[1] * SLIDE_WAY, 0.05),
            *(friction(1, 0.05, SLIDE_WAY), 80.0, -8.0),
        ),
    ]
    assert test.ways == tuple(expected)
    blocked = [name for name, sign in zip(NAMES, directions, strict=True) if not sign]
    refusal = Refusal(RefusalCode.NO_ROOM, blocked[0]) if blocked else None
    assert SelfTest.may_begin([START, leg], CONFIG) == refusal


def test_a_way_up_to_the_least_distance_from_the_singularity_has_no_room():
    start = START._replace(limits=(HIP, SLIDE._replace(position_max_si=1.5)), pose=(0.2, 0.8))
    end = np.array((0.2, 0.8 + SLIDE_WAY))
    least = float(singularity_ratio(START.parameters, end))

    for stop_ratio, direction in ((least, -1.0), (math.nextafter(least, 0.0), 1.0)):
        thresholds = SimpleNamespace(singularity_stop_ratio=stop_ratio)
        config = SimpleNamespace(self_test=TRAINER.self_test, thresholds=thresholds)
        (test,) = SelfTest.begin([start], ModeRequest(), config)
        assert test.ways[1].distance_si == direction * SLIDE_WAY


def test_legs_are_tested_one_after_the_other():
    first, second = SelfTest.begin([START, START], ModeRequest(), CONFIG)

    way_s = HIP_WAY / 0.1 + 0.2 + SLIDE_WAY / 0.05 + 0.2
    assert (first.wait_s, second.wait_s) == (0.0, pytest.approx(2 * way_s + 4 * 0.3))
    assert (first.start, first.ratios, first.stage) == ((0.2, 0.5), (0.5, 1.6), Stage.PREPARING)
    assert first.sums == (Sums(0.0, 0, 0.0, 0, 0.0, 0.0, 0.0),) * 2
    assert SelfTest.legs_in_turn


P = MotionPhase
EPS_S = 1e-9


@pytest.mark.parametrize(
    ("elapsed_s", "hip", "slide"),
    [
        (0.0, (P.REST, False), (P.REST, False)),
        (0.3 - EPS_S, (P.REST, False), (P.REST, False)),
        (0.3 + EPS_S, (P.FORTH, False), (P.REST, False)),
        (0.6 - EPS_S, (P.FORTH, False), (P.REST, False)),
        (0.6 + EPS_S, (P.FORTH, True), (P.REST, False)),
        (0.7 - EPS_S, (P.FORTH, True), (P.REST, False)),
        (0.7 + EPS_S, (P.FORTH, False), (P.REST, False)),
        (0.9 + EPS_S, (P.TURN, False), (P.REST, False)),
        (1.2 - EPS_S, (P.TURN, False), (P.REST, False)),
        (1.2 + EPS_S, (P.BACK, False), (P.REST, False)),
        (1.5 + EPS_S, (P.BACK, True), (P.REST, False)),
        (1.6 + EPS_S, (P.BACK, False), (P.REST, False)),
        (1.8 - EPS_S, (P.BACK, False), (P.REST, False)),
        (1.8 + EPS_S, (P.DONE, False), (P.REST, False)),
        (2.1 + EPS_S, (P.DONE, False), (P.FORTH, False)),
        (2.4 + EPS_S, (P.DONE, False), (P.FORTH, True)),
        (3.35, (P.DONE, False), (P.BACK, True)),
        (3.6 + EPS_S, (P.DONE, False), (P.DONE, False)),
    ],
)
def test_phases_follow_each_other_and_effort_counts_in_the_second_half_of_each_way(
    elapsed_s, hip, slide
):
    test = replace(RUNS, elapsed_s=elapsed_s)

    assert (test.phase(0), test.phase(1)) == (hip, slide)


SHORTER = replace(
    RUNS, ways=(RUNS.ways[0]._replace(distance_si=0.3, speed_si_per_s=1.0), RUNS.ways[1])
)
"""The hip takes 0.5 s for a way, without rounding."""


@pytest.mark.parametrize(
    ("elapsed_s", "phase"),
    [
        (0.3, (P.FORTH, False)),
        (0.55, (P.FORTH, True)),
        (0.8 - 0.2, (P.FORTH, False)),
        (0.8, (P.TURN, False)),
        (1.1, (P.BACK, False)),
        (1.35, (P.BACK, True)),
        (1.6 - 0.2, (P.BACK, False)),
        (1.6, (P.DONE, False)),
    ],
)
def test_a_phase_begins_at_its_time(elapsed_s, phase):
    assert replace(SHORTER, elapsed_s=elapsed_s).phase(0) == phase


def test_the_slide_begins_when_the_hip_has_ended():
    begun = replace(SHORTER, elapsed_s=1.6 + 0.3 + EPS_S)

    assert begun.phase(1) == (P.FORTH, False)
    assert begun.targets(SAMPLE).velocity[1] == pytest.approx(-0.1 * EPS_S / 0.2, rel=1e-3)


@pytest.mark.parametrize(
    ("elapsed_s", "position", "velocity"),
    [
        (0.3, (0.2, 0.5), (0.0, 0.0)),
        (0.4, (0.205, 0.5), (0.1, 0.0)),
        (0.5, (0.22, 0.5), (0.2, 0.0)),
        (0.6, (0.24, 0.5), (0.2, 0.0)),
        (0.8, (0.275, 0.5), (0.1, 0.0)),
        (1.0, (0.28, 0.5), (0.0, 0.0)),
        (1.3, (0.275, 0.5), (-0.1, 0.0)),
        (1.5, (0.24, 0.5), (-0.2, 0.0)),
        (1.9, (0.2, 0.5), (0.0, 0.0)),
        (2.4, (0.2, 0.48), (0.0, -0.1)),
        (3.3, (0.2, 0.48), (0.0, 0.1)),
    ],
)
def test_one_axis_moves_with_ramps_and_the_friction_of_its_speed(elapsed_s, position, velocity):
    target = replace(RUNS, elapsed_s=elapsed_s).targets(SAMPLE)

    assert target.position == pytest.approx(position)
    assert target.velocity == pytest.approx(velocity)
    assert target.feedforward == pytest.approx((30.0 * velocity[0], 600.0 * velocity[1]))
    assert (target.guided, target.load) == (True, None)
    for stage in (Stage.PREPARING, Stage.OVER):
        still = replace(RUNS, stage=stage, elapsed_s=elapsed_s).targets(SAMPLE)
        assert (still.position, still.velocity) == ((0.2, 0.5), (0.0, 0.0))


SAMPLE = LegSample(
    position=(0.2, 0.5),
    velocity=(0.0, 0.0),
    excess=(0.0, 0.0),
    fresh=(True, True),
    in_torque_mode=True,
    mode_changing=False,
)


def played(*, moved_ratio=1.0, back_ratio=1.0, friction_ratio=1.0, error_ratio=0.0, fresh=True):
    """The results of a leg whose axes follow by a share of their reference, and rub by one."""

    def follows(way, start, at, is_back):
        forth, back = (
            (way.distance_si, start + way.distance_si - at) if is_back else (at - start, 0)
        )
        return start + moved_ratio * (forth - back_ratio * back)

    test = RUNS
    for _ in range(round(4.0 / DT_S)):
        if test.stage is Stage.OVER:
            assert test.advance(SAMPLE, DT_S) is test
            return test.results()
        target = test.targets(SAMPLE)
        is_back = [test.phase(index)[0] is P.BACK for index in (0, 1)]
        position = map(follows, test.ways, test.start, target.position, is_back)
        excess = [
            friction_ratio * math.copysign(way.friction_si, speed) * (speed != 0)
            + error_ratio * way.load_tolerance_si
            + way.effort_offset_si
            for way, speed in zip(test.ways, target.velocity, strict=True)
        ]
        sample = SAMPLE._replace(position=tuple(position), excess=excess, fresh=(fresh, fresh))
        test = test.advance(sample, DT_S)
    raise AssertionError(f"never over: {test.elapsed_s}")


F = Finding


@pytest.mark.parametrize(
    ("machine", "fault", "slide_value", "slide_limit"),
    [
        ({}, F.NONE, 0.0, 0.0),
        ({"fresh": False}, F.NO_SAMPLE, 0.0, 0.0),
        ({"moved_ratio": 0.41, "back_ratio": 1.02}, F.NONE, 0.0, 0.0),
        ({"moved_ratio": 0.39}, F.NOT_MOVED_FORTH, -0.0156, -0.04),
        ({"moved_ratio": 1.49}, F.NONE, 0.0, 0.0),
        ({"moved_ratio": 1.51}, F.NOT_MOVED_FORTH, -0.0604, -0.04),
        ({"back_ratio": 0.35}, F.NOT_MOVED_BACK, 0.014, 0.04),
        ({"friction_ratio": -0.1}, F.ACTS_AGAINST_MOTION, -6.0, 60.0),
        ({"error_ratio": 0.99}, F.NONE, 0.0, 0.0),
        ({"error_ratio": 1.01}, F.LOAD_OF_ANOTHER_LEG, 80.8, 80.0),
        ({"error_ratio": -1.01}, F.LOAD_OF_ANOTHER_LEG, -80.8, 80.0),
        ({"friction_ratio": 0.49}, F.FRICTION_LESS, 0.49, 0.5),
        ({"friction_ratio": 0.51}, F.NONE, 0.0, 0.0),
        ({"friction_ratio": 1.59}, F.NONE, 0.0, 0.0),
        ({"friction_ratio": 1.61}, F.FRICTION_MORE, 1.61, 1.6),
    ],
)
def test_what_deviates_from_the_configuration_is_found_with_its_value_and_limit(
    machine, fault, slide_value, slide_limit
):
    hip, slide = played(**machine)

    assert (hip.fault, slide.fault) == (fault, fault)
    assert (slide.value, slide.limit) == (
        pytest.approx(slide_value, rel=1e-3),
        pytest.approx(slide_limit),
    )


@pytest.mark.parametrize(
    ("friction_si", "load_error_si", "moved_ratio", "fault"),
    [
        *((3.0, 8.0, 0.4, F.NONE), (9.0, -8.0, 1.5, F.NONE)),
        *((0.0, 0.0, 1.0, F.ACTS_AGAINST_MOTION), (0.5, 0.0, 1.0, F.FRICTION_LESS)),
    ],
)
def test_a_value_at_its_limit_is_allowed_but_friction_is_more_than_none(
    friction_si, load_error_si, moved_ratio, fault
):
    efforts = friction_si + load_error_si, 1, load_error_si - friction_si, 1
    sums = Sums(*efforts, moved_forth_si=moved_ratio, moved_back_si=-moved_ratio)
    way = RUNS.ways[0]._replace(distance_si=1.0, effort_offset_si=0.0)
    test = replace(RUNS, ways=(way, way), ratios=(0.5, 1.5), sums=(sums, sums))

    assert [one.fault for one in test.results()] == [fault, fault]


def test_the_result_has_friction_load_error_and_motion():
    hip, slide = played(moved_ratio=0.9, friction_ratio=1.2, error_ratio=0.25)

    assert hip == AxisResult(
        NAMES[0], *map(pytest.approx, (7.2, 1.2, 2.0, 0.072)), Finding.NONE, 0.0, 0.0
    )
    assert slide == AxisResult(NAMES[1], *map(pytest.approx, (72.0, 1.2, 20.0, -0.036)))
    one = replace(RUNS, sums=(Sums(1.0, 1), Sums(0.0, 0, 1.0, 1)))
    assert one.results()[0] == AxisResult(NAMES[0], 0.0, 0.0, 0.0, 0.0, F.NO_SAMPLE)
    assert one.results()[1] == AxisResult(NAMES[1], 0.0, 0.0, 0.0, 0.0, F.NO_SAMPLE)
    for failure in (Failure.STOP_REQUESTED, Failure.KEEPS_MOVING):
        assert replace(one, failure=failure).results()[0].fault is F.NOT_BEGUN


@pytest.mark.parametrize(
    ("stage", "elapsed_s", "progress"),
    [
        (Stage.PREPARING, 1.25, Progress(ProgressCode.EXERCISING, "", (1.25,))),
        (Stage.OVER, 1.25, Progress(ProgressCode.EXERCISING, "", (1.25,))),
        (Stage.PLAYING, 0.35, Progress(ProgressCode.TESTING, NAMES[0], (P.FORTH,))),
        (Stage.PLAYING, 1.35, Progress(ProgressCode.TESTING, NAMES[0], (P.BACK,))),
        (Stage.PLAYING, 3.05, Progress(ProgressCode.TESTING, NAMES[1], (P.BACK,))),
    ],
)
def test_its_progress_names_the_axis_and_its_phase(stage, elapsed_s, progress):
    assert replace(RUNS, stage=stage, elapsed_s=elapsed_s).progress() == progress


def test_it_begins_once_the_legs_before_it_are_tested():
    test = replace(RUNS, stage=Stage.PREPARING, wait_s=1.8, elapsed_s=1.785)

    waiting = test.advance(SAMPLE, DT_S)
    begun = waiting.advance(SAMPLE, DT_S)

    assert (waiting.stage, waiting.elapsed_s) == (Stage.PREPARING, pytest.approx(1.795))
    assert (begun.stage, begun.elapsed_s) == (Stage.PLAYING, 0.0)


def test_it_is_over_at_the_end_of_its_last_rest():
    over = RUNS.advance(SAMPLE, total_s(RUNS.ways))

    assert (over.stage, over.elapsed_s) == (Stage.OVER, 0.0)
