"""Which connections a server holds: fewer than it has descriptors, and always one for STOP.

A new connection may be the one that brings STOP, so none is refused. Where it is one too many,
another one is closed: of the address that has most, the one that has waited longest, and one with a
request only if all have one. Two kinds are never closed for that: the WebSocket of a page that gets
frames, and a STOP on its way. Their number is limited elsewhere (`PAGES_MAX`, `STOPS_MAX`) and is
below these limits.

uvicorn has no limit of its own for a client that connects and says nothing, nor does it count one
that is still in its TLS handshake. So this file accepts, and passes on to uvicorn's protocol.
"""

import asyncio
import contextlib
import errno
import socket
import ssl
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final

from starlette.types import ASGIApp, Message, Receive, Scope, Send

CONNECTIONS_MAX: Final = 128
"""Connections of all addresses. The services have 256 descriptors (`LimitNOFILE`), and the rest of
a server needs some 40 of them."""
ADDRESS_MAX: Final = 48
"""Connections of one address. A browser opens up to 6 for each page, and one WebSocket."""
WAIT_S: Final = 5.0
"""So long a client may take for its TLS handshake and the headers of its first request, and between
two requests."""
LOOK_S: Final = 1.0
RETRY_S: Final = 0.1
REPORT_S: Final = 60.0
"""A reason why a connection is not accepted is reported once in this time."""
FULL: Final = "no page can be opened, and a STOP that needs a new connection is lost: "
REMEDIES: Final = {
    errno.EMFILE: f"{FULL}this server has no file descriptor left; close unneeded pages, "
    "or raise LimitNOFILE of its unit (in a terminal: `ulimit -n`)",
    errno.ENFILE: f"{FULL}the machine has no file descriptor left; end unneeded programs",
}
STOP_PATH: Final = "/stop"


class Connection:
    """One accepted connection."""

    def __init__(self, connected: socket.socket, remote: tuple[Any, ...], now_s: float) -> None:
        """Take a socket.

        Args:
            connected: accepted, in use until its descriptor is closed.
            remote: address and port of the client.
            now_s: time of the loop.
        """
        self._socket = connected
        self._handshake: asyncio.Task[None] | None = None
        self._transport: asyncio.BaseTransport | None = None
        self.key = (remote[:2], connected.getsockname()[:2])
        """As `client` and `server` of a scope."""
        self.address: str = remote[0]
        self.since_s = now_s
        """When it was accepted, or its last request has ended."""
        self.is_asking = False
        """A request is being answered."""
        self.is_kept = False
        """It is the WebSocket of a page, or a STOP is on its way."""

    @property
    def is_over(self) -> bool:
        """Its descriptor is free."""
        return self._socket.fileno() < 0

    def open(
        self, make_protocol: Callable[[], asyncio.Protocol], tls: ssl.SSLContext | None
    ) -> None:
        """Begin the TLS handshake, if there is TLS, then the protocol."""

        async def connect() -> None:
            loop = asyncio.get_running_loop()
            # A client that ends, or fails in its handshake, is no fault of this server.
            with contextlib.suppress(OSError):
                self._transport, _ = await loop.connect_accepted_socket(
                    make_protocol,
                    self._socket,
                    ssl=tls,
                    ssl_handshake_timeout=None if tls is None else WAIT_S,
                )

        self._handshake = asyncio.create_task(connect())

    def close(self) -> None:
        """Close it at once."""
        if self._transport is not None and isinstance(self._transport, asyncio.WriteTransport):
            self._transport.abort()
        elif self._handshake is not None:
            self._handshake.cancel()


def surplus(connections: Sequence[Connection], address: str) -> Connection | None:
    """Return the connection to be closed after one was accepted; None: there are not too many.

    Args:
        connections: all, the new one last.
        address: of the new one.
    """
    counts = Counter(one.address for one in connections)
    if counts[address] <= ADDRESS_MAX:
        if len(connections) <= CONNECTIONS_MAX:
            return None
        address = counts.most_common(1)[0][0]
    loose = [one for one in connections[:-1] if not one.is_kept]
    of_address = [one for one in loose if one.address == address]
    return min(of_address or loose, key=lambda one: (one.is_asking, one.since_s), default=None)


def overdue(connections: Iterable[Connection], now_s: float) -> list[Connection]:
    """Return the connections that have said nothing for too long."""
    return [one for one in connections if not one.is_asking and now_s - one.since_s >= WAIT_S]


class Refusals:
    """Reports why a connection is not accepted: the same reason comes ten times a second."""

    def __init__(self) -> None:
        """Nothing has been reported."""
        self._reported_s: dict[int | None, float] = {}

    def line(self, error: OSError, now_s: float) -> str:
        """Return a line for the log; empty if this reason was reported a short time ago."""
        if now_s - self._reported_s.get(error.errno, -REPORT_S) < REPORT_S:
            return ""
        self._reported_s[error.errno] = now_s
        reason = REMEDIES.get(error.errno or 0, f"a connection was not accepted: {error.strerror}")
        return f"gaitd-display: {reason} (reported once in {REPORT_S:g} s)"


class Connections:
    """The connections of one server."""

    def __init__(self, app: ASGIApp) -> None:
        """Watch the requests of an application."""
        self._app = app
        self._held: dict[tuple[Any, Any], Connection] = {}
        self._refusals = Refusals()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Note that a connection has a request, which the application answers."""
        found = self._held.get((scope.get("client"), scope.get("server")))
        if found is None:
            await self._app(scope, receive, send)
            return
        connection = found

        async def noted(message: Message) -> None:
            # The first frame: the page has a place among `PAGES_MAX`.
            connection.is_kept |= message["type"] == "websocket.send"
            await send(message)

        connection.is_asking = True
        connection.is_kept = scope["type"] == "http" and scope["path"] == STOP_PATH
        try:
            await self._app(scope, receive, noted)
        finally:
            connection.is_asking = connection.is_kept = False
            connection.since_s = asyncio.get_running_loop().time()

    async def accept(
        self,
        listeners: Sequence[socket.socket],
        make_protocol: Callable[[], asyncio.Protocol],
        tls: ssl.SSLContext | None,
    ) -> None:
        """Accept connections until cancelled.

        Args:
            listeners: sockets that listen.
            make_protocol: returns uvicorn's protocol for one connection.
            tls: None: connections are not encrypted.
        """
        async with asyncio.TaskGroup() as group:
            group.create_task(self._look())
            for listener in listeners:
                group.create_task(self._accept(listener, make_protocol, tls))

    async def _accept(
        self,
        listener: socket.socket,
        make_protocol: Callable[[], asyncio.Protocol],
        tls: ssl.SSLContext | None,
    ) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                connected, remote = await loop.sock_accept(listener)
            except OSError as error:
                if line := self._refusals.line(error, loop.time()):
                    print(line, file=sys.stderr)
                await asyncio.sleep(RETRY_S)
                continue
            connection = Connection(connected, remote, loop.time())
            self._held[connection.key] = connection
            connection.open(make_protocol, tls)
            self._make_room(connection.address)
            await asyncio.sleep(0)  # so that what has come is read before the next one is accepted

    def _make_room(self, address: str) -> None:
        held = {key: one for key, one in self._held.items() if not one.is_over}
        closed = surplus([*held.values()], address)
        if closed is not None:
            closed.close()
            del held[closed.key]
        self._held = held

    async def _look(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(LOOK_S)
            for connection in overdue(self._held.values(), loop.time()):
                connection.close()
