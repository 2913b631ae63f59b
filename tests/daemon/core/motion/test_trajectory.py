"""What exercises ask for over time: inside speed and workspace, and without steps."""

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
from config_files import CONFIGS
from gaitd_names import Failure, Finding, MotionPhase, Stage
from gaitd_toml import load_toml
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from daemon.config.robot import leg_parameters
from daemon.config.settings import Robot, Sinusoid, Trainer
from daemon.core.exercises.approach import Approach, approach, is_clear
from daemon.core.exercises.excite import SETTLE_S, Excite
from daemon.core.exercises.exercise import BEGIN_MAX_S, LegSample, Reference
from daemon.core.exercises.gait import Gait, GaitPlan
from daemon.core.exercises.hold import Hold
from daemon.core.exercises.self_test import AVERAGED_MIN_S, SelfTest, Way, speed_max
from daemon.core.motion import gait_shape
from observer.mechanism.mechanism import singularity_ratio
from tests.observer.mechanics import closes

LEG = leg_parameters(load_toml(CONFIGS / "robot.toml", Robot))
GAIT = load_toml(CONFIGS / "demo.toml", Trainer).gait
SHAPE = gait_shape.gait_shape(GAIT)
MEAN = gait_shape.gait_angles(SHAPE, 0.0, 0.0)
DT_S = 0.01
CYCLES_MAX = 4000
"""More than any play here lasts."""
AT_REST = LegSample(
    position=(0.1, 0.45),
    velocity=(0.0, 0.0),
    excess=(0.0, 0.0),
    fresh=(True, True),
    in_torque_mode=True,
    mode_changing=False,
)
IN_POSITION_MODE = AT_REST._replace(in_torque_mode=False)


def at(position):
    return AT_REST._replace(position=position)


def gait_play(*, cadence_hz=0.5, duration_s=10.0, start=(0.1, 0.45)):
    return Gait(
        plan=GaitPlan(
            leg=LEG,
            shape=SHAPE,
            impedance=GAIT.impedance,
            way=approach(LEG, GAIT, start, MEAN),
            start=start,
            announce_s=GAIT.announce_s,
            cadence_hz=cadence_hz,
            amplitude_ratio=1.0,
            duration_s=duration_s,
            ramp_strides=GAIT.ramp_strides,
            phase_offset_strides=0.0,
            period_s=DT_S,
        )
    )


def story(plan, sample=AT_REST):
    """All (play, reference) from the announcement to the end, and the play that is over."""
    told = []
    for _ in range(CYCLES_MAX):
        if plan.stage is Stage.OVER:
            return told, plan
        told.append((plan, plan.targets(sample)))
        plan = plan.advance(sample, DT_S)
    raise AssertionError(f"never over: {plan.stage}")


@functools.cache
def gait_story(cadence_hz=0.5):
    """The whole story of one gait."""
    told, _ = story(gait_play(cadence_hz=cadence_hz))
    return told


def test_a_gait_is_announced_approached_played_and_ended_in_that_order():
    stages = [plan.stage for plan, _ in gait_story()]

    order = list(dict.fromkeys(stages))

    assert order == [Stage.ANNOUNCING, Stage.APPROACHING, Stage.PLAYING, Stage.ENDING]
    assert stages.count(Stage.ANNOUNCING) == pytest.approx(GAIT.announce_s / DT_S, abs=1)
    assert stages.count(Stage.PLAYING) == pytest.approx(10.0 / DT_S, abs=1)


def test_nothing_moves_while_a_gait_is_announced():
    announced = [ref for plan, ref in gait_story() if plan.stage == Stage.ANNOUNCING]

    assert {ref._replace(velocity=(0.0, 0.0)) for ref in announced} == {
        Reference((0.1, 0.45), (0.0, 0.0), (0.0, 0.0), guided=True)
    }


def test_the_approach_keeps_to_its_speed_limits():
    approach = [ref for plan, ref in gait_story() if plan.stage == Stage.APPROACHING]

    assert max(abs(ref.velocity[0]) for ref in approach) <= GAIT.hip.approach_rad_per_s * 1.001
    # Straight in hip and knee angle, not in slide position: a little faster on its way.
    assert max(abs(ref.velocity[1]) for ref in approach) <= GAIT.slide.approach_m_per_s * 1.2


@pytest.mark.parametrize("cadence_hz", [0.25, 0.5])
def test_the_whole_gait_is_without_steps_and_inside_the_workspace(cadence_hz):
    told = gait_story(cadence_hz)
    positions = np.array([ref.position for _, ref in told])

    steps = np.abs(np.diff(positions, axis=0)) / DT_S

    assert steps[:, 0].max() < 2.6
    assert steps[:, 1].max() < 2.6
    assert min(singularity_ratio(LEG, q) for q in positions) > 0.6


def test_the_velocity_is_the_derivative_of_the_position():
    told = [ref for _, ref in gait_story(0.25)]
    positions = np.array([ref.position for ref in told])
    velocities = np.array([ref.velocity for ref in told])

    assert np.allclose(np.diff(positions, axis=0) / DT_S, velocities[:-1], atol=1e-9)


def test_amplitude_and_cadence_rise_over_two_strides():
    playing = [plan for plan, _ in gait_story() if plan.stage == Stage.PLAYING]
    hips = np.array([ref.position[0] for p, ref in gait_story() if p.stage == Stage.PLAYING])
    strides = np.array([plan.strides for plan in playing])
    mean, full = SHAPE.hip_mean_rad, math.radians(15.0)

    assert np.abs(hips[strides < 0.5] - mean).max() < full / 2
    assert np.abs(hips[strides > 2] - mean).max() > full


def test_the_end_of_a_gait_is_its_mean_pose():
    _, last = gait_story()[-1]

    assert last.position == pytest.approx(gait_shape.joints_of_angles(LEG, MEAN), abs=2e-3)


@given(phase=st.floats(-3.0, 3.0), amplitude_ratio=st.floats(0.0, 1.0))
def test_gait_angles_are_the_fourier_series_of_the_file(phase, amplitude_ratio):
    def series(mean_deg, harmonics_deg):
        turns = [2 * math.pi * k * phase for k in range(1, len(harmonics_deg) + 1)]
        waves = (
            a * math.cos(turn) + b * math.sin(turn)
            for turn, (a, b) in zip(turns, harmonics_deg, strict=True)
        )
        return math.radians(mean_deg + amplitude_ratio * sum(waves))

    hip, knee = gait_shape.gait_angles(SHAPE, phase, amplitude_ratio)

    assert hip == pytest.approx(series(GAIT.hip.mean_deg, GAIT.hip.harmonics_deg), abs=1e-12)
    assert knee == pytest.approx(series(GAIT.knee.mean_deg, GAIT.knee.harmonics_deg), abs=1e-12)


def test_the_second_leg_walks_half_a_stride_later():
    first = gait_play()
    for _ in range(1500):
        first = first.advance(AT_REST, DT_S)

    second = replace(first, plan=replace(first.plan, phase_offset_strides=0.5))

    assert (second.gait_phase - first.gait_phase) % 1 == pytest.approx(0.5)


def test_without_a_stride_there_is_no_phase():
    assert gait_play().gait_phase == -1.0


HIPS = st.floats(min_value=math.radians(-15), max_value=math.radians(38))
SLIDES = st.floats(min_value=0.05, max_value=0.9)


@settings(derandomize=True, max_examples=100)
@given(HIPS, SLIDES)
def test_a_way_that_is_called_clear_is_reachable_everywhere(hip, slide):
    assume(closes(LEG, hip, slide))
    motion = approach(LEG, GAIT, (hip, slide), MEAN)
    assume(is_clear(LEG, motion, 0.15))
    plan = replace(gait_play(start=(hip, slide)), stage=Stage.APPROACHING)

    for part in np.linspace(0.01, 1, 17):
        moved = replace(plan, elapsed_s=part * motion.duration_s)
        q = moved.targets(AT_REST).position
        assert singularity_ratio(LEG, np.array(q)) > 0.1


def test_from_every_pose_of_the_gait_the_way_to_mid_pose_is_clear():
    for phase in np.linspace(0, 1, 50):
        start = gait_shape.joints_of_angles(LEG, gait_shape.gait_angles(SHAPE, phase, 1.0))
        assert is_clear(LEG, approach(LEG, GAIT, start, MEAN), 0.3)


def test_a_way_through_poses_that_cannot_be_reached_is_not_clear():
    start = gait_shape.joints_of_angles(LEG, MEAN)
    far = Approach(gait_shape.angles_of_joints(LEG, start), (-0.25, 1.0), 1.0)

    assert not is_clear(LEG, far, 0.15)


@settings(derandomize=True)
@given(st.floats(-3, 3), st.floats(-3, 3))
def test_a_hold_brakes_with_its_deceleration_and_then_stays(v_hip, v_slide):
    hold = Hold(start=(0.2, 0.5), start_velocity=(v_hip, v_slide), deceleration=(10.0, 20.0))
    refs = []
    for _ in range(60):
        refs.append(hold.targets(AT_REST))
        hold = hold.advance(AT_REST, DT_S)
    velocities = np.array([ref.velocity for ref in refs])

    assert np.all(np.abs(np.diff(velocities, axis=0)) <= np.array([0.1, 0.2]) + 1e-12)
    assert refs[-1].velocity == (0.0, 0.0)
    assert refs[-1].position[0] == pytest.approx(0.2 + 0.5 * v_hip * abs(v_hip) / 10.0)


def excite_play(**change):
    angles = gait_shape.gait_angles(SHAPE, 0.0, 0.0)
    middle = gait_shape.joints_of_angles(LEG, angles)
    plan = Excite(
        leg=LEG,
        way=approach(LEG, GAIT, (0.1, 0.45), angles),
        middle=middle,
        middle_load=gait_shape.load_at(LEG, middle),
        window=(0.5, 0.4),
        torque=(
            Sinusoid(
                axis="hip", kind="step", amplitude_si=11.0, frequency_hz=0, start_s=2, end_s=2.4
            ),
            Sinusoid(
                axis="slide", kind="sine", amplitude_si=95, frequency_hz=0.2, start_s=0, end_s=9
            ),
        ),
        artificial=(
            Sinusoid(
                axis="hip", kind="sine", amplitude_si=4, frequency_hz=0.35, start_s=1, end_s=9
            ),
        ),
        duration_s=5.0,
    )
    return replace(plan, **change)


def test_an_excitation_goes_to_mid_pose_and_settles_before_it_begins():
    plan = excite_play()
    told, _ = story(plan, at(plan.middle))

    approaching = [ref for play, ref in told if play.stage is Stage.APPROACHING]
    assert all(ref.guided for ref in approaching)
    assert approaching[-1].position == pytest.approx(plan.middle)


def test_an_excitation_does_not_begin_before_the_drives_are_in_torque_mode():
    plan = excite_play()
    for _ in range(round((plan.way.duration_s + BEGIN_MAX_S) / DT_S)):
        plan = plan.advance(IN_POSITION_MODE, DT_S)
    waiting = plan.targets(IN_POSITION_MODE)

    begun = plan.advance(AT_REST, DT_S)

    assert plan.stage == Stage.APPROACHING
    assert waiting == Reference(pytest.approx(plan.middle), (0.0, 0.0), (0.0, 0.0), guided=True)
    assert (begun.stage, begun.elapsed_s) == (Stage.PLAYING, 0.0)


def test_an_excitation_without_torque_mode_is_over_and_says_why():
    told, plan = story(excite_play(), IN_POSITION_MODE)

    assert {play.stage for play, _ in told} == {Stage.APPROACHING}
    assert len(told) * DT_S == pytest.approx(
        plan.way.duration_s + SETTLE_S + BEGIN_MAX_S, abs=2 * DT_S
    )
    assert plan.failure is Failure.NO_REST


def test_an_excitation_is_torque_alone_about_the_load_of_mid_pose():
    plan = excite_play(stage=Stage.PLAYING, elapsed_s=2.2)

    ref = plan.targets(at((0.3, 0.6)))

    slide_n = pytest.approx(95 * math.sin(2 * math.pi * 0.2 * 2.2))
    assert ref == Reference((0.3, 0.6), (0.0, 0.0), (11.0, slide_n), False, plan.middle_load)


def test_an_artificial_disturbance_begins_and_ends_with_its_times():
    after = lambda t: excite_play(stage=Stage.PLAYING, elapsed_s=t).artificial_si  # noqa: E731

    assert after(0.99) == (0.0, 0.0)
    assert after(1.5)[0] == pytest.approx(4 * math.sin(2 * math.pi * 0.35 * 0.5))
    assert after(9.0) == after(9.5) == (0.0, 0.0)
    assert excite_play(elapsed_s=1.5).artificial_si == (0.0, 0.0)


@pytest.mark.parametrize(("axis", "distance"), [(0, 0.51), (0, -0.51), (1, 0.41), (1, -0.41)])
def test_an_excitation_is_over_when_an_axis_leaves_its_window(axis, distance):
    plan = excite_play(stage=Stage.PLAYING)
    inside, outside = list(plan.middle), list(plan.middle)
    inside[axis] += 0.97 * distance
    outside[axis] += distance

    assert plan.advance(at(tuple(inside)), DT_S).stage == Stage.PLAYING
    assert plan.advance(at(tuple(outside)), DT_S).stage == Stage.OVER


@pytest.mark.parametrize(
    ("before", "hip_rad", "after"),
    [
        ((Stage.PLAYING, 3.5), 0.0, (Stage.PLAYING, 4.5)),
        ((Stage.PLAYING, 4.0), 0.0, (Stage.OVER, 0.0)),
        ((Stage.PLAYING, 4.5), 0.0, (Stage.OVER, 0.0)),
        ((Stage.PLAYING, 1.0), 0.5, (Stage.PLAYING, 2.0)),  # at the edge of its window
        ((Stage.OVER, 7.0), 0.6, (Stage.OVER, 8.0)),
    ],
)
def test_an_excitation_is_over_when_its_time_is(before, hip_rad, after):
    plan = excite_play(middle=(0.0, 0.5), stage=before[0], elapsed_s=before[1])

    later = plan.advance(at((hip_rad, 0.5)), 1.0)

    assert (later.stage, later.elapsed_s) == after


def test_an_excitation_rests_at_mid_pose_for_a_second_and_its_steps_begin_at_once():
    begun = excite_play(way=Approach(MEAN, MEAN, 2.0))

    for elapsed_s, stage in ((1.99, Stage.APPROACHING), (2.0, Stage.PLAYING)):
        later = replace(begun, elapsed_s=elapsed_s).advance(AT_REST, 1.0)
        assert later.stage is stage
    playing = replace(begun, stage=Stage.PLAYING)
    for elapsed_s, hip_nm in ((1.999, 0.0), (2.0, 11.0), (2.4, 0.0)):
        assert replace(playing, elapsed_s=elapsed_s).targets(AT_REST).feedforward[0] == hip_nm


def self_test_play(**change):
    def way(name, distance_si):
        return Way(name, distance_si, speed_max(abs(distance_si)), 6.0, 8.0, 0.0)

    plan = SelfTest(
        start=(0.1, 0.45),
        ways=(way("right/hip", math.radians(4.0)), way("right/slide", -0.04)),
        ratios=(0.5, 1.6),
        wait_s=0.0,
    )
    return replace(plan, **change)


@pytest.mark.parametrize(
    ("distance_si", "most_si_per_s"),
    [
        *((math.radians(4.0), 0.174), (math.radians(1.0), 0.043)),
        *((0.04, 0.1), (0.0051, 0.012), (4.0, 10.0)),
    ],
)
def test_the_highest_speed_of_a_self_test_leaves_a_tenth_of_a_second_to_average(
    distance_si, most_si_per_s
):
    assert speed_max(distance_si) == most_si_per_s


def test_the_fastest_self_test_has_no_step_and_averages_each_axis_both_ways():
    told, _ = story(self_test_play())
    positions = np.array([ref.position for _, ref in told])
    velocities = np.array([ref.velocity for _, ref in told])
    samples = [
        plan.phase(index) for plan, _ in told if plan.stage == Stage.PLAYING for index in (0, 1)
    ]

    most = np.array([0.174, 0.1])
    assert (np.abs(np.diff(positions, axis=0)) <= most * DT_S * (1 + 1e-9)).all()
    assert (np.abs(np.diff(velocities, axis=0)) <= most * DT_S / 0.2 * (1 + 1e-9)).all()
    for phase in (MotionPhase.FORTH, MotionPhase.BACK):
        averaged = [one for one in samples if one == (phase, True)]
        assert len(averaged) >= 2 * (AVERAGED_MIN_S / DT_S - 1)


def test_a_self_test_without_torque_mode_is_over_and_both_axes_say_why():
    _, plan = story(self_test_play(), IN_POSITION_MODE)

    assert [result.fault for result in plan.results()] == [Finding.NOT_BEGUN] * 2
