"""A drive that leaves operation enabled by itself is never enabled again without a request.

What the master acts on it judges in the same cycle, also where only a part of the sample has come.
"""

import pytest
from wire import (
    DISABLE_VOLTAGE_WORD,
    ENABLE_OPERATION,
    NODES,
    QUICK_STOP_WORD,
    change_what_drives_hear,
    change_what_drives_say,
    rpdo1,
)

from daemon.record import Cause, Mode
from drives.cia402 import decode_statusword
from drives.signals import PowerState
from sim_drives.frame import Frame

HIP = 5
SWITCH_ON_WORD = 0x0007


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
        (SWITCH_ON_WORD, PowerState.SWITCHED_ON),
        (DISABLE_VOLTAGE_WORD, PowerState.SWITCH_ON_DISABLED),
    ],
    ids=lambda value: value.name.lower() if isinstance(value, PowerState) else f"{value:02X}h",
)
def test_a_drive_that_left_operation_is_stopped_in_the_cycle_that_shows_it_without_its_tpdo2(
    warm_hold, word, left_to
):
    session = warm_hold
    leave_operation(session, word)

    seen = session.lockstep.run_until(
        lambda record: record.drives[0].power_state != PowerState.OPERATION_ENABLED, within_s=0.5
    )
    since = len(session.lockstep.bus.sent) - 4
    session.lockstep.run(0.3)

    assert seen.drives[0].power_state == left_to
    assert not seen.drives[0].fresh
    assert (seen.mode, seen.verdict.cause) == (Mode.STOPPING, Cause.DRIVE_LEFT_ENABLED)
    for node in NODES:
        words = [one.controlword for one in rpdo1(session.lockstep.bus.sent[since:], node)]
        assert words
        assert not any(word & ENABLE_OPERATION for word in words)
    assert session.lockstep.record.mode == Mode.FAULT
