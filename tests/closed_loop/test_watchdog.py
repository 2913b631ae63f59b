"""The watchdog is fed once for each cycle that was finished in time, whatever the drives do.

And systemd's status line has mode and cause as soon as they are others. All in simulated time: what
is not fed for 10 ms shows.
"""

import pytest
from gaitd_names import Cause, EventCode, ExitCode, Mode
from sessions import new_session, reported
from supervised import watched

from drives.canopen.bus import Frame
from drives.signals import PowerState

CYCLE_MS = 10.0
BUS_OFF = Frame(0x040, bytes(8), is_error=True)


def gone(session):
    session.bus.trouble.is_gone = True


def full(session):
    session.bus.trouble.queue_full = True


def off(session):
    session.bus.report(BUS_OFF)


def fed(session, seconds):
    """How often it is fed while so much time passes, and the longest time between two."""
    systemd = session.systemd
    systemd.forget()
    session.run(seconds)
    return len(systemd.fed_ns), systemd.longest_pause_ms()


def test_a_drive_that_is_silent_costs_no_feeding_and_the_other_axis_is_held(session):
    watched(session)
    session.command("silent right/hip")

    count, pause_ms = fed(session, 1)

    record = session.record
    assert count == 100
    assert pause_ms <= CYCLE_MS
    assert record.verdict.cause == Cause.DRIVE_SILENT
    assert record.verdict.drive == "right/hip"
    assert record.drives[1].power_state == PowerState.QUICK_STOP_ACTIVE
    assert abs(record.drives[1].velocity) < 0.03
    assert session.systemd.status[-1].endswith("[fault drive_silent right/hip]")


@pytest.mark.parametrize("trouble", [gone, full, off])
def test_trouble_on_the_bus_costs_no_feeding(warm_ready, trouble):
    session = watched(warm_ready)
    trouble(session)

    count, pause_ms = fed(session, 1)

    assert count >= 85
    assert pause_ms <= 3 * CYCLE_MS
    assert session.record.verdict.cause != Cause.NONE


def test_a_bring_up_whose_drive_does_not_answer_is_fed_in_every_cycle():
    session = watched(new_session())
    session.bus.at(250_000_000, lambda: session.command("deaf right/slide"))

    count, pause_ms = fed(session, 1.5)

    assert count >= 140
    assert pause_ms <= 2 * CYCLE_MS
    assert {record.mode for record in session.records} == {Mode.OFF, Mode.BRINGING_UP}
    assert session.record.verdict.cause == Cause.DRIVE_SILENT


def test_the_status_line_has_mode_and_cause_in_the_cycle_in_which_they_are_new(session):
    watched(session)
    session.command("hand_switch_open right/hip")

    stopped = session.run_until(lambda record: not record.mode.active, within_s=1)

    assert stopped.mode == Mode.STOPPING
    assert session.systemd.status[-1].endswith("[stopping hand_switch_open right/hip]")
    session.run_until(lambda record: record.mode == Mode.FAULT, within_s=5)
    assert session.systemd.status[-1].endswith("[fault hand_switch_open right/hip]")


def test_ready_is_told_once_and_not_before_the_loop_turns():
    session = watched(new_session())
    assert session.systemd.lines == []

    session.until_ready()

    assert session.systemd.lines.count("READY=1") == 1
    assert session.systemd.lines[0] == "READY=1"


def test_the_end_is_told_when_it_is_asked_for_and_the_last_line_says_what_remains(session):
    watched(session)

    code = session.loop.run(lambda: True)

    lines, effect = session.systemd.lines, session.settings.trainer.shutdown.effect
    stopping = lines.index("STOPPING=1")
    assert code == ExitCode.DONE
    assert lines.count("STOPPING=1") == 1
    assert any(line.endswith("[stopping shutdown]") for line in lines[stopping:])
    assert lines[-1].startswith("STATUS=ended: all axes are at rest and without power")
    assert lines[-1].endswith(effect)
    assert "WATCHDOG=1" in lines[stopping:]


def test_a_change_of_mode_is_one_line_of_the_journal_with_its_fields(session):
    watched(session)
    session.systemd.told.clear()
    session.command("hand_switch_open right/hip")

    session.run(1)

    modes = [fields["GAITD_MODE"] for _, _, fields in session.systemd.told]
    assert modes == ["stopping", "fault"]
    for _, priority, fields in session.systemd.told:
        assert priority == 3
        assert fields["GAITD_EVENT"] == "mode"
        assert fields["GAITD_CAUSE"] == "hand_switch_open"
        assert fields["GAITD_DRIVE"] == "right/hip"
        assert int(fields["GAITD_CYCLE"]) > 0


def test_a_reload_is_answered_with_an_event_and_changes_nothing(session):
    watched(session)
    before, asked = session.core.config, iter([True])
    first_seq = session.record.seq

    def ended():
        if session.record.seq > first_seq + 10:
            raise KeyboardInterrupt
        return False

    with pytest.raises(KeyboardInterrupt):
        session.loop.run(ended, lambda: next(asked, False))

    assert session.core.config is before
    assert session.record.mode == Mode.GAIT
    assert len(reported(session.records, EventCode.RELOAD_REFUSED)) == 1
