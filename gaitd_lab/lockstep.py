"""The real loop against the virtual machine in one thread, faster than time, bit for bit the same.

Nothing of the service is replaced but its ends: bus and clock are those of simulated time, over a
link that lets time pass by itself (`sim_drives/time/conductor.py`). `Gateway`
(`lockstep_gateway.py`) stands in for the other process: it keeps every record and asks for what a
script says. What runs in between is the product.
"""

import errno
from collections.abc import Callable, Mapping
from typing import Final

from daemon.config.bundle import Settings
from daemon.core.modes.persistent_state import PersistentState
from daemon.core.runtime.build import build
from daemon.core.runtime.loop import Loop
from daemon.core.runtime.loop_settings import Log, Supervisor
from daemon.core.runtime.process import loop_settings
from daemon.core.runtime.systemd import Supervision
from daemon.ipc.record import CycleRecord, ModeRequest, Outcome, RequestKind, RequestResult
from daemon.system.clock import SimulatedClock
from drives.canopen.simulated import SimulatedBus
from gaitd_lab.lockstep_gateway import BOOT_ID, Gateway
from sim_drives.time.conductor import UTC_OF_START_NS, Conductor, DirectLink, World

NS_PER_S: Final = 1_000_000_000


class WorldBus(SimulatedBus):
    """The service's end of a bus in memory, with the seat in the script's hand.

    What a script does to the seat: `at`, `hold`, `pause`, `report`, `trouble` (see `Conductor`).
    """

    def __init__(self, world: World) -> None:
        self.conductor = Conductor(world)
        self.seat = self.conductor.join("core")
        self.link = DirectLink(self.conductor, self.seat)
        super().__init__(self.link, "lockstep")
        self.at = self.conductor.at
        self.hold, self.pause, self.report = self.seat.hold, self.seat.pause, self.seat.report
        self.utc_of_ns = self.seat.utc_of_ns
        self.trouble = self.seat.trouble
        self.sent = self.seat.sent

    @property
    def now_ns(self) -> int:
        """The service's monotonic time."""
        return self.seat.now_ns

    @property
    def behind_ns(self) -> int:
        """By how much the service's clock is behind the world's."""
        return self.seat.behind_ns

    def let_pass(self, until_ns: int) -> None:
        """Time passes; what the drives send meanwhile waits."""
        self.link.wait(until_ns, for_frame=False)


class WorldClock(SimulatedClock):
    """Simulated time in memory; a script may set its wall clock."""

    def __init__(self, bus: WorldBus) -> None:
        super().__init__(bus.link)
        self._seat = bus.seat

    @property
    def utc_stepped_ns(self) -> int:
        """By how much the wall clock was set."""
        return self._seat.utc_ahead_ns - UTC_OF_START_NS

    @utc_stepped_ns.setter
    def utc_stepped_ns(self, stepped_ns: int) -> None:
        self._seat.utc_ahead_ns = UTC_OF_START_NS + stepped_ns


class MemoryStateFile:
    """Keeps the newest axis notes."""

    def __init__(self, notes: PersistentState) -> None:
        self.notes = notes
        self.is_full = False

    def write(self, notes: PersistentState) -> None:
        """As `daemon.core.runtime.state_file.NoteKeeper.write`.

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
        notes: PersistentState | None = None,
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
        self.notebook = MemoryStateFile(notes or PersistentState())
        built = build(settings, boot_id, self.notebook.notes)
        self.world = world
        self.core = built.core
        self.bus = bus or WorldBus(world)
        self.gateway = gateway or Gateway(on_record)
        grid = loop_settings(settings, built, self.notebook, self.bus.open)
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
