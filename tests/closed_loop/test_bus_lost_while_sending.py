"""The bus goes away between the samples of a cycle and its commands."""

import pytest
from gaitd_names import Cause, EventCode, Mode, StopCategory
from reports import verdict_of
from sessions import reported

RPDO1_OF_HIP, RPDO2_OF_SLIDE = 0x205, 0x306


def gone_when_sending(session, can_id):
    """From the next frame with this identifier on there is no interface any more."""
    bus = session.bus
    place = bus.send

    def send(frames):
        bus.trouble.is_gone |= any(frame.can_id == can_id for frame in frames)
        return place(frames)

    bus.send = send


@pytest.mark.parametrize("can_id", [RPDO1_OF_HIP, RPDO2_OF_SLIDE])
def test_a_cycle_that_finds_the_bus_gone_with_its_commands_is_told_as_it_was(warm_hold, can_id):
    warm_hold.command("hand_switch_open right/hip")
    begun = warm_hold.record
    gone_when_sending(warm_hold, can_id)

    warm_hold.run(0.2)

    records = [record for record in warm_hold.records if record.seq > begun.seq]
    found, lost = records[:2]
    assert [one.seq for one in records] == list(range(begun.seq + 1, warm_hold.record.seq + 1))
    assert (found.mode, found.verdict.cause) == (Mode.STOPPING, Cause.HAND_SWITCH_OPEN)
    (stopped,) = reported([found], EventCode.STOPPED)
    assert verdict_of(stopped).category == StopCategory.S1
    assert (lost.cycle, lost.mode) == (found.cycle, Mode.FAULT)
    (without,) = reported([lost], EventCode.CAUSE_FOUND)
    assert verdict_of(without).cause == Cause.BUS_DOWN
