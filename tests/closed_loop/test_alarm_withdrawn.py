"""An alarm by EMCY counts once, when it comes, whatever the drive says behind it."""

import pytest
from gaitd_names import Cause, Finding, Mode

from drives.canopen.bus import Frame

EMCY = 0x080 + 5
ALARM = bytes.fromhex("1023 01 0000000000")
NO_ERROR = bytes(8)
WARNING = bytes.fromhex("10FF 01 0000000000")
MS = 1_000_000


def say(session, *messages, after_ms):
    """EMCYs of the hip in one batch of frames, so long after the next grid point."""
    bus = session.bus
    at_ns = session.machine.world.now_ns + round((10 + after_ms) * MS)

    def speak():
        bus.seat.waiting += [Frame(EMCY, data, bus.utc_of_ns(bus.now_ns)) for data in messages]

    bus.at(at_ns, speak)
    session.run(0.03)


@pytest.mark.parametrize("after_ms", [0.5, 7.0], ids=["in the window", "between two windows"])
def test_an_alarm_that_the_drive_takes_back_in_the_same_batch_stops_all_the_same(
    warm_hold, after_ms
):
    session = warm_hold

    say(session, ALARM, NO_ERROR, after_ms=after_ms)

    verdict = session.record.verdict
    assert verdict.cause == Cause.EMERGENCY
    assert (verdict.finding, verdict.value) == (Finding.EMCY, 0x2310)
    assert not session.record.mode.active


def test_an_alarm_is_judged_once_and_no_warning_later_is_named_in_its_place(warm_ready):
    session = warm_ready

    say(session, ALARM, NO_ERROR, after_ms=0.5)
    assert session.record.mode == Mode.FAULT
    since = len(session.records)
    session.run(0.5)
    say(session, WARNING, after_ms=0.5)

    verdict = session.record.verdict
    assert (verdict.finding, verdict.value) == (Finding.EMCY, 0x2310)
    told = [event for record in session.records[since:] for event in record.events]
    assert told == []
