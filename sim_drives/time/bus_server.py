"""The socket of the simulated bus: connections, messages received and messages sent.

It processes the messages of `simtime.wire` and knows nothing of time: `server.py` (simulated time)
and `wall_clock.py` (`--wall-clock`) decide what a message does. Sending never waits for a client
that does not read: messages that do not fit into its socket are queued, up to OUTBOX_BYTES_MAX,
then dropped and counted. An invalid message ends its connection, with the reason, and no other.
"""

import contextlib
import select
import socket
import struct
import sys
from collections import deque
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import Final

from drives.canopen.frame import Frame
from simtime import wire

BACKLOG: Final = 16
OUTBOX_BYTES_MAX: Final = 64 * 1024 * 1024
_READ_COUNT_MAX: Final = 64
"""Messages read from one client in a row, before the next client."""
_CREDENTIALS: Final = struct.Struct("3i")


class Connection:
    """One client."""

    def __init__(self, end: socket.socket) -> None:
        self.end = end
        self.pid = _CREDENTIALS.unpack(
            end.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        )[0]
        self.hello: wire.Hello | None = None
        """The client's introduction."""
        self.outbox: deque[bytes] = deque()
        self.outbox_bytes = 0
        self.dropped_count = 0
        """Messages dropped because the client did not read in time."""

    @property
    def name(self) -> str:
        """Name for messages to the operator."""
        return f"{self.hello.name if self.hello else 'a program'} (pid {self.pid})"


class BusServer:
    """The listening socket and its clients."""

    def __init__(self, path: Path, listening: socket.socket) -> None:
        """Use `bus_server` to make one."""
        self.path = path
        self._listening = listening
        self._poller = select.poll()
        self._poller.register(listening, select.POLLIN)
        self._connections: dict[int, Connection] = {}
        self.on_leave: Callable[[Connection], None] = lambda _: None
        """Called when a client has disconnected, or was disconnected."""

    @property
    def connections(self) -> tuple[Connection, ...]:
        """Clients that have introduced themselves."""
        return tuple(one for one in self._connections.values() if one.hello is not None)

    def watch(self, descriptor: int) -> None:
        """Let `receive` also return when another descriptor is readable."""
        self._poller.register(descriptor, select.POLLIN)

    def receive(self, timeout_s: float) -> list[tuple[Connection, wire.ToServer]]:
        """Return the messages of the clients; waits up to the timeout for one."""
        said: list[tuple[Connection, wire.ToServer]] = []
        for descriptor, events in self._poller.poll(max(timeout_s, 0.0) * 1e3):
            if descriptor == self._listening.fileno():
                self._accept()
                continue
            connection = self._connections.get(descriptor)
            if connection is None:
                continue
            if events & select.POLLOUT:
                self._flush(connection)
            if events & (select.POLLIN | select.POLLHUP | select.POLLERR):
                said += self._read(connection)
        return said

    def _accept(self) -> None:
        with contextlib.suppress(BlockingIOError, ConnectionError):
            end, _ = self._listening.accept()
            end.setblocking(False)
            connection = Connection(end)
            self._connections[end.fileno()] = connection
            self._poller.register(end, select.POLLIN)

    def _read(self, connection: Connection) -> list[tuple[Connection, wire.ToServer]]:
        said: list[tuple[Connection, wire.ToServer]] = []
        for _ in range(_READ_COUNT_MAX):
            try:
                data = connection.end.recv(wire.MESSAGE_SIZE_MAX)
            except BlockingIOError:
                break
            except OSError:
                data = b""
            if not data:
                if not said:  # else its messages are processed before it is removed
                    self.drop(connection)
                break
            try:
                message = wire.read_to_server(data)
                self._must_introduce_itself(connection, message)
            except wire.WireError as error:
                self.refuse(connection, str(error))
                break
            said.append((connection, message))
            if isinstance(message, wire.Wait):
                break  # its next message follows the GRANT
        return said

    @staticmethod
    def _must_introduce_itself(connection: Connection, message: wire.ToServer) -> None:
        if isinstance(message, wire.Hello):
            if connection.hello is not None:
                raise wire.WireError("HELLO is sent once")
            connection.hello = message
        elif connection.hello is None:
            raise wire.WireError("the first message is HELLO")

    # --- out ----------------------------------------------------------------------------------

    def send(self, connection: Connection, message: bytes) -> None:
        """Send a message to a client; never waits."""
        if connection.outbox_bytes + len(message) > OUTBOX_BYTES_MAX:
            connection.dropped_count += 1
            return
        connection.outbox.append(message)
        connection.outbox_bytes += len(message)
        self._flush(connection)

    def send_frames(self, connection: Connection, frames: Sequence[Frame]) -> None:
        """Send frames to a client."""
        for message in wire.pack_frames(frames):
            self.send(connection, message)

    def refuse(self, connection: Connection, why: str) -> None:
        """Send a client the reason and disconnect it."""
        print(f"gaitd sim: {connection.name} is disconnected: {why}", file=sys.stderr, flush=True)
        with contextlib.suppress(OSError):
            connection.end.send(wire.pack_reply(why, refused=True))
        self.drop(connection)

    def drop(self, connection: Connection) -> None:
        """Remove a client."""
        if self._connections.pop(connection.end.fileno(), None) is None:
            return
        self._poller.unregister(connection.end)
        connection.end.close()
        if connection.dropped_count:
            count = connection.dropped_count
            print(f"gaitd sim: {connection.name} did not read {count} messages", file=sys.stderr)
        self.on_leave(connection)

    def _flush(self, connection: Connection) -> None:
        try:
            while connection.outbox:
                connection.end.send(connection.outbox[0])
                connection.outbox_bytes -= len(connection.outbox.popleft())
        except BlockingIOError:
            self._poller.modify(connection.end, select.POLLIN | select.POLLOUT)
            return
        except OSError:
            return  # disconnected: the next poll detects it
        self._poller.modify(connection.end, select.POLLIN)

    def is_connected(self, connection: Connection) -> bool:
        """Return whether a client is connected, as far as is known."""
        return self._connections.get(connection.end.fileno()) is connection

    def close(self) -> None:
        """Disconnect all clients."""
        for connection in tuple(self._connections.values()):
            self.drop(connection)


@contextlib.contextmanager
def bus_server(path: Path) -> Generator[BusServer]:
    """Listen at `path`; a socket left there by an earlier run is replaced.

    Raises:
        OSError: the path cannot be bound, is something else than a socket, or another server
            listens there.
    """
    if path.is_socket():
        _must_be_left_over(path)
        path.unlink()
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_CLOEXEC) as listening:
        listening.bind(str(path))
        listening.listen(BACKLOG)
        listening.setblocking(False)
        served = BusServer(path, listening)
        try:
            yield served
        finally:
            served.close()
            path.unlink(missing_ok=True)


def _must_be_left_over(path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_CLOEXEC) as probe:
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            return
    raise OSError(None, "another `gaitd sim` serves this bus")
