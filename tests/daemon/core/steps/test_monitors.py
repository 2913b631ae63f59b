"""Sums and counts over more than one cycle: which monitor of a leg is fed with what."""

from types import SimpleNamespace

import numpy as np
import pytest
from gaitd_names import EventCode, Mode, Stage
from msgspec.structs import replace
from safety_inputs import FEEDBACK, JOINT, LIMITS, THRESHOLDS
from step_inputs import a_core, a_leg, an_axis, now_shows, was_sent

from daemon.core.exercises.exercise import Reference
from daemon.core.safety import soft_limits, stopping_path
from daemon.core.safety.effort_monitor import EffortWatch
from daemon.core.safety.energy import StrideSum
from daemon.core.safety.inverse_dynamics import InverseDynamics
from daemon.core.safety.soft_limits import SoftZone
from daemon.core.safety.spasm import STILL_CYCLES, SpasmRules
from daemon.core.slices import Monitored, Placed, Softened
from daemon.core.steps import monitors
from daemon.ipc.report import Event
from drives.signals import OperationMode, PowerState
from observer.filter.status import Validity

OK, BAD = Validity.OK, Validity.BAD
WHOLE = (8.0, 90.0)
"""Need of the reference's motion, N·m and N."""


SLIDE_LIMITS = LIMITS._replace(quick_stop_deceleration_si_per_s2=30.0, clonus_swing_si=6.0)


@pytest.fixture
def core(monkeypatch):
    """A core in GAIT whose axes move at 0.2 rad and 0.5 m, referenced and enabled."""
    monkeypatch.setattr(monitors.stopping_path, "least_ratio", lambda *given: given)
    monkeypatch.setattr(monitors.inverse_dynamics, "evaluate", lambda *_: InverseDynamics())
    monkeypatch.setattr(
        monitors.inverse_dynamics,
        "needed",
        lambda *given: SimpleNamespace(certain=(given, given), whole=WHOLE),
    )
    axes = [
        an_axis(
            name,
            joint=JOINT._replace(position_si=position_si, velocity_si=velocity_si),
            gravity_si=7.0,
            limits=limits,
            energy=StrideSum(),
            residual=StrideSum(),
        )
        for name, position_si, velocity_si, limits in (
            ("right/hip", 0.2, 0.5, LIMITS),
            ("right/slide", 0.5, -0.4, SLIDE_LIMITS),
        )
    ]
    reference = Reference((0.2, 0.5), (0.3, 0.1), (0.0, 0.0), guided=True)
    leg = a_leg(
        *axes,
        placed=Placed(0.9),
        reference=reference,
        mechanism="mechanism",
        friction_laws="laws",
        parameters=None,
    )
    config = SimpleNamespace(
        thresholds=THRESHOLDS, period_s=0.01, spasm=SpasmRules(50, 0.2, 0.1, 0.01)
    )
    return a_core(leg, mode=Mode.GAIT, config=config)


def update(core, *, homing=False):
    """Monitor the leg for one cycle."""
    (leg,) = core.legs
    limits = LIMITS, SLIDE_LIMITS
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
    now_shows(slide, joint=slide.sensed.joint._replace(fresh=False))
    update(core)

    assert leg.monitored.window_cycles == window_cycles
    assert monitors.stride_energy(leg, hip) == pytest.approx(4 * 10.0 * 0.005)
    assert monitors.stride_energy(leg, slide) == pytest.approx(3 * 10.0 * 0.005)
    for stride_hz in (0.3, 0.7):
        leg.exercise = plays(stride_hz=stride_hz)
        update(core)
        assert monitors.stride_energy(leg, hip) == pytest.approx(10.0 * 0.005)
    monitors.clear_energy(core)
    assert [monitors.stride_energy(leg, axis) for axis in leg.axes] == [0.0, 0.0]


@pytest.mark.parametrize(
    ("exercise", "still_cycles", "drift"),
    [
        (plays(), 0, 6.25),
        (plays(), STILL_CYCLES - 1, 6.25),
        (plays(), STILL_CYCLES, 0.0),
        (plays(), 99, 0.0),
        (plays(Stage.ENDING), 0, 0.0),
        (plays(Stage.PREPARING), 0, 0.0),
        (plays(stride_hz=None), 0, 0.0),
        (None, 0, 0.0),
    ],
)
def test_the_residual_is_a_mean_over_a_whole_stride_of_a_gait_in_motion(
    core, monkeypatch, exercise, still_cycles, drift
):
    (leg,) = core.legs
    leg.exercise = exercise
    known = SimpleNamespace(residual=lambda index: 6.25 + index)
    monkeypatch.setattr(monitors.inverse_dynamics, "evaluate", lambda *_: known)
    monkeypatch.setattr(monitors.effort_monitor, "update", lambda watch, *_, **__: watch)
    for axis in core.axes:
        joint = axis.sensed.joint._replace(still_cycles=still_cycles)
        now_shows(axis, joint=joint)
    for count in range(200):
        assert monitors.stride_drift(leg, core.axes[0]) == 0.0, count
        update(core)

    expected = drift and drift + 1.0
    assert monitors.stride_drift(leg, core.axes[0]) == pytest.approx(drift)
    assert monitors.stride_drift(leg, core.axes[1]) == pytest.approx(expected)
    leg.exercise = exercise and plays(Stage.ENDING, stride_hz=exercise.stride_hz)
    update(core)
    assert monitors.stride_drift(leg, core.axes[0]) == 0.0


@pytest.mark.parametrize("index", [0, 1])
@pytest.mark.parametrize(
    ("changes", "homing", "pose_known", "free", "may_give_torque"),
    [
        ({}, False, True, True, True),
        ({"referenced": False}, False, False, True, True),
        ({"joint": JOINT._replace(position_si=9.0)}, False, True, False, True),
        ({"joint": JOINT._replace(position_si=-9.0)}, False, True, False, True),
        ({"joint": JOINT._replace(position_si=LIMITS.position_max_si)}, False, True, True, True),
        ({"joint": JOINT._replace(position_si=LIMITS.position_min_si)}, False, True, True, True),
        (
            {"joint": JOINT._replace(position_si=9.0), "referenced": False},
            *(False, False, True, True),
        ),
        ({"feedback": None}, False, True, True, False),
        (
            {"feedback": FEEDBACK._replace(power_state=PowerState.SWITCH_ON_DISABLED)},
            *(False, True, True, False),
        ),
        ({}, True, False, True, True),
    ],
)
def test_the_effort_monitor_knows_pose_range_and_power(
    core, monkeypatch, index, changes, homing, pose_known, free, may_give_torque
):
    fed = []
    dynamics = InverseDynamics()
    monkeypatch.setattr(monitors.inverse_dynamics, "evaluate", lambda *_: dynamics)
    monkeypatch.setattr(
        monitors.effort_monitor, "update", lambda *given, **named: fed.append((given, named))
    )
    axis = core.axes[index]
    now_shows(axis, **changes)
    watch = core.legs[0].monitored.watches[index]

    update(core, homing=homing)

    given, named = fed[index]
    assert given == (watch, axis.sensed.joint, dynamics, index, axis.limits)
    assert named == {
        "mismatch_cycles": THRESHOLDS.sign_mismatch_cycles,
        "may_give_torque": may_give_torque,
        "free": free,
        "pose_known": pose_known,
    }


@pytest.mark.parametrize("assist_si", [(0.0, 0.0), (0.0, 1.0), (0.0, -1.0)])
def test_where_the_leg_would_come_to_rest_is_known_with_its_pose_alone(core, assist_si):
    (leg,) = core.legs
    hip = leg.axes[0]
    leg.assist = replace(leg.assist, effort_si=assist_si)
    now_shows(hip, joint=hip.sensed.joint._replace(position_si=0.69))
    update(core)

    reaction_s = stopping_path.reaction_s(assisted=assist_si != (0.0, 0.0))
    assert leg.monitored.stopping_end_si == (
        stopping_path.end_of(0.69, 0.5, 20.0, reaction_s),
        stopping_path.end_of(0.5, -0.4, 30.0, reaction_s),
    )
    assert leg.monitored.stopping_ratio == (
        *("mechanism", (0.69, 0.5), (0.5, -0.4), (20.0, 30.0), reaction_s),
    )
    assert leg.monitored.zone == soft_limits.zone_at(
        (LIMITS, SLIDE_LIMITS), THRESHOLDS, (0.69, 0.5), 0.9
    )
    efforts = monitors.slowed(leg, (30.0, 30.0))
    assert efforts[0] < 30.0
    leg.is_located = False
    update(core)
    assert leg.monitored.stopping_end_si == (0.69, 0.5)
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
        now_shows(axis, wanted_velocity_si=0.3)
    now_shows(core.axes[1], wanted_velocity_si=0.4)
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

    if spasm_fed:
        ((patient, velocity, wanted, needed, still, rise, standstill),) = hip.spasm.fed
        assert (patient, velocity, wanted, still) == (6.0, 0.5, 0.3, 0)
        assert (rise, standstill) == (LIMITS.spasm_rise_si, LIMITS.standstill_si_per_s)
        assert needed != 0.0
    else:
        assert hip.spasm.fed == ["reset"]
    swing = "reset" if clonus_fed == "reset" else (clonus_fed, LIMITS.clonus_swing_si)
    assert hip.clonus.fed == [swing]
    if guided_motion:
        assert slide.spasm.fed[0][0] == 7.0
        assert slide.clonus.fed == [(7.0, SLIDE_LIMITS.clonus_swing_si)]
    else:
        assert (slide.spasm.fed, slide.clonus.fed) == (["reset"], ["reset"])


@pytest.mark.parametrize("guided", [True, False, None])
def test_a_guided_reference_needs_effort_for_its_acceleration(watched, guided):
    (leg,) = watched.legs
    reference = leg.reference._replace(guided=bool(guided))
    leg.reference = None if guided is None else reference
    before = Softened(wanted_velocity=(0.1, 0.15))

    found = soften(watched, before)

    needed = [axis.spasm.fed[0][3] for axis in watched.axes]
    if guided:
        laws_and_pose = ("mechanism", "laws", (0.2, 0.5), (0.3, 0.4))
        for *given, acceleration in needed:
            assert tuple(given) == laws_and_pose
            assert acceleration == pytest.approx((20.0, 25.0))
    else:
        assert needed == [0.0, 0.0]
    assert found.wanted_velocity == (0.3, 0.4)
    assert found.needed_si == (WHOLE if guided else None)


@pytest.mark.parametrize("index", [0, 1])
def test_a_spasm_and_clonus_of_either_axis_soften_the_leg_and_clonus_is_told(watched, index):
    axis = watched.axes[index]
    assert soften(watched) == Softened(wanted_velocity=(0.3, 0.4), needed_si=WHOLE)

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
    for ratio, is_saturated in ((0.999, False), (1.0, True), (1.1, True)):
        was_sent(axis, effort_si=sign * ratio * axis.limits.effort_max_si)
        assert monitors.is_saturated(core.legs[0]) is is_saturated


CST, CSP = OperationMode.CYCLIC_SYNC_TORQUE, OperationMode.CYCLIC_SYNC_POSITION


@pytest.mark.parametrize("index", [0, 1])
@pytest.mark.parametrize(
    ("feedback", "sent_mode", "enabled", "active"),
    [
        (FEEDBACK, CST, True, True),
        (None, CST, True, False),
        (FEEDBACK, CSP, True, False),
        (FEEDBACK, CST, False, False),
        (FEEDBACK._replace(mode_display=CSP), CST, True, False),
        (FEEDBACK._replace(mode_display=CSP), CSP, True, False),
        (FEEDBACK._replace(power_state=PowerState.SWITCHED_ON), CST, True, False),
        (FEEDBACK._replace(power_state=PowerState.QUICK_STOP_ACTIVE), CST, True, False),
    ],
)
def test_efforts_are_compared_where_a_drive_is_enabled_in_torque_mode(
    core, index, feedback, sent_mode, enabled, active
):
    (leg,) = core.legs
    axis = leg.axes[index]
    now_shows(axis, feedback=feedback)
    was_sent(axis, mode=sent_mode, effort_si=4.0)

    found = monitors.with_sent(leg, [enabled if one == index else True for one in (0, 1)])

    sent = [(0.0,), (0.0,)]
    sent[index] = (4.0,) if active else ()
    assert [watch.sent_si for watch in found.watches] == sent
