"""Our SDO client against servers that do what they should not, frame by frame (CiA 301 7.2.4)."""

import struct

import pytest
from bringup_bench import Bench
from hypothesis import given, settings
from hypothesis import strategies as st
from memory_bus import MS
from sdo_server import NODE, client, segmented

from drives.bringup.configurator import SDO_TIMEOUT_NS, SDO_TRANSFER_NS
from drives.canopen.bus import Frame
from drives.errors import DrivesError, SdoAborted, SdoGarbled, SdoTimeout

NAME = b"EPOS4 Compact 50/15"


# --- what works -----------------------------------------------------------------------------------


def test_a_string_comes_in_segments():
    port, _, _ = client(segmented(NAME))

    assert port.read(NODE, 0x1008, 0) == NAME


def test_a_number_that_comes_in_segments_where_one_frame_was_enough_is_read():
    port, _, _ = client(segmented(b"\x92\x01\x02\x00"))

    assert port.read(NODE, 0x1000, 0) == b"\x92\x01\x02\x00"


@pytest.mark.parametrize(("command", "size"), [(0x43, 4), (0x47, 3), (0x4B, 2), (0x4F, 1)])
def test_a_string_that_comes_in_one_frame_where_segments_were_likely_is_read(command, size):
    port, _, _ = client(lambda request: [bytes((command,)) + request[1:4] + b"EPOS"])

    assert port.read(NODE, 0x1008, 0) == b"EPOS"[:size]


# --- one channel, one transfer at a time ----------------------------------------------------------


def test_no_request_leaves_before_the_one_before_has_been_answered():
    bench = Bench()
    pending = set()
    overlaps = []
    send, drain = bench.bus.send, bench.bus.drain

    def watched_send(frames):
        for frame in frames:
            if frame.can_id & 0x780 == 0x600 and frame.data[0] != 0x80:
                overlaps.extend(pending)
                pending.add(frame.can_id & 0x7F)
        return send(frames)

    def watched_drain():
        frames = drain()
        pending.difference_update(f.can_id & 0x7F for f in frames if f.can_id & 0x780 == 0x580)
        return frames

    bench.bus.send, bench.bus.drain = watched_send, watched_drain
    bench.run()

    assert overlaps == []


def test_a_reply_that_comes_twice_is_not_taken_for_the_answer_to_the_next_request():
    values = {0x6065: 1, 0x6080: 2, 0x6085: 3}

    def twice(request):
        index = struct.unpack_from("<H", request, 1)[0]
        return [b"\x43" + request[1:4] + struct.pack("<I", values[index])] * 2

    port, _, _ = client(twice)
    read = [struct.unpack("<I", port.read(NODE, index, 0))[0] for index in values]

    assert read == [1, 2, 3]
    port.wait(port.now_ns() + 10 * MS)
    assert port.traffic(NODE).sdo_repeat_count == 3


@pytest.mark.parametrize("late_ms", [301, 350, 599])
def test_a_reply_that_comes_after_its_deadline_answers_nothing_else(late_ms):
    port, _, _ = client(lambda request: [])
    bus = port._bus
    bus.put(Frame(0x585, bytes.fromhex("4365600001000000")), late_ms * MS)

    with pytest.raises(SdoTimeout):
        port.read(NODE, 0x6065, 0)
    with pytest.raises(SdoTimeout, match="6080h"):
        port.read(NODE, 0x6080, 0)


# --- what is refused ------------------------------------------------------------------------------


def test_an_abort_is_told_with_the_real_object_its_code_and_its_text():
    port, _, _ = client(lambda request: [b"\x80" + request[1:4] + struct.pack("<I", 0x0601_0002)])

    with pytest.raises(SdoAborted, match="1018h:02 aborted with 06010002h") as caught:
        port.read(NODE, 0x1018, 2)

    assert (caught.value.index, caught.value.sub) == (0x1018, 2)


def test_a_silent_server_gets_its_deadline_and_then_exactly_one_abort_with_the_real_object():
    port, server, clock = client(lambda request: [])
    before_ns = clock.now_ns()

    with pytest.raises(SdoTimeout, match="2000h:01"):
        port.read(NODE, 0x2000, 1)

    assert clock.now_ns() - before_ns == SDO_TIMEOUT_NS
    assert server.aborts == [bytes.fromhex("8000200100000405")]


def test_a_hundred_reads_of_a_silent_server_take_a_hundred_deadlines_and_a_hundred_aborts():
    port, server, clock = client(lambda request: [])
    before_ns = clock.now_ns()

    for sub in range(100):
        with pytest.raises(SdoTimeout):
            port.read(NODE, 0x2000, sub)

    assert clock.now_ns() - before_ns == 100 * SDO_TIMEOUT_NS
    assert [abort[3] for abort in server.aborts] == list(range(100))
    assert len(server.requests) == 200


def test_segments_without_end_are_aborted_at_the_deadline_of_the_whole_transfer():
    port, server, clock = client(segmented(bytes(100_000), end=False))
    before_ns = clock.now_ns()

    with pytest.raises(SdoTimeout):
        port.read(NODE, 0x1008, 0)

    assert SDO_TRANSFER_NS <= clock.now_ns() - before_ns <= SDO_TRANSFER_NS + SDO_TIMEOUT_NS
    assert server.aborts == [bytes.fromhex("8008100000000405")]


@pytest.mark.parametrize("announced", [18, 20, 1000])
def test_a_segmented_answer_of_another_length_than_announced_is_no_answer(announced):
    port, _, _ = client(segmented(NAME, announced=announced))

    with pytest.raises(SdoGarbled, match="announced"):
        port.read(NODE, 0x1008, 0)


def test_a_toggle_bit_that_does_not_alternate_is_aborted_with_the_real_object():
    port, server, _ = client(segmented(NAME, toggles=(0, 0)))

    with pytest.raises(SdoGarbled, match="Toggle"):
        port.read(NODE, 0x1008, 0)

    assert server.aborts == [bytes.fromhex("8008100000000305")]


REPLIES = st.lists(
    st.one_of(
        st.binary(max_size=8),
        st.binary(min_size=4, max_size=4).map(lambda tail: b"\x43\x18\x10\x01" + tail),
        st.binary(min_size=7, max_size=7).map(lambda tail: b"\x00" + tail),
        st.sampled_from((0x41, 0x42, 0x43, 0x60, 0x80, 0xA0, 0xC0)).map(
            lambda command: bytes((command,)) + b"\x18\x10\x01\x04\0\0\0"
        ),
    ),
    max_size=3,
)


@settings(deadline=None, max_examples=300)
@given(replies=st.lists(REPLIES, max_size=8))
def test_whatever_a_server_answers_ends_in_bytes_or_in_an_error_of_ours(replies):
    waiting = iter(replies)
    port, _, clock = client(lambda request: next(waiting, []))
    before_ns = clock.now_ns()

    try:
        data = port.read(NODE, 0x1018, 1)
        assert isinstance(data, bytes)
    except DrivesError as error:
        assert "1018h:01" in str(error)

    assert clock.now_ns() - before_ns <= SDO_TRANSFER_NS + SDO_TIMEOUT_NS
    port._bus.nodes[0].reply = lambda request: [b"\x43\x18\x10\x01\xfb\0\0\0"]
    clock.time_ns += 100 * MS
    port.wait(clock.now_ns())
    assert port.read(NODE, 0x1018, 1) == b"\xfb\0\0\0"
