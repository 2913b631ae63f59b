"""Setpoints of controllers in the state of the core: received, put in force, and lapsed."""

import math
from types import SimpleNamespace

import pytest
from fresh_core import fresh, has_received, show
from gaitd_names import Lapse, Mode, RequestKind, Role, SetpointRefusal
from msgspec.structs import replace
from safety_inputs import JOINT

from daemon.core.slices import Assisted, LegAssist
from daemon.core.steps import controllers
from daemon.ipc.record import AxisPlan, AxisSetpoint, ModeRequest, Plan, Request, Setpoint

CYCLE = 1000
GOOD = Setpoint(7, 1, CYCLE, AxisSetpoint(2.0), AxisSetpoint(10.0), "right", 0.5)


def receive(core):
    """Check the setpoints that the core has received, as a cycle does."""
    legs, config = core.legs, core.config
    (legs[0].assist,), core.assisted = controllers.receive(
        legs, core.assisted, core.inputs, core.mode, config, CYCLE
    )


def advanced(core, *, enabled=True):
    """The assist of the leg in this cycle."""
    (leg,) = core.legs
    return controllers.advance(leg, core.mode, core.config, CYCLE, enabled=enabled)


def lapsed(core, before):
    """What has become of the setpoints if assist lapses in this cycle."""
    lease = core.inputs.lease
    return controllers.lapse(core.legs, before, lease, core.mode, core.config, CYCLE)


@pytest.fixture
def core():
    """A core in mode TORQUE under lease 7, whose leg has accepted nothing yet."""
    made = fresh().core
    made.mode, made.assisted = Mode.TORQUE, Assisted(torque_lease=7)
    (leg,) = made.legs
    leg.assist = LegAssist(lease=7)
    for axis in made.axes:
        show(axis, joint=JOINT._replace(velocity_si=0.0), reached_enabled=True)
    has_received(made, lease=7)
    return made


@pytest.mark.parametrize(
    ("setpoint", "refusal"),
    [
        (GOOD, None),
        (("leg", "left"), SetpointRefusal.UNKNOWN_LEG),
        (("lease", 6), SetpointRefusal.WRONG_LEASE),
    ],
)
def test_a_setpoint_is_checked_once_and_counted(core, setpoint, refusal):
    (leg,) = core.legs
    if setpoint is not GOOD:
        name, value = setpoint
        fields = {one: getattr(GOOD, one) for one in GOOD.__struct_fields__}
        setpoint = Setpoint(**{**fields, name: value})
    has_received(core, setpoints=(setpoint,))
    for _ in range(2):
        receive(core)

    accepted = refusal is None
    assert core.assisted.accepted_count == accepted
    assert leg.assist.accepted == (setpoint if accepted else None)
    assert leg.assist.seq == (1 if accepted else -1)
    repeated = 2 if refusal is SetpointRefusal.UNKNOWN_LEG else 1
    assert core.assisted.refused_count == ({} if accepted else {refusal: repeated})


def test_another_lease_begins_anew_once_the_assist_of_the_last_one_has_lapsed(core):
    (leg,) = core.legs
    leg.assist = replace(leg.assist, accepted=GOOD, seq=4, effort_si=(2.0, 0.0))
    other = Setpoint(8, 1, CYCLE, leg="right")
    has_received(core, setpoints=(other,), lease=8)

    receive(core)
    assert (leg.assist.lease, leg.assist.seq, leg.assist.accepted) == (8, -1, None)
    leg.assist = replace(leg.assist, effort_si=(0.0, 0.0), fade_si=None)
    receive(core)

    assert (leg.assist.accepted, leg.assist.seq) == (other, 1)


def test_a_setpoint_for_no_leg_hides_none_behind_it_and_assist_in_force_is_followed_on(core):
    (leg,) = core.legs
    leg.assist = replace(leg.assist, effort_si=(2.0, 0.0))
    has_received(core, setpoints=(Setpoint(7, 1, CYCLE, leg="left"), GOOD))

    receive(core)

    assert leg.assist.accepted == GOOD


def test_an_older_lease_is_another_lease_as_well(core):
    (leg,) = core.legs
    leg.assist = replace(leg.assist, lease=9, accepted=GOOD, seq=4, effort_si=(2.0, 0.0))
    has_received(core, setpoints=(GOOD,))

    receive(core)

    assert (leg.assist.lease, leg.assist.seq, leg.assist.accepted) == (7, -1, None)
    assert lapsed(core, Assisted(torque_lease=9, lapse_count=2)).lapse_count == 3


def test_a_mode_without_assist_keeps_no_setpoint(core):
    (leg,) = core.legs
    leg.assist = replace(leg.assist, accepted=GOOD)
    core.mode = Mode.HOLD

    receive(core)

    assert leg.assist.accepted is None


@pytest.mark.parametrize(("mode", "lease", "kept"), [(Mode.TORQUE, 9, False), (Mode.GAIT, 7, True)])
def test_mode_torque_begins_under_the_lease_of_now_and_without_assist(core, mode, lease, kept):
    (leg,) = core.legs
    leg.assist = replace(leg.assist, accepted=GOOD)
    plan = Plan(1.0, 1.0, 1.0, AxisPlan(3.0), AxisPlan())
    request = Request(1, RequestKind.MODE, CYCLE, ModeRequest(mode), Role.SESSION, plan)

    (assist,), assisted = controllers.begun(core.legs, core.assisted, request, 9)

    assert assisted.torque_lease == lease
    assert (assist.accepted is GOOD) is kept
    assert assisted.cap_si == ((3.0, math.inf) if mode is Mode.GAIT else (math.inf, math.inf))


OLD = CYCLE - 11


@pytest.mark.parametrize(
    ("mode", "lease", "for_cycle", "effort_si", "elapsed_s", "reason"),
    [
        (Mode.TORQUE, 7, CYCLE, (0.0, 0.0), 9.0, Lapse.NONE),
        (Mode.TORQUE, 8, CYCLE, (0.0, 0.0), 9.0, Lapse.LEASE_ENDED),
        (Mode.TORQUE, 7, OLD, (0.0, 0.0), 9.0, Lapse.STALE),
        (Mode.TORQUE, 7, None, (0.0, 0.0), 0.5, Lapse.NONE),
        (Mode.TORQUE, 7, None, (0.0, 0.0), 0.51, Lapse.NO_SETPOINT),
        (Mode.TORQUE, 7, None, (0.0, 0.0), None, Lapse.NONE),
        (Mode.GAIT, 8, CYCLE, (2.0, 0.0), 9.0, Lapse.NONE),
        (Mode.GAIT, 8, None, (2.0, 0.0), 9.0, Lapse.LEASE_ENDED),
        (Mode.GAIT, 8, None, (0.0, 0.0), 9.0, Lapse.NONE),
        (Mode.GAIT, 8, OLD, (2.0, 0.0), 9.0, Lapse.STALE),
        (Mode.HOLD, 8, OLD, (2.0, 0.0), 9.0, Lapse.NONE),
    ],
)
def test_assist_lapses_with_its_lease_and_with_stale_or_missing_setpoints(
    core, mode, lease, for_cycle, effort_si, elapsed_s, reason
):
    (leg,) = core.legs
    core.mode = mode
    has_received(core, lease=lease)
    accepted = None if for_cycle is None else Setpoint(7, 1, for_cycle, leg="right")
    leg.assist = replace(leg.assist, accepted=accepted, effort_si=effort_si)
    leg.exercise = None if elapsed_s is None else SimpleNamespace(elapsed_s=elapsed_s)

    after = lapsed(core, core.assisted)

    assert (Lapse.NONE if after is None else after.lapse_reason) is reason
    assert after is None or after.lapse_count == 1


@pytest.mark.parametrize(
    ("mode", "for_cycle", "is_followed", "ratio"),
    [
        (Mode.TORQUE, CYCLE, True, 1.0),
        (Mode.GAIT, CYCLE, True, 0.99),
        (Mode.GAIT, OLD, False, 1.0),
        (Mode.HOLD, CYCLE, False, 1.0),
    ],
)
def test_a_fresh_setpoint_is_followed_in_a_mode_that_takes_it(
    core, mode, for_cycle, is_followed, ratio
):
    (leg,) = core.legs
    core.mode = mode
    accepted = Setpoint(7, 1, for_cycle, AxisSetpoint(0.5), AxisSetpoint(), "right", 0.5)
    leg.assist = replace(leg.assist, accepted=accepted)

    now = advanced(core)

    assert now.added_si == ((0.5, 0.0) if is_followed else (0.0, 0.0))
    assert now.stiffness_ratio == pytest.approx(ratio)


def test_in_mode_torque_a_setpoint_of_full_stiffness_is_followed_as_it_is(core):
    full = Setpoint(7, 1, CYCLE, AxisSetpoint(0.5), leg="right")

    assert controllers._followed(full, core.mode, core.config, CYCLE) is full
    assert controllers._followed(None, core.mode, core.config, CYCLE) is None


def test_where_no_drive_is_to_be_enabled_assist_is_gone_at_once(core):
    (leg,) = core.legs
    leg.assist = replace(leg.assist, effort_si=(9.0, 9.0), accepted=None)

    assert advanced(core).added_si != (0.0, 0.0)
    assert advanced(core, enabled=False).added_si == (0.0, 0.0)


def test_assist_that_is_not_a_number_makes_the_command_one_that_is_refused(core, monkeypatch):
    (leg,) = core.legs
    leg.assist = replace(leg.assist, accepted=GOOD, effort_si=(2.0, 2.0))
    monkeypatch.setattr(controllers.assist.bounds, "bound_assist", lambda *_: None)

    leg.assist = advanced(core)
    assert all(map(math.isnan, leg.assist.added_si))
    assert (leg.assist.accepted, leg.assist.effort_si) == (None, (0.0, 0.0))
    assert advanced(core).added_si == (0.0, 0.0)
