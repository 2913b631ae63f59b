"""A latched stop stays latched when the core dies, and no run without an orderly end is clean."""

from datetime import UTC, datetime

import pytest
from gaitd_names import Cause, EventCode, Mode, Outcome, RequestKind, StopCategory
from sessions import changed_configs, new_session, reported, restarted

from daemon.core.modes import daily_test
from daemon.core.modes.persistent_state import UNREADABLE, PersistentState
from daemon.core.runtime.state_file import StateFile
from daemon.ipc.state_file import NAME
from gaitd_lab.lockstep import LockstepSession


def notes_of(session: LockstepSession) -> PersistentState:
    return session.state_file.persistent


def up(session: LockstepSession) -> LockstepSession:
    session.run_until(lambda record: record.mode in {Mode.FAULT, Mode.READY}, within_s=15)
    session.run(0.2)
    return session


STARTED_UTC_S = datetime(2026, 1, 1, tzinfo=UTC).timestamp()


def stopped(session: LockstepSession, line: str) -> LockstepSession:
    """In the cycle in which this stops it."""
    if line == "stop":
        session.gateway.stop()
    else:
        session.command(line)
    session.run_until(lambda record: record.verdict.cause != Cause.NONE, within_s=3)
    return session


def test_a_core_that_is_killed_as_it_stops_has_left_the_verdict(session):
    """In the very cycle in which the stop begins: nothing later has to happen for it."""
    stopped(session, "encoder_glitch right/hip - 3000")
    verdict = session.record.verdict

    # The machine has been without power meanwhile: nothing but the notes remembers.
    again = up(new_session(persistent=notes_of(session)))

    assert verdict.cause == Cause.ENCODER_JUMP
    assert again.record.mode == Mode.FAULT
    assert again.record.verdict.cause == verdict.cause
    assert again.record.verdict.category == verdict.category
    assert again.record.verdict.drive == verdict.drive
    assert again.record.verdict.value == pytest.approx(verdict.value)
    (latched,) = reported(again.records, EventCode.STILL_LATCHED)
    assert 0.0 <= latched.values[-1] - STARTED_UTC_S < 60.0


def test_beside_drives_that_still_hold_the_leg_the_latched_stop_is_what_is_shown(session):
    stopped(session, "hand_switch_open * 0.3")
    session.run(0.4)

    again = up(restarted(session))

    assert again.record.mode == Mode.FAULT
    assert again.record.verdict.cause == Cause.HAND_SWITCH_OPEN
    assert reported(again.records, EventCode.STILL_LATCHED)


def test_a_latched_stop_enables_nothing_and_a_reset_takes_it_away_from_the_file_too(session):
    session = new_session(persistent=notes_of(stopped(session, "stop")))
    again = up(session)

    assert again.request(RequestKind.ENABLE).outcome == Outcome.REFUSED
    assert again.request(RequestKind.RESET).outcome == Outcome.DONE
    assert notes_of(session).latched is None
    assert again.request(RequestKind.ENABLE).outcome == Outcome.DONE
    again.request(RequestKind.DISABLE)
    again.run(0.1)

    third = up(new_session(persistent=notes_of(session)))
    assert third.record.mode == Mode.READY


def test_an_orderly_shutdown_in_motion_latches_nothing(session):
    session.shut_down()

    assert notes_of(session).latched is None
    assert up(new_session(persistent=notes_of(session))).record.mode == Mode.READY


def test_a_run_that_ends_while_drives_are_enabled_has_an_unknown_end(warm_ready):
    session = warm_ready
    session.gateway.request(RequestKind.ENABLE)
    session.run(0.1)

    again = up(new_session(persistent=notes_of(session)))

    assert again.record.mode == Mode.FAULT
    assert again.record.verdict.cause == Cause.LAST_END_UNKNOWN
    assert again.record.verdict.category == StopCategory.S1
    assert again.request(RequestKind.RESET).outcome == Outcome.DONE


def test_after_a_power_cut_the_older_page_is_not_clean_either(session, tmp_path):
    """The disk has what was written before the stop; the stop never got there."""
    StateFile(tmp_path).write(notes_of(session), 0)
    page = (tmp_path / NAME).read_bytes()
    session.gateway.stop()
    session.run(1.0)
    StateFile(tmp_path).write(notes_of(session), 0)
    (tmp_path / NAME).write_bytes(page)

    again = up(new_session(persistent=StateFile(tmp_path).persistent))

    assert again.record.mode == Mode.FAULT
    assert again.record.verdict.cause == Cause.LAST_END_UNKNOWN


def test_a_page_that_the_power_cut_tore_is_latched_until_a_reset(session, tmp_path):
    stopped(session, "stop")
    StateFile(tmp_path).write(notes_of(session), 0)
    page = (tmp_path / NAME).read_bytes()
    (tmp_path / NAME).write_bytes(page[:100] + b"\0" * (len(page) - 100))
    persistent = StateFile(tmp_path).persistent
    assert persistent == UNREADABLE

    again = new_session(changed_configs(tmp_path), persistent)
    up(again)

    assert again.record.mode == Mode.FAULT
    assert again.record.verdict.cause == Cause.LAST_END_UNKNOWN
    assert again.request(RequestKind.RESET).outcome == Outcome.DONE
    assert notes_of(again).latched is None
    assert notes_of(again).damaged


def test_nothing_is_written_while_the_drives_are_enabled_but_the_stop_that_ends_it(
    session, monkeypatch
):
    monkeypatch.setattr(daily_test, "STORE_NS", 1_000_000_000)
    modes_written = []
    write = session.state_file.write

    def note(persistent, now_ns):
        modes_written.append(session.core.mode)
        write(persistent, now_ns)

    session.state_file.write = note
    session.run(1.2)
    assert modes_written == []

    session.gateway.stop()
    session.run(1)
    assert modes_written
    assert not any(mode.active for mode in modes_written)
