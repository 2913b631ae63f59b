"""The CAN bus: frames in, frames out. The only file that touches python-can in the cycle.

`Bus` is what everything else relies on; `CanBus` is the real one, over python-can's socketcan or
any other of its interfaces. The bus of simulated time is another (`simulated.py`).

Policy for a full transmit queue (ENOBUFS): what `send` cannot place at once is dropped and
counted, because process data of this cycle are worthless in the next. `send_urgent` (NMT, quick
stop) tries again until its deadline, and listens meanwhile. Neither raises for a full queue.
Any other failure is a BusError: the interface went down or away.

Nothing here reads a clock: whoever waits brings one. `Frame.time_ns` is the kernel's stamp
(SO_TIMESTAMPNS of a SocketCAN socket): the moment of arrival, by the wall clock, which NTP and
operators move. What it means in monotonic time is known only to who reads both clocks before and
after (`daemon/core/runtime/arrivals.py`). Stamps of other interfaces are those of another process
or machine, and not taken.
"""

import errno
from collections.abc import Generator, Sequence
from contextlib import contextmanager, suppress
from typing import Final, Protocol

import can
from can.interfaces.socketcan import SocketcanBus

from drives.errors import BusError
from simtime.frame import Frame

DRAIN_COUNT_MAX: Final = 512
"""Frames that one drain takes: a babbling node must not hold the cycle."""
SOCKETCAN: Final = "socketcan"
RETRY_PAUSE_S: Final = 0.0002
"""Between two tries of an urgent frame: at 1 Mbit/s one frame leaves the queue in about 0.13 ms."""

_QUEUE_FULL: Final = (errno.ENOBUFS, errno.EAGAIN)
_FAILURES: Final = (can.CanError, OSError, ValueError)
"""What python-can raises in use. ValueError: select() on a closed socket."""
_OPEN_FAILURES: Final = (*_FAILURES, TypeError)
"""TypeError: an interface that knows no bit rate."""


class Clock(Protocol):
    """What a wait needs of time."""

    def now_ns(self) -> int:
        """Monotonic time in ns."""
        ...


class Bus(Protocol):
    """A CAN bus as the drives package uses it."""

    def send(self, frames: Sequence[Frame]) -> int:
        """Send at once or not at all; the number of frames dropped on a full queue.

        Raises:
            BusError: the bus is down.
        """
        ...

    def send_urgent(self, frames: Sequence[Frame], deadline_ns: int, clock: Clock) -> int:
        """Send, trying again until the deadline; the number of frames that did not leave.

        Raises:
            BusError: the bus is down.
        """
        ...

    def drain(self) -> list[Frame]:
        """Everything received so far, oldest first; never waits.

        Raises:
            BusError: the bus is down.
        """
        ...

    def receive_until(self, deadline_ns: int, clock: Clock) -> list[Frame]:
        """Wait for the first frame, at most until the deadline; everything that is there by then.

        Raises:
            BusError: the bus is down.
        """
        ...

    def close(self) -> None:
        """Let go of the interface; safe to call twice and on a dead bus."""
        ...


class SteadySocketcan(SocketcanBus):
    """SocketCAN without the wall clock.

    python-can's own `recv` counts its patience with time.time(): set back by an hour while it
    waits, it waits for an hour, or for a frame. What it is built on waits in select().
    """

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """A frame, or None when the timeout is over."""
        return self._recv_internal(timeout)[0]


class CanBus:
    """A `Bus` over python-can, without any thread."""

    def __init__(self, bus: can.BusABC, channel: str) -> None:
        self._bus = bus
        self._channel = channel
        self._stamps = isinstance(bus, SocketcanBus)
        self._kept: list[Frame] = []  # received while an urgent frame waited
        self.dropped_count = 0
        """Frames that never left because the transmit queue was full."""
        self.foreign_count = 0
        """Frames received that no drive of ours sends: extended, remote or CAN FD."""

    @classmethod
    def open(cls, interface: str, channel: str, bitrate_bit_per_s: int) -> "CanBus":
        """Open an interface by python-can's own words.

        The bit rate of a SocketCAN interface is the operating system's matter; there it is only
        used for the bus load.

        Args:
            interface: python-can's name.
            channel: of it.
            bitrate_bit_per_s: of the bus.

        Raises:
            BusError: there is no such interface, or it does not work.
        """
        where = f"{interface}:{channel}"
        with _failures_as_bus_error(where, _OPEN_FAILURES):
            if interface == SOCKETCAN:
                bus: can.BusABC = SteadySocketcan(channel)
            else:
                bus = can.Bus(interface=interface, channel=channel, bitrate=bitrate_bit_per_s)
        return cls(bus, where)

    def send(self, frames: Sequence[Frame]) -> int:
        """As `Bus.send`."""
        dropped = sum(not self._place(frame) for frame in frames)
        self.dropped_count += dropped
        return dropped

    def send_urgent(self, frames: Sequence[Frame], deadline_ns: int, clock: Clock) -> int:
        """As `Bus.send_urgent`; what arrives meanwhile is kept for the next drain."""
        waiting = list(frames)
        while waiting:
            if self._place(waiting[0]):
                del waiting[0]
            elif clock.now_ns() >= deadline_ns:
                break
            else:
                frame = self._receive(RETRY_PAUSE_S)
                self._kept.extend(() if frame is None else (frame,))
        self.dropped_count += len(waiting)
        return len(waiting)

    def drain(self) -> list[Frame]:
        """As `Bus.drain`."""
        frames = self._kept
        self._kept = []
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

    def _receive(self, timeout_s: float) -> Frame | None:
        message = self._receive_message(timeout_s)
        frames: list[Frame] = []
        if message is not None:
            self._append(frames, message)
        return frames[0] if frames else None

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
    # python-can has one class for all; a select() that times out carries only this text.
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
