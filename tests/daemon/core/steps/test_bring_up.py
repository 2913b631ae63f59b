"""Bring-up of the drives as the core sees it: mode, verdict and events, on a bus in memory."""

from types import SimpleNamespace

import pytest
from bringup_bench import Bench
from drive_files import CYCLE
from fresh_core import fresh, has_been_sent, show
from gaitd_names import Cause, Doubt, EventCode, Mode, ProgressCode, StopCategory
from memory_bus import MS

from daemon.core.modes import latched_stop
from daemon.core.modes.persistent_state import PersistentState, StoredVerdict
from daemon.core.safety.joints import Joint
from daemon.core.safety.stop_sequence import Step, begin
from daemon.core.slices import Estimated, Passive
from daemon.core.steps import persistence, supervisor
from daemon.core.steps.bring_up import bring_up_core
from daemon.ipc.record import Verdict
from daemon.ipc.report import Event, Progress
from drives.canopen.bus import Frame
from drives.errors import BringUpRefused

JUMPED = StoredVerdict("S0", "encoder_jump", "right/hip", 2.5, 1.5, utc_ns=7)
POWERED = 0x1637
ERROR = bytes.fromhex("3081110000000000")
BUS_OFF = Frame(0x040, bytes(8), is_error=True)


class Session:
    """A core in mode OFF, and a bench with its two drives."""

    def __init__(self, persistent=PersistentState(), **drives):  # noqa: B008 - frozen
        self.built = fresh(persistent)
        self.core = self.built.core
        self.bench = Bench(**drives)
        self.shown = []

    def run(self):
        plans = self.built.plans.usual
        steps = bring_up_core(self.core, plans, self.bench.port, CYCLE)
        while True:
            try:
                progress = next(steps)
            except StopIteration as end:
                return end.value
            assert self.core.mode == Mode.BRINGING_UP
            self.shown.append((progress, self.core.bring_up))

    @property
    def cause(self):
        return self.core.verdict.cause, self.core.verdict.drive

    def told(self, code):
        return [event for event in self.core.events if event.code is code]


def test_drives_that_are_up_are_taken_over_and_nothing_of_before_is_left():
    session = Session()
    core = session.core
    core.verdict, core.load_checked = Verdict(StopCategory.S1, Cause.DRIVE_SILENT), True
    for axis in core.axes:
        axis.stop = begin(Step.HOLD, Joint(), 1)
        show(axis, joint=Joint(known=True), reached_enabled=True)
        has_been_sent(axis, effort_si=5.0)
        axis.sign_proven, axis.serial_number = True, 99
    (leg,) = core.legs
    leg.reference, leg.passive = object(), Passive(guidance_ratio=0.5)
    leg.estimated = Estimated(estimate=object(), bad_cycles=7, stride_count=3)
    core.evidence = {"right/hip": object()}  # of the drive 99, which is another one

    assert session.run() is True

    assert core.mode == Mode.READY
    assert core.drives is not None
    assert [drive.node_id for drive in core.drives.drives] == [axis.node_id for axis in core.axes]
    assert (core.verdict, core.load_checked, core.bring_up) == (Verdict(), False, None)
    for axis in core.axes:
        assert (axis.stop, axis.sensed.joint, axis.sensed.reached_enabled) == (None, Joint(), False)
        assert (axis.sent.effort_si, axis.sign_proven) == (0.0, False)
    assert (leg.reference, leg.estimated.estimate, leg.passive) == (None, None, Passive())
    assert (leg.estimated.bad_cycles, leg.estimated.stride_count) == (0, 3)
    assert core.evidence == {}
    assert core.events == [Event(EventCode.BRING_UP_BEGUN), Event(EventCode.DRIVES_UP)]


def test_tests_of_drives_that_were_changed_out_of_sight_are_forgotten(monkeypatch):
    session, names = Session(), []
    monkeypatch.setattr(
        persistence, "forget_other_drives", lambda _, reports: names.extend(r.name for r in reports)
    )

    session.run()

    assert names == [axis.name for axis in session.core.axes]


def test_each_step_is_shown_with_how_far_it_is():
    session = Session()

    session.run()

    assert session.shown
    for progress, shown in session.shown:
        counts = (progress.done_count, progress.total_count)
        assert shown == Progress(ProgressCode.SETTING_UP, progress.drive, counts)


def test_axes_that_are_not_referenced_are_named_with_the_reason():
    session = Session(PersistentState(damaged=True))

    session.run()

    assert session.core.events[-2:] == [
        Event(EventCode.NOT_REFERENCED, axis, (Doubt.POSE_UNREADABLE,))
        for axis in ("right/hip", "right/slide")
    ]


def test_errors_that_are_found_are_told_once_and_do_not_stop():
    session = Session()
    session.bench.hip.values |= {(0x6041, 0): 0x0218, (0x603F, 0): 0x8130, (0x1001, 0): 0x11}
    for after_ms in (10, 12):
        session.bench.bus.put(Frame(0x085, ERROR), after_ms * MS)

    assert session.run()

    assert session.core.mode == Mode.READY
    for code in (EventCode.FOUND_WITH_ERROR, EventCode.EMCY_IN_BRING_UP):
        (found,) = session.told(code)
        assert (found.subject, found.values) == ("right/hip", (0x8130,))
        assert found.said


def test_a_stop_that_was_latched_before_the_restart_is_fault_after_bring_up():
    session = Session(PersistentState(latched=JUMPED))

    assert session.run()

    assert session.core.mode == Mode.FAULT
    assert session.core.verdict == latched_stop.verdict_of(JUMPED)
    (told,) = session.told(EventCode.STILL_LATCHED)
    assert told.subject == "right/hip"
    assert told.values[-1] == pytest.approx(7e-9)
    assert session.core.causes_reported == {(Cause.ENCODER_JUMP, "right/hip")}


# --- what fails -----------------------------------------------------------------------------------


def test_a_refusal_ends_the_service_and_leaves_the_core_in_off():
    session = Session(hip={"abort_write": {(0x6065, 0): 0x06090030}})
    session.core.reset_cycles_left = 9
    show(session.core.axes[0], followed=True)

    with pytest.raises(BringUpRefused):
        session.run()

    core = session.core
    assert core.mode == Mode.OFF
    assert session.cause == (Cause.BRING_UP_FAILED, "right/hip")
    assert core.verdict.category is core.config.categories.of(Cause.BRING_UP_FAILED)
    assert "6065h" in core.verdict.said
    assert (core.drives, core.reset_cycles_left, core.bring_up) == (None, 0, None)
    assert not core.axes[0].sensed.followed
    assert len(session.told(EventCode.BRING_UP_FAILED)) == 1


def test_a_refusal_of_the_limits_for_one_axis_does_not_end_the_service():
    session = Session(hip={"abort_write": {(0x6065, 0): 0x06090030}})
    session.core.single_axis = SimpleNamespace()

    assert session.run() is False

    assert session.core.mode == Mode.OFF
    assert session.cause == (Cause.BRING_UP_FAILED, "right/hip")
    assert session.core.single_axis is None


def test_a_silent_drive_is_told_once_however_often_it_is_tried():
    session = Session(slide={"dead": True})

    assert session.run() is False
    assert session.run() is False

    assert session.core.mode == Mode.OFF
    assert session.cause == (Cause.DRIVE_SILENT, "right/slide")
    assert len(session.told(EventCode.BRING_UP_FAILED)) == 1
    assert len(session.told(EventCode.BRING_UP_BEGUN)) == 2


@pytest.mark.parametrize("is_off", [True, False])
def test_a_bus_that_fails_is_no_drive_s_fault(is_off):
    session = Session()
    if is_off:
        session.bench.bus.put(BUS_OFF, 20 * MS)
    else:
        session.bench.bus.send_urgent = lambda frames, deadline_ns, clock: len(frames)

    assert session.run() is False

    assert session.core.mode == Mode.OFF
    assert session.cause == (Cause.BUS_OFF if is_off else Cause.BUS_DOWN, "")
    assert ("bus-off" if is_off else "transmit queue") in session.core.verdict.said


@pytest.mark.parametrize(
    ("latched", "verdict"),
    [
        (None, (Cause.DRIVE_POWERED, "right/hip")),
        (JUMPED, (Cause.ENCODER_JUMP, "right/hip")),
        (StoredVerdict("S1", "last_end_unknown"), (Cause.DRIVE_POWERED, "right/hip")),
    ],
)
def test_a_drive_that_holds_the_leg_waits_for_a_reset(latched, verdict):
    session = Session(PersistentState(latched=latched), hip={"disabled_statusword": 0x0240})
    session.bench.hip.values[0x6041, 0] = POWERED
    session.core.single_axis = SimpleNamespace()

    assert session.run() is False

    assert session.core.mode == Mode.FAULT
    assert session.cause == verdict
    assert session.core.verdict.category is not StopCategory.NONE
    assert session.core.single_axis is None
    assert session.core.reset_cycles_left == 0
    assert not session.bench.touched_power()
    holds = Event(EventCode.DRIVE_HOLDS, "right/hip", ("operation_enabled",))
    assert session.core.events[-1] == holds


def test_a_requested_reset_is_consent_to_switch_off_the_drive_that_holds_the_leg():
    session = Session(hip={"disabled_statusword": 0x0240})
    session.bench.hip.values[0x6041, 0] = POWERED
    session.core.reset_cycles_left = 1

    assert session.run() is True

    assert session.core.mode == Mode.READY
    assert (0x6040, 0, 0) in session.bench.hip.written


def test_a_bus_that_is_lost_before_bring_up_is_told_in_mode_off():
    session = Session()

    supervisor.fail_bring_up(session.core, Cause.BUS_DOWN, "", "no such device")

    assert session.core.mode == Mode.OFF
    failed = Event(EventCode.BRING_UP_FAILED, "", (Cause.BUS_DOWN,), "no such device")
    assert session.core.events == [failed]
