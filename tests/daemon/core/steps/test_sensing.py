"""What one axis shows: a sample and what is wanted of its drive in, a slice out; then the leg."""

from types import SimpleNamespace

import pytest
from gaitd_names import Doubt, EventCode, Mode
from msgspec.structs import replace
from safety_inputs import FEEDBACK, LIMITS, THRESHOLDS
from sessions import demo
from step_inputs import AT_REST, a_core, a_leg, an_axis, now_shows, was_sent

from daemon.config.robot import leg_parameters
from daemon.core.exercises.exercise import Reference
from daemon.core.modes.persistent_state import PersistentState, PoseRules, StoredAxis
from daemon.core.safety.joints import Joint
from daemon.core.safety.stop_sequence import Step
from daemon.core.slices import Placed, Sensed
from daemon.core.steps import sensing
from daemon.core.steps.sensing import SensingInputs, news, place, sense
from daemon.ipc.report import Event
from drives.bringup.bringup import DriveReport
from drives.cia402.units import AxisScaling
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


def test_a_doubt_stays_while_nothing_new_is_lost():
    assert sensed(replace(KNOWN, doubt=Doubt.REBOOTED)).doubt is Doubt.REBOOTED


def test_a_step_is_a_jump_beyond_what_the_joint_can_reach():
    joint = Joint(known=True, fresh=True, elapsed_s=0.01)
    reach_si = sensing.jump_reach_si(joint, LIMITS, THRESHOLDS)

    for step_si, doubt in (
        (reach_si, Doubt.NONE),
        (-reach_si, Doubt.NONE),
        (1.01 * reach_si, Doubt.ENCODER_JUMPED),
        (-1.01 * reach_si, Doubt.ENCODER_JUMPED),
    ):
        stepped = joint._replace(step_si=step_si)
        assert sensing._reference_lost(stepped, LIMITS, FEEDBACK, THRESHOLDS) is doubt


def test_an_error_code_that_no_emcy_told_is_told_once_and_only_in_fault():
    text = {"error_code": 0x2310, "error_text": "overcurrent"}
    well, fault = sensed(**text), sensed(power_state=PowerState.FAULT, **text)
    event = Event(EventCode.ERROR_CODE_SHOWN, "right/hip", (0x2310,), "overcurrent")

    assert list(news(AXIS, KNOWN, fault)) == [event]
    assert list(news(AXIS, well, fault)) == [event]
    assert list(news(AXIS, Sensed(), fault)) == [event]
    assert list(news(AXIS, replace(fault, referenced=False), Sensed())) == []
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


CSP, HOMING = OperationMode.CYCLIC_SYNC_POSITION, OperationMode.HOMING


@pytest.mark.parametrize(
    ("sent", "shown", "is_ready"),
    [
        ({}, {}, True),
        ({}, {"power_state": PowerState.SWITCHED_ON}, False),
        ({}, {"power_state": PowerState.QUICK_STOP_ACTIVE}, False),
        ({}, {"mode_display": CSP}, False),
        ({"mode_sent": CSP}, {}, False),
        ({"mode_sent": CSP}, {"mode_display": CSP}, True),
        ({}, {"following": False}, False),
        ({"mode_sent": HOMING}, {"mode_display": HOMING, "following": False}, True),
    ],
)
def test_a_drive_is_ready_when_it_is_enabled_in_its_mode_and_follows(sent, shown, is_ready):
    before = replace(KNOWN, unready_cycles=5, shown_unpowered=True, unexpected_enable_cycles=3)
    now = replace(WANTED, **sent)

    found = sensed(before, now, **shown)

    assert (found.reached_enabled, found.unready_cycles) == (is_ready, 0 if is_ready else 6)
    assert (found.shown_unpowered, found.unexpected_enable_cycles) == (False, 0)
    assert sensed(replace(before, reached_enabled=True), now, **shown).reached_enabled


ENABLED, OFF = PowerState.OPERATION_ENABLED, PowerState.SWITCH_ON_DISABLED


@pytest.mark.parametrize(
    ("stopping", "seen_off", "state", "fresh", "cycles"),
    [
        (False, False, ENABLED, True, 4),
        (False, False, ENABLED, False, 4),
        (True, False, ENABLED, True, 0),
        (True, True, ENABLED, True, 4),
        (False, True, OFF, True, 0),
        (False, False, PowerState.UNKNOWN, False, 3),
        (False, False, PowerState.UNKNOWN, True, 4),
    ],
)
def test_power_that_nothing_asks_for_is_counted(stopping, seen_off, state, fresh, cycles):
    before = replace(
        KNOWN,
        shown_unpowered=seen_off,
        unexpected_enable_cycles=3,
        reached_enabled=True,
        unready_cycles=2,
    )

    found = sensed(before, replace(UNWANTED, is_stopping=stopping), power_state=state, fresh=fresh)

    assert found.unexpected_enable_cycles == cycles
    assert (found.reached_enabled, found.unready_cycles) == (False, 0)
    assert found.shown_unpowered is (seen_off or state is OFF)


@pytest.mark.parametrize("state", PowerState)
def test_a_drive_is_unpowered_where_no_single_controlword_enables_power(state):
    off = PowerState.NOT_READY_TO_SWITCH_ON, OFF, PowerState.FAULT

    assert sensed(now=UNWANTED, power_state=state).shown_unpowered is (state in off)


def test_an_error_of_bring_up_counts_until_a_fresh_sample_without_a_fault():
    failed = replace(KNOWN, bring_up_error=(0x8611, "following error"))

    assert sensed(failed, fresh=False).bring_up_error == (0x8611, "following error")
    assert sensed(failed, power_state=PowerState.FAULT).bring_up_error[0] == 0x8611
    assert sensed(failed).bring_up_error == (0, "")


def test_a_temperature_is_told_when_it_is_overdue_and_when_it_is_back():
    overdue = sensed(temperature_overdue=True)

    assert list(news(AXIS, KNOWN, overdue)) == [Event(EventCode.TEMPERATURE_OVERDUE, "right/hip")]
    assert list(news(AXIS, overdue, overdue)) == []
    for back in (KNOWN, replace(KNOWN, feedback=None)):
        told = [Event(EventCode.TEMPERATURE_BACK, "right/hip")]
        assert list(news(AXIS, overdue, back)) == told
    assert list(news(AXIS, Sensed(), KNOWN)) == []


# --- a leg and a core -----------------------------------------------------------------------------


@pytest.fixture
def core():
    """A core in HOLD whose axes are referenced at 0.2 rad and 0.5 m."""
    axes = [
        an_axis(name, joint=AT_REST._replace(position_si=position_si))
        for name, position_si in (("right/hip", 0.2), ("right/slide", 0.5))
    ]
    return a_core(a_leg(*axes))


def test_what_is_wanted_of_a_drive_follows_from_mode_and_stop(core):
    hip = core.axes[0]
    was_sent(hip, mode=OperationMode.CYCLIC_SYNC_POSITION)

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
    assert core.axes[1].sensed.feedback.alarm_count == 3
    assert [axis.sensed.emergencies_checked for axis in core.axes] == [0, 3]
    checked = [axis.sensed for axis in core.axes]
    sensing.alarms_checked(core)
    assert all(axis.sensed is one for axis, one in zip(core.axes, checked, strict=True))
    sensing.peek(core, [FEEDBACK, FEEDBACK._replace(alarm_count=1)])
    sensing.alarms_checked(core)
    assert core.axes[1].sensed.emergencies_checked == 1
    sensing.forget(core)
    assert core.axes[1].sensed.joint == Joint()
    sensing.alarms_checked(core)
    assert core.axes[1].sensed.emergencies_checked == 1


@pytest.mark.parametrize("index", [0, 1])
def test_trust_in_an_axis_is_given_and_taken_by_its_name(core, index):
    axis, other = core.axes[index], core.axes[1 - index]
    now_shows(axis, referenced=False, followed=False, doubt=Doubt.REBOOTED)
    sensing.take_home(axis)
    shown = axis.sensed
    assert (shown.followed, shown.referenced, shown.doubt) == (True, True, Doubt.NONE)
    for one in core.axes:
        sensing.trust_sign(one, trusted=True)
    assert (axis.sensed.sign_trusted, other.sensed.sign_trusted) == (True, True)

    sensing.doubt(core, axis.name)
    sensing.doubt_sign(core, axis.name)

    assert (axis.sensed.followed, other.sensed.followed) == (False, True)
    assert (axis.sensed.sign_trusted, other.sensed.sign_trusted) == (False, True)
    sensing.lose_positions(core)
    for one in core.axes:
        assert (one.sensed.followed, one.sensed.watched) == (False, False)


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
@pytest.mark.parametrize("index", [0, 1])
def test_after_a_bring_up_an_axis_is_referenced_if_it_was_homed_followed_or_where_it_was(
    core, monkeypatch, index, report, followed, has_bit, stored, doubt
):
    monkeypatch.setattr(sensing, "axis_scaling", lambda plan, base: AXIS.scaling)
    names = "hip", "slide"
    bits = [1, 1]
    bits[index] = 1 if has_bit else None
    plans = [
        SimpleNamespace(description=SimpleNamespace(profile=SimpleNamespace(referenced_bit=bit)))
        for bit in bits
    ]
    reports = [
        DriveReport(
            *(one, f"of {one}", PowerState.SWITCH_ON_DISABLED, 0, 300, 0),
            absolute=False,
            serial_number=77 + number,
            homed=True,
            error_register=0,
            error_code=0x8611 + number,
            error_text=one,
            emergencies=(),
            reference_lost=False,
        )
        for number, one in enumerate(names)
    ]
    reports[index] = reports[index]._replace(**{"homed": False, **report})
    core.persistent = PersistentState()
    for axis in core.axes:
        axis.poses = PoseRules(tolerance_si=0.1, believed_without_pose=False)
        now_shows(axis, unready_cycles=3, emergencies_checked=2, unexpected_enable_cycles=4)
    axis = core.axes[index]
    now_shows(axis, followed=followed, watched=False)
    if stored is not None:
        core.persistent = PersistentState(axes={axis.name: StoredAxis(stored, 1)})

    sensing.begin(core, plans, reports)

    for number, one in enumerate(core.axes):
        is_known = number != index or doubt is Doubt.NONE
        expected = Sensed(
            referenced=is_known,
            followed=is_known,
            doubt=Doubt.NONE if is_known else doubt,
            watched=True,
            shown_unpowered=True,
            bring_up_error=(0x8611 + number, names[number]),
            gravity_si=7.0,
        )
        assert one.sensed == expected
        assert (one.serial_number, one.scaling) == (77 + number, AXIS.scaling)


# --- the place of a leg ---------------------------------------------------------------------------

MECHANISM = tuple(map(float, leg_parameters(demo().robot)))
STILL = Reference((0.05, 0.3), (0.0, 0.0), (0.0, 0.0), guided=True)
MOVING = STILL._replace(velocity=(0.2, -0.1))
OPEN_LOOP = STILL._replace(guided=False)


def leg_at(reference, *, is_located=True):
    """A leg at 0.1 rad and 0.3 m."""
    shown = KNOWN, replace(KNOWN, joint=KNOWN.joint._replace(position_si=0.3), gravity_si=7.0)
    return SimpleNamespace(
        axes=tuple(SimpleNamespace(sensed=one) for one in shown),
        mechanism=MECHANISM,
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
    [
        (STILL, True, 6),
        (STILL, False, 0),
        (MOVING, True, 0),
        (MOVING._replace(velocity=(-0.2, 0.1)), True, 0),
        (OPEN_LOOP, True, 0),
        (None, True, 0),
    ],
)
@pytest.mark.parametrize("is_located", [True, False])
def test_a_leg_is_held_while_a_reference_that_stands_still_guides_it(
    reference, may_hold, held_cycles, is_located
):
    leg = leg_at(reference, is_located=is_located)

    placed, _ = place(leg, Placed(held_cycles=5), may_hold=may_hold)

    assert placed.held_cycles == held_cycles
