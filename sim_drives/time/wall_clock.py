"""The virtual drives by the computer's clock: one thread between a CAN bus and a `World`.

The bus is SocketCAN, another one of python-can's, or (`gaitd sim --wall-clock`) the socket of the
simulated bus, on which then nothing is waited for.

The world's time is this machine's monotonic clock, so a truth row carries the same time as the
service's record of that SYNC. The thread sleeps on the bus until the world's next event; in
between it wakes up every SLICE_NS, so that a SYNC finds the plant nearly up to date and is
answered early.

A frame reaches the drives when it was on the wire, however late this process comes to read it: a
real drive latches its encoder at SYNC. That is by the kernel's stamp, on our own socket by its
sender's. Where nobody stamps, or the wall clock has just been set, it is the time of reading. So
what has come is taken before the world goes on to the present.
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

from sim_drives.canopen.timers import MILLISECOND
from sim_drives.control import ControlSocket
from sim_drives.faults.script import FaultCommandError
from sim_drives.frame import Frame, TimedFrame
from sim_drives.time.bus_server import BusServer, Connection
from sim_drives.world import SYNC_ID, EmptyWorld, World
from simtime import wire
from simtime.frame import Frame as BusFrame
from simtime.page import PageWriter

SLICE_NS: Final = 5 * MILLISECOND
SYNC_SILENCE_NS: Final = 20 * MILLISECOND
"""Then SYNC is not late any more, but silent."""
QUIET_ROW_NS: Final = 10 * MILLISECOND
NS_PER_S: Final = 1_000_000_000
SOCKETCAN: Final = "socketcan"
BEHIND_NS: Final = 3 * MILLISECOND
"""The world is kept so far behind the present where a frame may be on its way to us."""
STEADY_NS: Final = 100_000
"""A wall clock that has moved by more against the other one since the last frame was set."""


def now_ns() -> int:
    """The clock of the virtual drives."""
    return time.monotonic_ns()


class BusLostError(Exception):
    """The machine's: the CAN interface has gone while we were on it."""


class Station(Protocol):
    """What the virtual drives need of a bus: python-can's, or `ServedBus`."""

    channel_info: str

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """A frame, or None when the timeout is over."""
        ...

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Put a frame on the bus."""
        ...


@contextlib.contextmanager
def open_bus(interface: str, channel: str, bitrate_bit_per_s: int) -> Generator[can.BusABC]:
    """Our station on a bus of python-can's.

    Raises:
        OSError, can.CanError: the interface or the address cannot be opened.
        ValueError: the channel makes no sense for the interface.
    """
    if interface == SOCKETCAN:
        with _KernelBus(channel) as bus:
            yield bus
    else:
        with can.Bus(channel=channel, interface=interface, bitrate=bitrate_bit_per_s) as bus:
            yield bus


class ServedBus:
    """The socket of the simulated bus by the computer's clock: a station among its clients."""

    def __init__(self, server: BusServer, page: PageWriter, obey: Callable[[str], str]) -> None:
        """Take a socket.

        Args:
            server: of the socket.
            page: tells readers that time is the computer's.
            obey: what a hand says.
        """
        self._server, self._obey = server, obey
        self._arrived: deque[can.Message] = deque()
        self.channel_info = f"simulated {server.path} by the wall clock"
        page.begin(now_ns(), time.time_ns() - now_ns(), wall_clock=True)
        page.write_pace(1.0)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """A frame; None when the timeout is over, or something else has happened."""
        if not self._arrived:
            for connection, message in self._server.receive(timeout or 0.0):
                self._take(connection, message)
        return self._arrived.popleft() if self._arrived else None

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """To every client."""
        del timeout
        frame = BusFrame(msg.arbitration_id, bytes(msg.data), time.time_ns())
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
                self._server.refuse(connection, "time is the wall clock: nothing is granted")
            case wire.Hand(line):
                self._command(connection, line)

    def _command(self, connection: Connection, line: str) -> None:
        try:
            said, refused = self._obey(line), False
        except FaultCommandError as error:
            said, refused = str(error), True
        self._server.send(connection, wire.pack_told(said, refused=refused))

    def _hand_out(self, sender: Connection | None, frames: Sequence[BusFrame]) -> None:
        for connection in self._server.connections:
            hello = connection.hello
            if connection is not sender and hello and hello.role is not wire.Role.HAND:
                self._server.send_frames(connection, frames)


def _message(frame: BusFrame) -> can.Message:
    return can.Message(
        timestamp=frame.time_ns * 1e-9,
        arbitration_id=frame.can_id,
        data=frame.data,
        is_extended_id=False,
        is_error_frame=frame.is_error,
    )


STAMPING: Final = (SocketcanBus, VirtualBus, ServedBus)
ON_ITS_WAY: Final = (VirtualBus, ServedBus)
"""On these a frame is some time on its way to us."""


class _KernelBus(SocketcanBus):
    """SocketCAN; python-can's `recv` would wait by the wall clock, which somebody may set."""

    def recv(self, timeout: float | None = None) -> can.Message | None:
        return self._recv_internal(timeout)[0]


class Arrivals:
    """When frames came, in the monotonic time of the world, from stamps of the wall clock."""

    def __init__(self) -> None:
        self._ahead_ns: int | None = None

    def time_of_ns(self, stamp_utc_ns: int, earliest_ns: int, now_ns: int, utc_ns: int) -> int:
        """The arrival of a frame between `earliest_ns` and now; now, if that is not known."""
        before_ns, self._ahead_ns = self._ahead_ns, utc_ns - now_ns
        if before_ns is None or abs(self._ahead_ns - before_ns) > STEADY_NS:
            return now_ns
        return min(max(stamp_utc_ns - self._ahead_ns, earliest_ns), now_ns)


class RealTime:
    """Runs a world on a bus."""

    def __init__(
        self,
        world: World | EmptyWorld,
        bus: Station,
        control: ControlSocket | None = None,
        on_silence: Callable[[int], None] | None = None,
    ) -> None:
        """Put a world on a bus.

        Args:
            world: of the virtual drives.
            bus: our station on it.
            control: commands to the drives.
            on_silence: called every QUIET_ROW_NS while no SYNC comes, with the last one's number.
        """
        self._world = world
        self._bus = bus
        self._control = control
        self._on_silence = on_silence
        self._noted_ns = now_ns() + SYNC_SILENCE_NS
        self._arrivals = Arrivals() if isinstance(bus, STAMPING) else None
        self._behind_ns = BEHIND_NS if isinstance(bus, ON_ITS_WAY) else 0
        self.dropped = 0
        """Frames that the interface did not take."""

    @property
    def now_ns(self) -> int:
        """The world's time."""
        return self._world.now_ns

    def run(self, should_end: Callable[[], bool]) -> None:
        """Until `should_end` says so; it is asked at least every SLICE_NS.

        Raises:
            BusLostError: the interface is gone.
        """
        while not should_end():
            if self._control is not None:
                self._control.serve()
            self._take_all(0.0)
            self._send(self._world.advance_to(self._until_ns()))
            self._note_silence()
            self._take_all(self._patience_s())

    def _until_ns(self) -> int:
        """As far as nothing can come any more that was on the wire before; events are in time."""
        now, world = now_ns(), self._world
        return max(world.now_ns, min(now, max(now - self._behind_ns, world.next_event_ns())))

    def _take_all(self, patience_s: float) -> None:
        """What has come, and what comes first within `patience_s`."""
        message = self._receive(patience_s)
        while message is not None:
            self._take(message)
            message = self._receive(0.0)

    def _patience_s(self) -> float:
        now = now_ns()
        return max(0, min(self._world.next_event_ns(), now + SLICE_NS) - now) / NS_PER_S

    def _note_silence(self) -> None:
        if self._on_silence is not None and self._world.now_ns >= self._noted_ns + QUIET_ROW_NS:
            self._noted_ns = self._world.now_ns
            self._on_silence(self._world.sync_count)

    def _take(self, message: can.Message) -> None:
        self._send(self._world.advance_to(self._arrival_ns(message)))
        odd = message.is_extended_id or message.is_remote_frame or message.is_error_frame
        if not odd:
            if message.arbitration_id == SYNC_ID:
                self._noted_ns = self._world.now_ns + SYNC_SILENCE_NS
            self._world.receive(Frame(message.arbitration_id, bytes(message.data)))

    def _arrival_ns(self, message: can.Message) -> int:
        now = now_ns()
        stamp_ns = message.timestamp * NS_PER_S
        if self._arrivals is None or not math.isfinite(stamp_ns):
            return now
        return self._arrivals.time_of_ns(int(stamp_ns), self._world.now_ns, now, time.time_ns())

    def _receive(self, patience_s: float) -> can.Message | None:
        try:
            return self._bus.recv(patience_s)
        except (OSError, can.CanError) as error:
            raise BusLostError(f"{self._bus.channel_info}: {error}") from error

    def _send(self, frames: Sequence[TimedFrame]) -> None:
        for frame in frames:
            message = can.Message(
                arbitration_id=frame.can_id, data=frame.data, is_extended_id=False
            )
            try:
                self._bus.send(message)
            except can.CanOperationError:
                self.dropped += 1  # a full queue: a real controller would lose it, too
