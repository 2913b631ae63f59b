"""Messages between a seat and the server of simulated time, and their layout.

The socket is AF_UNIX, SOCK_SEQPACKET: one message is one datagram, in order, none is lost. All
numbers are little-endian. The first byte is the kind of the message; the rest:

    to the server
    HELLO    u8 role, i64 now_ns, name (UTF-8)   the first message; now_ns: time must not be less
    SEND     i64 now_ns, frames                  put frames on the bus; not answered
    WAIT     i64 until_ns, u8 for_frame          let time pass; answered by GRANT
    HAND     a line of text (UTF-8)              a command of a test; answered by DONE or REFUSED

    from the server
    WELCOME  i64 now_ns, i64 utc_ahead_ns, u8 wall_clock
    FRAMES   frames                              came on the bus; before the GRANT of a seat's WAIT
    GRANT    i64 now_ns                          the wait is over; time stands until the next WAIT
    DONE     text                                result of the command
    REFUSED  text                                the error; the server then disconnects, except
                                                 after a HAND

    a frame  u32 can_id, u8 length, u8 flags, i64 time_ns, 8 bytes of data    (22 bytes)
             flags: bit 0 is an error frame of the controller

A frame's time_ns is simulated UTC (time + utc_ahead_ns) of its arrival. One message holds at most
FRAMES_MAX frames; more come in several.
"""

import struct
from collections.abc import Iterable, Iterator, Sequence
from enum import IntEnum
from typing import Final, NamedTuple

from drives.canopen.frame import Frame

FRAMES_MAX: Final = 512
MESSAGE_SIZE_MAX: Final = 16384
NAME_LENGTH_MAX: Final = 64


class Kind(IntEnum):
    """The first byte of a message."""

    HELLO = 1
    SEND = 2
    WAIT = 3
    HAND = 4
    WELCOME = 16
    FRAMES = 17
    GRANT = 18
    DONE = 19
    REFUSED = 20


class Role(IntEnum):
    """The role of a seat for the passing of time."""

    IN_STEP = 1
    """Time waits for this seat: a core, an integrator's node that is simulated as well."""
    BESIDE = 2
    """Time grants this seat's waits, but does not wait for the seat: a tool."""
    LISTENER = 3
    """This seat receives all frames, may send, and never waits: a logger."""
    HAND = 4
    """This seat sends commands: a test that holds time, lets it run, injects faults."""


class WireError(ValueError):
    """The message is invalid; the text gives the reason."""


_HELLO: Final = struct.Struct("<BBq")
_WELCOME: Final = struct.Struct("<BqqB")
_SEND: Final = struct.Struct("<Bq")
_WAIT: Final = struct.Struct("<BqB")
_GRANT: Final = struct.Struct("<Bq")
_FRAME: Final = struct.Struct("<IBBq8s")
_ERROR_FLAG: Final = 0x01
_ID_MAX: Final = 0x7FF
_ERROR_ID_MAX: Final = 0x1FFFFFFF
_LENGTH_MAX: Final = 8
_ROLES: Final = frozenset(int(role) for role in Role)


class Hello(NamedTuple):
    """The first message of a seat."""

    role: Role
    now_ns: int
    name: str


class Send(NamedTuple):
    """Frames for the bus."""

    now_ns: int
    frames: list[Frame]


class Wait(NamedTuple):
    """A request to let time pass."""

    until_ns: int
    for_frame: bool
    """True if the first frame ends the wait, too."""


class Hand(NamedTuple):
    """A command of a test."""

    line: str


class Welcome(NamedTuple):
    """The answer to HELLO."""

    now_ns: int
    utc_ahead_ns: int
    """Simulated UTC less simulated time."""
    wall_clock: bool
    """True if time is the computer's monotonic clock: nothing is waited for, nothing is granted."""


class Frames(NamedTuple):
    """Frames that came on the bus."""

    frames: list[Frame]


class Grant(NamedTuple):
    """A wait is over."""

    now_ns: int


class Reply(NamedTuple):
    """The answer to a HAND, or why the server refuses a message."""

    text: str
    refused: bool


ToServer = Hello | Send | Wait | Hand
FromServer = Welcome | Frames | Grant | Reply


def pack_hello(role: Role, now_ns: int, name: str) -> bytes:
    """Pack a HELLO."""
    return _HELLO.pack(Kind.HELLO, role, now_ns) + name.encode()


def pack_send(now_ns: int, frames: Sequence[Frame]) -> Iterator[bytes]:
    """Pack frames into as many SENDs as needed."""
    head = _SEND.pack(Kind.SEND, now_ns)
    return (head + part for part in _packed(frames))


def pack_here(now_ns: int) -> bytes:
    """Pack a SEND without frames: a sign of life while the seat makes no request."""
    return _SEND.pack(Kind.SEND, now_ns)


def pack_wait(until_ns: int, *, for_frame: bool) -> bytes:
    """Pack a WAIT."""
    return _WAIT.pack(Kind.WAIT, until_ns, for_frame)


def pack_hand(line: str) -> bytes:
    """Pack a HAND."""
    return bytes((Kind.HAND,)) + line.encode()


def pack_welcome(welcome: Welcome) -> bytes:
    """Pack a WELCOME."""
    return _WELCOME.pack(Kind.WELCOME, *welcome)


def pack_frames(frames: Sequence[Frame]) -> Iterator[bytes]:
    """Pack frames into as many FRAMES as needed."""
    head = bytes((Kind.FRAMES,))
    return (head + part for part in _packed(frames))


def pack_grant(now_ns: int) -> bytes:
    """Pack a GRANT."""
    return _GRANT.pack(Kind.GRANT, now_ns)


def pack_reply(text: str, *, refused: bool) -> bytes:
    """Pack a DONE or a REFUSED."""
    kind = Kind.REFUSED if refused else Kind.DONE
    return bytes((kind,)) + text.encode()[: MESSAGE_SIZE_MAX - 1]


def read_to_server(data: bytes) -> ToServer:
    """Parse a message of a seat.

    Raises:
        WireError: it is no message of a seat.
    """
    match _kind(data):
        case Kind.HELLO:
            _, role, now_ns = _unpacked(_HELLO, data)
            if role not in _ROLES:
                raise WireError(f"role {role} is not in {sorted(_ROLES)}")
            name = _text(data[_HELLO.size :])
            if len(name) > NAME_LENGTH_MAX or not name.isprintable():
                raise WireError(f"a name has at most {NAME_LENGTH_MAX} printable characters")
            return Hello(Role(role), now_ns, name)
        case Kind.SEND:
            _, now_ns = _unpacked(_SEND, data)
            return Send(now_ns, _frames(data[_SEND.size :]))
        case Kind.WAIT:
            _, until_ns, for_frame = _unpacked(_WAIT, data)
            return Wait(until_ns, bool(for_frame))
        case Kind.HAND:
            return Hand(_text(data[1:]))
        case kind:
            raise WireError(f"a seat does not send {kind.name}")


def read_from_server(data: bytes) -> FromServer:
    """Parse a message of the server.

    Raises:
        WireError: it is no message of a server.
    """
    match _kind(data):
        case Kind.FRAMES:
            return Frames(_frames(data[1:]))
        case Kind.GRANT:
            return Grant(_unpacked(_GRANT, data)[1])
        case Kind.WELCOME:
            _, now_ns, utc_ahead_ns, wall_clock = _unpacked(_WELCOME, data)
            return Welcome(now_ns, utc_ahead_ns, bool(wall_clock))
        case Kind.DONE | Kind.REFUSED as kind:
            return Reply(_text(data[1:]), kind is Kind.REFUSED)
        case kind:
            raise WireError(f"a server does not send {kind.name}")


def _kind(data: bytes) -> Kind:
    if not data:
        raise WireError("an empty message")
    try:
        return Kind(data[0])
    except ValueError as error:
        raise WireError(f"a message begins with its kind: {error}") from error


def _unpacked(layout: struct.Struct, data: bytes) -> tuple[int, ...]:
    if len(data) < layout.size:
        raise WireError(f"{Kind(data[0]).name} has {len(data)} bytes, at least {layout.size}")
    return layout.unpack_from(data)


def _text(data: bytes) -> str:
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        raise WireError(f"text is UTF-8: {error}") from error


def _packed(frames: Sequence[Frame]) -> Iterator[bytes]:
    for first in range(0, len(frames), FRAMES_MAX):
        yield b"".join(_rows(frames[first : first + FRAMES_MAX]))


def _rows(frames: Iterable[Frame]) -> Iterator[bytes]:
    for can_id, data, time_ns, is_error in frames:
        yield _FRAME.pack(can_id, len(data), _ERROR_FLAG * is_error, time_ns, data)


def _frames(data: bytes) -> list[Frame]:
    if len(data) % _FRAME.size:
        raise WireError(f"frames have {_FRAME.size} bytes each; got {len(data)} bytes")
    return [_frame(*row) for row in _FRAME.iter_unpack(data)]


def _frame(can_id: int, length: int, flags: int, time_ns: int, data: bytes) -> Frame:
    is_error = bool(flags & _ERROR_FLAG)
    if length > _LENGTH_MAX:
        raise WireError(f"a frame has 0 to {_LENGTH_MAX} bytes of data, not {length}")
    if can_id > (_ERROR_ID_MAX if is_error else _ID_MAX):
        raise WireError(f"identifier {can_id:X}h is beyond {_ID_MAX:X}h")
    return Frame(can_id, data[:length], time_ns, is_error)
