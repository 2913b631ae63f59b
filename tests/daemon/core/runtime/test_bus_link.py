"""The bus of the loop: what is sent, dropped and counted, and what the operator is told of it."""

from dataclasses import dataclass, field

import pytest
from gaitd_names import EventCode

from daemon.core.runtime.bus_link import Line
from daemon.ipc.record import BusRecord
from daemon.ipc.report import Event
from drives.bringup.configurator import Configurator
from drives.canopen.bus import Frame
from drives.canopen.bus_state import BusCondition, BusNotice

COMMANDS = [Frame(0x201 + number, bytes([number])) for number in range(4)]
OFF = Frame(0x040, bytes(8), is_error=True)


@dataclass
class OpenBus:
    """A bus that takes all but some frames, and has what it received."""

    left_count: int = 0
    coming: list[Frame] = field(default_factory=list)
    sent: list[Frame] = field(default_factory=list)
    closed_count: int = 0

    def send(self, frames):
        self.sent += frames
        return self.left_count

    def send_urgent(self, frames, deadline_ns, clock):
        assert (deadline_ns, clock) == (77, "clock")
        return self.send(frames)

    def drain(self):
        return self.coming

    def receive_until(self, deadline_ns, clock):
        assert (deadline_ns, clock) == (78, "clock")
        return self.coming

    def close(self):
        self.closed_count += 1


@pytest.fixture
def bus():
    return OpenBus()


@pytest.fixture
def line(bus):
    made = Line(lambda: bus, "clock", sync_overflow=0, master_node_id=127, bitrate_bit_per_s=10**6)
    made.open()
    return made


def bits_of(line):
    """Bits that the load meter has counted; the ratio of a second at 1 Mbit/s."""
    line.load.count(0)
    line.load.count(10**9)
    return round(line.load.busy_ratio * 10**6)


def test_nothing_is_sent_before_the_bus_is_open_and_it_is_opened_and_closed_once(bus):
    opened = []
    line = Line(lambda: opened.append(bus) or bus, "clock", 0, 127, 10**6)
    line.close()
    with pytest.raises(RuntimeError, match="before the bus is open"):
        line.drain()
    for _ in range(2):
        line.open()
        assert line.is_open
    for _ in range(2):
        line.close()
        assert not line.is_open

    assert (len(opened), bus.closed_count) == (1, 1)
    line.bus_state.feed(OFF)
    line.open()
    assert not line.is_off


@pytest.mark.parametrize("left_count", [0, 1])
def test_frames_that_find_no_room_are_counted_and_cost_no_bus_load(bus, line, left_count):
    bus.left_count = left_count

    line.send(COMMANDS)
    assert line.send_urgent(COMMANDS, 77) is (left_count == 0)
    line.drop(COMMANDS)

    assert bus.sent == COMMANDS * 2
    assert line.dropped_count == 2 * left_count + 4
    one = Line(OpenBus, "clock", 0, 127, 10**6)
    one.load.add(COMMANDS[: 4 - left_count] * 2)
    assert bits_of(line) == bits_of(one) > 0


def test_nothing_is_sent_while_the_controller_is_off(bus, line):
    line.bus_state.feed(OFF)

    line.send(COMMANDS)
    assert not line.send_urgent(COMMANDS, 77)

    assert (line.is_off, bus.sent, line.dropped_count) == (True, [], 0)


@pytest.mark.parametrize("read", [lambda line: line.drain(), lambda line: line.receive_until(78)])
def test_what_only_a_master_sends_comes_from_another_one(bus, line, read):
    own, error = Frame(0x77F, b"\5"), Frame(0x080, bytes(8), is_error=True)
    bus.coming = [Frame(0x080, b""), own, Frame(0x77E, b"\5"), error]
    line.bus_state.alone = True

    assert read(line) is bus.coming
    assert line.foreign_count == 2
    assert not line.bus_state.alone
    bus.coming = [error]
    line.bus_state.alone = True
    read(line)
    assert (line.foreign_count, line.bus_state.alone) == (2, True)
    assert bits_of(line) > 0


def test_another_master_is_told_at_the_first_time_and_at_each_tenfold_count(bus, line):
    told = []
    for _ in range(25):
        bus.coming = [Frame(0x080, b"")]
        line.drain()
        told += line.take_notices()

    code = EventCode.CAN_FOREIGN_MASTER
    assert told == [Event(code, values=(count,)) for count in (1, 11)]


def test_the_controller_is_told_and_recorded(line):
    state = line.bus_state
    state.overflow_count = 7
    state.take_notices = lambda: list(BusNotice)

    assert {event.code: event.values for event in line.take_notices()} == {
        EventCode.CAN_ACTIVE: (),
        EventCode.CAN_WARNING: (),
        EventCode.CAN_PASSIVE: (),
        EventCode.CAN_OFF: (),
        EventCode.CAN_ALONE: (),
        EventCode.CAN_FRAMES_LOST: (7,),
    }
    state.condition = BusCondition.PASSIVE
    state.bus_off_count, state.passive_count, state.warning_count = 1, 2, 3
    state.restart_count, state.no_ack_count = 4, 5
    line.foreign_count, line.load.busy_ratio = 6, 0.25
    assert line.record(8) == BusRecord("error passive", 1, 2, 3, 4, 5, 7, 6, 8, 0.25)


@pytest.mark.parametrize("requested", [False, True])
def test_a_bring_up_begins_without_history_and_after_a_reset_with_a_controller_that_runs(
    line, requested
):
    line.bus_state.feed(OFF)
    assert line.bus_state.has_been_off

    port = line.port(requested=requested, meanwhile=lambda: None)

    assert isinstance(port, Configurator)
    assert not line.bus_state.has_been_off
    assert line.is_off is not requested
