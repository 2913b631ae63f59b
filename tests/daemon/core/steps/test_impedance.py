"""What is commanded: targets of guidance, of a single axis, and the power that is asked for."""

import math
from types import SimpleNamespace

import pytest
from gaitd_names import Mode
from safety_inputs import FEEDBACK
from step_inputs import AT_REST, a_core, a_leg, an_axis, now_shows, was_sent

from daemon.core.exercises.exercise import Reference
from daemon.core.safety.stop_sequence import Step
from daemon.core.slices import LegAssist, Softened
from daemon.core.state import Leg
from daemon.core.steps import impedance
from daemon.core.steps.impedance import AxisSetpoint
from daemon.core.steps.targets import DriveRequest
from drives.cia402.units import AxisScaling
from drives.signals import DriveCommand, OperationMode, PowerRequest

CST, CSP = OperationMode.CYCLIC_SYNC_TORQUE, OperationMode.CYCLIC_SYNC_POSITION
CYCLE, DT_S = 100, 0.01
SCALING = AxisScaling(1000.0, 0.0, 0.01, 20.0, 32767, 1000.0, 1000.0)
POSES, LOADS = (0.2, 0.5), (7.0, 40.0)
STANDS = Reference(POSES, (0.0, 0.0), (0.0, 0.0), guided=True)


def stiffness(hip, slide):
    """An impedance of N·m/rad and N·m·s/rad of the hip, N/m and N·s/m of the slide."""
    return SimpleNamespace(
        hip=SimpleNamespace(stiffness_nm_per_rad=hip[0], damping_nm_s_per_rad=hip[1]),
        slide=SimpleNamespace(stiffness_n_per_m=slide[0], damping_n_s_per_m=slide[1]),
    )


SOFT = stiffness((300.0, 20.0), (4000.0, 250.0))
STIFF = stiffness((500.0, 30.0), (5000.0, 300.0))


@pytest.fixture
def core():
    """A core that holds its leg at rest at 0.2 rad and 0.5 m, with g of 7 N·m and 40 N."""
    axes = [
        an_axis(
            name,
            feedback=FEEDBACK._replace(position_counts=counts),
            joint=AT_REST._replace(position_si=position_si, effort_si=gravity_si),
            gravity_si=gravity_si,
            effort_si=gravity_si,
            effort_mean_si=gravity_si,
            position_si=position_si,
            scaling=SCALING,
        )
        for name, position_si, gravity_si, counts in zip(
            ("right/hip", "right/slide"), POSES, LOADS, (100, 200), strict=True
        )
    ]
    config = SimpleNamespace(period_s=DT_S, hold=STIFF, by_position=False)
    return a_core(a_leg(*axes, reference=STANDS, parameters=None), config=config)


def targets(core):
    found = impedance.bounded(core, impedance.requests(core), CYCLE)
    return found and [(one.effort_si, one.position_si) for one in found]


def setpoints(core):
    return impedance._setpoints(core, core.legs[0])


# --- guidance -------------------------------------------------------------------------------------


def test_a_leg_at_its_reference_is_carried(core):
    assert targets(core) == [(7.0, 0.2), (40.0, 0.5)]


@pytest.mark.parametrize(
    ("reference", "ratio", "efforts"),
    [
        (Reference((0.21, 0.5), (0.0, 0.0), (0.0, 0.0), guided=True), 1.0, (3.0, 0.0)),
        (Reference((0.2, 0.5), (0.1, 0.0), (0.0, 0.0), guided=True), 1.0, (2.0, 0.0)),
        (
            Reference((0.21, 0.499), (0.1, 0.02), (0.0, 0.0), guided=True),
            *(0.25, (0.75 + 1.0, -1.0 + 2.5)),
        ),
        (Reference((0.2, 0.499), (0.0, 0.01), (0.0, 0.0), guided=True), 1.0, (0.0, -4.0 + 2.5)),
        (Reference((0.3, 0.6), (0.5, 0.6), (1.0, -2.0), guided=False), 1.0, (1.0, -2.0)),
        (
            Reference((0.3, 0.6), (0.5, 0.6), (1.0, -2.0), guided=False, load=(8.0, 39.0)),
            *(1.0, (2.0, -3.0)),
        ),
    ],
)
def test_guidance_adds_spring_damper_and_feedforward_to_the_load(core, reference, ratio, efforts):
    (leg,) = core.legs
    leg.exercise = SimpleNamespace(impedance=SOFT)
    leg.reference, leg.guidance_ratio = reference, ratio

    found = setpoints(core)

    for index, one in enumerate(found):
        assert one.effort_si - LOADS[index] == pytest.approx(efforts[index])
        assert (one.position_si, one.velocity_si) == (
            *(reference.position[index], reference.velocity[index]),
        )


def test_a_joint_in_motion_is_damped(core):
    for axis in core.axes:
        now_shows(axis, joint=axis.sensed.joint._replace(velocity_si=0.1))

    assert [one.effort_si for one in setpoints(core)] == pytest.approx([7.0 - 3.0, 40.0 - 30.0])


@pytest.mark.parametrize("exercise", [None, SimpleNamespace(impedance=None)])
def test_without_an_impedance_of_its_own_a_leg_has_that_of_hold(core, exercise):
    (leg,) = core.legs
    leg.exercise, leg.reference = exercise, STANDS._replace(position=(0.201, 0.501))

    assert [one.effort_si for one in setpoints(core)] == pytest.approx([7.5, 45.0])


def test_a_controller_a_spasm_and_clonus_reduce_guidance():
    leg = SimpleNamespace(
        assist=LegAssist(stiffness_ratio=0.5), softened=Softened(spasm_ratio=0.5, clonus_ratio=0.8)
    )

    assert Leg.guidance_ratio.fget(leg) == 0.25


def test_assist_of_a_controller_is_added_and_a_number_that_is_not_finite_refuses_the_command(core):
    (leg,) = core.legs
    leg.assist = LegAssist(effort_si=(1.0, -2.0))
    assert targets(core) == [(8.0, 0.2), (38.0, 0.5)]

    leg.assist = LegAssist(is_finite=False)
    assert targets(core) is None


def test_what_would_move_the_leg_deeper_into_a_margin_is_reduced(core, monkeypatch):
    monkeypatch.setattr(
        impedance.monitors, "slowed", lambda leg, efforts: (efforts[0] - 1.0, efforts[1] - 2.0)
    )

    assert [effort for effort, _ in targets(core)] == [6.0, 38.0]


@pytest.mark.parametrize("index", [0, 1])
@pytest.mark.parametrize(
    "changes",
    [
        {"effort_si": math.nan},
        {"effort_offset_si": math.nan},
        {"mode": CSP, "position_offset_si": math.nan},
    ],
    ids=["effort", "its offset", "offset of the position"],
)
def test_a_target_that_is_not_finite_refuses_the_command(core, index, changes):
    axis = core.axes[index]
    core.config.by_position = "mode" in changes
    shown = FEEDBACK._replace(mode_display=changes.get("mode", CST))
    for one in core.axes:
        was_sent(one, mode=shown.mode_display)
        now_shows(one, feedback=shown)
    assert targets(core) == [(7.0, 0.2), (40.0, 0.5)]
    was_sent(axis, **changes)

    assert targets(core) is None


def test_a_number_that_is_not_finite_counts_where_its_mode_does_not_use_it(core):
    core.legs[0].reference = Reference(POSES, (math.inf, 0.0), (0.0, 0.0), guided=False)

    assert targets(core) is None


@pytest.mark.parametrize(
    ("mode", "reference"), [(Mode.READY, STANDS), (Mode.HOLD, None), (Mode.READY, None)]
)
def test_without_power_or_reference_there_is_no_effort_at_the_present_pose(core, mode, reference):
    core.mode, core.legs[0].reference = mode, reference
    for axis in core.axes:
        was_sent(axis, effort_si=2.0, position_si=0.0)

    assert setpoints(core) == (AxisSetpoint(0.0, 0.2, 0.0), AxisSetpoint(0.0, 0.5, 0.0))
    assert targets(core) == [(0.0, 0.2), (0.0, 0.5)]


# --- a single axis --------------------------------------------------------------------------------


def homes(effort_si=7.5, *, searching=False):
    return SimpleNamespace(
        axis="right/hip",
        effort_si=effort_si,
        by_drive=False,
        searching=searching,
        limits=lambda usual, moving: usual._replace(effort_max_si=12.0),
    )


@pytest.mark.parametrize(
    ("effort_si", "mode", "sent_si", "pushing", "expected"),
    [
        (7.5, Mode.COMMISSION, 6.9, True, 7.5),
        (50.0, Mode.COMMISSION, 11.0, True, 12.0),
        (50.0, Mode.COMMISSION, 1.0, True, 7.0),
        (7.5, Mode.REFERENCE, 6.9, True, 7.5),
        (7.5, Mode.REFERENCE, 6.9, False, 0.0),
        (7.5, Mode.READY, 0.0, True, 0.0),
        (math.nan, Mode.COMMISSION, 6.9, True, None),
        (7.5, Mode.COMMISSION, math.nan, True, None),
    ],
)
def test_a_single_axis_gets_its_small_effort_and_the_other_none(
    core, effort_si, mode, sent_si, pushing, expected
):
    core.mode, core.single_axis = mode, homes(effort_si)
    hip, slide = core.axes
    was_sent(hip, effort_si=sent_si, effort_offset_si=1.0, position_offset_si=2.0, position_si=0.0)
    was_sent(slide, effort_si=0.0)
    requests = [DriveRequest(CST, pushing, False, DT_S), DriveRequest(CST, False, False, DT_S)]

    found = impedance.bounded(core, requests, CYCLE)

    if expected is None:
        assert found is None
    else:
        of_hip, of_slide = found
        assert (of_hip.effort_si, of_slide.effort_si) == (pytest.approx(expected), 0.0)
        assert (of_hip.position_si, of_slide.position_si) == POSES
        assert (of_hip.effort_offset_si, of_hip.effort_mean_si) == (1.0, 7.0)
        assert of_hip.position_offset_si == 2.0
        (_, velocity), (_, of_other) = ((one.effort_si, one.velocity_si) for one in setpoints(core))
        assert (velocity, of_other) == (0.0, 0.0)


# --- mode and power -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("still_cycles", "reached", "mode", "expected"),
    [
        (4, True, CSP, CSP),
        (5, True, CSP, CST),
        (6, True, CSP, CST),
        (4, False, CSP, CST),
        (4, True, CST, CST),
    ],
)
def test_an_enabled_drive_changes_its_mode_only_at_rest(
    core, still_cycles, reached, mode, expected
):
    hip = core.axes[0]
    now_shows(
        hip, joint=hip.sensed.joint._replace(still_cycles=still_cycles), reached_enabled=reached
    )
    was_sent(hip, mode=mode)
    core.legs[0].takes_over = True

    assert impedance.requests(core)[0] == DriveRequest(expected, True, False, DT_S, True)
    core.mode = Mode.READY
    assert impedance.requests(core)[0] == DriveRequest(CST, False, False, DT_S, True)
    core.config.by_position = True
    assert impedance.requests(core)[0] == DriveRequest(CSP, False, True, DT_S, True)


@pytest.mark.parametrize(
    ("reference", "first"),
    [(STANDS._replace(velocity=(1.0, 0.0)), 0.26), (None, 0.25)],
    ids=["moving", "at rest"],
)
def test_a_stop_in_position_mode_brakes_in_its_first_cycle_and_only_then(core, reference, first):
    hip = core.axes[0]
    was_sent(hip, mode=CSP, position_si=0.25)
    now_shows(hip, feedback=FEEDBACK._replace(mode_display=CSP))
    core.legs[0].reference = reference
    hip.stop = SimpleNamespace(step=Step.HOLD, since_cycle=CYCLE)
    begun = targets(core)[0][1]
    hip.stop = SimpleNamespace(step=Step.HOLD, since_cycle=CYCLE - 1)
    later = targets(core)[0][1]

    assert begun == pytest.approx(first, abs=0.003)
    assert later < begun


@pytest.mark.parametrize(
    ("changes", "step", "power"),
    [
        ({}, None, PowerRequest.ENABLE),
        ({"mode": Mode.READY}, None, PowerRequest.DISABLE_VOLTAGE),
        ({"mode": Mode.READY, "reset_cycles_left": 1}, None, PowerRequest.FAULT_RESET),
        ({"reset_cycles_left": 1}, None, PowerRequest.ENABLE),
        ({}, Step.QUICK_STOP, PowerRequest.QUICK_STOP),
        ({}, Step.DISABLE, PowerRequest.DISABLE_VOLTAGE),
        ({}, Step.HOLD, PowerRequest.ENABLE),
        ({"single_axis": homes(searching=True)}, None, PowerRequest.HOME),
        ({"single_axis": homes()}, None, PowerRequest.ENABLE),
    ],
)
def test_power_is_asked_for_by_stop_mode_and_reset(core, changes, step, power):
    for name, value in changes.items():
        setattr(core, name, value)
    hip = core.axes[0]
    hip.stop = None if step is None else SimpleNamespace(step=step)
    was_sent(hip, mode=CSP, effort_si=2.0, position_si=0.25)

    assert impedance.command(core)[0] == DriveCommand(power, CSP, 250, 40)


@pytest.mark.parametrize(
    ("step", "power"),
    [
        (None, PowerRequest.QUICK_STOP),
        (Step.HOLD, PowerRequest.QUICK_STOP),
        (Step.DISABLE, PowerRequest.DISABLE_VOLTAGE),
    ],
)
def test_after_a_bug_each_drive_is_stopped_where_it_is_or_stays_stopped_harder(core, step, power):
    hip, slide = core.axes
    hip.stop = None if step is None else SimpleNamespace(step=step)
    was_sent(hip, mode=CSP)
    now_shows(slide, feedback=None)

    assert impedance.stop_without_feedback(core) == [
        DriveCommand(power, CSP, 100, 0),
        DriveCommand(PowerRequest.QUICK_STOP, CST, 0, 0),
    ]
