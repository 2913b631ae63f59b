"""The service behind a CAN driver that reports errors: two USB adapters and a wire between them.

QEMU's controllers make no errors (test_two_controllers.py). The adapters of
tests/support/usb_adapters.py do; the kernel drives them by its `usb_8dev`, and from there on
everything is its own: the states of the interface, its error frames, the carrier that is lost with
bus-off, and the restart, by hand and by `restart-ms`.
"""

import socket
import struct

import pytest
from can_wire import Controller, State, connect
from gaitd_names import Cause, EventCode, Mode
from sessions import reported
from usb_adapters import (
    ANSWERS,
    CMD_SUBMIT,
    CMD_UNLINK,
    COMMAND,
    COMMANDS,
    CONTROL,
    FRAMES_IN,
    FRAMES_OUT,
    GET_DESCRIPTOR,
    HEADER,
    OPEN,
    PRODUCT,
    RETURN,
    SUBMIT,
    UNLINK,
    wired,
)

from drives.canopen.bus_state import BusCondition

OURS = {0x000, 0x080, 0x701, *(base + node for base in (0x200, 0x300, 0x600) for node in (5, 6))}
on_the_rig = [pytest.mark.rig_vcan, pytest.mark.timeout(3000)]
MEGABIT = 1_000_000


# --- the controllers ------------------------------------------------------------------------------


class Host:
    """What a controller has told."""

    def __init__(self) -> None:
        self.heard: list[bytes] = []
        self.learnt: list[tuple[State, int]] = []

    def hear(self, frame: bytes) -> None:
        self.heard.append(frame)

    def learn(self, state: State, errors: int) -> None:
        self.learnt.append((state, errors))


@pytest.fixture
def wire():
    hosts = Host(), Host()
    controllers = tuple(map(Controller, hosts))
    connect(*controllers)
    for controller in controllers:
        controller.open(MEGABIT)
    for host in hosts:
        host.learnt.clear()
    return controllers, hosts


def test_a_frame_that_is_heard_arrives_and_counts_one_error_down(wire):
    (one, _), (_, host) = wire
    one.errors = 5

    one.send(b"frame")

    assert host.heard == [b"frame"]
    assert one.errors == 4


@pytest.mark.parametrize("silence", [Controller.close, lambda other: other.open(500_000)])
def test_a_lonely_controller_becomes_error_passive_and_goes_no_farther(wire, silence):
    (one, other), (host, _) = wire
    silence(other)

    while one.has_room:
        one.send(b"frame")

    assert host.learnt == [(State.WARNING, 96), (State.PASSIVE, 128)]
    assert (one.state, one.errors) == (State.PASSIVE, 128)


def test_what_waited_goes_out_once_another_node_listens_and_errors_fade_frame_by_frame(wire):
    (one, other), (host, heard) = wire
    other.close()
    one.send(b"first")
    other.open(MEGABIT)

    for _ in range(40):
        one.send(b"later")

    assert heard.heard == [b"first"] + 40 * [b"later"]
    assert host.learnt[-2:] == [(State.WARNING, 127), (State.ACTIVE, 95)]


def test_a_broken_transceiver_is_bus_off_until_the_controller_is_opened(wire):
    (one, _), (host, heard) = wire
    one.broken = True
    one.send(b"first")
    one.broken = False
    one.send(b"second")

    assert host.learnt[-1] == (State.BUS_OFF, 256)
    assert heard.heard == []

    one.open(MEGABIT)
    one.send(b"third")

    assert heard.heard == [b"third"]
    assert one.state is State.ACTIVE


# --- the adapters, to a host of USB/IP ------------------------------------------------------------


class UsbHost:
    """What the kernel is to an adapter."""

    def __init__(self, far: socket.socket) -> None:
        self._far = far
        self._number = 0

    def submit(self, endpoint: int, length: int = 0, out: bytes = b"", setup: bytes = b"") -> int:
        self._number += 1
        to_host = not out
        head = HEADER.pack(CMD_SUBMIT, self._number, 1, to_host, endpoint)
        rest = SUBMIT.pack(0, length or len(out), 0, 0, 0, setup)
        self._far.sendall(head + rest + out)
        return self._number

    def unlink(self, number: int) -> None:
        self._number += 1
        self._far.sendall(HEADER.pack(CMD_UNLINK, self._number, 1, 0, 0) + UNLINK.pack(number))

    def returned(self) -> tuple[int, int, int, bytes]:
        """Number, status, length and content; what follows is content."""
        came = self._far.recv(4096)
        number = HEADER.unpack_from(came)[1]
        status, length, *_ = RETURN.unpack_from(came, HEADER.size)
        return number, status, length, came[HEADER.size + RETURN.size :]


@pytest.fixture
def usb():
    """Two adapters, and who they are plugged into."""
    pairs = [socket.socketpair() for _ in range(2)]
    adapters = wired(pairs[0][0], pairs[1][0])
    yield adapters, [UsbHost(far) for _, far in pairs]
    for near, far in pairs:
        near.close()
        far.close()


def work(adapter) -> None:
    adapter.usb.read()
    adapter.go_on()


def opened(adapter, host) -> None:
    """32 MHz / (4 * (1 + 5 + 2)): 1 Mbit/s."""
    timing = struct.pack(">BBBH", 5, 2, 1, 4)
    host.submit(COMMANDS, out=COMMAND.pack(0x11, 0, OPEN, 9, 0, timing, 0x22))
    work(adapter)
    assert host.returned()[:3] == (1, 0, 16)
    host.submit(ANSWERS, 16)
    work(adapter)
    assert host.returned()[3] == COMMAND.pack(0x11, 0, OPEN, 0, 0, b"", 0x22)
    host.submit(FRAMES_IN, 64)
    work(adapter)
    assert host.returned()[3][:2] == b"\x55\x03"


def test_an_adapter_says_by_its_name_what_it_is_and_refuses_what_it_does_not_know(usb):
    (adapter, _), (host, _) = usb
    for what in (PRODUCT, 0x600):
        host.submit(CONTROL, 255, setup=struct.pack("<BBHHH", 0x80, GET_DESCRIPTOR, what, 0, 255))
        work(adapter)

    told = host._far.recv(4096)

    assert "USB2CAN converter".encode("utf-16-le") in told
    assert RETURN.unpack_from(told, len(told) - RETURN.size)[0] == -32


def test_a_frame_goes_from_one_host_over_both_adapters_to_the_other(usb):
    adapters, hosts = usb
    for adapter, host in zip(adapters, hosts, strict=True):
        opened(adapter, host)
        assert adapter.controller.bitrate_bit_per_s == MEGABIT
    frame = struct.pack(">BIB8s", 0, 0x080, 2, b"\x11\x22")
    hosts[1].submit(FRAMES_IN, 64)
    work(adapters[1])

    number = hosts[0].submit(FRAMES_OUT, out=b"\x55" + frame + b"\xaa")
    work(adapters[0])

    assert hosts[0].returned()[:3] == (number, 0, 16)
    assert hosts[1].returned()[3] == b"\x55\x00" + frame + bytes(4) + b"\xaa"


def test_frames_for_which_there_is_no_room_stay_with_the_host_and_can_be_taken_back(usb):
    (adapter, _), (host, _) = usb
    opened(adapter, host)
    frame = b"\x55" + struct.pack(">BIB8s", 0, 0x080, 0, b"") + b"\xaa"
    numbers = [host.submit(FRAMES_OUT, out=frame) for _ in range(5)]
    work(adapter)
    taken = host._far.recv(4096)

    assert len(taken) == 3 * (HEADER.size + RETURN.size)
    host.unlink(numbers[-1])
    work(adapter)
    assert host.returned()[1] == -104
    assert [number for _, number, _ in adapter.usb.given] == [numbers[3]]


# --- the service ----------------------------------------------------------------------------------


def rig_test(test):
    for mark in on_the_rig:
        test = mark(test)
    return test


@rig_test
def test_the_drives_are_found_over_two_usb_adapters_at_1_mbit_per_s(controllers_world):
    info = controllers_world.facts["usb"]["linkinfo"]["info_data"]

    assert info["state"] == "ERROR-ACTIVE"
    assert info["bittiming"]["bitrate"] == 1_000_000


@rig_test
def test_alone_on_the_wire_our_controller_is_error_passive_and_says_so(controllers_world):
    info = controllers_world.facts["usb_alone"]["linkinfo"]["info_data"]
    records = controllers_world.records("usb_alone")

    assert info["state"] == "ERROR-PASSIVE"
    assert reported(records, EventCode.CAN_PASSIVE, EventCode.CAN_ALONE)
    assert records[-1].bus.condition == BusCondition.PASSIVE.value
    assert records[-1].bus.bus_off_count == 0


@rig_test
def test_heard_again_the_controller_becomes_error_active_frame_by_frame(controllers_world):
    info = controllers_world.facts["usb_heard_again"]["linkinfo"]["info_data"]
    records = controllers_world.records("usb_heard_again")

    assert info["state"] == "ERROR-ACTIVE"
    assert records[-1].bus.condition == BusCondition.ACTIVE.value
    assert reported(records, EventCode.CAN_ACTIVE)


@rig_test
def test_a_transceiver_that_breaks_is_bus_off_and_nothing_of_ours_gets_out(controllers_world):
    link = controllers_world.facts["usb_off"]
    last = controllers_world.records("usb_off")[-1]

    assert link["linkinfo"]["info_data"]["state"] == "BUS-OFF"
    assert "NO-CARRIER" in link["flags"]
    assert last.verdict.cause == Cause.BUS_OFF
    assert last.mode in {Mode.OFF, Mode.FAULT}
    assert (last.bus.condition, last.bus.bus_off_count) == (BusCondition.OFF.value, 1)
    assert not [one for one in controllers_world.frames("usb_off") if one.frame.can_id in OURS]


@rig_test
def test_bus_off_lasts_until_the_controller_is_restarted(controllers_world):
    facts = controllers_world.facts

    assert facts["usb_mended"]["linkinfo"]["info_data"]["state"] == "BUS-OFF"
    assert facts["usb_restarted"]["linkinfo"]["info_data"]["state"] == "ERROR-ACTIVE"
    assert facts["usb_restarted"]["linkinfo"]["info_xstats"]["restarts"] == 1
    assert facts["condition_restarted"] == BusCondition.ACTIVE.value


@rig_test
def test_with_restart_ms_the_kernel_restarts_it_again_and_again_and_nothing_is_enabled(
    controllers_world,
):
    records = controllers_world.records("usb_restarting")
    bus, before = records[-1].bus, records[0].bus

    assert controllers_world.facts["usb_restarting"]["linkinfo"]["info_data"]["restart_ms"] == 100
    assert bus.bus_off_count >= before.bus_off_count + 2
    assert bus.restart_count > before.restart_count
    assert records[-1].verdict.cause == Cause.BUS_OFF
    assert records[-1].mode in {Mode.OFF, Mode.FAULT, Mode.BRINGING_UP}


@rig_test
def test_mended_the_drives_are_found_again_without_a_hand_on_the_interface(controllers_world):
    facts = controllers_world.facts
    records = controllers_world.records("usb_restarted_by_itself")

    assert facts["usb_restarted_by_itself"]["linkinfo"]["info_data"]["state"] == "ERROR-ACTIVE"
    # Ready as often as they are found; the drives behind two adapters answer too late to stay so.
    assert Mode.READY in {record.mode for record in records}
    assert records[-1].bus.condition == BusCondition.ACTIVE.value
    assert facts["usb_exit"] == 0
