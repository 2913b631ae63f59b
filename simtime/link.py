"""Client side of simulated time: sends and receives frames, and lets time pass while it waits.

Bus and clock of a service in simulated time use a `Link`: `SocketLink` in a process of its own, and
`sim_drives.time.conductor.DirectLink` in the process of the virtual drives. With the server's
`--wall-clock` a `SocketLink` carries frames alone, and waits by the computer's clock.
"""

import contextlib
import select
import socket
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NoReturn, Protocol

from drives.canopen.frame import Frame
from simtime import wire
from simtime.page import PageError, SimulatedTime, page_path
from simtime.wire import Role

CONNECT_TIMEOUT_S: Final = 5.0
"""Time limit for the server's WELCOME."""
WATCHED_TIMEOUT_S: Final = 0.5
"""Time limit for the WELCOME, if a watchdog uses the computer's clock."""
_LAST_READS: Final = 1000
_WAIT_MAX_NS: Final = 1_000_000_000


class LinkLostError(Exception):
    """There is no server, or it has ended or refused; the message states which."""


class Link(Protocol):
    """The interface that a bus and a clock in simulated time need."""

    def now_ns(self) -> int:
        """Simulated time."""
        ...

    def utc_ns(self) -> int:
        """Simulated UTC."""
        ...

    @property
    def is_in_step(self) -> bool:
        """True if the seat is taken, and its time simulated."""
        ...

    def open(self) -> None:
        """Take the seat, unless it is taken.

        Raises:
            LinkLostError: the seat is not available.
        """
        ...

    def check(self) -> None:
        """Raise if the seat is lost.

        Raises:
            LinkLostError: there is no bus any more.
        """
        ...

    def send(self, frames: Sequence[Frame]) -> int:
        """Put frames on the bus now; return the number that did not fit into the queue.

        Raises:
            LinkLostError: the bus is gone.
        """
        ...

    def wait(self, until_ns: int, *, for_frame: bool) -> None:
        """Let time pass up to an instant, or to the first frame.

        Raises:
            LinkLostError: the bus is gone.
        """
        ...

    def take(self) -> list[Frame]:
        """Return the received frames, each once."""
        ...


class SocketLink:
    """A seat over the socket of `gaitd sim`.

    Before the seat is taken its time is that of the server's page. When a server has ended, or the
    seat could not be taken, time continues by the computer's clock from its last value: a server
    may have a page before it listens, and its time stands until the seats are taken. A later server
    begins no earlier.
    """

    def __init__(
        self,
        path: Path,
        role: Role,
        name: str,
        *,
        wall_clock_only: bool = False,
        timeout_s: float | None = None,
    ) -> None:
        """Configure the seat; it is taken by `open`.

        Args:
            path: path of the server's socket.
            role: role of the seat for time.
            name: name for messages, and for `stall NAME`.
            wall_clock_only: refuse a server whose time is simulated.
            timeout_s: time limit for any answer, of the computer's time; None: unlimited (core).
        """
        self._path, self._role, self._name = path, role, name
        self._wall_clock_only = wall_clock_only
        self._timeout_s = timeout_s
        self._socket: socket.socket | None = None
        self._page: SimulatedTime | None = None
        self._is_wall_clock = False
        self._is_apart = False
        """Time continues by the computer's clock, although there is a page."""
        self._now_ns = self._left_ns = time.monotonic_ns()
        """Simulated time of the newest grant; the computer's time of it, without a server."""
        self._utc_ahead_ns = time.time_ns() - self._now_ns
        with contextlib.suppress(OSError, PageError):  # `open` reports what is wrong with it
            self._page = SimulatedTime(page_path(path))
            self._now_ns = 0
            self._utc_ahead_ns = self._page.utc_ns() - self._page.now_ns()
        self._frames: list[Frame] = []

    # --- time ---------------------------------------------------------------------------------

    def now_ns(self) -> int:
        """As `Link.now_ns`: the page's time, so a stopped process sees how much has passed."""
        if self._is_wall_clock:
            return time.monotonic_ns()
        if self._page is None or self._is_apart:
            return self._now_ns + time.monotonic_ns() - self._left_ns
        self._now_ns = max(self._now_ns, self._page.now_ns())
        return self._now_ns

    def utc_ns(self) -> int:
        """As `Link.utc_ns`."""
        return time.time_ns() if self._is_wall_clock else self.now_ns() + self._utc_ahead_ns

    @property
    def is_in_step(self) -> bool:
        """As `Link.is_in_step`."""
        return self._socket is not None and not self._is_wall_clock

    # --- the seat -----------------------------------------------------------------------------

    def open(self) -> None:
        """As `Link.open`."""
        if self._socket is not None:
            return
        made = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_CLOEXEC)
        try:
            made.settimeout(WATCHED_TIMEOUT_S if self._wall_clock_only else CONNECT_TIMEOUT_S)
            made.connect(str(self._path))
            made.send(wire.pack_hello(self._role, self.now_ns(), self._name))
            self._welcome(made.recv(wire.MESSAGE_SIZE_MAX))
            self._page = SimulatedTime(page_path(self._path))
        except (OSError, wire.WireError, PageError) as error:
            made.close()
            self._leave_page()
            raise LinkLostError(f"`gaitd sim` does not answer there: {error}") from error
        except LinkLostError:
            made.close()
            self._leave_page()
            raise
        made.settimeout(self._timeout_s)
        self._socket, self._is_apart = made, False

    def _welcome(self, data: bytes) -> None:
        if not data:
            raise LinkLostError("`gaitd sim` has closed the connection")
        match wire.read_from_server(data):
            case wire.Welcome(now_ns, utc_ahead_ns, is_wall_clock):
                if self._wall_clock_only and not is_wall_clock:
                    raise LinkLostError(
                        "its time is simulated, but a watchdog uses the computer's clock: "
                        "start `gaitd sim` with --wall-clock"
                    )
                self._now_ns, self._utc_ahead_ns = now_ns, utc_ahead_ns
                self._is_wall_clock = is_wall_clock
            case wire.Reply(text):
                raise LinkLostError(f"`gaitd sim` refuses this program: {text}")
            case other:
                raise LinkLostError(f"`gaitd sim` answers with {type(other).__name__}")

    def check(self) -> None:
        """As `Link.check`."""
        self._existing()

    def fileno(self) -> int:
        """Return the descriptor for poll(): readable when a message has come.

        Raises:
            LinkLostError: the seat is not taken.
        """
        return self._existing().fileno()

    def close(self) -> None:
        """Leave the seat; time continues by the computer's clock."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None
            self._leave_page()

    def _leave_page(self) -> None:
        now_ns = self.now_ns()
        self._is_wall_clock, self._is_apart = False, True
        self._now_ns, self._left_ns = now_ns, time.monotonic_ns()

    # --- frames -------------------------------------------------------------------------------

    def send(self, frames: Sequence[Frame]) -> int:
        """As `Link.send`; by the computer's clock it never waits for a server that hangs."""
        said = [self._send_message(message) for message in wire.pack_send(self.now_ns(), frames)]
        return 0 if all(said) else len(frames)

    def send_alive(self) -> None:
        """Send a sign of life while no request is made: otherwise the seat would count as hung."""
        with contextlib.suppress(LinkLostError):  # the next use of the bus raises it
            self._send_message(wire.pack_here(self.now_ns()))

    def wait(self, until_ns: int, *, for_frame: bool) -> None:
        """As `Link.wait`."""
        if self._is_wall_clock:
            self._wait_by_the_wall(until_ns, for_frame=for_frame)
            return
        self._send_message(wire.pack_wait(until_ns, for_frame=for_frame))
        while not isinstance(message := self._receive_message(), wire.Grant):
            self._accept(message)
        self._now_ns = max(self._now_ns, message.now_ns)

    def take(self) -> list[Frame]:
        """As `Link.take`."""
        frames, self._frames = self._frames, []
        return frames

    def receive(self) -> None:
        """Read one message; for listeners. Those of a fast server may have no end.

        Raises:
            LinkLostError: the server has ended.
        """
        self._accept(self._receive_message())

    def command(self, line: str) -> str:
        """Send a command of a test, and return its answer.

        Raises:
            ValueError: the server refuses it; with the server's message.
            LinkLostError: the server has ended.
        """
        self._send_message(wire.pack_hand(line))
        while not isinstance(message := self._receive_message(), wire.Reply):
            self._accept(message)
        if message.refused:
            raise ValueError(message.text)
        return message.text

    def _wait_by_the_wall(self, until_ns: int, *, for_frame: bool) -> None:
        self._receive_waiting()
        while not (for_frame and self._frames):
            left_ns = until_ns - time.monotonic_ns()
            if left_ns <= 0:
                return
            if not for_frame:  # frames that arrive meanwhile wait in the socket
                time.sleep(left_ns * 1e-9)
            elif self._has_waiting(min(left_ns, _WAIT_MAX_NS) * 1e-9):
                self._receive_waiting()

    def _has_waiting(self, within_s: float) -> bool:
        # poll() would round the time up to milliseconds, and delay each SYNC by up to one.
        return bool(select.select([self._existing()], [], [], within_s)[0])

    def _receive_waiting(self) -> None:
        while self._has_waiting(0.0):
            self.receive()

    def _accept(self, message: wire.FromServer) -> None:
        match message:
            case wire.Frames(frames):
                self._frames += frames
            case wire.Reply(text):
                self._lose(f"`gaitd sim` refuses what was sent: {text}")
            case other:
                self._lose(f"`gaitd sim` answers with {type(other).__name__}")

    def _send_message(self, message: bytes) -> bool:
        """Send a message; return whether there was room for it."""
        try:
            self._existing().send(message, socket.MSG_DONTWAIT * self._is_wall_clock)
        except BlockingIOError:
            return False
        except OSError as error:
            self._lose(f"`gaitd sim` has ended: {error}")
        return True

    def _receive_message(self) -> wire.FromServer:
        try:
            data = self._existing().recv(wire.MESSAGE_SIZE_MAX)
        except OSError as error:
            self._lose(f"`gaitd sim` has ended: {error}")
        if not data:
            self._lose("`gaitd sim` has ended")
        return wire.read_from_server(data)

    def _existing(self) -> socket.socket:
        if self._socket is None:
            raise LinkLostError("`gaitd sim` has ended")
        return self._socket

    def _lose(self, why: str) -> NoReturn:
        told = self._last_message()
        with contextlib.suppress(OSError):
            self.close()
        raise LinkLostError(f"`gaitd sim` refuses what was sent: {told}" if told else why)

    def _last_message(self) -> str:
        """Return the server's reason for disconnecting, if its message is still unread."""
        end = self._existing()
        end.setblocking(False)
        for _ in range(_LAST_READS):
            with contextlib.suppress(OSError, wire.WireError):
                message = wire.read_from_server(end.recv(wire.MESSAGE_SIZE_MAX))
                if isinstance(message, wire.Reply):
                    return message.text
        return ""
