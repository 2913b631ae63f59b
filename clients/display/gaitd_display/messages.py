"""`/messages`: the messages of the trainer over WebSocket, for pages and programs of other people.

The address has the keys: `/messages?key=right/activity&key=events`. It only reads. What a client
sends is the number of a frame that it has; anything else is refused, and reaches nothing.

A slow client costs no memory, and reads the present: of a message that comes regularly the newest
one waits, of strides, controller states and events the newest `ITEMS_MAX`; `dropped_count` counts
the others. At most `WINDOW` frames are on their way without their number having come back. A frame
without messages says that the server is there.
"""

import asyncio
import contextlib
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Final

import anyio
import msgspec
from gaitd_client import NotValid, Stream, Trainer
from gaitd_client.trainer import DRIVES, LEGS
from gaitd_client.wire import schema_name
from starlette.websockets import WebSocket, WebSocketDisconnect

from gaitd_display.feed import ITEMS_MAX, WINDOW

PATH: Final = "/messages"
CLIENTS_MAX: Final = 16
HEARTBEAT_S: Final = 0.25
"""After this time without a message there is a frame without one."""
SHOWN_MAX: Final = 40
"""Characters of what a client has sent that are repeated in its refusal."""
TRY_LATER: Final = 1013
NOT_ALLOWED: Final = 1008
"""Codes with which a WebSocket is closed; gaitd.mjs reads them."""

Open = Callable[[Trainer], Stream[Any]]


def _of_leg(leg: str) -> Mapping[str, Open]:
    return {
        f"{leg}/estimate": lambda trainer: trainer.estimate(leg),
        f"{leg}/activity": lambda trainer: trainer.activity(leg),
        f"{leg}/friction": lambda trainer: trainer.friction(leg),
        f"{leg}/stride": lambda trainer: trainer.stride(leg),
        f"{leg}/controller": lambda trainer: trainer.controller(leg),
    }


def _of_drive(name: str) -> Open:
    return lambda trainer: trainer.drive(name)


STREAMS: Final[Mapping[str, Open]] = {
    **_of_leg(LEGS[0]),
    **_of_leg(LEGS[1]),
    **{f"drives/{name}": _of_drive(name) for name in DRIVES},
    "safety": lambda trainer: trainer.safety(),
    "events": lambda trainer: trainer.events(),
    "health": lambda trainer: trainer.health(),
}
"""Keys that can be read, as on Zenoh behind `gaitd/TRAINER/`."""
KEPT: Final = ("/stride", "/controller", "events")
"""Ends of the keys whose messages are no state: each of them counts."""


class Message(msgspec.Struct, frozen=True):
    """A message as on Zenoh, or why there is none."""

    key: str
    schema: str
    """`gaitd.NAME.v1`, as in the encoding on Zenoh."""
    value: msgspec.Struct | None = None
    """None: nothing about this key is known at present."""
    trouble: str | None = None
    """`silent` or `unreadable`; None: there is a value."""
    text: str = ""
    """The trouble in words."""


class Refusal(msgspec.Struct, frozen=True):
    """The last frame of a client that has asked for something that is not offered."""

    error: str


class Waiting:
    """What waits for one client."""

    def __init__(self) -> None:
        """Start empty."""
        self._states: dict[str, Message] = {}
        self._items: deque[Message] = deque(maxlen=ITEMS_MAX)
        self._changed = asyncio.Event()
        self._sent_seq = self._received_seq = 0
        self.dropped_count = 0
        """Messages that were replaced by newer ones before they were sent."""

    def add(self, message: Message) -> None:
        """Let a message wait."""
        if message.key.endswith(KEPT):
            self.dropped_count += len(self._items) == self._items.maxlen
            self._items.append(message)
        else:
            self.dropped_count += message.key in self._states
            self._states[message.key] = message
        self._changed.set()

    def acknowledge(self, text: str) -> None:
        """Take note that the client has the frame of this number.

        Raises:
            ValueError: it is no number, or that of a frame that was not sent.
        """
        allowed = f"{self._received_seq} to {self._sent_seq}"
        seq = int(text) if text.isascii() and text.isdigit() else -1
        if not self._received_seq <= seq <= self._sent_seq:
            raise ValueError(
                f"sent {text[:SHOWN_MAX]!r}; allowed is the number of a frame that has come,"
                f" {allowed}: this address only reads"
            )
        self._received_seq = seq
        self._changed.set()

    async def next(self, replaced_count: Callable[[], int]) -> str:
        """Wait for a message, or a heartbeat, and for room on the way; return the frame.

        Args:
            replaced_count: messages that the streams have replaced.
        """
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(HEARTBEAT_S):
                while not (self._states or self._items):
                    await self._change()
        while self._sent_seq - self._received_seq >= WINDOW:
            await self._change()
        self._sent_seq += 1
        frame = {
            "seq": self._sent_seq,
            "dropped_count": self.dropped_count + replaced_count(),
            "messages": [*self._items, *self._states.values()],
        }
        self._items.clear()
        self._states.clear()
        return msgspec.json.encode(frame).decode()

    async def _change(self) -> None:
        self._changed.clear()
        await self._changed.wait()


class MessageSockets:
    """The WebSockets of `/messages` of one server."""

    def __init__(self, trainer: Trainer) -> None:
        """Read from a trainer."""
        self._trainer = trainer
        self._client_count = 0

    async def serve(self, socket: WebSocket) -> None:
        """Serve one client until either side ends."""
        # Also one that is refused: a page sees the code of an accepted socket only.
        await socket.accept()
        keys = list(dict.fromkeys(socket.query_params.getlist("key")))
        unknown = [key for key in keys if key not in STREAMS]
        if unknown or not keys:
            given = repr(unknown[0][:SHOWN_MAX]) if unknown else "(missing)"
            await _refuse(socket, f"key: {given}; allowed: {', '.join(STREAMS)}")
            return
        if self._client_count >= CLIENTS_MAX:
            await socket.close(TRY_LATER, f"{CLIENTS_MAX} clients are connected; close one")
            return
        self._client_count += 1
        try:
            await self._serve(socket, keys)
        finally:
            self._client_count -= 1

    async def _serve(self, socket: WebSocket, keys: list[str]) -> None:
        waiting = Waiting()
        with contextlib.ExitStack() as closing:
            streams = [(key, STREAMS[key](self._trainer)) for key in keys]
            for _, stream in streams:
                closing.callback(stream.close)

            def replaced_count() -> int:
                return sum(stream.dropped_count for _, stream in streams)

            async def send() -> None:
                with contextlib.suppress(WebSocketDisconnect):
                    while True:
                        await socket.send_text(await waiting.next(replaced_count))
                group.cancel_scope.cancel()

            async def receive() -> None:
                with contextlib.suppress(WebSocketDisconnect):
                    try:
                        while True:
                            waiting.acknowledge(await _text(socket))
                    except ValueError as error:
                        await _refuse(socket, str(error))
                group.cancel_scope.cancel()

            async with anyio.create_task_group() as group:
                for key, stream in streams:
                    group.start_soon(_follow, key, stream, waiting)
                group.start_soon(send)
                group.start_soon(receive)


async def _text(socket: WebSocket) -> str:
    """Return what the client sends next; a binary message is shown as such."""
    message = await socket.receive()
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(message["code"])
    text: str | None = message.get("text")
    return "(binary)" if text is None else text


async def _follow(key: str, stream: Stream[Any], waiting: Waiting) -> None:
    schema = schema_name(stream.kind)
    async for item in stream:
        if isinstance(item, NotValid):
            waiting.add(Message(key, schema, None, item.trouble.value, item.text))
        else:
            waiting.add(Message(key, schema, item))


async def _refuse(socket: WebSocket, said: str) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):  # the client has closed it
        await socket.send_text(msgspec.json.encode(Refusal(said)).decode())
        await socket.close(NOT_ALLOWED)
