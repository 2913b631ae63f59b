"""SYNC on its grid: its counter, and what happens to it when the process has had no time."""

import dataclasses
from itertools import pairwise

import msgspec
import pytest
from sessions import Session

from daemon.ipc.record import Cause, Mode, RequestKind
from gaitd_lab.lockstep import Lockstep
from sim_drives.frame import Frame as WorldFrame

MS = 1_000_000
SYNC = 0x080
START = b"\x01"
CLOSEST_MS = 7


class Counted(Session):
    """A session whose SYNC counts to 7, with drives that take it: 1019h is not the subject here."""

    def __init__(self):
        super().__init__()
        file = self.settings.file
        cycle = msgspec.structs.replace(file.trainer.cycle, sync_counter=7)
        trainer = msgspec.structs.replace(file.trainer, cycle=cycle)
        file = dataclasses.replace(file, trainer=trainer)
        world = self.machine.world
        take = world.receive
        world.receive = lambda frame: take(WorldFrame(SYNC, b"") if frame.can_id == SYNC else frame)
        self.lockstep = Lockstep(dataclasses.replace(self.settings, file=file), world)


@pytest.fixture(scope="module")
def warm_counted():
    return Counted().until_ready()


@pytest.fixture(scope="module")
def warm_counted_gait():
    return Counted().walking(warm_s=2)


def syncs(session, since=0):
    return [frame for frame in session.lockstep.bus.sent[since:] if frame.can_id == SYNC]


def runs_on(counts):
    return all(after == before % 7 + 1 for before, after in pairwise(counts))


def pause_while_waiting(session, pause_ns):
    session.lockstep.bus.let_pass(session.lockstep.bus.now_ns + pause_ns)


def pause_after_sync(session, pause_ns):
    """Frozen between the SYNC and the drives' answers."""
    bus = session.lockstep.bus
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
    sent = warm_counted.lockstep.bus.sent
    started = max(n for n, f in enumerate(sent) if f.can_id == 0 and f.data[:1] == START)

    counts = [frame.data[0] for frame in syncs(warm_counted, started)]

    assert all(len(frame.data) == 1 for frame in syncs(warm_counted))
    assert counts[0] == 1
    assert runs_on(counts)
    assert len(counts) > 20


def test_the_counter_begins_again_when_the_nodes_are_started_again(warm_counted):
    warm_counted.machine.command("sto_open right/hip 0.1")
    warm_counted.machine.command("emcy right/hip 0.1 0x2310")
    warm_counted.lockstep.run(0.5)
    before = len(warm_counted.lockstep.bus.sent)

    warm_counted.lockstep.request(RequestKind.RESET)

    assert syncs(warm_counted, before)
    sent = warm_counted.lockstep.bus.sent
    starts = [n for n, f in enumerate(sent) if f.can_id == 0 and f.data[:1] == START]
    assert starts[-1] > before
    assert syncs(warm_counted, starts[-1])[0].data == b"\x01"


@pytest.mark.parametrize("pause", [pause_while_waiting, pause_after_sync])
@pytest.mark.parametrize("pause_ms", [4, 9, 12, 35, 200])
def test_after_a_pause_there_is_no_burst_and_the_counter_goes_on(
    warm_counted_gait, pause, pause_ms
):
    before = len(warm_counted_gait.lockstep.bus.sent)

    pause(warm_counted_gait, pause_ms * MS)
    warm_counted_gait.lockstep.run(0.5)

    frames = syncs(warm_counted_gait, before)
    times_ms = [frame.time_ns / MS for frame in frames]
    spacing_ms = [b - a for a, b in pairwise(times_ms)]
    assert min(spacing_ms) >= CLOSEST_MS
    assert runs_on([frame.data[0] for frame in frames])
    assert len(frames) > 10


def test_a_pause_of_a_few_cycles_is_told_and_counted_and_the_targets_go_on_without_a_step(session):
    missed = session.lockstep.record.timing.overrun_count
    limits = session.settings.limits
    begun = len(session.lockstep.records)

    pause_while_waiting(session, 35 * MS)
    session.lockstep.run(0.5)

    records = session.lockstep.records[begun - 1 :]
    told = [event for record in records for event in record.events]
    steps_nm = [
        abs(b.drives[0].target_effort_si - a.drives[0].target_effort_si)
        for a, b in pairwise(records)
    ]
    assert session.lockstep.record.timing.overrun_count == missed + 3
    assert len([text for text in told if text.startswith("3 cycles in a row had no time")]) == 1
    assert session.lockstep.record.mode == Mode.GAIT
    assert max(steps_nm) <= limits.hip.torque_rate_max_nm_per_s * 0.01 * 1.001


def test_a_pause_that_is_too_long_is_a_verdict(session):
    pause_while_waiting(session, 70 * MS)
    stopped = session.lockstep.run_until(lambda record: not record.mode.active, within_s=0.1)

    assert stopped.verdict.cause == Cause.CYCLE_OVERRUN
