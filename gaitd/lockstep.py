"""The real loop against the virtual machine in one thread, faster than time, bit for bit the same.

Nothing of the service is replaced but its ends: `WorldBus` stands in for the CAN socket, and time
passes only while somebody waits on it; `Gateway` (`lockstep_gateway.py`) stands in for the other
process, keeps every record and asks for what a script says. What runs in between is the product.
"""

import errno
import heapq
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Final, Protocol

from daemon.config.bundle import Settings
from daemon.core.axis_notes import Notes
from daemon.core.build import build
from daemon.core.loop import Loop
from daemon.core.loop_settings import Log, Supervisor
from daemon.core.process import loop_settings
from daemon.core.supervision import Supervision
from daemon.record import CycleRecord, ModeRequest, Outcome, RequestKind, RequestResult
from drives.bus import Clock, Frame
from drives.errors import BusError
from drives.nmt import SYNC_ID
from gaitd.lockstep_gateway import BOOT_ID, Gateway
from sim_drives.frame import Frame as WorldFrame
from sim_drives.frame import TimedFrame

NS_PER_S: Final = 1_000_000_000
UTC_OF_START_NS: Final = 1_767_225_600_000_000_000
RETRY_NS: Final = 200_000
"""Between two tries of an urgent frame, as on a real bus."""


class WorldClock:
    """Simulated time: what the world says. Sleeping lets the world go on."""

    def __init__(self, bus: "WorldBus") -> None:
        self._bus = bus

    @property
    def utc_stepped_ns(self) -> int:
        """By how much somebody has set the wall clock."""
        return self._bus.utc_stepped_ns

    @utc_stepped_ns.setter
    def utc_stepped_ns(self, stepped_ns: int) -> None:
        self._bus.utc_stepped_ns = stepped_ns

    def now_ns(self) -> int:
        """Simulated time."""
        return self._bus.now_ns

    def utc_ns(self) -> int:
        """A fixed date plus simulated time, and what somebody has set it by."""
        return self._bus.utc_of_ns(self._bus.now_ns)

    def sleep_until(self, deadline_ns: int) -> None:
        """Let the world go on; what it sends meanwhile waits on the bus."""
        self._bus.let_pass(deadline_ns)


@dataclass(slots=True)
class BusTrouble:
    """What is wrong with the service's own end of the bus."""

    queue_full: bool = False
    """Nothing can be placed in the transmit queue."""
    is_off: bool = False
    """The controller is off the bus: what is sent is lost, and nothing is heard."""
    is_gone: bool = False
    """The interface is not there: whoever uses it gets a BusError."""
    sync_delay_ns: int = 0
    """SYNC waits so long for its place on the wire."""


class World(Protocol):
    """What this bus needs of `sim_drives.world.World`, or of whatever stands before one."""

    @property
    def now_ns(self) -> int:
        """Simulated time."""
        ...

    def receive(self, frame: WorldFrame) -> None:
        """A frame of the master's."""
        ...

    def advance_to(self, time_ns: int) -> list[TimedFrame]:
        """Time passes; what the drives send."""
        ...

    def next_event_ns(self) -> int:
        """When the drives do something by themselves."""
        ...


class WorldBus:
    """A `drives.bus.Bus` whose other end is a `World`. Frames take no time on this wire.

    Things can happen at any moment, also in the middle of a wait: `at` puts them on the agenda.
    Meanwhile `hold` stops the service and not the world (a frozen process), and `pause` stops the
    service's clock with it (a machine that was suspended).
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._waiting: list[Frame] = []
        self._agenda: list[tuple[int, int, Callable[[], None]]] = []
        self._order = count()
        self._held_until_ns = 0
        self.behind_ns = 0
        """By how much the service's clock is behind the world's."""
        self.utc_stepped_ns = 0
        """By how much somebody has set the wall clock."""
        self.trouble = BusTrouble()
        self.sent: list[Frame] = []
        """Every frame of the master's that was on the wire, in order, with the world's time."""

    @property
    def now_ns(self) -> int:
        """The service's monotonic time: the world's, less what the service was suspended for."""
        return self._world.now_ns - self.behind_ns

    def utc_of_ns(self, service_ns: int) -> int:
        """What the wall clock, as it is set now, shows at a monotonic time of the service."""
        return UTC_OF_START_NS + service_ns + self.utc_stepped_ns

    # --- what happens ---------------------------------------------------------------------

    def at(self, world_ns: int, action: Callable[[], None]) -> None:
        """Do something when the world is at that time, whatever the service does then."""
        heapq.heappush(self._agenda, (world_ns, next(self._order), action))

    def hold(self, duration_ns: int) -> None:
        """Stop the service from now on; its clock goes on."""
        self._held_until_ns = self._world.now_ns + duration_ns

    def pause(self, duration_ns: int) -> None:
        """Stop the service from now on, and its clock with it."""
        self.behind_ns += duration_ns

    def report(self, frame: Frame) -> None:
        """The controller says something of itself: an error frame."""
        self._waiting.append(frame._replace(is_error=True))

    # --- as a bus -------------------------------------------------------------------------

    def open(self) -> "WorldBus":
        """As `CanBus.open`.

        Raises:
            BusError: the interface is not there.
        """
        self._must_exist()
        return self

    def send(self, frames: Sequence[Frame]) -> int:
        """All frames reach all drives now, unless there is trouble; the number dropped.

        Raises:
            BusError: the interface is not there.
        """
        self._must_exist()
        if self.trouble.queue_full:
            return len(frames)
        for frame in frames:
            self._place(frame)
        return 0

    def send_urgent(self, frames: Sequence[Frame], deadline_ns: int, clock: Clock) -> int:
        """As `send`; a full queue is tried again until the deadline."""
        del clock
        while self.trouble.queue_full and self.now_ns < deadline_ns:
            self.let_pass(min(self.now_ns + RETRY_NS, deadline_ns))
        return self.send(frames)

    def drain(self) -> list[Frame]:
        """What the drives have sent up to now."""
        self._must_exist()
        self.let_pass(self.now_ns)
        frames, self._waiting = self._waiting, []
        return frames

    def receive_until(self, deadline_ns: int, clock: Clock) -> list[Frame]:
        """Let time pass to the next frame, at most to the deadline."""
        del clock
        frames = self.drain()
        while not frames and self.now_ns < deadline_ns:
            self.let_pass(min(max(self._next_ns(), self.now_ns), deadline_ns))
            frames, self._waiting = self._waiting, []
        return frames

    def close(self) -> None:
        """Nothing to let go of."""

    def let_pass(self, until_ns: int) -> None:
        """Time passes; what the drives send meanwhile waits."""
        if until_ns < self.now_ns:
            return
        while self._agenda and self._agenda[0][0] <= self._world_until(until_ns):
            due_ns, _, action = heapq.heappop(self._agenda)
            self._advance(max(due_ns, self._world.now_ns))
            action()
        self._advance(self._world_until(until_ns))

    # --- the wire -------------------------------------------------------------------------

    def _must_exist(self) -> None:
        if self.trouble.is_gone:
            raise BusError("lockstep", "the interface is gone")

    def _place(self, frame: Frame) -> None:
        if self.trouble.sync_delay_ns and frame.can_id == SYNC_ID:
            at_ns = self._world.now_ns + self.trouble.sync_delay_ns
            self.at(at_ns, lambda: self._deliver(frame))
        elif not self.trouble.is_off:
            self._deliver(frame)

    def _deliver(self, frame: Frame) -> None:
        self.sent.append(frame._replace(time_ns=self._world.now_ns))
        self._world.receive(WorldFrame(frame.can_id, frame.data))

    def _world_until(self, until_ns: int) -> int:
        """The world's time up to which it lives before the service goes on."""
        return max(until_ns + self.behind_ns, self._held_until_ns)

    def _next_ns(self) -> int:
        event_ns = self._world.next_event_ns()
        if self._agenda:
            event_ns = min(event_ns, self._agenda[0][0])
        return event_ns - self.behind_ns

    def _advance(self, world_ns: int) -> None:
        for timed in self._world.advance_to(world_ns):
            if not self.trouble.is_off:
                stamp_ns = self.utc_of_ns(timed.time_ns - self.behind_ns)
                self._waiting.append(Frame(timed.can_id, timed.data, stamp_ns))


class MemoryNotebook:
    """Keeps the newest axis notes."""

    def __init__(self, notes: Notes) -> None:
        self.notes = notes
        self.is_full = False

    def write(self, notes: Notes) -> None:
        """As `daemon.core.notebook.NoteKeeper.write`.

        Raises:
            OSError: there is no space left.
        """
        if self.is_full:
            raise OSError(errno.ENOSPC, "no space left for the notebook")
        self.notes = notes


class Lockstep:
    """One service and one virtual machine, turned as far as a script wants."""

    def __init__(
        self,
        settings: Settings,
        world: World,
        on_record: Callable[[CycleRecord], None] | None = None,
        notes: Notes | None = None,
        bus: WorldBus | None = None,
        gateway: Gateway | None = None,
        supervisor: Supervisor | None = None,
        log: Log | None = None,
        boot_id: str = BOOT_ID,
    ) -> None:
        """Build the service; nothing turns yet.

        Args:
            settings: of the service.
            world: the virtual machine.
            on_record: told each record.
            notes: that an earlier life of the core has left.
            bus: to this world, with what is on its agenda; else a new one.
            gateway: in place of a well-behaved one.
            supervisor: told what systemd is told.
            log: told what the journal is told.
            boot_id: of this core; another one than its gateway's is not listened to.
        """
        self.notebook = MemoryNotebook(notes or Notes())
        built = build(settings, boot_id, self.notebook.notes)
        self.world = world
        self.core = built.core
        self.bus = bus or WorldBus(world)
        self.gateway = gateway or Gateway(on_record)
        grid = replace(loop_settings(settings, built, self.notebook), open_bus=self.bus.open)
        self.clock = WorldClock(self.bus)
        effect = settings.trainer.shutdown.effect
        supervision = Supervision(supervisor or _NoSupervisor(), log or _NoLog(), effect)
        self.loop = Loop(built.core, grid, self.gateway, self.clock, supervision)

    @property
    def record(self) -> CycleRecord:
        """The newest."""
        return self.gateway.records[-1]

    @property
    def records(self) -> list[CycleRecord]:
        """All since the start."""
        return self.gateway.records

    def run(self, duration_s: float) -> None:
        """Turn for so much simulated time."""
        end_ns = self.bus.now_ns + round(duration_s * NS_PER_S)
        while self.bus.now_ns < end_ns:
            self.loop.turn()

    def run_until(self, reached: Callable[[CycleRecord], bool], within_s: float) -> CycleRecord:
        """Turn until a record is as wanted.

        Raises:
            NotReachedError: none was within that simulated time.
        """
        end_ns = self.bus.now_ns + round(within_s * NS_PER_S)
        while self.bus.now_ns < end_ns:
            self.loop.turn()
            if self.records and reached(self.record):
                return self.record
        raise NotReachedError(within_s, self.record)

    def request(
        self, kind: RequestKind, wanted: ModeRequest | None = None, within_s: float = 10.0
    ) -> RequestResult:
        """Ask for something and turn until it is answered."""
        self.gateway.ask(kind, wanted)
        self.run_until(lambda _: self.gateway.outcome().outcome != Outcome.PENDING, within_s)
        return self.gateway.outcome()

    def shut_down(self, within_s: float = 10.0) -> None:
        """As on SIGTERM: stop what moves, switch off, let go of the drives."""
        end_ns = self.bus.now_ns + round(within_s * NS_PER_S)
        while not self.loop.may_end() and self.bus.now_ns < end_ns:
            self.loop.turn(shutdown=True)
        self.loop.leave()


class NotReachedError(Exception):
    """A script waited for something that did not happen."""

    def __init__(self, within_s: float, record: CycleRecord) -> None:
        super().__init__(
            f"not within {within_s:g} s; mode {record.mode.name.lower()}, {record.progress}"
        )


class _NoSupervisor:
    """Nobody watches a lock-step run."""

    def send(self, *lines: str) -> bool:
        """Nobody listens."""
        del lines
        return True


class _NoLog:
    """And nobody reads."""

    def tell(self, text: str, priority: int, fields: Mapping[str, str]) -> None:
        """Nobody reads."""
