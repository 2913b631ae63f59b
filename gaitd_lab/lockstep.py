"""The real loop against the virtual machine in one thread, faster than real time and reproducible.

Only the ends of the service are replaced: bus and clock are those of simulated time, over a link
that advances time by itself (`sim_drives/time/conductor.py`). `Gateway` (`lockstep_gateway.py`)
replaces the gateway process: it stores every record and sends the requests of a script. Everything
in between is the production code. The same inputs give the same results bit for bit.
"""

import errno
from collections.abc import Callable, Mapping
from typing import Final, Self

from gaitd_names import Mode, Outcome, RequestKind, Stage

from daemon.config.bundle import Settings
from daemon.core.modes.persistent_state import PersistentState
from daemon.core.runtime.build import build
from daemon.core.runtime.loop import Loop
from daemon.core.runtime.process import loop_settings
from daemon.core.runtime.systemd import Supervision
from daemon.ipc.record import CycleRecord, ModeRequest, RequestResult
from gaitd_lab.lockstep_gateway import BOOT_ID, Gateway
from gaitd_lab.virtual_machine import virtual_machine
from sim_drives.build import Machine
from sim_drives.plant.truth import TruthLog
from sim_drives.time.conductor import UTC_OF_START_NS, Conductor, DirectLink, World
from simtime.bus import SimulatedBus
from simtime.clock import SimulatedClock

NS_PER_S: Final = 1_000_000_000
SETTLE_S: Final = 0.2
"""Time in mode ready before a session continues."""
BEGIN_S: Final = 30.0
"""Time limit of the approach to an exercise."""


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
        return self.seat.now_ns()

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

    def __init__(self, persistent: PersistentState) -> None:
        self.persistent = persistent
        self.is_full = False

    def write(self, persistent: PersistentState, now_ns: int) -> None:  # noqa: ARG002
        """As `daemon.core.runtime.state_file.StateStore.write`.

        Raises:
            OSError: there is no space left.
        """
        if self.is_full:
            raise OSError(errno.ENOSPC, "no space left for the notebook")
        self.persistent = persistent


class LockstepSession:
    """One service and its virtual machine from power-on, run under the control of a script.

    session = LockstepSession(load(configs / "demo.toml")).walk(cadence_hz=0.25)
    session.command("emcy right/hip 0.3 0x2310")
    stopped = session.run_until(lambda record: not record.mode.active, within_s=0.1)
    """

    def __init__(
        self,
        settings: Settings,
        machine: Machine | None = None,
        *,
        world: World | None = None,
        persistent: PersistentState | None = None,
        gateway: Gateway | None = None,
        boot_id: str = BOOT_ID,
    ) -> None:
        """Build machine and service; nothing runs yet.

        Args:
            settings: settings of the service.
            machine: the virtual machine; else that of the settings' plant.toml, with its truth.
            world: replaces the machine's own on the bus: one that alters frames on their way.
            persistent: persistent state of an earlier core.
            gateway: replaces the standard gateway.
            boot_id: boot id of this core, which ignores gateway states for another one.
        """
        self.settings = settings
        self.truth = TruthLog(None)
        """True state of the first leg at each SYNC, if the session has built the machine."""
        self.machine = machine or virtual_machine(
            settings.file, truth={settings.legs[0].name: self.truth}
        )
        self.bus = WorldBus(world or self.machine.world)
        self._start(persistent or PersistentState(), gateway or Gateway(), boot_id)

    def _start(self, persistent: PersistentState, gateway: Gateway, boot_id: str) -> None:
        self.state_file = MemoryStateFile(persistent)
        self.gateway = gateway
        self.clock = WorldClock(self.bus)
        built = build(self.settings, boot_id, persistent)
        self.core = built.core
        grid = loop_settings(self.settings, built, self.state_file, self.bus.open)
        effect = self.settings.trainer.shutdown.effect
        supervision = Supervision(_NoSupervisor(), _NoLog(), effect)
        self.loop = Loop(built.core, grid, gateway, self.clock, supervision)

    def restart_core(self) -> None:
        """Start a new core and gateway on the same bus, with the state file of the last core."""
        self._start(self.state_file.persistent, Gateway(), BOOT_ID)

    @property
    def world_ns(self) -> int:
        """The world's time, independent of the service's clock."""
        return self.machine.world.now_ns

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

    def until(self, mode: Mode, within_s: float = 10.0) -> None:
        """Run until the service is in a mode.

        Raises:
            NotReachedError: the mode was not reached in that time.
        """
        self.run_until(lambda record: record.mode == mode, within_s)

    def command(self, line: str) -> None:
        """Inject or clear a fault, or start a programme of the patient: see `Machine.command`."""
        self.machine.command(line)

    def request(
        self, kind: RequestKind, wanted: ModeRequest | None = None, within_s: float = 10.0
    ) -> RequestResult:
        """Send a request and run until it is answered."""
        self.gateway.request(kind, wanted)
        self.run_until(lambda _: self.gateway.outcome().outcome != Outcome.PENDING, within_s)
        return self.gateway.outcome()

    def execute(self, kind: RequestKind, wanted: ModeRequest | None = None) -> None:
        """Send a request that must be accepted.

        Raises:
            RefusedError: it was refused.
        """
        answer = self.request(kind, wanted)
        if answer.outcome != Outcome.DONE:
            raise RefusedError(f"{kind} was refused: {answer.refusal}")

    # --- reaching a mode; each raises NotReachedError or RefusedError ---------------------------

    def until_ready(self) -> Self:
        """Run from power-on until the service is ready."""
        self.until(Mode.READY)
        self.run(SETTLE_S)
        return self

    def enable(self) -> Self:
        """Run from power-on to mode hold, unless the service holds already."""
        if not self.records or self.record.mode != Mode.HOLD:
            self.until_ready().execute(RequestKind.ENABLE)
        return self

    def walk(self, *, cadence_hz: float = 0.25, duration_s: float = 0.0) -> Self:
        """Run to the first stride of a gait, and on for a time."""
        gait = ModeRequest(Mode.GAIT, cadence_hz=cadence_hz, amplitude_ratio=1.0, duration_s=600.0)
        self.enable().execute(RequestKind.MODE, gait)
        self.run_until(lambda record: record.gait_phase >= 0, BEGIN_S)
        self.run(duration_s)
        return self

    def excite(self, scenario: str, duration_s: float) -> Self:
        """Run to the first cycle of an [excite] scenario of this duration."""
        wanted = ModeRequest(Mode.EXCITE, duration_s=duration_s, scenario=scenario)
        self.enable().execute(RequestKind.MODE, wanted)
        self.run_until(lambda record: record.stage is Stage.PLAYING, BEGIN_S)
        return self

    def shut_down(self, within_s: float = 10.0) -> None:
        """Shut down as on SIGTERM: stop all motion, switch off, release the drives."""
        end_ns = self.bus.now_ns + round(within_s * NS_PER_S)
        while not self.loop.may_end() and self.bus.now_ns < end_ns:
            self.loop.turn(shutdown=True)
        self.loop.leave()


class RefusedError(Exception):
    """The service refused a request of a script; the message gives the reason."""


class NotReachedError(Exception):
    """A condition of a script was not reached."""

    def __init__(self, within_s: float, record: CycleRecord) -> None:
        super().__init__(f"not within {within_s:g} s; mode {record.mode}, {record.progress}")


class _NoSupervisor:
    """A systemd notifier without a receiver."""

    def send(self, *lines: str) -> bool:
        """Do nothing."""
        del lines
        return True


class _NoLog:
    """A log without a receiver."""

    def write(self, text: str, priority: int, fields: Mapping[str, str]) -> None:
        """Do nothing."""
