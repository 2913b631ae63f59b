"""The watchdog is fed once for each cycle that was finished in time, whatever the drives do.

And systemd's status line has mode and cause as soon as they are others. All in simulated time: what
is not fed for 10 ms shows.
"""

from unittest import mock

import pytest
from gaitd_names import Cause, EventCode, ExitCode, Mode
from sessions import new_session, reported
from supervised import watched

from daemon.core.runtime.systemd import PROGRESS_CYCLES
from daemon.core.safety import checks
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


def unplugged(session):
    session.command("unplugged right/hip")
    session.command("unplugged right/slide")


def fed(session, seconds):
    """How often it is fed while so much time passes, and the longest time between two."""
    systemd = session.systemd
    systemd.forget()
    session.run(seconds)
    return len(systemd.fed_ns), systemd.longest_pause_ms()


@pytest.mark.parametrize("silent_s", [1, pytest.param(60, marks=pytest.mark.thorough)])
def test_a_drive_that_is_silent_for_long_costs_no_feeding_and_the_other_axis_is_held(
    session, silent_s
):
    watched(session)
    session.command("silent right/hip")

    count, pause_ms = fed(session, silent_s)

    record = session.record
    assert count == 100 * silent_s
    assert pause_ms <= CYCLE_MS
    assert record.verdict.cause == Cause.DRIVE_SILENT
    assert record.verdict.drive == "right/hip"
    assert record.drives[1].power_state == PowerState.QUICK_STOP_ACTIVE
    assert abs(record.drives[1].velocity) < 0.03
    assert session.systemd.status[-1].endswith("[fault drive_silent right/hip]")


@pytest.mark.parametrize("trouble", [gone, full, off, unplugged])
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

    count, pause_ms = fed(session, 3)

    assert count >= 285
    assert pause_ms <= 2 * CYCLE_MS
    assert {record.mode for record in session.records} == {Mode.OFF, Mode.BRINGING_UP}
    assert session.record.verdict.cause == Cause.DRIVE_SILENT


def test_a_cycle_of_a_bring_up_that_had_no_time_is_not_fed():
    session = watched(new_session())
    session.bus.at(250_000_000, lambda: session.bus.hold(35_000_000))

    session.run(0.01)  # one turn: a whole bring-up, with its records

    assert session.record.mode == Mode.READY
    assert len(session.systemd.fed_ns) == len(session.records) - 1


def test_a_cycle_that_had_no_time_is_not_fed(session):
    watched(session)
    begun = session.record

    session.systemd.forget()
    session.bus.hold(35_000_000)
    session.run(0.5)

    cycles = session.record.cycle - begun.cycle
    missed = session.record.timing.overrun_count - begun.timing.overrun_count
    assert missed == 3
    assert len(session.systemd.fed_ns) < cycles - missed + 1
    assert sum(session.record.timing.overrun_by_part.values()) == missed


def test_the_status_line_has_mode_and_cause_in_the_cycle_in_which_they_are_new(session):
    watched(session)
    session.command("hand_switch_open right/hip")

    stopped = session.run_until(lambda record: not record.mode.active, within_s=1)

    assert stopped.mode == Mode.STOPPING
    assert session.systemd.status[-1].endswith("[stopping hand_switch_open right/hip]")
    session.run_until(lambda record: record.mode == Mode.FAULT, within_s=5)
    assert session.systemd.status[-1].endswith("[fault hand_switch_open right/hip]")


def test_a_status_that_systemd_had_no_room_for_is_sent_again_in_the_next_cycle():
    session = watched(new_session())
    session.systemd.is_busy = True
    session.until_ready()
    session.systemd.is_busy = False

    session.run(0.01)

    ready, status = session.systemd.lines[:2]
    assert ready == "READY=1"
    assert status.startswith("STATUS=")
    assert status.endswith("[ready]")


def test_nothing_new_is_told_rarely(session):
    watched(session)
    session.systemd.forget()

    session.run(1)

    assert len(session.systemd.status) <= 1 * 100 / PROGRESS_CYCLES + 1
    assert all(line.endswith("[gait]") for line in session.systemd.status)


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


def test_a_bug_is_an_end_that_is_told_before_the_blind_stops_and_says_what_was_seen_last(session):
    watched(session)

    with mock.patch.object(checks, "check_raw", side_effect=ZeroDivisionError("ours")):
        code = session.loop.run(lambda: False)

    assert code == ExitCode.UNAVAILABLE
    assert session.systemd.lines[0] == "STOPPING=1"
    assert "WATCHDOG=1" not in session.systemd.lines
    assert session.systemd.status[-1].startswith("ended by a bug of ours: quick stops were sent")
    assert "right/hip operation_enabled" in session.systemd.status[-1]


def test_the_end_without_drives_claims_nothing_about_their_power():
    session = watched(new_session())
    gone(session)
    session.run(0.1)

    session.loop.run(lambda: True)

    assert session.systemd.status[-1].startswith(
        "ended without the drives: their power is not known"
    )


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
