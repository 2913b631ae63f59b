"""The CAN bus: frames in, frames out. The only file that touches python-can in the cycle.

`Bus` is the interface that everything else uses; `CanBus` is the real one, over python-can's
socketcan or any other of its own interfaces.

Policy for a full transmit queue (ENOBUFS): frames that `send` cannot place at once are dropped and
counted, because process data of this cycle are worthless in the next. `send_urgent` (NMT, quick
stop) tries again until its deadline, and receives meanwhile. Neither raises for a full queue.
Any other failure is a BusError: the interface went down or away.

No function here reads a clock: a function that waits takes one. `Frame.time_ns` is the kernel's
stamp (SO_TIMESTAMPNS of a SocketCAN socket): the arrival time by the wall clock, which NTP and
operators change. Converting it to monotonic time needs both clocks, read before and after
(`daemon/core/runtime/arrivals.py`). Stamps of other interfaces come from another process or
machine, and are not used.
"""

import errno
from collections.abc import Generator, Sequence
from contextlib import contextmanager, suppress
from typing import Final, Protocol

import can
from can.interfaces import BACKENDS
from can.interfaces.socketcan import SocketcanBus

from drives.canopen.frame import Frame
from drives.errors import BusError

DRAIN_COUNT_MAX: Final = 512
"""Most frames that one drain takes: a babbling node must not block the cycle."""
SOCKETCAN: Final = "socketcan"
RETRY_PAUSE_S: Final = 0.0002
"""Pause between two tries of an urgent frame: at 1 Mbit/s one frame takes about 0.13 ms."""

_OWN_BACKENDS: Final = "can.interfaces."

_QUEUE_FULL: Final = (errno.ENOBUFS, errno.EAGAIN)
_FAILURES: Final = (can.CanError, OSError, ValueError)
"""Exceptions that python-can raises in use. ValueError: select() on a closed socket."""
_OPEN_FAILURES: Final = (*_FAILURES, TypeError)
"""Exceptions of opening. TypeError: an interface that knows no bit rate."""


class Clock(Protocol):
    """The clock that a wait needs."""

    def now_ns(self) -> int:
        """Monotonic time in ns."""
        ...


class Bus(Protocol):
    """A CAN bus as the drives package uses it."""

    def send(self, frames: Sequence[Frame]) -> int:
        """Send at once or not at all; return the number of frames dropped on a full queue.

        Raises:
            BusError: the bus is down.
        """
        ...

    def send_urgent(self, frames: Sequence[Frame], deadline_ns: int, clock: Clock) -> int:
        """Send, trying again until the deadline; return the number of frames that were not sent.

        Raises:
            BusError: the bus is down.
        """
        ...

    def drain(self) -> list[Frame]:
        """Return everything received so far, oldest first; never waits.

        Raises:
            BusError: the bus is down.
        """
        ...

    def receive_until(self, deadline_ns: int, clock: Clock) -> list[Frame]:
        """Wait for the first frame, at most until the deadline; return everything received by then.

        Raises:
            BusError: the bus is down.
        """
        ...

    def close(self) -> None:
        """Close the interface; safe to call twice and on a dead bus."""
        ...


class OpenedBus(Bus, Protocol):
    """A `Bus` that was opened by its interface and channel."""

    foreign_count: int
    """Received frames of kinds that no drive sends: extended, remote or CAN FD."""


class SteadySocketcan(SocketcanBus):
    """SocketCAN without the wall clock.

    python-can's own `recv` measures its timeout with time.time(): if that is set back by an hour
    during a wait, the wait takes an hour longer. The method below it waits in select().
    """

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return a frame, or None after the timeout."""
        return self._recv_internal(timeout)[0]


class CanBus:
    """A `Bus` over python-can, without any thread."""

    def __init__(self, bus: can.BusABC, channel: str) -> None:
        self._bus = bus
        self._channel = channel
        self._stamps = isinstance(bus, SocketcanBus)
        self._buffered: list[Frame] = []  # received while an urgent frame waited
        self.dropped_count = 0
        """Frames that were never sent because the transmit queue was full."""
        self.foreign_count = 0
        """As `OpenedBus.foreign_count`."""

    @classmethod
    def open(cls, interface: str, channel: str, bitrate_bit_per_s: int) -> "CanBus":
        """Open one of python-can's own interfaces by its name.

        An interface that another installed package has registered is refused: no package that
        happens to be there gives the service a bus.

        The bit rate of a SocketCAN interface is set by the operating system; there it is only used
        for the bus load.

        Args:
            interface: python-can's name.
            channel: channel of the interface.
            bitrate_bit_per_s: bit rate of the bus.

        Raises:
            BusError: there is no such interface, or it does not work.
        """
        where = f"{interface}:{channel}"
        with _failures_as_bus_error(where, _OPEN_FAILURES):
            if interface == SOCKETCAN:
                bus: can.BusABC = SteadySocketcan(channel)
            elif not BACKENDS.get(interface, ("",))[0].startswith(_OWN_BACKENDS):
                raise BusError(where, "cannot be opened: no interface of python-can's own")
            else:
                bus = can.Bus(interface=interface, channel=channel, bitrate=bitrate_bit_per_s)
        return cls(bus, where)

    def send(self, frames: Sequence[Frame]) -> int:
        """As `Bus.send`."""
        dropped = sum(not self._place(frame) for frame in frames)
        self.dropped_count += dropped
        return dropped

    def send_urgent(self, frames: Sequence[Frame], deadline_ns: int, clock: Clock) -> int:
        """As `Bus.send_urgent`; frames that arrive meanwhile are kept for the next drain."""
        waiting = list(frames)
        while waiting:
            if self._place(waiting[0]):
                del waiting[0]
            elif clock.now_ns() >= deadline_ns:
                break
            else:
                message = self._receive_message(RETRY_PAUSE_S)
                if message is not None:
                    self._append(self._buffered, message)
        self.dropped_count += len(waiting)
        return len(waiting)

    def drain(self) -> list[Frame]:
        """As `Bus.drain`."""
        frames = self._buffered
        self._buffered = []
        for _ in range(DRAIN_COUNT_MAX):
            message = self._receive_message(0.0)
            if message is None:
                break
            self._append(frames, message)
        return frames

    def receive_until(self, deadline_ns: int, clock: Clock) -> list[Frame]:
        """As `Bus.receive_until`."""
        frames = self.drain()
        while not frames:
            remaining_ns = deadline_ns - clock.now_ns()
            if remaining_ns <= 0:
                break
            message = self._receive_message(remaining_ns * 1e-9)
            if message is not None:
                self._append(frames, message)
                frames.extend(self.drain())
        return frames

    def close(self) -> None:
        """As `Bus.close`."""
        with suppress(*_FAILURES):
            self._bus.shutdown()

    def _place(self, frame: Frame) -> bool:
        message = can.Message(
            arbitration_id=frame.can_id,
            data=frame.data,
            is_extended_id=False,
            check=False,
        )
        try:
            self._bus.send(message)
        except _FAILURES as error:
            if _queue_full(error):
                return False
            raise BusError(self._channel, f"cannot send: {_words(error)}") from error
        return True

    def _receive_message(self, timeout_s: float) -> can.Message | None:
        try:
            return self._bus.recv(timeout_s)
        except _FAILURES as error:
            raise BusError(self._channel, f"cannot receive: {_words(error)}") from error

    def _append(self, frames: list[Frame], message: can.Message) -> None:
        is_error = message.is_error_frame
        if not is_error and (message.is_extended_id or message.is_remote_frame or message.is_fd):
            self.foreign_count += 1
            return
        time_ns = int(message.timestamp * 1e9) if self._stamps else 0
        frames.append(Frame(message.arbitration_id, bytes(message.data), time_ns, is_error))


def _queue_full(error: BaseException) -> bool:
    # python-can has one class for all; only this text identifies a select() that timed out.
    if not isinstance(error, can.CanOperationError):
        return False
    return error.error_code in _QUEUE_FULL or "Transmit buffer full" in str(error)


def _words(error: BaseException) -> str:
    return f"{error} ({type(error).__name__})" if str(error) else type(error).__name__


@contextmanager
def _failures_as_bus_error(
    channel: str, failures: tuple[type[BaseException], ...]
) -> Generator[None]:
    try:
        yield
    except failures as error:
        raise BusError(channel, f"cannot be opened: {_words(error)}") from error
