"""The loopback bus of a machine without SocketCAN: python-can-remote's server over a virtual bus.

Every client of `ws://HOST:PORT/` is one more station on one python-can `virtual` bus in this
process, and so are the virtual drives. A frame carries the time at which its client has sent it,
or else that of its arrival. Clients come and go as they like, and may be killed: what
python-can-remote 0.3.0 makes of that (a thread that dies with a traceback, a station whose queue is
never read again and grows) is mended here.
"""

import contextlib
import threading
from collections.abc import Generator
from socket import socket
from typing import Any, Final
from urllib.parse import urlparse

import can
from can.interfaces.virtual import VirtualBus
from can_remote.server import ClientRequestHandler, RemoteServer, RemoteServerProtocol
from can_remote.websocket import WebSocket, get_accept_key

POLL_S: Final = 0.2
PROTOCOL: Final = "can.binary+json.v1"
GONE: Final = (OSError, can.CanError)
"""What a socket or a bus says when the other side has left: can_remote's WebsocketClosed is none of
them and is handled where it is raised."""


class BusAddressError(ValueError):
    """The operator's: the channel is no ws://HOST:PORT/ that can be served here."""


def parse_channel(channel: str) -> tuple[str, int]:
    """Host and port of `ws://HOST:PORT/`.

    Raises:
        BusAddressError: it is something else.
    """
    try:
        address = urlparse(channel)
        host, port = address.hostname, address.port
    except ValueError as error:
        raise BusAddressError(f"{channel!r} is no ws://HOST:PORT/ ({error})") from error
    if address.scheme != "ws" or not host or port is None:
        raise BusAddressError(f"{channel!r} is no ws://HOST:PORT/")
    return host, port


class _Session(RemoteServerProtocol):
    """One client; leaves no thread and no station behind, however it goes."""

    def recv(self, timeout: float | None = None) -> Any:  # noqa: ANN401 - as python-can-remote has it
        """What the client says; the time stamp of a frame is kept, where it has one."""
        said = super().recv(timeout)
        if isinstance(said, can.Message) and isinstance(self.bus, VirtualBus):
            self.bus.preserve_timestamps = said.timestamp > 0
        return said

    def _send_to_client(self) -> None:
        try:
            while self.running:
                message = self.bus.recv(POLL_S)
                if message is not None:
                    self.send_msg(message)
        except GONE:
            self.running = False  # the client's side of the socket has gone: nobody to tell
        finally:
            self.bus.shutdown()


class _Handler(ClientRequestHandler):
    """Accepts a client as python-can-remote does, and forgets it in every case."""

    def start_websocket(self) -> None:
        self.send_response(101)
        self.send_header("Upgrade", "WebSocket")
        self.send_header("Connection", "Upgrade")
        key = get_accept_key(self.headers["Sec-WebSocket-Key"])
        self.send_header("Sec-WebSocket-Accept", key)
        self.send_header("Sec-WebSocket-Protocol", PROTOCOL)
        self.end_headers()
        _Session(_config(self.server), WebSocket(None, PROTOCOL, sock=self.request)).run()


def _config(server: object) -> dict[str, object]:
    assert isinstance(server, RemoteServer)  # noqa: S101 - our own server's handler
    return dict(server.config)


class _Server(RemoteServer):
    """A server whose clients may break off without a traceback on our stderr."""

    def handle_error(self, request: socket | tuple[bytes, socket], client_address: object) -> None:
        """A client that broke off is no error of ours."""
        del request, client_address


@contextlib.contextmanager
def served_bus(host: str, port: int) -> Generator[can.BusABC]:
    """Serve a loopback bus, and be a station on it.

    Args:
        host: a loopback address.
        port: TCP; 0 takes a free one, shown in the station's `channel_info`.

    Raises:
        OSError: nobody can listen there.
    """
    channel = f"sim-{host}-{port}-{id(object())}"
    server = _Server(host, port, interface="virtual", channel=channel)
    server.RequestHandlerClass = _Handler
    thread = threading.Thread(target=server.serve_forever, args=(POLL_S,), name="bus", daemon=True)
    with can.Bus(interface="virtual", channel=channel) as station:
        station.channel_info = f"ws://{host}:{server.server_port}/"
        thread.start()
        try:
            yield station
        finally:
            server.shutdown()
            server.server_close()
            thread.join()
