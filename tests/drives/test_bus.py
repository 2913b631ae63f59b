import errno

import can
import pytest
from memory_bus import MS, ManualClock

from daemon.system.clock import MonotonicClock
from drives.canopen.bus import CanBus, Frame, SteadySocketcan
from drives.canopen.bus_state import BusCondition, BusMonitor, BusNotice
from drives.errors import BusError

RPDO = Frame(0x205, bytes(7))
TIMEOUT_NS = 30_000 * MS
QUICK_STOP = Frame(0x205, b"\x02\x00\x0a\x00\x00\x00\x00")


class Scripted(can.BusABC):
    """A python-can bus that refuses the first sends as a full SocketCAN queue does."""

    def __init__(self, refusals, error=None, clock=None):
        super().__init__(channel="scripted")
        self.channel_info = "scripted"
        self.refusals = refusals
        self.error = error or can.CanOperationError(
            "Failed to transmit: No buffer space available", errno.ENOBUFS
        )
        self.clock = clock
        self.sent = []
        self.waiting = []

    def send(self, msg, timeout=None):
        if self.refusals:
            self.refusals -= 1
            raise self.error
        self.sent.append(msg)

    def recv(self, timeout=None):
        if self.waiting:
            return self.waiting.pop(0)
        if self.clock is not None:
            self.clock.time_ns += int(timeout * 1e9)
        return None


def scripted(refusals, **options):
    raw = Scripted(refusals, **options)
    return raw, CanBus(raw, "scripted")


# --- a full transmit queue ------------------------------------------------------------------------


def test_process_data_that_find_a_full_queue_are_dropped_and_counted_and_never_raise():
    raw, bus = scripted(20)

    dropped = [bus.send([RPDO]) for _ in range(21)]

    assert dropped == [1] * 20 + [0]
    assert bus.dropped_count == 20
    assert len(raw.sent) == 1


def test_a_select_that_times_out_is_a_full_queue_too():
    _, bus = scripted(1, error=can.CanOperationError("Transmit buffer full"))

    assert bus.send([RPDO]) == 1


def test_a_quick_stop_is_tried_again_in_the_same_cycle():
    clock = ManualClock()
    raw, bus = scripted(20, clock=clock)

    left = bus.send_urgent([QUICK_STOP], clock.now_ns() + 10 * MS, clock)

    assert left == 0
    assert bytes(raw.sent[0].data) == QUICK_STOP.data
    assert bus.dropped_count == 0


def test_urgent_frames_leave_in_order():
    clock = ManualClock()
    raw, bus = scripted(3, clock=clock)

    bus.send_urgent([Frame(0, b"\x02\x05"), Frame(0, b"\x02\x06")], clock.now_ns() + 10 * MS, clock)

    assert [bytes(message.data) for message in raw.sent] == [b"\x02\x05", b"\x02\x06"]


def test_a_queue_that_stays_full_ends_at_the_deadline():
    clock = ManualClock()
    _, bus = scripted(10**6, clock=clock)
    deadline_ns = clock.now_ns() + 2 * MS

    assert bus.send_urgent([QUICK_STOP, QUICK_STOP], deadline_ns, clock) == 2
    assert clock.now_ns() <= deadline_ns + MS
    assert bus.dropped_count == 2


def test_what_arrives_while_an_urgent_frame_waits_is_not_lost():
    clock = ManualClock()
    raw, bus = scripted(2, clock=clock)
    raw.waiting = [
        can.Message(arbitration_id=0x085, data=bytes(8), is_extended_id=False),
        can.Message(arbitration_id=0x185, data=bytes(7), is_extended_id=False),
    ]

    bus.send_urgent([QUICK_STOP], clock.now_ns() + 10 * MS, clock)

    assert [frame.can_id for frame in bus.drain()] == [0x085, 0x185]
    assert bus.drain() == []


@pytest.mark.parametrize(
    "error",
    [
        can.CanOperationError("Failed to transmit: Network is down", errno.ENETDOWN),
        OSError(errno.EPIPE, "Broken pipe"),
        TimeoutError("timed out"),
    ],
)
def test_any_other_failure_to_send_is_a_bus_that_is_down(error):
    _, bus = scripted(1, error=error)

    with pytest.raises(BusError, match="cannot send"):
        bus.send([RPDO])


# --- receiving ------------------------------------------------------------------------------------


def test_waiting_ends_at_the_deadline_when_nothing_comes():
    clock = ManualClock()
    _, bus = scripted(0, clock=clock)
    deadline_ns = clock.now_ns() + 4 * MS

    assert bus.receive_until(deadline_ns, clock) == []
    assert clock.now_ns() >= deadline_ns


def test_frames_that_no_drive_of_ours_sends_are_counted_and_left_out():
    raw, bus = scripted(0)
    raw.waiting = [
        can.Message(arbitration_id=0x18FF, is_extended_id=True, data=b""),
        can.Message(arbitration_id=0x705, is_remote_frame=True, is_extended_id=False),
        can.Message(arbitration_id=0x705, data=b"\x05", is_extended_id=False, timestamp=12.5),
    ]

    # Without its stamp: only this machine's kernel is believed, on SocketCAN.
    assert bus.drain() == [Frame(0x705, b"\x05")]
    assert bus.foreign_count == 2


def test_a_babbling_node_does_not_hold_a_drain_for_ever():
    raw, bus = scripted(0)
    raw.waiting = [can.Message(arbitration_id=0x123, is_extended_id=False)] * 2000

    assert len(bus.drain()) == 512


def test_error_frames_come_through_as_such():
    raw, bus = scripted(0)
    raw.waiting = [can.Message(arbitration_id=0x040, is_error_frame=True, data=bytes(8))]

    (frame,) = bus.drain()

    assert frame.is_error
    assert frame.can_id == 0x040


# --- interfaces -----------------------------------------------------------------------------------


def test_waiting_on_socketcan_never_looks_at_the_wall_clock(monkeypatch):
    def forbidden():
        raise AssertionError("a wait that asks what time it is")

    bus = SteadySocketcan.__new__(SteadySocketcan)
    bus._is_shutdown = True  # never opened
    waited = []
    monkeypatch.setattr(bus, "_recv_internal", lambda timeout_s: (waited.append(timeout_s), False))
    monkeypatch.setattr("can.bus.time", forbidden)

    assert bus.recv(0.25) is None
    assert waited == [0.25]


def test_a_virtual_bus_carries_frames_both_ways():
    clock = MonotonicClock()
    ours = CanBus.open("virtual", "test-both-ways", 1_000_000)
    theirs = CanBus.open("virtual", "test-both-ways", 1_000_000)

    ours.send([Frame(0x080, b"")])
    got = theirs.receive_until(clock.now_ns() + TIMEOUT_NS, clock)
    theirs.send([Frame(0x185, b"1234567")])

    assert [frame[:2] for frame in got] == [(0x080, b"")]
    assert [frame[:2] for frame in ours.drain()] == [(0x185, b"1234567")]
    ours.close()
    ours.close()
    theirs.close()


def test_a_closed_bus_is_a_bus_error_and_no_traceback():
    bus = CanBus.open("virtual", "test-closed", 1_000_000)
    bus.close()

    with pytest.raises(BusError):
        bus.send([RPDO])
    with pytest.raises(BusError):
        bus.drain()


@pytest.mark.parametrize(
    ("interface", "channel"),
    [
        ("socketcan", "can_that_is_not_there"),
        ("gaitd", "a_socket_that_is_not_there"),
        ("no-such-interface", "x"),
    ],
)
def test_an_interface_that_is_not_there_is_the_operator_s_or_the_machine_s_matter(
    interface, channel
):
    with pytest.raises(BusError, match=interface):
        CanBus.open(interface, channel, 1_000_000)


def test_no_package_that_happens_to_be_installed_gives_a_bus(tmp_path):
    assert "gaitd" in can.interfaces.VALID_INTERFACES  # registered by the virtual drives

    with pytest.raises(BusError, match="no interface of python-can's own"):
        CanBus.open("gaitd", str(tmp_path / "bus"), 1_000_000)


# --- the controller's own reports -----------------------------------------------------------------


def error(class_bits, status=0):
    return Frame(class_bits, bytes((0, status, 0, 0, 0, 0, 0, 0)), is_error=True)


def test_bus_off_lasts_until_the_controller_restarts():
    monitor = BusMonitor()

    assert monitor.feed(error(0x040))
    assert not monitor.feed(error(0x004, 0x40))
    assert monitor.condition is BusCondition.OFF

    assert monitor.feed(error(0x100))
    assert monitor.condition is BusCondition.ACTIVE
    assert (monitor.bus_off_count, monitor.restart_count) == (1, 1)


@pytest.mark.parametrize("status", [0x10, 0x20])
def test_error_passive_is_an_event_and_not_bus_off(status):
    monitor = BusMonitor()

    assert monitor.feed(error(0x004, status))
    assert monitor.condition is BusCondition.PASSIVE
    assert not monitor.feed(error(0x004, status))
    assert monitor.passive_count == 2

    assert monitor.feed(error(0x004, 0x08))
    assert monitor.condition is BusCondition.WARNING
    assert monitor.feed(error(0x004, 0x40))
    assert monitor.condition is BusCondition.ACTIVE


def test_an_active_error_announcement_ends_error_passive_and_not_bus_off():
    """linux/can/error.h CAN_ERR_PROT_ACTIVE, as usb_8dev reports that all is well again."""
    monitor = BusMonitor()
    well_again = Frame(0x008, b"\0\0\x40\0\0\0\0\0", is_error=True)
    one_more = Frame(0x088, well_again.data, is_error=True)
    passive = Frame(0x00C, b"\0\x20\x40\0\0\0\0\0", is_error=True)

    monitor.feed(error(0x004, 0x20))
    assert not monitor.feed(one_more)
    assert not monitor.feed(passive)
    assert monitor.condition is BusCondition.PASSIVE
    assert monitor.feed(well_again)
    assert monitor.condition is BusCondition.ACTIVE

    monitor.feed(error(0x040))
    assert not monitor.feed(well_again)
    assert monitor.condition is BusCondition.OFF


def test_a_missing_acknowledgement_alone_is_told_apart():
    monitor = BusMonitor()

    assert not monitor.feed(error(0x020))
    assert monitor.no_ack_count == 1
    assert monitor.condition is BusCondition.ACTIVE


def test_frames_lost_in_the_controller_are_counted():
    monitor = BusMonitor()

    monitor.feed(error(0x004, 0x01))
    monitor.feed(Frame(0x004, b"", is_error=True))

    assert monitor.overflow_count == 1


def test_every_change_of_the_controller_is_told_once():
    monitor = BusMonitor()
    monitor.frame_received()
    for frame in (error(0x004, 0x08), error(0x004, 0x08), error(0x004, 0x20), error(0x040)):
        monitor.feed(frame)

    notices = monitor.take_notices()

    assert notices == [BusNotice.WARNING, BusNotice.PASSIVE, BusNotice.OFF]
    assert monitor.take_notices() == []


def test_a_storm_of_changes_leaves_a_bounded_number_of_lines():
    monitor = BusMonitor()
    for _ in range(1000):
        monitor.feed(error(0x004, 0x08))
        monitor.feed(error(0x004, 0x40))

    assert monitor.warning_count == 1000
    assert len(monitor.take_notices()) == 4


def test_a_bus_off_that_is_over_before_it_is_read_is_remembered_until_a_bring_up():
    monitor = BusMonitor()
    monitor.feed(error(0x040))
    monitor.feed(error(0x100))

    assert monitor.condition is BusCondition.ACTIVE
    assert monitor.has_been_off
    monitor.reset_history()
    assert not monitor.has_been_off


def test_a_missing_acknowledgement_is_over_when_a_node_is_heard():
    monitor = BusMonitor()
    monitor.feed(error(0x020))
    monitor.feed(Frame(0x008, b"\0\0\0\x19\0\0\0\0", is_error=True))

    assert monitor.alone
    assert monitor.no_ack_count == 2
    assert len(monitor.take_notices()) == 1
    monitor.frame_received()
    assert not monitor.alone


def test_a_transmitter_that_is_passive_before_anything_was_heard_is_alone():
    lonely, troubled = BusMonitor(), BusMonitor()
    troubled.frame_received()

    for monitor in (lonely, troubled):
        monitor.feed(error(0x004, 0x20))

    assert (lonely.alone, troubled.alone) == (True, False)
    assert lonely.no_ack_count == 0
