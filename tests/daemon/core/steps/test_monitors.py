"""Sums and counts over more than one cycle: which monitor of a leg is fed with what."""

from types import SimpleNamespace

import numpy as np
import pytest
from fresh_core import fresh, has_been_sent, show
from gaitd_names import EventCode, Mode, Stage
from msgspec.structs import replace
from safety_inputs import FEEDBACK, JOINT

from daemon.core.exercises.exercise import Reference
from daemon.core.safety import stopping_path
from daemon.core.safety.effort_monitor import EffortWatch
from daemon.core.safety.inverse_dynamics import InverseDynamics
from daemon.core.safety.soft_limits import SoftZone
from daemon.core.slices import Monitored, Softened
from daemon.core.steps import monitors
from daemon.ipc.report import Event
from drives.signals import OperationMode, PowerState
from observer.filter.status import Validity

OK, BAD = Validity.OK, Validity.BAD


@pytest.fixture
def core():
    """A core in GAIT whose axes move at 0.2 rad and 0.5 m, referenced and enabled."""
    made = fresh().core
    made.mode = Mode.GAIT
    for axis, position_si in zip(made.axes, (0.2, 0.5), strict=True):
        joint = JOINT._replace(position_si=position_si, effort_si=10.0, step_si=0.005)
        show(axis, joint=joint, referenced=True, feedback=FEEDBACK, gravity_si=7.0)
    made.legs[0].reference = Reference((0.2, 0.5), (0.3, 0.1), (0.0, 0.0), guided=True)
    return made


def update(core, *, homing=False):
    """Monitor the leg for one cycle."""
    (leg,) = core.legs
    hip, slide = leg.axes
    limits = hip.limits, slide.limits
    leg.monitored = monitors.update(leg, leg.monitored, limits, core.config, homing=homing)


def plays(stage=Stage.PLAYING, stride_hz=0.5):
    return SimpleNamespace(stage=stage, stride_hz=stride_hz)


# --- a stride -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("exercise", "window_cycles"), [(plays(), 200), (plays(stride_hz=None), 400), (None, 400)]
)
def test_energy_is_summed_over_a_stride_or_the_window_and_anew_with_another(
    core, exercise, window_cycles
):
    (leg,) = core.legs
    hip, slide = leg.axes
    leg.exercise = exercise
    update(core)
    for _ in range(2):
        update(core)
    show(slide, joint=slide.sensed.joint._replace(fresh=False))
    update(core)

    assert leg.monitored.window_cycles == window_cycles
    assert monitors.stride_energy(leg, hip) == pytest.approx(4 * 10.0 * 0.005)
    assert monitors.stride_energy(leg, slide) == pytest.approx(3 * 10.0 * 0.005)
    leg.exercise = plays(stride_hz=0.3)
    update(core)
    assert monitors.stride_energy(leg, hip) == pytest.approx(10.0 * 0.005)
    monitors.clear_energy(core)
    assert monitors.stride_energy(leg, hip) == 0.0


@pytest.mark.parametrize(
    ("exercise", "still_cycles", "drift"),
    [
        (plays(), 0, 6.0),
        (plays(), 99, 0.0),
        (plays(Stage.ENDING), 0, 0.0),
        (plays(stride_hz=None), 0, 0.0),
        (None, 0, 0.0),
    ],
)
def test_the_residual_is_a_mean_over_a_whole_stride_of_a_gait_in_motion(
    core, monkeypatch, exercise, still_cycles, drift
):
    (leg,) = core.legs
    leg.exercise = exercise
    known = SimpleNamespace(residual=lambda index: 6.0 + index)
    monkeypatch.setattr(monitors.inverse_dynamics, "evaluate", lambda *_: known)
    monkeypatch.setattr(monitors.effort_monitor, "update", lambda watch, *_, **__: watch)
    for axis in core.axes:
        joint = axis.sensed.joint._replace(still_cycles=still_cycles)
        show(axis, joint=joint)
    for count in range(200):
        assert monitors.stride_drift(leg, core.axes[0]) == 0.0, count
        update(core)

    expected = drift and drift + 1.0
    assert monitors.stride_drift(leg, core.axes[0]) == pytest.approx(drift)
    assert monitors.stride_drift(leg, core.axes[1]) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("changes", "homing", "pose_known", "free", "may_give_torque"),
    [
        ({}, False, True, True, True),
        ({"referenced": False}, False, False, True, True),
        ({"joint": JOINT._replace(position_si=9.0)}, False, True, False, True),
        ({"joint": JOINT._replace(position_si=-9.0)}, False, True, False, True),
        ({"feedback": None}, False, True, True, False),
        (
            {"feedback": FEEDBACK._replace(power_state=PowerState.SWITCH_ON_DISABLED)},
            *(False, True, True, False),
        ),
        ({}, True, False, True, True),
    ],
)
def test_the_effort_monitor_knows_pose_range_and_power(
    core, monkeypatch, changes, homing, pose_known, free, may_give_torque
):
    fed = []
    dynamics = InverseDynamics()
    monkeypatch.setattr(monitors.inverse_dynamics, "evaluate", lambda *_: dynamics)
    monkeypatch.setattr(
        monitors.effort_monitor, "update", lambda *given, **named: fed.append((given, named))
    )
    hip, _ = core.axes
    show(hip, **changes)
    watch = core.legs[0].monitored.watches[0]

    update(core, homing=homing)

    given, named = fed[0]
    assert given == (watch, hip.sensed.joint, dynamics, 0, hip.limits)
    assert named == {
        "mismatch_cycles": core.config.thresholds.sign_mismatch_cycles,
        "may_give_torque": may_give_torque,
        "free": free,
        "pose_known": pose_known,
    }
    assert fed[1][0][3] == 1


@pytest.mark.parametrize("assist_si", [(0.0, 0.0), (0.0, 1.0)])
def test_where_the_leg_would_come_to_rest_is_known_with_its_pose_alone(core, assist_si):
    (leg,) = core.legs
    hip, slide = leg.axes
    leg.assist = replace(leg.assist, effort_si=assist_si)
    show(hip, joint=hip.sensed.joint._replace(position_si=hip.limits.position_max_si))
    update(core)

    reaction_s = stopping_path.reaction_s(assisted=assist_si != (0.0, 0.0))
    ends = [
        stopping_path.end_of(
            *(axis.sensed.joint.position_si, axis.sensed.joint.velocity_si),
            *(axis.limits.quick_stop_deceleration_si_per_s2, reaction_s),
        )
        for axis in leg.axes
    ]
    assert list(leg.monitored.stopping_end_si) == ends
    assert leg.monitored.stopping_ratio < 1.0
    assert leg.monitored.zone.entered
    efforts = monitors.slowed(leg, (30.0, 30.0))
    assert efforts[0] < 30.0
    show(slide, referenced=False)
    update(core)
    assert list(leg.monitored.stopping_end_si) == [
        axis.sensed.joint.position_si for axis in leg.axes
    ]
    assert (leg.monitored.stopping_ratio, leg.monitored.zone) == (1.0, SoftZone())
    assert monitors.slowed(leg, (30.0, 30.0)) == (30.0, 30.0)


# --- spasm and clonus -----------------------------------------------------------------------------


class Watch:
    """A watch over a patient that keeps what it is fed with."""

    def __init__(self):
        self.fed, self.cycles, self.lasts, self.begins = [], 0, False, False

    def reset(self):
        self.fed.append("reset")

    def update(self, *values):
        self.fed.append(values)


@pytest.fixture
def watched(core):
    for axis in core.axes:
        axis.spasm, axis.clonus = Watch(), Watch()
        show(axis, wanted_velocity_si=0.3)
    return core


def estimate(*validity):
    return SimpleNamespace(validity=validity, state=np.arange(8.0))


def soften(core, before=None, found=None, *, guided_motion=True):
    return monitors.soften(
        *(core.legs[0], before or Softened(), found or estimate(OK, OK), core.config),
        guided_motion=guided_motion,
    )


@pytest.mark.parametrize(
    ("validity", "guided_motion", "mismatch_cycles", "spasm_fed", "clonus_fed"),
    [
        ((OK, OK), True, 0, True, 6.0),
        ((BAD, OK), True, 0, False, None),
        ((OK, OK), False, 0, False, "reset"),
        ((OK, OK), True, 1, False, 6.0),
    ],
)
def test_a_patient_is_watched_in_a_guided_motion_with_a_valid_estimate(
    watched, validity, guided_motion, mismatch_cycles, spasm_fed, clonus_fed
):
    hip, slide = watched.axes
    (leg,) = watched.legs
    against = EffortWatch(sign_mismatch_cycles=mismatch_cycles)
    leg.monitored = Monitored(watches=(against, EffortWatch()))

    soften(watched, found=estimate(*validity), guided_motion=guided_motion)

    limits = hip.limits
    if spasm_fed:
        ((patient, velocity, wanted, needed, still, rise, standstill),) = hip.spasm.fed
        assert (patient, velocity, wanted, still) == (6.0, 0.5, 0.3, 0)
        assert (rise, standstill) == (limits.spasm_rise_si, limits.standstill_si_per_s)
        assert needed != 0.0
    else:
        assert hip.spasm.fed == ["reset"]
    swing = "reset" if clonus_fed == "reset" else (clonus_fed, limits.clonus_swing_si)
    assert hip.clonus.fed == [swing]
    if guided_motion:
        assert slide.spasm.fed[0][0] == 7.0
        assert slide.clonus.fed == [(7.0, slide.limits.clonus_swing_si)]


@pytest.mark.parametrize("guided", [True, False, None])
def test_a_guided_reference_needs_effort_for_its_acceleration(watched, guided):
    (leg,) = watched.legs
    reference = leg.reference._replace(guided=bool(guided))
    leg.reference = None if guided is None else reference
    before = Softened(wanted_velocity=(0.1, 0.2))

    found = soften(watched, before)

    needed = watched.axes[0].spasm.fed[0][3]
    if guided:
        acceleration = (0.3 - 0.1) / 0.01, (0.3 - 0.2) / 0.01
        expected = monitors.inverse_dynamics.needed(
            *(leg.mechanism, leg.friction_laws, (0.2, 0.5), (0.3, 0.3)),
            acceleration,
        )
        assert needed == pytest.approx(expected[0])
    else:
        assert needed == 0.0
    assert found.wanted_velocity == (0.3, 0.3)


@pytest.mark.parametrize("index", [0, 1])
def test_a_spasm_and_clonus_of_either_axis_soften_the_leg_and_clonus_is_told(watched, index):
    axis = watched.axes[index]
    assert soften(watched) == Softened(wanted_velocity=(0.3, 0.3))

    axis.spasm.cycles = 1
    assert (soften(watched).spasm_ratio, soften(watched).clonus_ratio) == (0.9, 1.0)
    axis.spasm.cycles, axis.clonus.lasts = 0, True
    assert (soften(watched).spasm_ratio, soften(watched).clonus_ratio) == (1.0, 0.9)
    assert list(monitors.news(watched.legs[0])) == []
    axis.clonus.begins = True
    assert list(monitors.news(watched.legs[0])) == [Event(EventCode.CLONUS_BEGUN, axis.name)]


# --- what was sent --------------------------------------------------------------------------------


@pytest.mark.parametrize("index", [0, 1])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_effort_at_its_limit_saturates_the_leg(core, index, sign):
    axis = core.axes[index]
    for ratio, is_saturated in ((0.999, False), (1.0, True)):
        has_been_sent(axis, effort_si=sign * ratio * axis.limits.effort_max_si)
        assert monitors.is_saturated(core.legs[0]) is is_saturated


CST, CSP = OperationMode.CYCLIC_SYNC_TORQUE, OperationMode.CYCLIC_SYNC_POSITION


@pytest.mark.parametrize(
    ("feedback", "sent_mode", "enabled", "active"),
    [
        (FEEDBACK, CST, True, True),
        (None, CST, True, False),
        (FEEDBACK, CSP, True, False),
        (FEEDBACK, CST, False, False),
        (FEEDBACK._replace(mode_display=CSP), CST, True, False),
        (FEEDBACK._replace(power_state=PowerState.SWITCHED_ON), CST, True, False),
    ],
)
def test_efforts_are_compared_where_a_drive_is_enabled_in_torque_mode(
    core, feedback, sent_mode, enabled, active
):
    (leg,) = core.legs
    hip = leg.axes[0]
    show(hip, feedback=feedback)
    has_been_sent(hip, mode=sent_mode, effort_si=4.0)

    found = monitors.with_sent(leg, [enabled, True])

    assert found.watches[0].sent_si == ((4.0,) if active else ())
