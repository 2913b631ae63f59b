"""The whole service on a bus in trouble: bus-off, error passive, no other node, a full queue."""

import numpy as np
import pytest
from gaitd_names import Cause, EventCode, Mode, Outcome, RequestKind
from sessions import new_session, reported

from drives.canopen.bus import Frame

MS = 1_000_000
ENABLING = 0b1000
QUICK_STOP = 0x02
BUS_OFF = Frame(0x040, bytes(8), is_error=True)
RESTARTED = Frame(0x100, bytes(8), is_error=True)
PASSIVE = Frame(0x004, b"\0\x30\0\0\0\0\0\0", is_error=True)
WARNING = Frame(0x004, b"\0\x0c\0\0\0\0\0\0", is_error=True)
ACTIVE = Frame(0x004, b"\0\x40\0\0\0\0\0\0", is_error=True)
OVERFLOW = Frame(0x004, b"\0\x01\0\0\0\0\0\0", is_error=True)
NO_ACKNOWLEDGE = Frame(0x020, bytes(8), is_error=True)


def put(session, *frames):
    """Let the controller report this, or another node send it, now."""
    session.bus.seat.waiting.extend(frames)


def told_count(session, code):
    return len(reported(session.records, code))


def words_sent(session, since=0):
    sent = session.bus.sent[since:]
    return [int.from_bytes(f.data[:2], "little") for f in sent if f.can_id in {0x205, 0x206}]


# --- the controller's state -----------------------------------------------------------------------


def test_while_the_controller_is_bus_off_nothing_is_sent_at_all(session):
    put(session, BUS_OFF)
    session.run(0.01)
    before = len(session.bus.sent)

    session.run(0.5)

    assert session.bus.sent[before:] == []
    assert session.record.bus.condition == "bus-off"
    assert session.record.verdict.cause == Cause.BUS_OFF


def test_a_controller_that_comes_back_enables_nothing_before_a_reset(session):
    before = len(session.bus.sent)
    put(session, BUS_OFF)
    session.run(0.3)
    put(session, RESTARTED)

    session.run(0.5)

    assert session.record.mode == Mode.FAULT
    assert session.record.verdict.cause == Cause.BUS_OFF
    assert not any(word & ENABLING for word in words_sent(session, before))
    answer = session.request(RequestKind.RESET)
    assert answer.outcome == Outcome.DONE, answer.refusal
    assert session.record.mode == Mode.READY


def test_bus_off_at_rest_is_not_brought_up_again_without_a_request(warm_ready):
    put(warm_ready, BUS_OFF)
    warm_ready.run(0.1)
    put(warm_ready, RESTARTED)
    warm_ready.run(1.5)

    assert warm_ready.record.mode == Mode.FAULT
    assert warm_ready.record.verdict.cause == Cause.BUS_OFF
    assert told_count(warm_ready, EventCode.BRING_UP_BEGUN) == 1


@pytest.mark.parametrize(
    ("frame", "condition", "code"),
    [
        (PASSIVE, "error passive", EventCode.CAN_PASSIVE),
        (WARNING, "warning", EventCode.CAN_WARNING),
    ],
)
def test_error_passive_and_warning_are_told_and_do_not_stop(session, frame, condition, code):
    put(session, frame, frame)
    session.run(0.5)
    during = session.record
    put(session, ACTIVE)
    session.run(0.1)

    assert during.mode == Mode.GAIT
    assert during.bus.condition == condition
    assert during.bus.passive_count + during.bus.warning_count == 2
    assert told_count(session, code) == 1
    assert told_count(session, EventCode.CAN_ACTIVE) == 1
    assert session.record.bus.condition == "active"


def test_error_passive_is_told_while_a_bring_up_still_waits_for_a_drive():
    session = new_session()
    session.command("unplugged *")
    session.bus.at(session.machine.world.now_ns + 200 * MS, lambda: put(session, PASSIVE))
    session.run(0.01)  # one turn: a whole bring-up, with its records

    at, failed = (
        next(n for n, one in enumerate(session.records) if reported([one], code))
        for code in (EventCode.CAN_PASSIVE, EventCode.BRING_UP_FAILED)
    )

    assert at < 30 < failed


def test_frames_lost_in_the_controller_are_counted_and_told_in_powers_of_ten(session):
    for _ in range(50):
        put(session, OVERFLOW)
        session.run(0.01)

    assert session.record.bus.overflow_count == 50
    assert told_count(session, EventCode.CAN_FRAMES_LOST) == 2


def test_a_missing_acknowledgement_alone_is_told_apart_and_does_not_stop(session):
    put(session, NO_ACKNOWLEDGE)
    session.run(0.2)

    assert session.record.mode == Mode.GAIT
    assert session.record.bus.no_ack_count == 1
    assert told_count(session, EventCode.CAN_ALONE) == 1


def test_another_master_in_operation_is_counted_and_told(session):
    put(session, Frame(0x080, b""), Frame(0x701, b"\x05"))
    session.run(0.2)

    assert session.record.bus.foreign_master_count == 2
    assert told_count(session, EventCode.CAN_FOREIGN_MASTER) == 1


def test_a_node_that_never_rests_holds_up_no_sync(session):
    """While some of its frames are read, the next ones come."""
    bus = session.bus
    take, end_ns = bus.link.take, bus.now_ns + 100 * MS
    before = len(bus.sent)

    def take_slowly():
        taken = take()
        if bus.now_ns < end_ns:
            bus.let_pass(bus.now_ns + MS // 10)
            put(session, Frame(0x7F0, bytes(8)))
        return taken

    bus.link.take = take_slowly
    session.run(0.1)

    syncs_ns = [frame.time_ns for frame in bus.sent[before:] if frame.can_id == 0x080]
    assert len(syncs_ns) >= 10
    assert max(np.diff(syncs_ns)) <= 10.5 * MS
    assert (session.record.mode, session.record.timing.overrun_count) == (Mode.GAIT, 0)


# --- a full transmit queue ------------------------------------------------------------------------


class FullQueue:
    """The bus of a session, refusing frames as a full SocketCAN queue does."""

    def __init__(self, session):
        self.bus = session.bus
        self.place = self.bus.send
        self.refusals = 0
        self.only = None
        """Identifiers that are refused; None: all."""
        self.bus.send, self.bus.send_urgent = self.send, self.send_urgent

    def send(self, frames):
        dropped = 0
        for frame in frames:
            if self.refusals and (self.only is None or frame.can_id in self.only):
                self.refusals -= 1
                dropped += 1
            else:
                self.place([frame])
        return dropped

    def send_urgent(self, frames, deadline_ns, clock):
        waiting = list(frames)
        while waiting and clock.now_ns() < deadline_ns:
            if self.send(waiting[:1]) == 0:
                del waiting[0]
            else:
                self.bus.let_pass(self.bus.now_ns + MS // 5)
        return len(waiting)


def test_process_data_that_find_a_full_queue_are_dropped_and_counted_and_the_gait_goes_on(session):
    FullQueue(session).refusals = 2

    session.run(1)

    assert session.record.tx_dropped_count == 2
    assert session.record.mode == Mode.GAIT


def test_a_queue_that_stays_full_ends_in_a_quick_stop_that_is_tried_until_it_leaves(session):
    queue = FullQueue(session)
    before = len(session.bus.sent)
    # Three cycles of five frames; the stop of the fourth finds the queue full three times more.
    queue.refusals = 3 * 5 + 6

    stopped = session.run_until(lambda record: not record.mode.active, within_s=0.1)

    assert stopped.verdict.cause == Cause.TRANSMIT_QUEUE_FULL
    assert queue.refusals == 0
    assert words_sent(session, before) == [QUICK_STOP] * 2  # in the cycle of the verdict
    session.run(2)
    assert session.record.mode == Mode.FAULT


def test_twenty_refusals_never_raise_out_of_the_loop_and_end_at_rest(session):
    queue = FullQueue(session)

    for _ in range(20):
        queue.refusals = 20
        session.loop.turn()
    queue.refusals = 0
    session.run(3)

    truth = session.truth.rows[-1]
    assert session.record.mode == Mode.FAULT
    assert abs(truth.hip_velocity_rad_per_s) < 0.05
    assert abs(truth.slide_velocity_m_per_s) < 0.05


def test_nmt_stop_of_a_lost_drive_that_finds_a_full_queue_is_sent_again_until_it_leaves(session):
    queue = FullQueue(session)
    queue.refusals, queue.only = 10**6, {0x000}
    sent = session.bus.sent
    before = len(sent)

    session.command("silent right/hip")
    session.run_until(lambda record: not record.mode.active, within_s=1)
    session.run(0.05)
    refused = [frame for frame in sent[before:] if frame.can_id == 0x000]
    queue.refusals = 0
    session.run(0.1)

    assert refused == []
    assert [f.data for f in sent[before:] if f.can_id == 0x000] == [b"\x02\x05"]
