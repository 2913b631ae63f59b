"""The virtual drives by the computer's clock: one thread between a CAN bus and a `World`.

The bus is SocketCAN, another one of python-can's, or (`gaitd sim --wall-clock`) the socket of the
simulated bus, on which nothing is waited for in this mode.

The world's time is this machine's monotonic clock, so a truth row carries the same time as the
service's record of that SYNC. The thread sleeps on the bus until the world's next event; in
between it wakes up every SLICE_NS, so that a SYNC finds the plant nearly up to date and is
answered early.

A frame reaches the drives at its time on the wire, however late this process reads it: a real drive
latches its encoder at SYNC. That time is the kernel's stamp, on the simulated bus the sender's.
Without a stamp, or if the wall clock has just been set, it is the time of reading. Received frames
are therefore processed before the world advances to the present.
"""

import contextlib
import math
import time
from collections import deque
from collections.abc import Callable, Generator, Sequence
from typing import Final, Protocol

import can
from can.interfaces.socketcan import SocketcanBus
from can.interfaces.virtual import VirtualBus

from drives.canopen.frame import Frame
from sim_drives.canopen.timers import MILLISECOND
from sim_drives.control import ControlSocket
from sim_drives.faults.script import FaultCommandError
from sim_drives.time.bus_server import BusServer, Connection
from sim_drives.world import SYNC_ID, World
from simtime import wire
from simtime.page import PageWriter

SLICE_NS: Final = 5 * MILLISECOND
SYNC_SILENCE_NS: Final = 20 * MILLISECOND
"""Time after which SYNC is not late any more, but missing."""
QUIET_ROW_NS: Final = 10 * MILLISECOND
NS_PER_S: Final = 1_000_000_000
SOCKETCAN: Final = "socketcan"
BEHIND_NS: Final = 3 * MILLISECOND
"""The world is kept this far behind the present where a frame may still be on its way."""
STEADY_NS: Final = 100_000
"""If both clocks have moved by more than this relative to each other, the wall clock was set."""


def now_ns() -> int:
    """The clock of the virtual drives."""
    return time.monotonic_ns()


class BusLostError(Exception):
    """Machine error: the CAN interface disappeared during operation."""


class Station(Protocol):
    """The interface that the virtual drives need of a bus: python-can's, or `ServedBus`."""

    channel_info: str

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return a frame, or None when the timeout is over."""
        ...

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Put a frame on the bus."""
        ...


@contextlib.contextmanager
def open_bus(interface: str, channel: str, bitrate_bit_per_s: int) -> Generator[can.BusABC]:
    """Open a python-can bus.

    Raises:
        OSError, can.CanError: the interface or the address cannot be opened.
        ValueError: the channel is invalid for the interface.
    """
    if interface == SOCKETCAN:
        with _KernelBus(channel) as bus:
            yield bus
    else:
        with can.Bus(channel=channel, interface=interface, bitrate=bitrate_bit_per_s) as bus:
            yield bus


class ServedBus:
    """The socket of the simulated bus by the computer's clock, as a bus for the virtual drives."""

    def __init__(self, server: BusServer, page: PageWriter, obey: Callable[[str], str]) -> None:
        """Use a server's socket.

        Args:
            server: server of the socket.
            page: indicates to readers that time is the computer's.
            obey: executes commands of a controlling client.
        """
        self._server, self._obey = server, obey
        self._arrived: deque[can.Message] = deque()
        self.channel_info = f"simulated {server.path} by the wall clock"
        page.begin(now_ns(), time.time_ns() - now_ns(), wall_clock=True)
        page.write_pace(1.0)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return a frame; None when the timeout is over, or another event has happened."""
        if not self._arrived:
            for connection, message in self._server.receive(timeout or 0.0):
                self._take(connection, message)
        return self._arrived.popleft() if self._arrived else None

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame to every client."""
        del timeout
        frame = Frame(msg.arbitration_id, bytes(msg.data), time.time_ns())
        self._hand_out(None, [frame])

    def _take(self, connection: Connection, message: wire.ToServer) -> None:
        match message:
            case wire.Hello():
                welcome = wire.Welcome(now_ns(), time.time_ns() - now_ns(), wall_clock=True)
                self._server.send(connection, wire.pack_welcome(welcome))
            case wire.Send(sent_ns, frames):
                stamp_ns = sent_ns + time.time_ns() - now_ns()
                stamped = [frame._replace(time_ns=stamp_ns) for frame in frames]
                self._arrived.extend(map(_message, stamped))
                self._hand_out(connection, stamped)
            case wire.Wait():
                self._server.refuse(connection, "time is the wall clock: the server grants no time")
            case wire.Hand(line):
                self._command(connection, line)

    def _command(self, connection: Connection, line: str) -> None:
        try:
            said, refused = self._obey(line), False
        except FaultCommandError as error:
            said, refused = str(error), True
        self._server.send(connection, wire.pack_reply(said, refused=refused))

    def _hand_out(self, sender: Connection | None, frames: Sequence[Frame]) -> None:
        for connection in self._server.connections:
            hello = connection.hello
            if connection is not sender and hello and hello.role is not wire.Role.HAND:
                self._server.send_frames(connection, frames)


def _message(frame: Frame) -> can.Message:
    return can.Message(
        timestamp=frame.time_ns * 1e-9,
        arbitration_id=frame.can_id,
        data=frame.data,
        is_extended_id=False,
        is_error_frame=frame.is_error,
    )


STAMPING: Final = (SocketcanBus, VirtualBus, ServedBus)
ON_ITS_WAY: Final = (VirtualBus, ServedBus)
"""Interfaces on which a frame takes time to reach this process."""


class _KernelBus(SocketcanBus):
    """SocketCAN; python-can's `recv` would wait by the wall clock, which may be set."""

    def recv(self, timeout: float | None = None) -> can.Message | None:
        return self._recv_internal(timeout)[0]


class Arrivals:
    """Converts wall-clock stamps of received frames to the monotonic time of the world."""

    def __init__(self) -> None:
        self._ahead_ns: int | None = None

    def time_of_ns(self, stamp_utc_ns: int, earliest_ns: int, now_ns: int, utc_ns: int) -> int:
        """Return a frame's arrival between `earliest_ns` and now; now, if it is unknown."""
        before_ns, self._ahead_ns = self._ahead_ns, utc_ns - now_ns
        if before_ns is None or abs(self._ahead_ns - before_ns) > STEADY_NS:
            return now_ns
        return min(max(stamp_utc_ns - self._ahead_ns, earliest_ns), now_ns)


class RealTime:
    """Runs a world on a bus."""

    def __init__(
        self,
        world: World,
        bus: Station,
        control: ControlSocket | None = None,
        on_silence: Callable[[int], None] | None = None,
    ) -> None:
        """Connect a world to a bus.

        Args:
            world: world of the virtual drives.
            bus: the bus of the drives.
            control: commands to the drives.
            on_silence: called every QUIET_ROW_NS while no SYNC comes, with the last one's number.
        """
        self._world = world
        self._bus = bus
        self._control = control
        self._on_silence = on_silence
        self._recorded_ns = now_ns() + SYNC_SILENCE_NS
        self._arrivals = Arrivals() if isinstance(bus, STAMPING) else None
        self._behind_ns = BEHIND_NS if isinstance(bus, ON_ITS_WAY) else 0
        self.dropped = 0
        """Frames that the interface did not accept."""

    @property
    def now_ns(self) -> int:
        """The world's time."""
        return self._world.now_ns

    def run(self, should_end: Callable[[], bool]) -> None:
        """Run until `should_end` returns true; it is called at least every SLICE_NS.

        Raises:
            BusLostError: the interface is gone.
        """
        while not should_end():
            if self._control is not None:
                self._control.serve()
            self._receive_all(0.0)
            self._send(self._world.advance_to(self._until_ns()))
            self._record_silence()
            self._receive_all(self._timeout_s())

    def _until_ns(self) -> int:
        """Return the time before which no more frames can arrive; events are not delayed."""
        now, world = now_ns(), self._world
        return max(world.now_ns, min(now, max(now - self._behind_ns, world.next_event_ns())))

    def _receive_all(self, timeout_s: float) -> None:
        """Return the received frames, waiting up to `timeout_s` for the first."""
        message = self._receive(timeout_s)
        while message is not None:
            self._take(message)
            message = self._receive(0.0)

    def _timeout_s(self) -> float:
        now = now_ns()
        return max(0, min(self._world.next_event_ns(), now + SLICE_NS) - now) / NS_PER_S

    def _record_silence(self) -> None:
        if self._on_silence is not None and self._world.now_ns >= self._recorded_ns + QUIET_ROW_NS:
            self._recorded_ns = self._world.now_ns
            self._on_silence(self._world.sync_count)

    def _take(self, message: can.Message) -> None:
        self._send(self._world.advance_to(self._arrival_ns(message)))
        odd = message.is_extended_id or message.is_remote_frame or message.is_error_frame
        if not odd:
            if message.arbitration_id == SYNC_ID:
                self._recorded_ns = self._world.now_ns + SYNC_SILENCE_NS
            self._world.receive(Frame(message.arbitration_id, bytes(message.data)))

    def _arrival_ns(self, message: can.Message) -> int:
        now = now_ns()
        stamp_ns = message.timestamp * NS_PER_S
        if self._arrivals is None or not math.isfinite(stamp_ns):
            return now
        return self._arrivals.time_of_ns(int(stamp_ns), self._world.now_ns, now, time.time_ns())

    def _receive(self, timeout_s: float) -> can.Message | None:
        try:
            return self._bus.recv(timeout_s)
        except (OSError, can.CanError) as error:
            raise BusLostError(f"{self._bus.channel_info}: {error}") from error

    def _send(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            message = can.Message(
                arbitration_id=frame.can_id, data=frame.data, is_extended_id=False
            )
            try:
                self._bus.send(message)
            except can.CanOperationError:
                self.dropped += 1  # a full queue: a real controller would lose the frame, too
