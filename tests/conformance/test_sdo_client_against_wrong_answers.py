"""The master's SDO client against servers that answer anything: named errors, and never a lie.

The answers are built here from CiA 301 7.2.4.3, bit by bit; the client is
`drives.bringup.configurator`.
"""

import struct

import canopen
import pytest
from hypothesis import given
from hypothesis import strategies as st
from memory_bus import MS, ManualClock, MemoryBus

from drives.bringup.configurator import Configurator
from drives.canopen.bus import Frame
from drives.errors import SdoAborted, SdoGarbled, SdoTimeout

NODE = 5
INDEX, SUB = 0x2000, 3
OBJECT = struct.pack("<HB", INDEX, SUB)
NAMED = (SdoAborted, SdoGarbled, SdoTimeout)


class Server:
    """Answers the n-th request with the n-th list of frames' data, then not at all."""

    next_beat_ns = None

    def __init__(self, answers):
        self.answers = list(answers)
        self.requests = []

    def take(self, frame, now_ns):
        if frame.can_id != 0x600 + NODE or frame.data[0] == 0x80:
            return []
        self.requests.append(frame.data)
        replies = self.answers.pop(0) if self.answers else []
        return [(Frame(0x580 + NODE, data), MS) for data in replies]

    def beats(self, now_ns):
        return []


def client(answers):
    clock = ManualClock()
    server = Server(answers)
    return Configurator(MemoryBus(clock, [server]), clock), server


def expedited(data, place=OBJECT):
    """Upload response with 1 to 4 bytes in the frame itself: 0100 nn11."""
    return bytes((0x43 | (4 - len(data)) << 2,)) + place + data.ljust(4, b"\0")


def segmented(data, *, announced=None):
    """Initiate with the size, then segments of seven bytes: 000t nnnc, toggled, the last marked."""
    size = len(data) if announced is None else announced
    frames = [bytes((0x41,)) + OBJECT + struct.pack("<I", size)]
    parts = [data[n : n + 7] for n in range(0, len(data), 7)] or [b""]
    for number, part in enumerate(parts):
        last = number == len(parts) - 1
        head = (number & 1) << 4 | (7 - len(part)) << 1 | last
        frames.append(bytes((head,)) + part.ljust(7, b"\0"))
    return [[frame] for frame in frames]


anything = st.binary(max_size=8)
nearly = st.builds(
    lambda head, place, rest, cut: (bytes((head,)) + place + rest)[:cut],
    st.sampled_from((0x40, 0x41, 0x42, 0x43, 0x4B, 0x4F, 0x60, 0x80, 0x20, 0x30, 0x00, 0x01, 0x10)),
    st.sampled_from((OBJECT, b"\x00\x20\x02", b"\x01\x20\x03", bytes(3))),
    st.binary(min_size=4, max_size=4),
    st.sampled_from((8, 8, 8, 8, 7, 4, 1, 0)),
)
answers = st.lists(st.lists(anything | nearly, max_size=3), max_size=8)
foreign = st.builds(
    lambda head, place, rest: bytes((head,)) + place + rest,
    st.sampled_from((0x43, 0x4B, 0x41, 0x60, 0x80)),
    st.binary(min_size=3, max_size=3).filter(lambda place: place != OBJECT),
    st.binary(min_size=4, max_size=4),
)
"""Whole and right, but for another object: a late answer to an earlier request."""
truncated = st.binary(max_size=7) | st.builds(lambda cut: expedited(b"\1")[:cut], st.integers(0, 7))


@given(answers)
def test_whatever_is_answered_to_a_read_it_ends_in_a_value_or_a_named_error(replies):
    port, _ = client(replies)

    try:
        value = port.read(NODE, INDEX, SUB)
    except NAMED as error:
        assert (error.index, error.sub) == (INDEX, SUB)
    else:
        starts = [f for some in replies for f in some if f[:1] and f[0] & 0xE0 == 0x40]
        assert any(len(f) == 8 and f[1:4] == OBJECT for f in starts)
        assert isinstance(value, bytes)


@given(answers, st.binary(min_size=1, max_size=30))
def test_whatever_is_answered_to_a_write_it_is_confirmed_or_a_named_error(replies, data):
    port, _ = client(replies)

    try:
        port.write(NODE, INDEX, SUB, data)
    except NAMED as error:
        assert (error.index, error.sub) == (INDEX, SUB)
    else:
        confirmed = [f for some in replies for f in some if len(f) == 8 and f[0] & 0xE0 == 0x60]
        assert any(f[1:4] == OBJECT for f in confirmed)


@given(answers, st.binary(min_size=1, max_size=4))
def test_the_client_is_free_for_the_next_transfer_whatever_came_before(replies, data):
    port, server = client(replies)
    for attempt in (
        lambda: port.read(NODE, INDEX, SUB),
        lambda: port.write(NODE, INDEX, SUB, b"1"),
    ):
        try:
            attempt()
        except NAMED:
            continue
    port.wait(port.now_ns() + 1000 * MS)  # what was still under way is over

    server.answers = [[expedited(data)]]

    assert port.read(NODE, INDEX, SUB) == data


@given(st.lists(foreign | truncated, max_size=5), st.binary(min_size=1, max_size=4))
def test_strangers_and_stumps_before_the_answer_do_not_change_it(strays, data):
    port, _ = client([[*strays, expedited(data)]])

    assert port.read(NODE, INDEX, SUB) == data


@given(st.binary(min_size=5, max_size=60), st.data())
def test_strangers_and_stumps_between_segments_do_not_change_what_is_read(data, draw):
    replies = segmented(data)
    for reply in replies:
        reply[:0] = draw.draw(st.lists(truncated, max_size=2))
    port, _ = client(replies)

    assert port.read(NODE, INDEX, SUB) == data


@given(st.binary(min_size=8, max_size=60), st.data())
def test_a_segment_with_the_wrong_toggle_bit_is_never_taken(data, draw):
    replies = segmented(data)
    number = draw.draw(st.integers(1, len(replies) - 1))
    (frame,) = replies[number]
    replies[number] = [bytes((frame[0] ^ 0x10,)) + frame[1:]]
    port, _ = client(replies)

    with pytest.raises(NAMED):
        port.read(NODE, INDEX, SUB)


@given(st.binary(min_size=5, max_size=40), st.integers(0, 60))
def test_a_transfer_of_another_length_than_announced_is_no_value(data, announced):
    port, _ = client(segmented(data, announced=announced))

    try:
        value = port.read(NODE, INDEX, SUB)
    except NAMED:
        assert announced != len(data)
    else:
        assert value == data
        assert announced == len(data)


@given(st.integers(0, 0xFFFFFFFF), st.booleans())
def test_an_abort_has_its_code_and_a_text_whatever_the_code_is(code, writing):
    abort = b"\x80" + OBJECT + struct.pack("<I", code)
    port, _ = client([[abort]])

    with pytest.raises(SdoAborted) as caught:
        if writing:
            port.write(NODE, INDEX, SUB, b"\x01")
        else:
            port.read(NODE, INDEX, SUB)

    assert caught.value.code == code
    assert caught.value.text
    assert f"{code:08X}h" in str(caught.value)


def test_an_abort_in_the_middle_of_segments_ends_the_transfer():
    replies = segmented(bytes(range(30)))
    replies[2] = [b"\x80" + OBJECT + struct.pack("<I", 0x06060000)]
    port, server = client(replies)

    with pytest.raises(SdoAborted) as caught:
        port.read(NODE, INDEX, SUB)

    assert caught.value.code == 0x06060000
    assert len(server.requests) == 3


def test_a_server_that_falls_silent_is_told_by_an_abort_for_the_object():
    clock = ManualClock()
    server = Server(segmented(bytes(20))[:2])
    bus = MemoryBus(clock, [server])
    port = Configurator(bus, clock)

    with pytest.raises(SdoTimeout):
        port.read(NODE, INDEX, SUB)

    assert bus.sent[-1].data == b"\x80" + OBJECT + struct.pack("<I", 0x05040000)


# --- against a server that we did not write ---------------------------------------------------


class LocalNode:
    """python-canopen's SDO server, in lock-step: its network hands frames to us, not to a bus."""

    next_beat_ns = None

    def __init__(self, node):
        self.node = node
        self.waiting = []
        node.network = self
        node.sdo.network = self

    def send_message(self, can_id, data, remote=False):
        self.waiting.append((Frame(can_id, bytes(data)), MS))

    def take(self, frame, now_ns):
        if frame.can_id != 0x600 + NODE:
            return []
        self.node.sdo.on_request(frame.can_id, bytearray(frame.data), 0.0)
        replies, self.waiting = self.waiting, []
        return replies

    def beats(self, now_ns):
        return []


@pytest.fixture(scope="module")
def canopen_server():
    dictionary = canopen.ObjectDictionary()
    text = canopen.objectdictionary.ODVariable("text", INDEX, 0)
    text.data_type, text.access_type = canopen.objectdictionary.VISIBLE_STRING, "rw"
    number = canopen.objectdictionary.ODVariable("number", INDEX + 1, 0)
    number.data_type, number.access_type = canopen.objectdictionary.UNSIGNED32, "rw"
    dictionary.add_object(text)
    dictionary.add_object(number)
    clock = ManualClock()
    server = LocalNode(canopen.LocalNode(NODE, dictionary))
    return Configurator(MemoryBus(clock, [server]), clock)


@given(st.text(alphabet=[chr(n) for n in range(32, 127)], min_size=1, max_size=100))
def test_what_is_written_to_canopen_s_server_is_read_from_it(canopen_server, text):
    canopen_server.write(NODE, INDEX, 0, text.encode())

    assert canopen_server.read(NODE, INDEX, 0) == text.encode()


@given(st.integers(0, 0xFFFFFFFF))
def test_a_number_written_to_canopen_s_server_is_read_from_it(canopen_server, number):
    data = struct.pack("<I", number)
    canopen_server.write(NODE, INDEX + 1, 0, data)

    assert canopen_server.read(NODE, INDEX + 1, 0) == data


def test_canopen_s_server_aborts_are_named(canopen_server):
    with pytest.raises(SdoAborted) as caught:
        canopen_server.read(NODE, 0x5FFF, 0)
    assert caught.value.code == 0x06020000
