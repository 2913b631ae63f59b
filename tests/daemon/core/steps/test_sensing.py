"""What one axis shows: a sample and what is wanted of its drive in, a slice out; then the leg."""

import dataclasses
from types import SimpleNamespace

import pytest
from fresh_core import fresh, has_been_sent, show
from gaitd_names import Doubt, EventCode, Mode
from msgspec.structs import replace
from safety_inputs import FEEDBACK, JOINT, LIMITS, THRESHOLDS

from daemon.core.exercises.exercise import Reference
from daemon.core.modes.persistent_state import PersistentState, StoredAxis
from daemon.core.safety.joints import Joint
from daemon.core.safety.stop_sequence import Step
from daemon.core.slices import Placed, Sensed
from daemon.core.steps import sensing
from daemon.core.steps.sensing import SensingInputs, news, place, sense
from daemon.ipc.report import Event
from drives.cia402.units import AxisScaling, expected_base
from drives.signals import OperationMode, PowerState

AXIS = SimpleNamespace(
    name="right/hip",
    limits=LIMITS,
    scaling=AxisScaling(1000.0, 0.0, 0.1, 10.0, 1000, 1.0, 1.0),
)
WANTED = SensingInputs(
    origin_moved=False,
    enable_wanted=True,
    is_stopping=False,
    mode_sent=OperationMode.CYCLIC_SYNC_TORQUE,
)
UNWANTED = replace(WANTED, enable_wanted=False)
KNOWN = Sensed(
    feedback=FEEDBACK,
    joint=Joint(known=True, fresh=True, position_si=0.1, sample_ns=1, counts=100),
    referenced=True,
    followed=True,
    doubt=Doubt.NONE,
    watched=True,
    sign_trusted=True,
)
SYNC_NS = 10_000_001


def sensed(before=KNOWN, now=WANTED, **shown):
    return sense(AXIS, before, FEEDBACK._replace(**shown), now, THRESHOLDS, SYNC_NS)


def trust(found):
    return found.referenced, found.followed, found.watched, found.sign_trusted


@pytest.mark.parametrize(
    ("shown", "left", "doubt"),
    [
        ({}, (True, True, True, True), Doubt.NONE),
        ({"sample_age_cycles": 2}, (True, True, True, True), Doubt.NONE),
        ({"sample_age_cycles": 3}, (True, False, False, False), Doubt.NONE),
        ({"rebooted": True}, (False, False, False, False), Doubt.REBOOTED),
        ({"reference_lost": True}, (False, False, True, False), Doubt.ENCODER_ERROR),
        ({"position_counts": 9000}, (False, False, True, False), Doubt.ENCODER_JUMPED),
    ],
)
def test_what_is_still_known_of_an_axis_after_its_sample(shown, left, doubt):
    found = sensed(**shown)

    assert (trust(found), found.doubt) == (left, doubt)
    told = [Event(EventCode.REFERENCE_LOST, "right/hip", (doubt,))]
    told = [] if doubt is Doubt.NONE else told
    assert list(news(AXIS, KNOWN, found)) == told


def test_an_error_code_that_no_emcy_told_is_told_once_and_only_in_fault():
    text = {"error_code": 0x2310, "error_text": "overcurrent"}
    well, fault = sensed(**text), sensed(power_state=PowerState.FAULT, **text)
    event = Event(EventCode.ERROR_CODE_SHOWN, "right/hip", (0x2310,), "overcurrent")

    assert list(news(AXIS, KNOWN, fault)) == [event]
    assert list(news(AXIS, well, fault)) == [event]
    for before, after in ((KNOWN, well), (fault, fault), (fault, well)):
        assert list(news(AXIS, before, after)) == []


def test_what_was_lost_is_not_told_again_and_comes_back_by_no_sample():
    lost = sensed(rebooted=True)
    after = sensed(replace(lost, joint=KNOWN.joint), reference_lost=True)

    assert (trust(after), after.doubt) == ((False,) * 4, Doubt.REBOOTED)
    assert list(news(AXIS, lost, after)) == []


def test_a_step_of_the_origin_is_no_motion():
    moved = sensed(now=replace(WANTED, origin_moved=True), position_counts=9000)

    assert (moved.referenced, moved.origin_moved, moved.joint.velocity_si) == (True, True, 0.0)


@pytest.mark.parametrize(
    ("shown", "reached", "unready"),
    [
        ({}, True, 0),
        ({"power_state": PowerState.SWITCHED_ON}, False, 5),
        ({"mode_display": OperationMode.CYCLIC_SYNC_POSITION}, False, 5),
        ({"following": False}, False, 5),
    ],
)
def test_a_drive_is_ready_when_it_is_enabled_in_its_mode_and_follows(shown, reached, unready):
    before = replace(KNOWN, unready_cycles=4, shown_unpowered=True, unexpected_enable_cycles=3)

    found = sensed(before, **shown)

    assert (found.reached_enabled, found.unready_cycles) == (reached, unready)
    assert (found.shown_unpowered, found.unexpected_enable_cycles) == (False, 0)


@pytest.mark.parametrize(
    ("stopping", "seen_off", "shown", "cycles"),
    [
        (False, False, {}, 4),
        (True, False, {}, 0),
        (True, True, {}, 4),
        (False, True, {"power_state": PowerState.SWITCH_ON_DISABLED}, 0),
        (False, False, {"power_state": PowerState.UNKNOWN, "fresh": False}, 3),
    ],
)
def test_power_that_nothing_asks_for_is_counted(stopping, seen_off, shown, cycles):
    before = replace(KNOWN, shown_unpowered=seen_off, unexpected_enable_cycles=3)

    found = sensed(before, replace(UNWANTED, is_stopping=stopping), **shown)

    assert found.unexpected_enable_cycles == cycles
    assert (found.reached_enabled, found.unready_cycles) == (False, 0)


def test_an_error_of_bring_up_counts_until_a_fresh_sample_without_a_fault():
    failed = replace(KNOWN, bring_up_error=(0x8611, "following error"))

    assert sensed(failed, fresh=False).bring_up_error == (0x8611, "following error")
    assert sensed(failed, power_state=PowerState.FAULT).bring_up_error[0] == 0x8611
    assert sensed(failed).bring_up_error == (0, "")


def test_a_temperature_is_told_when_it_is_overdue_and_when_it_is_back():
    overdue = sensed(temperature_overdue=True)

    assert list(news(AXIS, KNOWN, overdue)) == [Event(EventCode.TEMPERATURE_OVERDUE, "right/hip")]
    assert list(news(AXIS, overdue, overdue)) == []
    assert list(news(AXIS, overdue, KNOWN)) == [Event(EventCode.TEMPERATURE_BACK, "right/hip")]


# --- a leg and a core -----------------------------------------------------------------------------


@pytest.fixture
def core():
    """A core whose axes are referenced at 0.2 rad and 0.5 m."""
    made = fresh().core
    for axis, position_si in zip(made.axes, (0.2, 0.5), strict=True):
        joint = JOINT._replace(position_si=position_si)
        show(axis, joint=joint, referenced=True, gravity_si=7.0, feedback=FEEDBACK)
    return made


def test_what_is_wanted_of_a_drive_follows_from_mode_and_stop(core):
    hip = core.axes[0]
    core.mode = Mode.HOLD
    has_been_sent(hip, mode=OperationMode.CYCLIC_SYNC_POSITION)

    found = sensing.inputs_of(core, hip, FEEDBACK)

    assert found == SensingInputs(False, True, False, OperationMode.CYCLIC_SYNC_POSITION)
    hip.stop = SimpleNamespace(step=Step.DISABLE)
    found = sensing.inputs_of(core, hip, FEEDBACK)
    assert (found.enable_wanted, found.is_stopping) == (False, True)
    core.mode = Mode.REFERENCE
    core.single_axis = SimpleNamespace(axis=hip.name, moves_origin=lambda feedback: True)
    assert sensing.inputs_of(core, hip, FEEDBACK).origin_moved


def test_between_two_windows_alarms_are_seen_and_the_joints_stay(core):
    joints = [axis.sensed.joint for axis in core.axes]

    sensing.peek(core, [FEEDBACK, FEEDBACK._replace(alarm_count=3)])
    sensing.alarms_checked(core)

    assert [axis.sensed.joint for axis in core.axes] == joints
    assert [axis.sensed.emergencies_checked for axis in core.axes] == [0, 3]
    checked = core.axes[1].sensed
    sensing.forget(core)
    assert core.axes[1].sensed.joint == Joint()
    sensing.alarms_checked(core)
    assert core.axes[1].sensed.emergencies_checked == checked.emergencies_checked


def test_trust_in_an_axis_is_given_and_taken_by_its_name(core):
    hip, slide = core.axes
    sensing.take_home(hip)
    for axis in core.axes:
        sensing.trust_sign(axis, trusted=True)
        show(axis, followed=True, watched=True)
    assert (hip.sensed.followed, hip.sensed.referenced, hip.sensed.doubt) == (
        *(True, True, Doubt.NONE),
    )

    sensing.doubt(core, hip.name)
    sensing.doubt_sign(core, slide.name)

    assert [axis.sensed.followed for axis in core.axes] == [False, True]
    assert [axis.sensed.sign_trusted for axis in core.axes] == [True, False]
    sensing.lose_positions(core)
    assert not slide.sensed.followed
    assert not slide.sensed.watched


@pytest.mark.parametrize(
    ("report", "followed", "has_bit", "stored", "doubt"),
    [
        ({"reference_lost": True, "homed": True}, True, True, None, Doubt.ENCODER_ERROR),
        ({"homed": True}, False, True, None, Doubt.NONE),
        ({}, False, True, None, Doubt.NOT_HOMED),
        ({}, True, True, None, Doubt.NOT_HOMED),
        ({}, True, False, None, Doubt.NONE),
        ({"homed": True}, True, True, None, Doubt.NONE),
        ({"absolute": True}, True, True, 9.0, Doubt.NONE),
        ({"absolute": True}, False, True, 0.3, Doubt.NONE),
        ({"absolute": True}, False, True, 9.0, Doubt.LEFT_ELSEWHERE),
    ],
)
def test_after_a_bring_up_an_axis_is_referenced_if_it_was_homed_followed_or_where_it_was(
    report, followed, has_bit, stored, doubt
):
    built = fresh()
    core, plans = built.core, list(built.plans.usual)
    before = plans[0].description
    profile = replace(before.profile, referenced_bit=1 if has_bit else None)
    description = dataclasses.replace(before, profile=profile)
    plans[0] = plans[0]._replace(description=description)
    hip = core.axes[0]
    if stored is not None:
        core.persistent = PersistentState(axes={hip.name: StoredAxis(stored, 1)})
        hip.poses = hip.poses._replace(tolerance_si=0.1)
    show(hip, followed=followed, unready_cycles=3, emergencies_checked=2, reached_enabled=True)
    counts = round(0.3 * hip.scaling.counts_per_si)
    shown = SimpleNamespace(
        **{"absolute": False, "homed": False, "reference_lost": False, **report},
        base=expected_base(description),
        serial_number=77,
        position_counts=counts,
        error_code=0x8611,
        error_text="x",
    )

    sensing.begin(core, plans, [shown, shown])

    sensed = hip.sensed
    is_known = doubt is Doubt.NONE
    assert (sensed.referenced, sensed.followed, sensed.doubt) == (is_known, is_known, doubt)
    assert (sensed.watched, sensed.shown_unpowered, sensed.reached_enabled) == (True, True, False)
    assert (sensed.unready_cycles, sensed.unexpected_enable_cycles) == (0, 0)
    assert (sensed.emergencies_checked, sensed.bring_up_error) == (0, (0x8611, "x"))
    assert (hip.serial_number, sensed.feedback, sensed.joint) == (77, None, Joint())


# --- the place of a leg ---------------------------------------------------------------------------

STILL = Reference((0.05, 0.3), (0.0, 0.0), (0.0, 0.0), guided=True)
MOVING = STILL._replace(velocity=(0.2, -0.1))
OPEN_LOOP = STILL._replace(guided=False)


def leg_at(reference, *, is_located=True):
    """A leg at 0.1 rad and 0.3 m."""
    shown = KNOWN, replace(KNOWN, joint=KNOWN.joint._replace(position_si=0.3), gravity_si=7.0)
    return SimpleNamespace(
        axes=tuple(SimpleNamespace(sensed=one) for one in shown),
        mechanism=fresh().core.legs[0].mechanism,
        reference=reference,
        is_located=is_located,
    )


@pytest.mark.parametrize(
    ("reference", "tracking", "wanted_velocity"),
    [
        (STILL, (0.05, 0.0), (0.0, 0.0)),
        (MOVING, (0.05, 0.0), (0.2, -0.1)),
        (OPEN_LOOP, (0.0, 0.0), (0.0, 0.0)),
        (None, (0.0, 0.0), (0.0, 0.0)),
    ],
)
def test_a_leg_is_compared_with_a_reference_that_guides_it(reference, tracking, wanted_velocity):
    placed, shown = place(leg_at(reference), Placed(), may_hold=False)

    assert 0.0 < placed.singularity_ratio < 1.0
    assert all(one.gravity_si not in {0.0, 7.0} for one in shown)
    assert tuple(one.tracking_si for one in shown) == pytest.approx(tracking)
    assert tuple(one.wanted_velocity_si for one in shown) == wanted_velocity


def test_beyond_the_reach_of_a_leg_its_load_stays():
    leg = leg_at(None)
    hip, slide = leg.axes
    slide.sensed = replace(slide.sensed, joint=slide.sensed.joint._replace(position_si=5.0))

    placed, shown = place(leg, Placed(), may_hold=False)

    assert placed.singularity_ratio <= 0.0
    assert [one.gravity_si for one in shown] == [hip.sensed.gravity_si, 7.0]


def test_a_leg_at_an_unknown_place_keeps_what_it_has_shown():
    leg = leg_at(MOVING, is_located=False)

    placed, shown = place(leg, Placed(0.5), may_hold=True)

    assert placed == Placed(1.0)
    assert shown == tuple(axis.sensed for axis in leg.axes)


@pytest.mark.parametrize(
    ("reference", "may_hold", "held_cycles"),
    [(STILL, True, 5), (STILL, False, 0), (MOVING, True, 0), (OPEN_LOOP, True, 0), (None, True, 0)],
)
@pytest.mark.parametrize("is_located", [True, False])
def test_a_leg_is_held_while_a_reference_that_stands_still_guides_it(
    reference, may_hold, held_cycles, is_located
):
    leg = leg_at(reference, is_located=is_located)

    placed, _ = place(leg, Placed(held_cycles=4), may_hold=may_hold)

    assert placed.held_cycles == held_cycles
