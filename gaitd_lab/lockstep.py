"""The real loop against the virtual machine in one thread, faster than real time and reproducible.

Only the ends of the service are replaced: bus and clock are those of simulated time, over a link
that advances time by itself (`sim_drives/time/conductor.py`). `Gateway` (`lockstep_gateway.py`)
replaces the gateway process: it stores every record and sends the requests of a script. Everything
in between is the production code. The same inputs give the same results bit for bit.
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
    """The service's interface to a bus in memory; a script may disturb its seat.

    Disturbances of the seat: `at`, `hold`, `pause`, `report`, `trouble` (see `Conductor`).
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
        """Monotonic time of the service."""
        return self.seat.now_ns

    @property
    def behind_ns(self) -> int:
        """Offset of the service's clock behind the world's."""
        return self.seat.behind_ns

    def let_pass(self, until_ns: int) -> None:
        """Let time pass; frames that the drives send meanwhile are queued."""
        self.link.wait(until_ns, for_frame=False)


class WorldClock(SimulatedClock):
    """Simulated time in memory; a script may set its wall clock."""

    def __init__(self, bus: WorldBus) -> None:
        super().__init__(bus.link)
        self._seat = bus.seat

    @property
    def utc_stepped_ns(self) -> int:
        """Total change of the wall clock by a script."""
        return self._seat.utc_ahead_ns - UTC_OF_START_NS

    @utc_stepped_ns.setter
    def utc_stepped_ns(self, stepped_ns: int) -> None:
        self._seat.utc_ahead_ns = UTC_OF_START_NS + stepped_ns


class MemoryStateFile:
    """Stores the newest persistent state in memory."""

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
    """One service and one virtual machine, run under the control of a script."""

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
        """Build the service; nothing runs yet.

        Args:
            settings: settings of the service.
            world: the virtual machine.
            on_record: receives each record.
            notes: persistent state of an earlier core.
            bus: a bus to this world, with its scheduled actions; else a new one.
            gateway: replaces the standard gateway.
            supervisor: receives the notifications to systemd.
            log: receives the journal messages.
            boot_id: boot id of this core, which ignores gateway states for another one.
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
        """The newest record."""
        return self.gateway.records[-1]

    @property
    def records(self) -> list[CycleRecord]:
        """All records since the start."""
        return self.gateway.records

    def run(self, duration_s: float) -> None:
        """Run for a simulated time."""
        end_ns = self.bus.now_ns + round(duration_s * NS_PER_S)
        while self.bus.now_ns < end_ns:
            self.loop.turn()

    def run_until(self, reached: Callable[[CycleRecord], bool], within_s: float) -> CycleRecord:
        """Run until a record meets a condition.

        Raises:
            NotReachedError: none did within that simulated time.
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
        """Send a request and run until it is answered."""
        self.gateway.ask(kind, wanted)
        self.run_until(lambda _: self.gateway.outcome().outcome != Outcome.PENDING, within_s)
        return self.gateway.outcome()

    def shut_down(self, within_s: float = 10.0) -> None:
        """Shut down as on SIGTERM: stop all motion, switch off, release the drives."""
        end_ns = self.bus.now_ns + round(within_s * NS_PER_S)
        while not self.loop.may_end() and self.bus.now_ns < end_ns:
            self.loop.turn(shutdown=True)
        self.loop.leave()


class NotReachedError(Exception):
    """A condition of a script was not reached."""

    def __init__(self, within_s: float, record: CycleRecord) -> None:
        super().__init__(
            f"not within {within_s:g} s; mode {record.mode.name.lower()}, {record.progress}"
        )


class _NoSupervisor:
    """A systemd notifier without a receiver."""

    def send(self, *lines: str) -> bool:
        """Do nothing."""
        del lines
        return True


class _NoLog:
    """A log without a receiver."""

    def tell(self, text: str, priority: int, fields: Mapping[str, str]) -> None:
        """Do nothing."""
