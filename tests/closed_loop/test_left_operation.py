"""A drive that leaves operation enabled by itself is never enabled again without a request.

What the master acts on it judges in the same cycle, also where only a part of the sample has come.
"""

import pytest
from gaitd_names import Cause, Mode, Outcome, RequestKind
from wire import (
    DISABLE_VOLTAGE_WORD,
    ENABLE_OPERATION,
    NODES,
    QUICK_STOP_WORD,
    change_what_drives_hear,
    change_what_drives_say,
    rpdo1,
)

from drives.canopen.frame import Frame
from drives.cia402.power_state import decode_statusword
from drives.signals import PowerState

HIP = 5
AT_THE_ENDS = {PowerState.SWITCH_ON_DISABLED, PowerState.OPERATION_ENABLED}


def leave_operation(session, word):
    """The hip takes the next 0Fh for another word, and its TPDO2 is lost while it shows so."""
    told, shown = [], [PowerState.OPERATION_ENABLED]

    def hear(frame):
        if frame.can_id != 0x200 + HIP or told:
            return frame
        told.append(frame)
        return Frame(frame.can_id, word.to_bytes(2, "little") + frame.data[2:])

    def say(frame):
        if frame.can_id == 0x180 + HIP:
            shown[0] = decode_statusword(int.from_bytes(frame.data[:2], "little"))
        lost = frame.can_id == 0x280 + HIP and shown[0] is not PowerState.OPERATION_ENABLED
        return None if lost else frame

    change_what_drives_hear(session, hear)
    change_what_drives_say(session, say)


@pytest.mark.parametrize(
    ("word", "left_to"),
    [
        (QUICK_STOP_WORD, PowerState.QUICK_STOP_ACTIVE),
        (DISABLE_VOLTAGE_WORD, PowerState.SWITCH_ON_DISABLED),
    ],
    ids=lambda value: value.name.lower() if isinstance(value, PowerState) else f"{value:02X}h",
)
def test_a_drive_that_left_operation_is_stopped_in_the_cycle_that_shows_it_without_its_tpdo2(
    warm_hold, word, left_to
):
    session = warm_hold
    leave_operation(session, word)

    seen = session.run_until(
        lambda record: record.drives[0].power_state != PowerState.OPERATION_ENABLED, within_s=0.5
    )
    since = len(session.bus.sent) - 4
    session.run(0.3)

    assert seen.drives[0].power_state == left_to
    assert not seen.drives[0].fresh
    assert (seen.mode, seen.verdict.cause) == (Mode.STOPPING, Cause.DRIVE_LEFT_ENABLED)
    for node in NODES:
        words = [one.controlword for one in rpdo1(session.bus.sent[since:], node)]
        assert words
        assert not any(word & ENABLE_OPERATION for word in words)
    assert session.record.mode == Mode.FAULT


def test_a_drive_that_goes_straight_to_operation_enabled_is_held_like_any_other(warm_ready):
    """06h is answered with operation enabled; what lies between is never shown."""
    session, told = warm_ready, []

    def hear(frame):
        if frame.can_id != 0x200 + HIP or not frame.data[0] & 0x04:
            return frame
        told.append(frame)
        word = 0x06 if len(told) == 1 else 0x0F
        return Frame(frame.can_id, word.to_bytes(2, "little") + frame.data[2:])

    def say(frame):
        word = int.from_bytes(frame.data[:2], "little")
        if frame.can_id != 0x180 + HIP or decode_statusword(word) in AT_THE_ENDS:
            return frame
        return frame._replace(data=(word & ~0x6F | 0x40).to_bytes(2, "little") + frame.data[2:])

    change_what_drives_hear(session, hear)
    change_what_drives_say(session, say)
    begun, since = session.truth.rows[-1], len(session.records)

    answer = session.request(RequestKind.ENABLE)
    session.run(0.4)

    shown = {record.drives[0].power_state for record in session.records[since:]}
    assert shown == AT_THE_ENDS
    assert answer.outcome == Outcome.DONE, answer.refusal
    assert session.truth.rows[-1].hip_angle_rad == pytest.approx(begun.hip_angle_rad, abs=0.01)
