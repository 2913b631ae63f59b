"""What is commanded: targets of guidance, of a single axis, and the power that is asked for."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
from fresh_core import fresh, has_been_sent, show
from gaitd_names import Mode, ProgressCode, Stage
from msgspec.structs import replace
from safety_inputs import FEEDBACK, JOINT

from daemon.core.exercises.exercise import Reference
from daemon.core.exercises.homing import Homing
from daemon.core.exercises.sign_test import SignTest
from daemon.core.exercises.single_axis import AxisStart, AxisStep, HomingRules, PushRules
from daemon.core.safety.stop_sequence import Step
from daemon.core.slices import LegAssist, Placed, Softened
from daemon.core.steps import exercises, impedance, sampling, status, wanted
from daemon.ipc.report import Progress
from drives.cia402.torque import TorqueSampling
from drives.signals import DriveCommand, OperationMode, PowerRequest
from observer.mechanism.mechanism import mass_matrix

CST, CSP = OperationMode.CYCLIC_SYNC_TORQUE, OperationMode.CYCLIC_SYNC_POSITION
CYCLE = 100


def single(kind, **changes):
    rules = PushRules(12.0, 6.0, 0.03), HomingRules(30.0, 0.3, 100)
    begun = kind.begin(AxisStart("right/hip", *rules, True, True, 0, 0.01))
    return dataclasses.replace(begun, **changes)


@pytest.fixture
def core():
    """A core that holds its leg at rest at 0.2 rad and 0.5 m, with g of 7 N·m and 40 N."""
    made = fresh().core
    made.mode, made.load_checked = Mode.HOLD, True
    for axis, (position_si, gravity_si) in zip(made.axes, ((0.2, 7.0), (0.5, 40.0)), strict=True):
        joint = JOINT._replace(
            position_si=position_si, velocity_si=0.0, effort_si=gravity_si, still_cycles=100
        )
        feedback = FEEDBACK._replace(node_id=axis.node_id)
        show(axis, joint=joint, feedback=feedback, gravity_si=gravity_si, reached_enabled=True)
        show(axis, referenced=True)
        has_been_sent(
            axis, effort_si=gravity_si, effort_mean_si=gravity_si, position_si=position_si
        )
    exercises.hold_here(made)
    (leg,) = made.legs
    leg.reference = Reference((0.2, 0.5), (0.0, 0.0), (0.0, 0.0), guided=True)
    return made


def stopped(step):
    return None if step is None else SimpleNamespace(step=step)


def targets(core):
    found = impedance.bounded(core, impedance.requests(core), CYCLE)
    return found and [(one.effort_si, one.position_si) for one in found]


def test_a_leg_at_its_reference_is_carried(core):
    assert targets(core) == [(7.0, 0.2), (40.0, 0.5)]


@pytest.mark.parametrize(
    ("reference", "ratio", "efforts"),
    [
        (Reference((0.21, 0.5), (0.0, 0.0), (0.0, 0.0), guided=True), 1.0, (3.0, 0.0)),
        (Reference((0.2, 0.5), (0.1, 0.0), (0.0, 0.0), guided=True), 1.0, (2.0, 0.0)),
        (Reference((0.21, 0.5), (0.1, 0.0), (0.0, 0.0), guided=True), 0.25, (0.75 + 1.0, 0.0)),
        (Reference((0.2, 0.499), (0.0, 0.01), (0.0, 0.0), guided=True), 1.0, (0.0, -4.0 + 2.5)),
        (Reference((0.3, 0.6), (0.0, 0.0), (1.0, -2.0), guided=False), 1.0, (1.0, -2.0)),
        (
            Reference((0.3, 0.6), (0.0, 0.0), (1.0, -2.0), guided=False, load=(8.0, 39.0)),
            *(1.0, (2.0, -3.0)),
        ),
    ],
)
def test_guidance_adds_spring_damper_and_feedforward_to_the_load(core, reference, ratio, efforts):
    (leg,) = core.legs
    gait = core.config.gait.impedance
    assert (gait.hip.stiffness_nm_per_rad, gait.hip.damping_nm_s_per_rad) == (300.0, 20.0)
    assert (gait.slide.stiffness_n_per_m, gait.slide.damping_n_s_per_m) == (4000.0, 250.0)
    leg.exercise = SimpleNamespace(impedance=gait)
    leg.reference, leg.assist = reference, LegAssist(stiffness_ratio=ratio)

    (hip, _), (slide, _) = targets(core)

    assert (hip - 7.0, slide - 40.0) == pytest.approx(efforts)


@pytest.mark.parametrize("exercise", [None, SimpleNamespace(impedance=None)])
def test_without_an_impedance_of_its_own_a_leg_has_that_of_hold_and_a_spasm_softens_it(
    core, exercise
):
    (leg,) = core.legs
    leg.exercise = exercise
    leg.reference = Reference((0.201, 0.5), (0.0, 0.0), (0.0, 0.0), guided=True)
    stiff = targets(core)[0][0]
    leg.softened = Softened(spasm_ratio=0.5)

    assert stiff - 7.0 == pytest.approx(0.001 * core.config.hold.hip.stiffness_nm_per_rad)
    assert targets(core)[0][0] - 7.0 == pytest.approx((stiff - 7.0) / 2)


def test_assist_of_a_controller_is_added_and_a_number_that_is_not_finite_refuses_the_command(core):
    (leg,) = core.legs
    leg.assist = LegAssist(effort_si=(1.0, -2.0))
    assert targets(core) == [(8.0, 0.2), (38.0, 0.5)]

    leg.assist = LegAssist(is_finite=False)
    assert targets(core) is None


def test_a_target_that_is_not_finite_refuses_the_command_too(core):
    (leg,) = core.legs
    has_been_sent(core.axes[1], effort_si=math.nan)
    assert targets(core) is None
    has_been_sent(core.axes[1], effort_si=40.0)
    leg.reference = Reference((0.2, 0.5), (math.inf, 0.0), (0.0, 0.0), guided=False)

    assert targets(core) is None


def test_drives_that_are_not_to_push_get_no_effort_at_the_present_pose(core):
    core.mode = Mode.READY

    assert targets(core) == [(0.0, 0.2), (0.0, 0.5)]
    core.mode, core.legs[0].reference = Mode.HOLD, None
    assert [position for _, position in targets(core)] == [0.2, 0.5]


@pytest.mark.parametrize(
    ("kind", "mode", "changes", "efforts", "velocity"),
    [
        (SignTest, Mode.COMMISSION, {"effort_si": 7.5}, (7.5, 0.0), None),
        (SignTest, Mode.COMMISSION, {"effort_si": 50.0}, (12.0, 0.0), None),
        (SignTest, Mode.READY, {"effort_si": 7.5}, (0.0, 0.0), None),
        (Homing, Mode.REFERENCE, {}, (1.0, 0.0), None),
    ],
)
def test_a_single_axis_gets_its_small_effort_and_the_other_none(
    core, kind, mode, changes, efforts, velocity
):
    del velocity
    core.mode, core.single_axis = mode, single(kind, step=AxisStep.FORTH, **changes)
    for axis in core.axes:
        has_been_sent(axis, effort_si=6.9)

    found = targets(core)

    assert [position for _, position in found] == [0.2, 0.5]
    assert found[1][0] == 0.0
    assert found[0][0] == pytest.approx(efforts[0], abs=1.0)


def test_a_single_axis_whose_effort_is_not_finite_refuses_the_command(core):
    core.mode, core.single_axis = Mode.COMMISSION, single(SignTest)
    has_been_sent(core.axes[0], effort_si=math.nan)

    assert targets(core) is None


@pytest.mark.parametrize(
    ("still_cycles", "reached", "mode", "expected"),
    [(4, True, CSP, CSP), (5, True, CSP, CST), (4, False, CSP, CST), (4, True, CST, CST)],
)
def test_an_enabled_drive_changes_its_mode_only_at_rest(
    core, still_cycles, reached, mode, expected
):
    hip = core.axes[0]
    show(hip, joint=hip.sensed.joint._replace(still_cycles=still_cycles), reached_enabled=reached)
    has_been_sent(hip, mode=mode)
    core.legs[0].takes_over = True

    request = impedance.requests(core)[0]

    assert (request.mode, request.pushing, request.takes_over) == (expected, True, True)
    assert (request.leaving, request.dt_s) == (False, 0.01)
    core.mode = Mode.READY
    assert impedance.requests(core)[0].mode is CST


def test_a_stop_in_position_mode_brakes_in_its_first_cycle_and_only_then(core):
    hip = core.axes[0]
    hip.stop = SimpleNamespace(step=Step.HOLD, since_cycle=CYCLE)
    has_been_sent(hip, mode=CSP, position_si=0.25)
    show(hip, feedback=hip.sensed.feedback._replace(mode_display=CSP))
    core.legs[0].reference = Reference((0.2, 0.5), (1.0, 0.0), (0.0, 0.0), guided=True)

    first = targets(core)[0][1]
    hip.stop = SimpleNamespace(step=Step.HOLD, since_cycle=CYCLE - 1)
    later = targets(core)[0][1]

    assert first == pytest.approx(0.26, abs=0.003)
    assert later < first


@pytest.mark.parametrize(
    ("changes", "stop", "power"),
    [
        ({}, None, PowerRequest.ENABLE),
        ({"mode": Mode.READY}, None, PowerRequest.DISABLE_VOLTAGE),
        ({"mode": Mode.READY, "reset_cycles_left": 1}, None, PowerRequest.FAULT_RESET),
        ({"reset_cycles_left": 1}, None, PowerRequest.ENABLE),
        ({}, Step.QUICK_STOP, PowerRequest.QUICK_STOP),
        (
            {"mode": Mode.REFERENCE, "single_axis": single(Homing, step=AxisStep.SEARCHING)},
            *(None, PowerRequest.HOME),
        ),
        (
            {"mode": Mode.REFERENCE, "single_axis": single(Homing, step=AxisStep.ENABLING)},
            *(None, PowerRequest.ENABLE),
        ),
    ],
)
def test_power_is_asked_for_by_stop_mode_and_reset(core, changes, stop, power):
    for name, value in changes.items():
        setattr(core, name, value)
    hip = core.axes[0]
    hip.stop = stopped(stop)
    has_been_sent(hip, mode=CSP, effort_si=2.0, position_si=0.25)

    command = impedance.command(core)[0]

    assert command == DriveCommand(
        power=power,
        mode=CSP,
        target_position_counts=round(0.25 * hip.scaling.counts_per_si),
        target_torque_permille=round(2.0 * hip.scaling.permille_per_effort_si),
    )


@pytest.mark.parametrize(
    ("stop", "power"),
    [
        (None, PowerRequest.QUICK_STOP),
        (Step.HOLD, PowerRequest.QUICK_STOP),
        (Step.DISABLE, PowerRequest.DISABLE_VOLTAGE),
    ],
)
def test_after_a_bug_each_drive_is_stopped_where_it_is_or_stays_stopped_harder(core, stop, power):
    hip, slide = core.axes
    hip.stop = stopped(stop)
    has_been_sent(hip, mode=CSP)
    show(slide, feedback=None)

    assert impedance.stop_without_feedback(core) == [
        DriveCommand(power, CSP, FEEDBACK.position_counts, 0),
        DriveCommand(PowerRequest.QUICK_STOP, CST, 0, 0),
    ]


# --- wanted ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mode", "stop", "is_driving"),
    [
        (Mode.READY, None, False),
        (Mode.HOLD, None, True),
        (Mode.STOPPING, None, True),
        (Mode.FAULT, None, False),
        (Mode.FAULT, Step.HOLD, True),
        (Mode.FAULT, Step.QUICK_STOP, True),
        (Mode.FAULT, Step.DISABLE, False),
    ],
)
def test_drives_are_driven_while_a_mode_or_a_stop_keeps_their_power(core, mode, stop, is_driving):
    core.mode, core.axes[1].stop = mode, stopped(stop)

    assert wanted.is_driving(core) is is_driving
    assert wanted.enable_wanted(core, core.axes[1]) is (
        mode is Mode.HOLD if stop is None else stop is Step.HOLD
    )


@pytest.mark.parametrize(
    ("step", "nmt_stopped", "silenced"),
    [(None, (), False), (Step.DISABLE, (), False), (Step.NMT_STOP, (6,), False),
     (Step.SILENCE, (6,), True)],
)  # fmt: skip
def test_the_last_steps_of_a_stop_name_its_drives(core, step, nmt_stopped, silenced):
    core.axes[1].stop = stopped(step)

    assert wanted.nmt_stopped(core) == nmt_stopped
    assert wanted.is_silenced(core) is silenced


@pytest.mark.parametrize(
    ("changes", "guidance", "stop", "mode"),
    [
        ({}, "impedance", None, CST),
        ({}, "position", None, CSP),
        ({}, "position", Step.HOLD, OperationMode.HOMING),
        ({"mode": Mode.TORQUE}, "position", None, CST),
        ({"single_axis": single(SignTest)}, "position", None, CST),
        ({"single_axis": single(Homing)}, "position", None, OperationMode.HOMING),
    ],
)
def test_the_mode_of_operation_follows_from_mode_guidance_and_single_axis(
    core, changes, guidance, stop, mode
):
    for name, value in changes.items():
        setattr(core, name, value)
    core.config = config_of(core, guidance)
    hip = core.axes[0]
    hip.stop = stopped(stop)
    has_been_sent(hip, mode=OperationMode.HOMING)
    has_been_sent(core.axes[1], mode=wanted.mode_wanted(core, core.axes[1]))

    assert wanted.mode_wanted(core, hip) is mode
    assert wanted.is_mode_changing(core) is (mode is not OperationMode.HOMING)


def config_of(core, guidance):
    return dataclasses.replace(core.config, gait=replace(core.config.gait, guidance=guidance))


@pytest.mark.parametrize(("hip", "slide", "wants"), [(1, 1, True), (0, 1, True), (0, 0, False)])
def test_a_leg_is_enabled_if_one_of_its_drives_is(core, hip, slide, wants):
    for axis, is_wanted in zip(core.axes, (hip, slide), strict=True):
        axis.stop = None if is_wanted else SimpleNamespace(step=Step.DISABLE)

    assert wanted.enable_wanted_of(core, core.legs[0]) is wants


# --- sampling and status --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("acceleration", "sampling_kinds", "referenced", "ratio", "used"),
    [
        ((10.0, 0.0), (1, 1), True, 0.8, (10.0, 0.0)),
        ((10.0, -5.0), (1, 1), True, 0.8, (10.0, -5.0)),
        ((10.0, -5.0), (0, 1), True, 0.8, (0.0, -5.0)),
        ((10.0, -5.0), (0, 0), True, 0.8, (0.0, 0.0)),
        ((0.0, 0.0), (1, 1), True, 0.8, (0.0, 0.0)),
        ((10.0, -5.0), (1, 1), False, 0.8, (0.0, 0.0)),
        ((10.0, -5.0), (1, 1), True, 0.0, (0.0, 0.0)),
    ],
)
def test_half_of_the_inertia_s_effort_is_uncertain_where_a_sample_may_miss_it(
    core, acceleration, sampling_kinds, referenced, ratio, used
):
    (leg,) = core.legs
    leg.placed = Placed(ratio)
    for axis, one, is_instant in zip(core.axes, acceleration, sampling_kinds, strict=True):
        has_been_sent(axis, acceleration_si=one)
        axis.torque_sampling = TorqueSampling.INSTANT if is_instant else TorqueSampling.FILTERED
    show(core.axes[1], referenced=referenced)

    found = sampling.effort_std(leg)

    inertia = mass_matrix(leg.parameters, np.array((0.2, 0.5))) @ np.array(used)
    assert found == pytest.approx(tuple(0.5 * abs(inertia)))
    show(core.axes[1], referenced=True)
    show(core.axes[0], referenced=referenced)
    assert sampling.effort_std(leg) == pytest.approx(found)


PLAYS = SimpleNamespace(
    stage=Stage.PLAYING,
    legs_in_turn=False,
    progress=lambda: Progress(ProgressCode.EXERCISING, "", (3.0,)),
)


@pytest.mark.parametrize(
    ("changes", "stage", "progress"),
    [
        ({"mode": Mode.STOPPING, "exercise": PLAYS}, None, None),
        ({"mode": Mode.FAULT, "exercise": PLAYS}, None, None),
        ({"mode": Mode.BRINGING_UP}, Stage.PREPARING, None),
        (
            {"mode": Mode.BRINGING_UP, "bring_up": Progress(ProgressCode.SETTING_UP)},
            *(Stage.PREPARING, Progress(ProgressCode.SETTING_UP)),
        ),
        (
            {"mode": Mode.REFERENCE, "single_axis": single(Homing, step=AxisStep.SEARCHING)},
            *(Stage.PLAYING, Progress(ProgressCode.ONE_AXIS, "right/hip", (AxisStep.SEARCHING,))),
        ),
        ({"mode": Mode.HOLD}, None, None),
        (
            {"mode": Mode.HOLD, "load_checked": False},
            *(Stage.PREPARING, Progress(ProgressCode.COMPARING_LOAD)),
        ),
        (
            {"mode": Mode.GAIT, "exercise": PLAYS},
            *(Stage.PLAYING, Progress(ProgressCode.EXERCISING, "", (3.0,))),
        ),
        ({"mode": Mode.READY, "exercise": None}, None, None),
    ],
)
def test_stage_and_progress_are_those_of_bring_up_exercise_or_single_axis(
    core, changes, stage, progress
):
    changes = {"exercise": None, **changes}
    core.legs[0].exercise = changes.pop("exercise")
    for name, value in changes.items():
        setattr(core, name, value)

    assert (status.stage(core), status.progress(core)) == (stage, progress)
