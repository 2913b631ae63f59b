"""What the port of bring-up sends, counts and waits for, on a bus in memory, frame by frame."""

import queue
import struct
from collections import deque

import pytest
from memory_bus import MS
from sdo_server import NODE, client, segmented

from drives.bringup.port import NodeTraffic
from drives.canopen.bus import Frame
from drives.canopen.bus_state import BusCondition, BusMonitor
from drives.canopen.nmt import SyncProducer
from drives.errors import BusError, BusOff, SdoAborted, SdoGarbled, SdoTimeout
from drives.signals import NmtState

OTHER_NODE = 6
EMERGENCY = bytes.fromhex("3081110000000000")
BUS_OFF = Frame(0x040, bytes(8), is_error=True)
NO_ACK = Frame(0x020, bytes(8), is_error=True)
NUMBER = b"\x92\x01\x02\x00"


def silent(**options):
    return client(lambda request: [], **options)


def number(request):
    """The reply of a server to whom every object is the same number."""
    return [b"\x43" + request[1:4] + NUMBER]


def receive(port, *frames):
    """Put frames on the bus, and receive them one wait after the other."""
    for frame in frames:
        port._bus.put(frame)
        port.wait(port.now_ns())


# --- what is counted ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("can_id", "data", "counted"),
    [
        *(
            (service + NODE, b"ab", {"pdo_count": {service + NODE: 1}, "pdo_data": b"ab"})
            for service in (0x180, 0x280, 0x380, 0x480)
        ),
        (0x080 + NODE, EMERGENCY, {"emergencies": deque([EMERGENCY])}),
        (0x700 + NODE, b"\x00", {"boot_up_count": 1, "nmt_state": NmtState.BOOT_UP}),
        (0x700 + NODE, b"\x05", {"heartbeat_count": 1, "nmt_state": NmtState.OPERATIONAL}),
        (0x700 + NODE, b"\x05\x05", {}),
        (0x580 + NODE, b"\x43\x00\x10\x00" + NUMBER, {}),
        *(
            (service + NODE, b"\x05", {})
            for service in (0x000, 0x100, 0x200, 0x500, 0x600, 0x680, 0x780)
        ),
    ],
)
def test_each_frame_is_counted_for_its_node(can_id, data, counted):
    port, _, _ = silent()
    if "pdo_data" in counted:
        counted = counted | {"pdo_data": {can_id: counted["pdo_data"]}}

    receive(port, Frame(can_id, data))

    assert port.traffic(NODE) == NodeTraffic(**counted)
    assert port.traffic(OTHER_NODE) == port.traffic(0) == NodeTraffic()
    assert port.foreign_sync_count == 0


def test_a_sync_of_another_node_is_counted_and_is_no_emergency():
    port, _, _ = silent()

    receive(port, Frame(0x080, b""), Frame(0x080, b"\x01"))

    assert port.foreign_sync_count == 2
    assert port.traffic(0) == NodeTraffic()


def test_of_each_pdo_the_newest_is_kept():
    port, _, _ = silent()

    receive(port, Frame(0x185, b"a"), Frame(0x285, b"b"), Frame(0x185, b"c"))

    assert port.traffic(NODE).pdo_count == {0x185: 2, 0x285: 1}
    assert port.traffic(NODE).pdo_data == {0x185: b"c", 0x285: b"b"}


def test_boot_up_messages_heartbeats_and_other_frames_of_their_service_are_told_apart():
    port, _, _ = silent()
    found = []

    for data in (b"\x00", b"\x7f", b"\x05", b"\x33", b"\x00", b"\x05"):
        receive(port, Frame(0x705, data))
        traffic = port.traffic(NODE)
        found.append((traffic.boot_up_count, traffic.heartbeat_count, traffic.nmt_state))

    boot_up, pre, run = NmtState.BOOT_UP, NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL
    assert found == [
        (1, 0, boot_up),
        (1, 1, pre),
        (1, 2, run),
        (1, 2, run),
        (2, 2, boot_up),
        (2, 3, run),
    ]


def test_the_heartbeats_of_two_nodes_are_counted_apart():
    port, _, _ = silent()

    receive(port, Frame(0x705, b"\x05"), Frame(0x706, b"\x05"), Frame(0x705, b"\x05"))

    assert [port.traffic(node).heartbeat_count for node in (NODE, OTHER_NODE)] == [2, 1]


# --- the bus --------------------------------------------------------------------------------------


def test_a_frame_shows_that_another_node_is_there_and_an_error_frame_does_not():
    port, _, _ = silent()

    receive(port, NO_ACK, NO_ACK)
    assert port.bus_state.alone
    receive(port, Frame(0x185, b""))

    assert not port.bus_state.alone
    assert port.traffic(NODE).pdo_count == {0x185: 1}
    assert port.traffic(NO_ACK.can_id & 0x7F) == NodeTraffic()


def test_nothing_is_sent_and_nothing_waited_for_while_the_controller_is_bus_off():
    port, _, _ = silent()

    with pytest.raises(BusOff, match="in bring-up: the controller is bus-off: wiring, bit rate"):
        receive(port, BUS_OFF)
    with pytest.raises(BusOff):
        port.send([Frame(0, b"\x82\x05")])
    assert port._bus.sent == []

    receive(port, Frame(0x185, b""))  # the report of its restart was lost
    assert port.bus_state.condition is BusCondition.ACTIVE
    port.send([Frame(0, b"\x82\x05")])
    assert port._bus.sent == [Frame(0, b"\x82\x05")]


@pytest.mark.parametrize("alone", [True, False])
def test_frames_that_do_not_leave_within_their_time_are_an_error_of_the_bus(alone):
    port, _, clock = silent()
    asked = []

    def full(frames, deadline_ns, its_clock):
        asked.append((frames, deadline_ns - clock.now_ns(), its_clock))
        return 1

    port._bus.send_urgent = full
    port.bus_state.alone = alone
    frames = [Frame(0, b"\x82\x05"), Frame(0, b"\x82\x06")]

    with pytest.raises(BusError) as caught:
        port.send(frames)

    assert asked == [(frames, 20 * MS, clock)]
    assert str(caught.value) == (
        "CAN bus in bring-up: the transmit queue stays full: 1 frames of bring-up did not leave"
        + ("; no other node is on the bus" if alone else "")
    )


def test_sync_and_state_of_the_bus_are_the_owner_s_or_new_ones():
    sync, bus_state = SyncProducer(3), BusMonitor()
    port, _, _ = silent(sync=sync, bus_state=bus_state)
    assert (port.sync, port.bus_state) == (sync, bus_state)

    port, _, _ = silent()
    assert port.sync.frame() == Frame(0x080, b"")
    assert port.bus_state.condition is BusCondition.ACTIVE


# --- transfers ------------------------------------------------------------------------------------


def test_a_read_is_one_request():
    port, server, clock = client(number)
    begun_ns = clock.now_ns()

    assert port.read(NODE, 0x1018, 2) == NUMBER

    assert server.requests == [bytes.fromhex("4018100200000000")]
    assert clock.now_ns() - begun_ns == 1 * MS


def test_a_write_of_up_to_four_bytes_is_one_request():
    port, server, _ = client(lambda request: [b"\x60" + request[1:4] + bytes(4)])

    port.write(NODE, 0x6040, 0, b"\x06\x00")

    assert server.requests == [bytes.fromhex("2b40600006000000")]


def test_a_write_of_more_than_four_bytes_goes_in_segments():
    def reply(request):
        if request[0] & 0xE0 == 0x20:
            return [b"\x60" + request[1:4] + bytes(4)]
        return [bytes((0x20 | request[0] & 0x10,)) + bytes(7)]

    port, server, _ = client(reply)

    port.write(NODE, 0x1010, 1, b"twelve bytes")

    assert server.requests == [
        bytes.fromhex("211010010c000000"),
        b"\x00twelve ",
        b"\x15bytes\0\0",
    ]


def test_an_abort_code_that_the_standard_does_not_have_is_told_as_it_is():
    port, _, _ = client(lambda request: [b"\x80" + request[1:4] + struct.pack("<I", 0x0ABC_0DEF)])

    with pytest.raises(SdoAborted) as caught:
        port.write(NODE, 0x6040, 0, b"\x06\x00")

    assert str(caught.value) == "6040h:00 aborted with 0ABC0DEFh, unknown abort code"
    assert caught.value.code == 0x0ABC_0DEF


def test_the_wait_for_a_reply_is_cut_into_slices_and_ends_exactly():
    calls = []
    port, _, clock = silent(sdo_timeout_ns=25 * MS, meanwhile=lambda: calls.append(clock.now_ns()))
    begun_ns = clock.now_ns()

    with pytest.raises(SdoTimeout, match="within 25 ms"):
        port.read(NODE, 0x1000, 0)

    assert [call_ns - begun_ns for call_ns in calls] == [10 * MS, 20 * MS, 25 * MS]
    assert clock.now_ns() - begun_ns == 25 * MS


def test_a_wait_that_ends_late_is_over():
    port, _, clock = silent()
    receive_until = port._bus.receive_until

    def late(deadline_ns, its_clock):
        frames = receive_until(deadline_ns, its_clock)
        clock.time_ns += 1
        return frames

    port._bus.receive_until = late

    with pytest.raises(SdoTimeout):
        port.read(NODE, 0x1000, 0)


def test_canopen_waits_by_no_clock_of_its_own(monkeypatch):
    timeouts_s, get = [], queue.Queue.get

    def recorded(self, block=True, timeout=None):
        timeouts_s.append(timeout)
        return get(self, block, timeout)

    monkeypatch.setattr(queue.Queue, "get", recorded)
    port, _, _ = client(number)
    port.read(NODE, 0x1000, 0)

    assert timeouts_s == [0]


def test_an_abort_without_a_code_is_a_general_error():
    port, server, _ = client(number)
    port.read(NODE, 0x1018, 2)

    port._clients[NODE].abort()

    assert server.aborts == [bytes.fromhex("8018100200000008")]


def test_a_reply_of_the_last_moment_counts_and_a_later_one_does_not():
    for late_ns, outcome in ((0, "read"), (1, "silent")):
        port, _, _ = silent()
        port._bus.put(Frame(0x585, b"\x43\x00\x10\x00" + NUMBER), 300 * MS + late_ns)
        if outcome == "read":
            assert port.read(NODE, 0x1000, 0) == NUMBER
        else:
            with pytest.raises(SdoTimeout, match="within 300 ms"):
                port.read(NODE, 0x1000, 0)


def test_a_transfer_after_one_that_timed_out_is_told_by_its_own_error():
    port, server, _ = silent()
    with pytest.raises(SdoTimeout):
        port.read(NODE, 0x1000, 0)

    server.reply = segmented(b"EPOS4 Compact", toggles=(0, 0))

    with pytest.raises(SdoGarbled, match="1008h:00: Toggle bit mismatch"):
        port.read(NODE, 0x1008, 0)


@pytest.mark.parametrize(("timeout_ms", "whole_ms"), [(300, 1000), (2000, 2000)])
def test_the_limit_of_a_whole_transfer_is_never_less_than_that_of_a_reply(timeout_ms, whole_ms):
    """The server sends a segment each 90 ms, and does not end."""
    port, _, clock = client(segmented(bytes(100_000), end=False), sdo_timeout_ns=timeout_ms * MS)
    bus = port._bus
    put = bus.put
    bus.put = lambda frame, after_ns=0: put(frame, 90 * after_ns)
    begun_ns = clock.now_ns()

    with pytest.raises(SdoTimeout):
        port.read(NODE, 0x1008, 0)

    assert clock.now_ns() - begun_ns == whole_ms * MS


@pytest.mark.parametrize(
    ("reply", "read"),
    [
        ("4300100092010200", True),
        ("43001000920102", False),  # seven bytes
        ("430010009201020000", False),  # nine bytes
        ("6000100092010200", False),  # the reply to a write
        ("4301100092010200", False),
        ("4300110092010200", False),
        ("4300100192010200", False),
        ("0000100092010200", False),  # a segment
        ("c300100092010200", False),  # a block
    ],
)
def test_a_reply_belongs_to_the_request_by_its_kind_and_its_object(reply, read):
    data = bytes.fromhex(reply)
    port, _, _ = client(lambda request: [data] if request[0] == 0x40 else [])

    if read:
        assert port.read(NODE, 0x1000, 0) == NUMBER
        return
    with pytest.raises(SdoTimeout):
        port.read(NODE, 0x1000, 0)


@pytest.mark.parametrize(("named", "outcome"), [("001000", SdoAborted), ("011000", SdoTimeout)])
def test_an_abort_ends_the_transfer_of_its_object_alone(named, outcome):
    abort = bytes.fromhex("80" + named + "00000206")
    port, _, _ = client(lambda request: [abort] if request[0] == 0x40 else [])

    with pytest.raises(outcome):
        port.read(NODE, 0x1000, 0)


def test_a_segment_needs_no_object_and_an_abort_between_segments_does():
    """Between segments, replies that name an object belong to another transfer."""
    whole = segmented(b"EPOS4 Compact")

    def reply(request):
        stray = [] if request[0] == 0x40 else [b"\x80\x00\x20\x01" + bytes(4), *number(request)]
        return stray + whole(request)

    port, _, _ = client(reply)

    assert port.read(NODE, 0x1008, 0) == b"EPOS4 Compact"


# --- replies that come twice ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("again", "repeats"),
    [
        ("4300100092010200", 1),
        ("43001000ffffffff", 1),  # the other node has another value
        ("4700100092010200", 0),
        ("4301100092010200", 0),
        ("43001000", 1),
        ("430010", 0),
        ("", 0),
        ("00", 0),
    ],
)
def test_a_reply_that_repeats_the_one_before_is_counted(again, repeats):
    port, _, _ = client(number)
    receive(port, Frame(0x585, b""), Frame(0x585, bytes.fromhex(again)))
    assert port.traffic(NODE).sdo_repeat_count == 0

    port.read(NODE, 0x1000, 0)
    receive(port, Frame(0x585, bytes.fromhex(again)))

    assert port.traffic(NODE).sdo_repeat_count == repeats
    assert port.traffic(OTHER_NODE).sdo_repeat_count == 0


def test_two_replies_at_the_same_time_are_one_and_its_repeat():
    port, _, _ = client(number)
    port._bus.put(Frame(0x585, b"\x43\x00\x10\x00" + NUMBER), 1 * MS)

    assert port.read(NODE, 0x1000, 0) == NUMBER
    assert port.traffic(NODE).sdo_repeat_count == 1


@pytest.mark.parametrize(
    ("request_", "reply"),
    [
        ("4000100000000000", "4300100092010200"),
        ("4000100000000000", "8000100000000206"),
        ("2b00100000000000", "6000100000000000"),
        ("6000000000000000", "00"),
    ],
)
def test_a_reply_to_another_client_s_request_repeats_none_and_the_next_one_does(request_, reply):
    """One that came before ours, too: one of two equal replies is ours."""
    port, _, _ = client(number)
    receive(port, Frame(0x605, b""), Frame(0x605, bytes.fromhex(request_)))
    port.read(NODE, 0x1000, 0)
    again = Frame(0x585, bytes.fromhex("4300100092010200"))

    receive(port, Frame(0x585, bytes.fromhex(reply)))
    assert port.traffic(NODE).sdo_repeat_count == 0
    receive(port, again)
    assert port.traffic(NODE).sdo_repeat_count == 1


def test_a_reply_to_another_client_s_download_repeats_ours_once_it_comes_twice():
    port, _, _ = client(lambda request: [b"\x60" + request[1:4] + bytes(4)])
    port.write(NODE, 0x6060, 0, b"\x08")
    receive(port, Frame(0x605, bytes.fromhex("2f60600008000000")))

    for repeats in (0, 1):
        receive(port, Frame(0x585, bytes.fromhex("6060600000000000")))
        assert port.traffic(NODE).sdo_repeat_count == repeats


def test_a_segment_for_another_client_repeats_ours_once_it_comes_twice():
    port, _, _ = client(segmented(b"EPOS4 Compact"))
    port.read(NODE, 0x1008, 0)
    receive(port, Frame(0x605, b"\x70" + bytes(7)))

    for repeats in (0, 1):
        receive(port, Frame(0x585, b"\x13other"))
        assert port.traffic(NODE).sdo_repeat_count == repeats


def test_a_reply_to_another_client_before_any_request_of_ours_is_none_of_ours():
    port, _, _ = client(number)

    receive(
        port,
        Frame(0x605, bytes.fromhex("4000100000000000")),
        Frame(0x585, bytes.fromhex("4300100092010200")),
    )

    assert port.read(NODE, 0x1000, 0) == NUMBER
    assert port.traffic(NODE).sdo_repeat_count == 0


@pytest.mark.parametrize(("came_ms", "requests"), [(None, 1), (0, 2), (100, 2)])
def test_an_upload_without_a_reply_is_tried_once_more_where_it_met_another_client(
    came_ms, requests
):
    """The other one's request came before it, or while it waited; its reply is none of ours."""
    port, server, _ = client(lambda request: [])
    if came_ms is not None:
        port._bus.put(Frame(0x605, bytes.fromhex("4001320100000000")), came_ms * MS)
        port._bus.put(Frame(0x585, bytes.fromhex("4b013201fa000000")), (came_ms + 1) * MS)
        port.wait(port.now_ns())

    with pytest.raises(SdoTimeout):
        port.read(NODE, 0x1000, 0)

    assert [request[0] for request in server.requests].count(0x40) == requests


def test_a_late_reply_to_a_request_that_was_given_up_repeats_none():
    port, server, _ = client(number)
    port.read(NODE, 0x1000, 0)
    server.reply = lambda request: []
    with pytest.raises(SdoTimeout):
        port.read(NODE, 0x1000, 0)

    receive(port, Frame(0x585, b"\x43\x00\x10\x00" + NUMBER))
    assert port.traffic(NODE).sdo_repeat_count == 0
    server.reply = lambda request: [b"\x4f" + request[1:4] + b"\x07\0\0\0"]
    assert port.read(NODE, 0x1001, 0) == b"\x07"


def test_a_segment_is_repeated_by_its_command_and_toggle_bit():
    port, _, _ = client(segmented(b"EPOS4 Compact"))
    port.read(NODE, 0x1008, 0)  # the last segment has the command 13h

    for data, repeats in ((b"\x13other", 1), (b"\x03pact", 1), (b"\x13", 2)):
        receive(port, Frame(0x585, data))
        assert port.traffic(NODE).sdo_repeat_count == repeats


def test_repeats_are_counted_for_each_node():
    port, server, _ = client(number)
    port.read(NODE, 0x1000, 0)
    receive(port, Frame(0x585, bytes.fromhex("4300100092010200")))
    port._bus.put(Frame(0x586, bytes.fromhex("4300100092010200")), 1 * MS)
    port.read(OTHER_NODE, 0x1000, 0)

    receive(port, *[Frame(0x586, bytes.fromhex("4300100092010200"))] * 2)

    assert [port.traffic(node).sdo_repeat_count for node in (NODE, OTHER_NODE)] == [1, 2]
    assert len(server.requests) == 1
