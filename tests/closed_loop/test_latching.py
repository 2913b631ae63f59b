"""A latched stop stays latched when the core dies, and no run without an orderly end is clean."""

from datetime import UTC, datetime

import pytest
from gaitd_names import Cause, EventCode, Finding, Mode, Outcome, RequestKind, StopCategory
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


CAUSES = {
    "stop": Cause.STOP_REQUESTED,
    "hand_switch_open * 0.3": Cause.HAND_SWITCH_OPEN,
    "sto_open * 0.3": Cause.STO_ACTIVE,
    "encoder_glitch right/hip - 3000": Cause.ENCODER_JUMP,
    "emcy right/hip 0.3 0x2310": Cause.EMERGENCY,
}


def stopped(session: LockstepSession, line: str) -> LockstepSession:
    """In the cycle in which this stops it."""
    if line == "stop":
        session.gateway.stop()
    else:
        session.command(line)
    session.run_until(lambda record: record.verdict.cause != Cause.NONE, within_s=3)
    return session


QUICK_CAUSES = ("stop", "encoder_glitch right/hip - 3000")
"""Held by the core; without power, and with a value."""


@pytest.mark.parametrize(
    "line",
    [
        pytest.param(line, marks=() if line in QUICK_CAUSES else pytest.mark.thorough)
        for line in CAUSES
    ],
)
def test_a_core_that_is_killed_as_it_stops_has_left_the_verdict(session, line):
    """In the very cycle in which the stop begins: nothing later has to happen for it."""
    stopped(session, line)
    verdict = session.record.verdict

    # The machine has been without power meanwhile: nothing but the notes remembers.
    again = up(new_session(persistent=notes_of(session)))

    assert verdict.cause in {CAUSES[line], Cause.DRIVE_FAULT}
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


def test_drives_that_are_not_there_at_the_second_restart_do_not_make_it_forget(session):
    first = new_session(persistent=notes_of(stopped(session, "stop")))
    up(first)
    session = new_session(persistent=notes_of(first))
    session.command("unplugged right/hip 3")
    session.run(2.5)
    assert session.record.mode in {Mode.OFF, Mode.BRINGING_UP}

    assert up(session).record.verdict.cause == Cause.STOP_REQUESTED


def test_an_orderly_shutdown_in_motion_latches_nothing(session):
    session.shut_down()

    assert notes_of(session).latched is None
    assert up(new_session(persistent=notes_of(session))).record.mode == Mode.READY


def test_an_orderly_shutdown_of_a_stopped_machine_keeps_its_stop(session):
    stopped(session, "hand_switch_open * 0.3")
    session.run(1.0)
    session.shut_down()

    again = up(new_session(persistent=notes_of(session)))

    assert again.record.verdict.cause == Cause.HAND_SWITCH_OPEN


@pytest.mark.parametrize("moment", ["enabling", "braking to switch off"])
def test_a_run_that_ends_while_drives_are_enabled_has_an_unknown_end(warm_ready, warm_gait, moment):
    session = warm_ready if moment == "enabling" else warm_gait
    if moment == "enabling":
        session.gateway.request(RequestKind.ENABLE)
        session.run(0.1)
    elif moment == "braking to switch off":
        session.gateway.request(RequestKind.DISABLE)
        session.run_until(lambda record: record.mode == Mode.STOPPING, within_s=2)

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


def test_a_cause_of_another_version_is_latched_all_the_same(session):
    persistent = notes_of(stopped(session, "stop"))
    latched = persistent.latched
    assert latched is not None
    text = latched.__class__(latched.category, "METEORITE", utc_ns=latched.utc_ns)

    again = up(new_session(persistent=PersistentState(latched=text)))

    assert again.record.mode == Mode.FAULT
    assert again.record.verdict.cause == Cause.LAST_END_UNKNOWN
    assert again.record.verdict.finding is Finding.NOTES_OF_OTHER_VERSION
    assert again.record.verdict.said == "METEORITE"


def test_an_end_of_the_service_while_it_stops_keeps_the_cause(session):
    session.gateway.stop()
    session.run(0.05)
    assert session.record.mode == Mode.STOPPING

    session.shut_down()
    again = up(restarted(session))

    assert again.record.mode == Mode.FAULT
    assert again.record.verdict.cause == Cause.STOP_REQUESTED


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
