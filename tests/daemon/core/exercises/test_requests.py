"""What each exercise refuses, begins with and says of itself before it moves a leg."""

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest
from config_files import CONFIGS
from gaitd_names import Failure, ProgressCode, RefusalCode, Stage
from gaitd_toml import load_toml
from safety_inputs import ALL_WELL, LIMITS

from daemon.config.robot import leg_parameters
from daemon.config.settings import Robot, Trainer
from daemon.core.exercises import approach
from daemon.core.exercises.approach import Approach
from daemon.core.exercises.excite import Excite
from daemon.core.exercises.exercise import LegSample, LegStart, Reference
from daemon.core.exercises.gait import Gait
from daemon.core.exercises.hold import Hold
from daemon.core.exercises.torque import Torque
from daemon.core.motion.gait_shape import gait_angles, gait_shape, joints_of_angles, load_at
from daemon.ipc.record import ModeRequest
from daemon.ipc.report import Progress, Refusal

LEG = leg_parameters(load_toml(CONFIGS / "robot.toml", Robot))
TRAINER = load_toml(CONFIGS / "demo.toml", Trainer)
SHAPE = gait_shape(TRAINER.gait)
MEAN = gait_angles(SHAPE, 0.0, 0.0)
MIDDLE = joints_of_angles(LEG, MEAN)
CONFIG = SimpleNamespace(
    gait=TRAINER.gait,
    excite=TRAINER.excite,
    period_s=0.01,
    thresholds=SimpleNamespace(singularity_stop_ratio=0.15),
)
RIGHT = LegStart(
    name="right",
    axis_names=("right/hip", "right/slide"),
    parameters=LEG,
    shape=SHAPE,
    limits=(LIMITS, LIMITS._replace(quick_stop_deceleration_si_per_s2=30.0)),
    friction=(),
    over=(),
    effort_offset=(0.0, 0.0),
    phase_offset_strides=0.0,
    pose=(0.1, 0.45),
)
LEFT = RIGHT._replace(name="left", phase_offset_strides=0.25, pose=MIDDLE)
SAMPLE = LegSample((0.1, 0.45), (0.3, 0.4), (5.0, 6.0), (True, True), True, False)
GAIT = ModeRequest(cadence_hz=0.25, amplitude_ratio=0.5, duration_s=60.0)
EXCITE = ModeRequest(scenario="paper", duration_s=20.0)
R = RefusalCode


def changed(wanted, **changes):
    return ModeRequest(**{**{n: getattr(wanted, n) for n in wanted.__struct_fields__}, **changes})


@pytest.mark.parametrize(
    ("exercise", "wanted", "now", "refusal"),
    [
        (Hold, ModeRequest(), {}, None),
        (Torque, ModeRequest(), {}, Refusal(R.LEASE_NEEDED)),
        (Torque, ModeRequest(), {"lease_held": True}, None),
        (Gait, GAIT, {}, None),
        (Gait, changed(GAIT, cadence_hz=0.02, amplitude_ratio=1.0, duration_s=3600.0), {}, None),
        (Gait, changed(GAIT, cadence_hz=0.5, duration_s=0.5), {}, None),
        *(
            (Gait, changed(GAIT, cadence_hz=one), {}, Refusal(R.CADENCE_OUT_OF_RANGE, "", values))
            for one, values in ((0.019, (0.019, 0.02, 0.5)), (0.501, (0.501, 0.02, 0.5)))
        ),
        *(
            (
                *(Gait, changed(GAIT, amplitude_ratio=one), {}),
                Refusal(R.AMPLITUDE_OUT_OF_RANGE, "", (one, 0.0, 1.0)),
            )
            for one in (-0.5, 0.0, 1.001)
        ),
        *(
            (
                *(Gait, changed(GAIT, duration_s=one), {}),
                Refusal(R.DURATION_OUT_OF_RANGE, "", (one, 0.0, 3600.0)),
            )
            for one in (-1.0, 0.0, 3600.1)
        ),
        (Excite, EXCITE, {}, None),
        (Excite, changed(EXCITE, duration_s=30.0), {}, None),
        (Excite, changed(EXCITE, duration_s=0.5), {}, None),
        (
            *(Excite, changed(EXCITE, scenario="x"), {}),
            Refusal(R.NO_SUCH_SCENARIO, said="friction, paper"),
        ),
        *(
            (
                *(Excite, changed(EXCITE, duration_s=one), {}),
                Refusal(R.DURATION_OUT_OF_RANGE, "", (one, 0.0, 30.0)),
            )
            for one in (-1.0, 0.0, 30.1)
        ),
        (Excite, EXCITE, {"patient_configured": True}, Refusal(R.PATIENT_CONFIGURED)),
        (Excite, EXCITE, {"lease_held": True}, Refusal(R.LEASE_HELD)),
        (
            *(Excite, changed(EXCITE, scenario="friction")),
            *({"patient_configured": True, "lease_held": True}, None),
        ),
    ],
)  # fmt: skip
def test_a_request_is_refused_for_its_arguments_and_the_state_of_the_service(
    exercise, wanted, now, refusal
):
    assert exercise.refuse(wanted, replace(ALL_WELL, **now)) == refusal


@pytest.mark.parametrize("exercise", [Gait, Excite])
@pytest.mark.parametrize(
    ("ratio", "refusal"), [(0.15, None), (0.999, Refusal(R.NO_CLEAR_WAY, "right"))]
)
def test_what_goes_to_mid_pose_needs_a_clear_way_there(exercise, ratio, refusal):
    config = SimpleNamespace(
        gait=TRAINER.gait, thresholds=SimpleNamespace(singularity_stop_ratio=ratio)
    )

    assert exercise.may_begin([RIGHT, LEFT], config) == refusal
    assert Hold.may_begin([RIGHT], config) is None


def test_legs_arrive_at_mid_pose_together_within_their_speeds():
    far, near = approach.to_mid_pose([RIGHT, LEFT], CONFIG)

    hip_s, slide_s = (abs(MIDDLE[0] - 0.1) / 0.2, abs(MIDDLE[1] - 0.45) / 0.15)
    assert far.duration_s == near.duration_s == pytest.approx(1.875 * max(hip_s, slide_s))
    assert far.joints(LEG, 0.0) == pytest.approx((0.1, 0.45))
    assert near.joints(LEG, 0.3) == pytest.approx(MIDDLE)
    for elapsed_s in (far.duration_s, far.duration_s + 9.0):
        assert far.joints(LEG, elapsed_s) == pytest.approx(MIDDLE)
    assert approach.to_mid_pose([LEFT], CONFIG)[0].duration_s == 0.5
    back = approach.approach(LEG, TRAINER.gait, (MIDDLE[0], 0.7), MEAN)
    assert back.duration_s == pytest.approx(1.875 * (0.7 - MIDDLE[1]) / 0.15)
    turned = approach.approach(LEG, TRAINER.gait, (MIDDLE[0] - 0.3, MIDDLE[1]), MEAN)
    assert turned.duration_s == pytest.approx(1.875 * 0.3 / 0.2)


@pytest.mark.parametrize(("ratio", "is_clear"), [(0.3, False), (0.301, True)])
def test_a_way_is_clear_if_each_of_fifty_poses_on_it_is(monkeypatch, ratio, is_clear):
    times_s = []
    way = SimpleNamespace(
        duration_s=2.0, joints=lambda leg, elapsed_s: times_s.append(elapsed_s) or (0.1, 0.5)
    )
    monkeypatch.setattr(approach, "singularity_ratio", lambda leg, pose: ratio)

    assert approach.is_clear(LEG, way, 0.3) is is_clear
    assert times_s == pytest.approx([0.04 * number for number in range(1, 51)])


@pytest.mark.parametrize(
    ("x", "share"),
    [(-1.0, 0.0), (0.25, 0.103515625), (0.5, 0.5), (0.75, 0.896484375), (1.0, 1.0), (2.0, 1.0)],
)
def test_the_share_of_a_minimum_jerk_motion_is_its_polynomial(x, share):
    assert approach.minimum_jerk(x) == share


def test_a_gait_begins_with_its_settings_and_each_leg_with_its_phase():
    right, left = Gait.begin([RIGHT, LEFT], GAIT, CONFIG)

    plan = right.plan
    assert (plan.leg, plan.shape, plan.start) == (tuple(LEG), SHAPE, (0.1, 0.45))
    assert [plan.way, left.plan.way] == approach.to_mid_pose([RIGHT, LEFT], CONFIG)
    assert (plan.cadence_hz, plan.amplitude_ratio, plan.duration_s) == (0.25, 0.5, 60.0)
    assert (plan.announce_s, plan.ramp_strides, plan.period_s) == (3.0, 2, 0.01)
    assert (plan.phase_offset_strides, left.plan.phase_offset_strides) == (0.0, 0.25)
    assert right.impedance == TRAINER.gait.impedance
    assert (right.stage, right.strides, right.end_strides) == (Stage.ANNOUNCING, 0.0, 0.0)


@pytest.mark.parametrize(
    ("stage", "cadence_hz", "phase"),
    [
        (Stage.ANNOUNCING, None, -1.0),
        (Stage.APPROACHING, None, -1.0),
        (Stage.PLAYING, 0.25, 0.5),
        (Stage.ENDING, 0.25, 0.5),
        (Stage.OVER, None, -1.0),
    ],
)
def test_a_leg_has_a_cadence_and_a_phase_while_it_walks(stage, cadence_hz, phase):
    _, left = Gait.begin([RIGHT, LEFT], GAIT, CONFIG)
    walking = replace(left, stage=stage, strides=3.25)

    assert (walking.stride_hz, walking.gait_phase) == (cadence_hz, phase)


G = Stage


@pytest.mark.parametrize(
    ("before", "after"),
    [
        # stage, time in it, strides, strides at the end of playing; the cadence ramps over two
        ((G.ANNOUNCING, 2.985, 0.0, 0.0), (G.ANNOUNCING, 2.995, 0.0, 0.0)),
        ((G.ANNOUNCING, 2.991, 0.0, 0.0), (G.APPROACHING, 0.0, 0.0, 0.0)),
        ((G.APPROACHING, 0.0, 0.0, 0.0), (G.APPROACHING, 0.01, 0.0, 0.0)),
        ((G.APPROACHING, 99.0, 0.0, 0.0), (G.PLAYING, 0.0, 0.0, 0.0)),
        ((G.PLAYING, 1.0, 0.0, 0.0), (G.PLAYING, 1.01, 0.00125, 0.0)),
        ((G.PLAYING, 1.0, 1.0, 0.0), (G.PLAYING, 1.01, 1.001875, 0.0)),
        ((G.PLAYING, 1.0, 7.0, 0.0), (G.PLAYING, 1.01, 7.0025, 0.0)),
        ((G.PLAYING, 59.991, 7.0, 0.0), (G.ENDING, 0.0, 7.0025, 7.0025)),
        ((G.ENDING, 1.0, 7.5, 7.0025), (G.ENDING, 1.01, 7.5025, 7.0025)),
        ((G.ENDING, 60.0, 7.5, 7.0025), (G.ENDING, 60.01, 7.5025, 7.0025)),
        ((G.ENDING, 3.99, 8.0001, 7.0025), (G.OVER, 0.0, 8.0026, 7.0025)),
        ((G.OVER, 1.0, 8.0, 7.0), (G.OVER, 1.01, 8.0, 7.0)),
    ],
)
def test_a_gait_goes_on_from_stage_to_stage_by_time_and_strides(before, after):
    (begun,) = Gait.begin([RIGHT], GAIT, CONFIG)
    stage, elapsed_s, strides, end_strides = before
    now = replace(begun, stage=stage, elapsed_s=elapsed_s, strides=strides, end_strides=end_strides)

    later = now.advance(SAMPLE, 0.01)

    found = later.stage, later.elapsed_s, later.strides, later.end_strides
    assert found == (after[0], *map(pytest.approx, after[1:]))
    assert later.plan is now.plan
    waiting = now.advance(SAMPLE._replace(mode_changing=True), 0.01)
    assert (waiting == now) == (stage is G.ANNOUNCING)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ((G.ANNOUNCING, 2.0, 0.0, 0.0), G.APPROACHING),
        ((G.APPROACHING, 3.0, 0.0, 0.0), G.PLAYING),
        ((G.PLAYING, 59.0, 7.0, 0.0), G.ENDING),
        ((G.ENDING, 3.0, 7.75, 7.0), G.OVER),
    ],
)
def test_a_stage_of_a_gait_is_over_in_the_cycle_that_completes_it(before, after):
    (begun,) = Gait.begin([RIGHT], GAIT, CONFIG)
    stage, elapsed_s, strides, end_strides = before
    plan = replace(begun.plan, way=Approach(MEAN, MEAN, 4.0))
    now = replace(begun, plan=plan, stage=stage, elapsed_s=elapsed_s, strides=strides)

    assert replace(now, end_strides=end_strides).advance(SAMPLE, 1.0).stage is after


@pytest.mark.parametrize(
    ("stage", "strides", "end_strides", "amplitude_ratio"),
    [
        (G.PLAYING, 0.0, 0.0, 0.0),
        (G.PLAYING, 1.0, 0.0, 0.25),
        (G.PLAYING, 2.25, 0.0, 0.5),
        (G.ENDING, 2.75, 2.25, 0.25),
        (G.ENDING, 1.25, 1.0, 0.25 * 0.896484375),
        (G.ENDING, 1.25, 0.5, 0.5 * 0.103515625 * 0.103515625),
        (G.OVER, 3.3, 2.25, 0.0),
        (G.OVER, 2.75, 2.25, 0.0),
    ],
)
def test_the_amplitude_rises_over_the_first_strides_and_falls_over_the_last(
    stage, strides, end_strides, amplitude_ratio
):
    _, left = Gait.begin([RIGHT, LEFT], GAIT, CONFIG)

    now = replace(left, stage=stage, strides=strides, end_strides=end_strides)

    angles = gait_angles(SHAPE, strides + 0.25, amplitude_ratio)
    assert now.pose() == pytest.approx(joints_of_angles(LEG, angles))


def test_an_excitation_begins_with_its_scenario():
    (made,) = Excite.begin([RIGHT], EXCITE, CONFIG)

    scenario = TRAINER.excite["paper"]
    assert (made.leg, made.middle, made.middle_load) == (LEG, MIDDLE, load_at(LEG, MIDDLE))
    assert made.way == approach.to_mid_pose([RIGHT], CONFIG)[0]
    assert (made.torque, made.artificial) == (scenario.torque, scenario.artificial)
    assert (made.window, made.duration_s) == ((math.radians(24.0), 0.35), 20.0)
    assert (made.stage, made.continues_effort) == (Stage.APPROACHING, False)


@pytest.mark.parametrize(
    ("scenario", "stage", "is_artificial"),
    [
        ("paper", Stage.APPROACHING, False),
        ("paper", Stage.PLAYING, True),
        ("paper", Stage.OVER, False),
        ("open_loop", Stage.PLAYING, False),
    ],
)
def test_a_scenario_is_artificial_while_it_plays_if_it_has_a_disturbance(
    scenario, stage, is_artificial
):
    (made,) = Excite.begin([RIGHT], changed(EXCITE, scenario=scenario), CONFIG)
    now = replace(made, stage=stage, elapsed_s=15.5)

    assert now.is_artificial is is_artificial
    hip_nm = 4 * math.sin(2 * math.pi * 0.35 * 0.5) if is_artificial else 0.0
    assert now.artificial_si == (pytest.approx(hip_nm), 30.0 if is_artificial else 0.0)


def test_a_hold_keeps_the_pose_and_brakes_as_a_quick_stop():
    (held,) = Hold.begin([RIGHT], ModeRequest(), CONFIG)
    braking = Hold.braking((0.1, 0.45), (1.0, -0.6), RIGHT.limits)

    assert held.targets(SAMPLE) == Reference((0.1, 0.45), (0.0, 0.0), (0.0, 0.0), guided=True)
    assert (held.deceleration, held.stage) == ((20.0, 30.0), None)
    assert braking.targets(SAMPLE).velocity == (1.0, -0.6)
    for elapsed_s, position, velocity in (
        (0.01, (0.109, 0.4455), (0.8, -0.3)),
        (0.04, (0.124, 0.444), (0.2, 0.0)),
        (1.0, (0.125, 0.444), (0.0, 0.0)),
    ):
        target = braking.advance(SAMPLE, elapsed_s).targets(SAMPLE)
        assert (target.position, target.velocity) == (
            pytest.approx(position),
            pytest.approx(velocity),
        )


def test_in_torque_mode_the_reference_is_the_leg_itself_and_nothing_is_told_besides():
    (first,) = Torque.begin([RIGHT], ModeRequest(), CONFIG)

    later = first.advance(SAMPLE, 0.01).advance(SAMPLE, 0.02)

    assert (later.stage, later.elapsed_s) == (Stage.PLAYING, 0.03)
    assert later.targets(SAMPLE) == Reference((0.1, 0.45), (0.0, 0.0), (0.0, 0.0), guided=False)
    assert later.progress() is None


def test_a_leg_that_does_not_walk_has_no_impedance_cadence_phase_or_disturbance():
    (held,) = Hold.begin([RIGHT], ModeRequest(), CONFIG)
    held = held.advance(SAMPLE, 2.5)

    assert held.progress() == Progress(ProgressCode.EXERCISING, "", (2.5,))
    assert (held.impedance, held.stride_hz, held.gait_phase) == (None, None, -1.0)
    assert (held.artificial_si, held.is_artificial) == ((0.0, 0.0), False)
    assert (held.failure, held.elapsed_s) == (Failure.NONE, 2.5)
    assert (Hold.continues_effort, Hold.continues_effort_at_stages) == (True, False)
    assert not Hold.legs_in_turn


@pytest.mark.parametrize(
    ("elapsed_s", "in_torque_mode", "stage", "failure"),
    [
        (0.999, True, Stage.APPROACHING, Failure.NONE),
        (1.0, True, Stage.PLAYING, Failure.NONE),
        (20.999, False, Stage.APPROACHING, Failure.NONE),
        (21.0, False, Stage.OVER, Failure.NO_REST),
        (21.0, True, Stage.PLAYING, Failure.NONE),
    ],
)
def test_an_exercise_waits_for_torque_mode_for_twenty_seconds(
    elapsed_s, in_torque_mode, stage, failure
):
    (made,) = Excite.begin([RIGHT], EXCITE, CONFIG)
    waiting = replace(made, elapsed_s=elapsed_s)

    now = waiting.begun_in_torque_mode(SAMPLE._replace(in_torque_mode=in_torque_mode), 1.0)

    assert (now.stage, now.failure) == (stage, failure)
    assert now.elapsed_s == (elapsed_s if stage is Stage.APPROACHING else 0.0)
    assert now.way is made.way


def test_a_way_is_straight_in_the_angles_of_hip_and_knee():
    way = Approach((0.0, 0.4), (0.2, 0.8), 2.0)

    assert way.joints(LEG, 1.0) == pytest.approx(joints_of_angles(LEG, (0.1, 0.6)))
