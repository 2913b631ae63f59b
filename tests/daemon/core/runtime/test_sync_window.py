"""One SYNC and its answers: what counts as one, and when listening ends."""

from dataclasses import dataclass, field

import pytest

from daemon.core.runtime.sync_window import Window
from drives.canopen.bus import Frame
from drives.canopen.nmt import SYNC_FRAME, SyncProducer, heartbeat_frame

MS = 1_000_000
AHEAD_NS = 1_767_225_600 * 1_000_000_000
WINDOW_NS = 4 * MS
STATUS, TORQUE = 0x185, 0x285
HEARTBEAT_CYCLES, MASTER_NODE_ID = 2, 127


@dataclass
class Wire:
    """Line, clock and drives at once: frames come at their times, and are read when asked for."""

    coming: list[tuple[int, int]]
    """(monotonic ns, identifier), in order."""
    now: int = 0
    stepped_ns: int = 0
    step_at_ns: int = 1 << 62
    stamped: bool = True
    waiting: list[int] = field(default_factory=list)
    """Identifiers of frames that were in the socket before SYNC."""
    sent: list[Frame] = field(default_factory=list)
    between: list[int] = field(default_factory=list)
    cyclic_ids = frozenset({STATUS, TORQUE})
    sync = SyncProducer()
    is_off = False

    def now_ns(self):
        return self.now

    def utc_ns(self):
        return self.utc_of(self.now)

    def utc_of(self, mono_ns):
        return AHEAD_NS + mono_ns + (self.stepped_ns if mono_ns >= self.step_at_ns else 0)

    def sleep_until(self, deadline_ns):
        raise AssertionError(deadline_ns)

    def send(self, frames):
        self.sent += frames

    def drain(self):
        waiting, self.waiting = self.waiting, []
        return [Frame(can_id, b"") for can_id in waiting]

    def receive_until(self, deadline_ns):
        if self.coming and self.coming[0][0] <= deadline_ns:
            self.now = max(self.now, self.coming[0][0])
        else:
            self.now = max(self.now, deadline_ns)
        came = [one for one in self.coming if one[0] <= self.now]
        self.coming = self.coming[len(came) :]
        return [
            Frame(can_id, b"", self.utc_of(at_ns) if self.stamped else 0) for at_ns, can_id in came
        ]

    def feed_between(self, frames, now_ns):
        del now_ns
        self.between += [frame.can_id for frame in frames]
        return False


def collected(wire, window=None):
    window = window or Window(wire, wire, WINDOW_NS, HEARTBEAT_CYCLES, MASTER_NODE_ID)
    answers = window.collect(wire, wire.now)
    return [frame.can_id for frame in answers.frames], answers.answer_ns, window


def test_listening_ends_when_all_have_answered_once_a_whole_window_was_complete():
    wire = Wire([(1 * MS, STATUS), (2 * MS, TORQUE), (12 * MS, STATUS), (13 * MS, TORQUE)])
    first, _, window = collected(wire)
    assert (first, wire.now) == ([STATUS, TORQUE], WINDOW_NS)

    wire.now = 11 * MS
    second, _, _ = collected(wire, window)

    assert (second, wire.now) == ([STATUS, TORQUE], 13 * MS)


@pytest.mark.parametrize("read_ms", [2, 3])
def test_a_bus_that_never_rests_does_not_lengthen_the_window(read_ms):
    wire = Wire([], now=10 * MS)

    def receive_until(_deadline_ns):
        wire.now += read_ms * MS
        assert wire.now < 20 * MS
        return [Frame(STATUS, b"", wire.utc_of(wire.now))]

    wire.receive_until = receive_until

    assert collected(wire)[0] == [STATUS] * 2


def test_what_came_between_the_last_look_and_the_sync_is_late_and_no_sample():
    wire = Wire([(9 * MS, STATUS), (11 * MS, STATUS), (12 * MS, TORQUE)], now=10 * MS)

    answers, _, _ = collected(wire)

    assert answers == [STATUS, TORQUE]
    assert wire.between == [STATUS]


@pytest.mark.parametrize("stepped_ns", [3_600_000 * MS, -3_600_000 * MS, 5 * MS, -5 * MS])
@pytest.mark.parametrize("step_at_ns", [10 * MS, 11_500_000, 12 * MS])
def test_a_wall_clock_that_is_set_inside_a_window_costs_no_answer(stepped_ns, step_at_ns):
    wire = Wire([(11 * MS, STATUS), (12 * MS, TORQUE)], 10 * MS, stepped_ns, step_at_ns)

    answers, _, _ = collected(wire)

    assert answers == [STATUS, TORQUE]
    assert wire.between == []


def test_the_time_of_the_last_answer_is_told_by_its_stamp_and_not_by_when_it_was_read():
    wire = Wire([(10_400_000, STATUS), (10_700_000, TORQUE)], now=10 * MS)
    wire.receive_until = late(wire)

    _, answer_ns, _ = collected(wire)

    assert answer_ns == pytest.approx(700_000, abs=1000)


def late(wire):
    """Reading, 3 ms after a frame has come: another process had the processor."""
    read = Wire.receive_until

    def receive_until(deadline_ns):
        wire.now += 3 * MS
        return read(wire, deadline_ns)

    return receive_until


def test_without_stamps_the_order_of_reading_decides():
    wire = Wire([(9 * MS, STATUS), (12 * MS, TORQUE)], now=10 * MS, stamped=False)

    answers, answer_ns, _ = collected(wire)

    assert answers == [STATUS, TORQUE]
    assert answer_ns == 0


def test_what_waited_in_the_socket_is_late():
    wire = Wire([(11 * MS, STATUS), (12 * MS, TORQUE)], now=10 * MS, waiting=[STATUS])

    answers, _, _ = collected(wire)

    assert (answers, wire.between) == ([STATUS, TORQUE], [STATUS])


def test_an_answer_that_comes_twice_is_kept_and_completes_nothing():
    wire = Wire([(1 * MS, STATUS), (2 * MS, STATUS), (3 * MS, TORQUE)])

    answers, answer_ns, window = collected(wire)

    assert answers == [STATUS, STATUS, TORQUE]
    assert answer_ns == pytest.approx(3 * MS, abs=1000)
    window.reset()
    wire.coming, wire.now = [(11 * MS, STATUS), (12 * MS, TORQUE)], 10 * MS
    collected(wire, window)
    assert wire.now == 14 * MS  # after a bring-up the first window is used in full again


def test_the_heartbeat_leaves_with_every_second_sync():
    wire, window = Wire([]), None
    for _ in range(4):
        _, answer_ns, window = collected(wire, window)
        assert answer_ns == 0

    own = heartbeat_frame(MASTER_NODE_ID)
    assert wire.sent == [SYNC_FRAME, SYNC_FRAME, own, SYNC_FRAME, SYNC_FRAME, own]


def test_while_the_controller_is_off_no_sync_leaves():
    wire = Wire([(11 * MS, STATUS)], now=10 * MS)
    wire.is_off = True

    assert collected(wire)[:2] == ([], 0)
    assert wire.sent == []
