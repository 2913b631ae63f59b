"""Power that appears without a request of ours is stopped in every mode, as far as silence.

Another master switches a drive's RPDOs off by SDO and enables it, so that none of our controlwords
arrives, while SYNC and heartbeat feed the drive's watch over us.
"""

import math
import struct

import pytest
from gaitd_names import Cause, EventCode, Mode, Outcome, RequestKind, StopCategory
from reports import verdict_of
from sessions import new_session, reported, restarted
from wire import SYNC, change_what_drives_hear, change_what_drives_say

from daemon.core.safety.stop_sequence import Step
from drives.canopen.frame import Frame
from drives.signals import PowerState
from gaitd_lab.lockstep import LockstepSession

HIP = 5
NMT_STOP = bytes((0x02, HIP))
HEARTBEAT_TIME_WRITTEN = bytes((0x2B, 0x17, 0x10))
"""The last object that bring-up writes; then it waits for a heartbeat, and configures the slide."""
QUICK_STOP_ACTIVE, UNKNOWN = 0x07, 0x61


def write(session, index, sub, value, bits):
    """Another master's SDO download to the hip."""
    size = bits // 8
    head = struct.pack("<BHB", 0x23 | (4 - size) << 2, index, sub)
    data = head + value.to_bytes(size, "little").ljust(4, b"\0")
    session.machine.world.receive(Frame(0x600 + HIP, data))
    session.run(0.01)


def take_over(session, *, permille=500):
    """The hip, deaf to our RPDOs, is enabled and pushes."""
    for index in (0x1400, 0x1401):
        write(session, index, 1, 0x80000000 | (0x200 + 0x100 * (index & 1)) + HIP, 32)
    write(session, 0x6071, 0, permille, 16)
    for word in (0x06, 0x07, 0x0F):
        write(session, 0x6040, 0, word, 16)


def fault(session):
    """After a fault in READY, whose cause is gone: without a stop of ours."""
    session.command("emcy right/slide 0.1 0x2310")
    session.run_until(lambda record: record.mode == Mode.FAULT, within_s=2)
    session.run(0.2)
    assert [axis.stop for axis in session.core.axes] == [None, None]
    return session


def powers(session):
    """Power states of the statuswords that the drives hold."""
    world = session.machine.world
    return {world.node(name).dictionary.value(0x6041, 0) & 0x6F for name in world.drives}


def steps(session):
    return [axis.stop.step for axis in session.core.axes]


def ignore_nmt_stop(session):
    change_what_drives_hear(
        session, lambda frame: Frame(0x7E0, b"") if frame.data[:2] == NMT_STOP else frame
    )


def moved_rad(session, begun):
    angles = [row.hip_angle_rad for row in session.truth.rows[begun:]]
    return max(angles) - min(angles)


def test_a_drive_that_another_master_enables_is_stopped_though_it_hears_no_controlword(
    warm_ready,
):
    session = fault(warm_ready)
    begun = len(session.truth.rows)
    since = len(session.records)

    take_over(session)
    session.run(0.7)

    records = session.records[since:]
    shown = next(n for n, one in enumerate(records) if one.drives[0].power_state == 5)
    verdict = records[shown].verdict
    assert (verdict.cause, verdict.drive) == (Cause.UNEXPECTED_ENABLE, "right/hip")
    assert verdict.category == StopCategory.S0
    assert steps(session) == [Step.NMT_STOP, Step.DISABLE]
    assert session.record.mode == Mode.FAULT
    assert moved_rad(session, begun) < math.radians(2.0)
    assert abs(session.machine.trainers["right"].truth().velocity[0]) < 0.05
    assert session.request(RequestKind.ENABLE).outcome == Outcome.REFUSED


def test_a_drive_that_ignores_nmt_stop_as_well_is_left_without_sync_and_heartbeat(warm_ready):
    session = warm_ready
    begun = len(session.truth.rows)
    ignore_nmt_stop(session)

    take_over(session)
    session.run(1.0)

    assert steps(session)[0] == Step.SILENCE
    last = [one for one in session.bus.sent if one.can_id in {SYNC, 0x701}][-1]
    assert session.bus.now_ns - last.time_ns > 500_000_000
    assert moved_rad(session, begun) < math.radians(3.0)
    assert abs(session.machine.trainers["right"].truth().velocity[0]) < 0.05


def show(session, word):
    """From now on the hip's statusword says something else than what it does."""

    def change(frame):
        if frame.can_id != 0x180 + HIP:
            return frame
        return frame._replace(data=word.to_bytes(2, "little") + frame.data[2:])

    change_what_drives_say(session, change)


@pytest.mark.parametrize(
    ("word", "within_s"),
    [(QUICK_STOP_ACTIVE, 0.02), (UNKNOWN, 0.28)],
    ids=["quick stop active", "no state of the standard"],
)
def test_a_statusword_that_does_not_prove_a_drive_off_is_taken_to_silence(
    warm_ready, word, within_s
):
    session = warm_ready
    ignore_nmt_stop(session)

    show(session, word)
    session.run(within_s)
    assert session.core.axes[0].stop is not None
    session.run(0.7)

    stops = [verdict_of(event) for event in reported(session.records, EventCode.STOPPED)]
    assert (StopCategory.S0, "right/hip") in [(one.category, one.drive) for one in stops]
    assert session.record.mode == Mode.FAULT
    assert steps(session)[0] == Step.SILENCE


def test_a_drive_that_a_disable_does_not_switch_off_is_stopped(warm_hold):
    session = warm_hold
    answer = session.request(RequestKind.DISABLE)
    assert answer.outcome == Outcome.DONE

    show(session, 0x27)
    session.run(0.3)

    assert session.record.verdict.cause == Cause.UNEXPECTED_ENABLE
    assert steps(session)[0] > Step.DISABLE


def test_drives_that_our_own_stop_holds_are_left_as_they_are_also_by_the_next_core(
    warm_generic_hold,
):
    session = warm_generic_hold
    session.command("hand_switch_open * 0.3")
    session.run(1.0)
    again = restarted(session)
    again.run(1.0)

    held = PowerState.QUICK_STOP_ACTIVE
    assert {drive.power_state for drive in session.record.drives} == {held}
    assert session.record.verdict.cause == Cause.HAND_SWITCH_OPEN
    assert again.record.mode == Mode.FAULT
    assert again.record.verdict.cause == Cause.HAND_SWITCH_OPEN
    assert powers(session) == {QUICK_STOP_ACTIVE}


def test_drives_that_hold_for_a_reason_that_no_core_knows_hold_until_a_reset(warm_generic_hold):
    """The notebook of the core that stopped them is lost."""
    session = warm_generic_hold
    session.command("hand_switch_open * 0.3")
    session.run(1.0)
    again = LockstepSession(session.settings, session.machine)
    found = again.run_until(lambda record: record.mode == Mode.FAULT, within_s=1)

    verdict = (found.verdict.cause, found.verdict.drive, found.verdict.value)
    assert verdict == (Cause.DRIVE_POWERED, "right/hip", PowerState.QUICK_STOP_ACTIVE)
    again.run(1.0)
    assert powers(session) == {QUICK_STOP_ACTIVE}
    assert again.request(RequestKind.RESET).outcome == Outcome.DONE
    again.until(Mode.READY)


def test_a_drive_that_is_enabled_while_the_service_still_starts_is_stopped_in_its_first_cycle():
    session = new_session()
    world, bus = session.machine.world, session.bus
    hear = world.receive

    def enable(word):
        return lambda: hear(Frame(0x600 + HIP, struct.pack("<BHBHH", 0x2B, 0x6040, 0, word, 0)))

    def receive(frame):
        hear(frame)
        if frame.can_id == 0x600 + HIP and frame.data[:3] == HEARTBEAT_TIME_WRITTEN:
            for after_ms, word in ((5, 0x06), (10, 0x07), (15, 0x0F)):
                bus.at(world.now_ns + after_ms * 1_000_000, enable(word))

    world.receive = receive
    first = session.run_until(
        lambda record: record.drives[0].power_state != PowerState.UNKNOWN, within_s=5
    )

    assert first.verdict.cause == Cause.UNEXPECTED_ENABLE
    assert first.mode == Mode.STOPPING
