"""Messages of simulated time: what was packed is read, and no bytes are more than refused."""

import random

import pytest

from drives.canopen.frame import Frame
from simtime import wire
from simtime.wire import Role, WireError

FRAMES = [
    Frame(0x080, b""),
    Frame(0x181, b"\x01\x02\x03", 1_767_225_600_123_456_789),
    Frame(0x0C, bytes(8), 5, is_error=True),
]


@pytest.mark.parametrize(
    ("packed", "meant"),
    [
        (wire.pack_hello(Role.IN_STEP, 12, "core"), wire.Hello(Role.IN_STEP, 12, "core")),
        (wire.pack_wait(-1, for_frame=True), wire.Wait(-1, True)),
        (wire.pack_hand("pace max"), wire.Hand("pace max")),
        (*wire.pack_send(7, FRAMES), wire.Send(7, FRAMES)),
    ],
)
def test_what_a_seat_says_is_what_the_server_reads(packed, meant):
    assert wire.read_to_server(packed) == meant


@pytest.mark.parametrize(
    ("packed", "meant"),
    [
        (wire.pack_welcome(wire.Welcome(1, 2, True)), wire.Welcome(1, 2, True)),
        (wire.pack_grant(2**62), wire.Grant(2**62)),
        (wire.pack_reply("no", refused=True), wire.Reply("no", True)),
        (*wire.pack_frames(FRAMES), wire.Frames(FRAMES)),
    ],
)
def test_what_the_server_says_is_what_a_seat_reads(packed, meant):
    assert wire.read_from_server(packed) == meant


def test_many_frames_take_several_messages_of_a_bounded_size():
    frames = [Frame(number % 0x800, b"\x00" * 8, number) for number in range(1300)]

    messages = list(wire.pack_frames(frames))

    assert len(messages) == 3
    assert max(map(len, messages)) <= wire.MESSAGE_SIZE_MAX
    assert [f for one in messages for f in wire.read_from_server(one).frames] == frames


@pytest.mark.parametrize("read", [wire.read_to_server, wire.read_from_server])
def test_no_bytes_are_more_than_refused(read):
    draw = random.Random(1)
    kinds = [int(kind) for kind in wire.Kind]
    for _ in range(20_000):
        head = bytes([draw.choice(kinds)]) if draw.random() < 0.8 else b""
        try:
            read(head + draw.randbytes(draw.randrange(60)))
        except WireError as error:
            assert str(error)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        bytes([99]),
        wire.pack_hello(Role.IN_STEP, 0, "x" * 65),
        wire.pack_hello(Role.IN_STEP, 0, "two\nlines"),
        wire.pack_hello(Role.IN_STEP, 0, "core").replace(b"\x01\x01", b"\x01\x09", 1),
        b"".join(wire.pack_send(0, [Frame(0x800, b"")])),
        wire.pack_grant(1),
    ],
)
def test_a_message_that_is_none_of_a_seat_is_refused(data):
    with pytest.raises(WireError):
        wire.read_to_server(data)
