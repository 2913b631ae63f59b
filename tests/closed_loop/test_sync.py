"""SYNC on its grid: its counter, and what happens to it when the process has had no time."""

from dataclasses import replace
from itertools import pairwise

import msgspec
import pytest
from gaitd_names import Cause, EventCode, Mode, RequestKind
from sessions import CONFIGS, briefly_announced, reported
from wire import change_what_drives_hear

from daemon.preflight.load import load
from drives.canopen.frame import Frame
from gaitd_lab.lockstep import LockstepSession

MS = 1_000_000
SYNC = 0x080
START = b"\x01"
CLOSEST_MS = 7


@pytest.fixture(scope="module")
def warm_counted():
    """A session whose SYNC counts to 7, with drives that take it: 1019h is not the subject here."""
    settings = load(CONFIGS / "demo.toml")
    cycle = msgspec.structs.replace(settings.trainer.cycle, sync_counter=7)
    trainer = msgspec.structs.replace(settings.trainer, cycle=cycle)
    settings = replace(settings, file=replace(settings.file, trainer=trainer))
    session = LockstepSession(briefly_announced(settings))
    change_what_drives_hear(
        session, lambda frame: Frame(SYNC, b"") if frame.can_id == SYNC else frame
    )
    return session.until_ready()


def syncs(session, since=0):
    return [frame for frame in session.bus.sent[since:] if frame.can_id == SYNC]


def runs_on(counts):
    return all(after == before % 7 + 1 for before, after in pairwise(counts))


def pause_while_waiting(session, pause_ns):
    session.bus.let_pass(session.bus.now_ns + pause_ns)


def pause_after_sync(session, pause_ns):
    """Frozen between the SYNC and the drives' answers."""
    bus = session.bus
    place = bus.send

    def send(frames):
        placed = place(frames)
        bus.send = place
        bus.let_pass(bus.now_ns + pause_ns)
        return placed

    bus.send = send


def test_a_sync_without_counter_is_an_empty_frame(warm_ready):
    assert {frame.data for frame in syncs(warm_ready)} == {b""}


def test_the_counter_begins_with_one_when_the_nodes_are_started_and_has_no_gap_from_there(
    warm_counted,
):
    sent = warm_counted.bus.sent
    started = max(n for n, f in enumerate(sent) if f.can_id == 0 and f.data[:1] == START)

    counts = [frame.data[0] for frame in syncs(warm_counted, started)]

    assert all(len(frame.data) == 1 for frame in syncs(warm_counted))
    assert counts[0] == 1
    assert runs_on(counts)
    assert len(counts) > 20


def test_the_counter_begins_again_when_the_nodes_are_started_again(warm_counted):
    warm_counted.command("sto_open right/hip 0.1")
    warm_counted.command("emcy right/hip 0.1 0x2310")
    warm_counted.run(0.5)
    before = len(warm_counted.bus.sent)

    warm_counted.request(RequestKind.RESET)

    assert syncs(warm_counted, before)
    sent = warm_counted.bus.sent
    starts = [n for n, f in enumerate(sent) if f.can_id == 0 and f.data[:1] == START]
    assert starts[-1] > before
    assert syncs(warm_counted, starts[-1])[0].data == b"\x01"


@pytest.mark.parametrize("pause", [pause_while_waiting, pause_after_sync])
@pytest.mark.parametrize("pause_ms", [4, 35])
def test_after_a_pause_there_is_no_burst_and_the_counter_goes_on(warm_counted, pause, pause_ms):
    before = len(warm_counted.bus.sent)

    pause(warm_counted, pause_ms * MS)
    warm_counted.run(0.2)

    frames = syncs(warm_counted, before)
    times_ms = [frame.time_ns / MS for frame in frames]
    spacing_ms = [b - a for a, b in pairwise(times_ms)]
    assert min(spacing_ms) >= CLOSEST_MS
    assert runs_on([frame.data[0] for frame in frames])
    assert len(frames) > 10


def test_a_pause_of_a_few_cycles_is_told_and_counted_and_the_targets_go_on_without_a_step(session):
    missed = session.record.timing.overrun_count
    limits = session.settings.limits
    begun = len(session.records)

    pause_while_waiting(session, 35 * MS)
    session.run(0.5)

    records = session.records[begun - 1 :]
    steps_nm = [
        abs(b.drives[0].target_effort - a.drives[0].target_effort) for a, b in pairwise(records)
    ]
    assert session.record.timing.overrun_count == missed + 3
    (told,) = reported(records, EventCode.CYCLES_MISSED)
    assert told.values[0] == 3
    assert session.record.mode == Mode.GAIT
    assert max(steps_nm) <= limits.hip.torque_rate_max_nm_per_s * 0.01 * 1.001


def test_a_pause_that_is_too_long_is_a_verdict(session):
    pause_while_waiting(session, 70 * MS)
    stopped = session.run_until(lambda record: not record.mode.active, within_s=0.1)

    assert stopped.verdict.cause == Cause.CYCLE_OVERRUN
