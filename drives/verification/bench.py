"""One drive in a cycle of its own: SYNC, its sample, its command, the master's heartbeat.

The cycle is that of the service: a grid of `period_ms`, a window for the answers after each SYNC,
then the two RPDOs. Frames that are left out on purpose (heartbeat, commands) are arguments of a
turn. A turn that begins more than a period late begins the grid anew: cycles are never made up for,
since a burst of targets is a jump.
"""

import struct
from contextlib import suppress
from typing import Final, NamedTuple

from drives.bringup.bringup import DriveReport, bring_up
from drives.bringup.plan import CycleSettings, DrivePlan
from drives.bringup.port import DrivePort
from drives.canopen.bus import Bus, Clock, Frame
from drives.canopen.nmt import NmtCommand, heartbeat_frame, nmt_frame
from drives.canopen.objects import Object
from drives.canopen.sdo import SDO_ANSWER_ID, upload_request, uploaded
from drives.canopen.sniffer import BusSniffer
from drives.cia402.drive import Drive, DriveGroup
from drives.cia402.power_state import POWER_STAGE_OFF, decode_statusword
from drives.cia402.units import AxisScaling, axis_scaling
from drives.errors import BusError, DrivesError, SdoAborted, SdoGarbled, SdoTimeout
from drives.signals import DriveCommand, DriveFeedback, OperationMode, PowerRequest, PowerState

WINDOW_NS: Final = 5_000_000
HEARTBEAT_CYCLES: Final = 2
LEAVE_CYCLES: Final = 20
LEAVE_MAX_NS: Final = 3_000_000_000
"""Until a drive that was told to has no power."""
URGENT_NS: Final = 20_000_000
NS_PER_MS: Final = 1_000_000
NS_PER_S: Final = 1e9


class BenchLimits(NamedTuple):
    """Bounds of what is played, rad and N·m, or m and N, at the joint."""

    velocity_max_si_per_s: float
    effort_max_si: float
    following_error_si: float
    deceleration_si_per_s2: float
    """Ramp of a quick stop, as bring-up writes it."""


class Row(NamedTuple):
    """One cycle: what was commanded, and the sample after it."""

    time_s: float
    stage: str
    power_state: str
    mode_display: int
    position_counts: int
    torque_raw: int
    target_counts: int
    torque_permille: int
    is_fresh: bool


class Recorder(BusSniffer):
    """Keeps each frame with the time at which this program sent or received it."""

    def __init__(self, clock: Clock) -> None:
        """Begin without a frame."""
        super().__init__()
        self._clock = clock
        self.frames: list[tuple[int, Frame]] = []

    def sent(self, frame: Frame) -> None:
        """As `BusSniffer.sent`."""
        self.frames.append((self._clock.now_ns(), frame))
        super().sent(frame)

    def received(self, frame: Frame, now_ns: int) -> None:
        """As `BusSniffer.received`."""
        self.frames.append((now_ns, frame))
        super().received(frame, now_ns)


class Bench:
    """The drive after its bring-up, and the cycle that moves it."""

    def __init__(
        self,
        plan: DrivePlan,
        report: DriveReport,
        limits: BenchLimits,
        cycle: CycleSettings,
        *,
        bus: Bus,
        clock: Clock,
        port: DrivePort,
    ) -> None:
        """Begin at the present time; nothing is sent."""
        self.plan, self.limits, self.cycle = plan, limits, cycle
        self.scaling: AxisScaling = axis_scaling(plan.description, report.base)
        self._bus, self._clock, self._port = bus, clock, port
        self.drive = Drive(plan.description, clock.now_ns())
        self._group = DriveGroup((self.drive,))
        self._begin_ns = self._next_ns = clock.now_ns()
        self._count = 0
        self._answers: dict[tuple[int, int], bytes] = {}
        self.stage = ""
        self.was_late = False
        """The last turn began more than a period late."""
        self.silent_count = 0
        """Turns in a row without a whole sample."""
        self.rows: list[Row] = []
        self.feedback = self.drive.peek(clock.now_ns())

    @property
    def period_s(self) -> float:
        """Time of one turn."""
        return self.cycle.period_ms * 1e-3

    @property
    def now_s(self) -> float:
        """Time since the begin."""
        return (self._clock.now_ns() - self._begin_ns) / NS_PER_S

    @property
    def counts_per_rev(self) -> int:
        """Counts of one revolution of the motor."""
        return self.plan.description.axis.transmission.counts_per_rev

    def turn(
        self,
        power: PowerRequest,
        mode: OperationMode = OperationMode.CYCLIC_SYNC_TORQUE,
        *,
        target_counts: int | None = None,
        torque_permille: int = 0,
        heartbeat: bool = True,
        commands: bool = True,
    ) -> DriveFeedback:
        """Play one cycle, and return the drive's feedback.

        Args:
            power: what is asked of the drive.
            mode: of operation.
            target_counts: target position; None: where the joint is.
            torque_permille: target torque.
            heartbeat: False: the master's is left out.
            commands: False: the RPDOs are left out.

        Raises:
            BusError: the bus is down.
        """
        period_ns = self.cycle.period_ms * NS_PER_MS
        self._next_ns += period_ns
        self.was_late = self._clock.now_ns() > self._next_ns + period_ns
        if self.was_late:
            self._next_ns = self._clock.now_ns()
        self._receive(self._next_ns, in_window=False)
        frames = [self._port.sync.frame()]
        self._count += 1
        if heartbeat and self._count % HEARTBEAT_CYCLES == 0:
            frames.append(heartbeat_frame(self.cycle.master_node_id))
        self._bus.send(frames)
        self._receive(self._next_ns + WINDOW_NS, in_window=True)
        self.feedback = self._group.end_of_window(self._count, self._clock.now_ns())[0]
        target = self.feedback.position_counts if target_counts is None else target_counts
        self.silent_count = 0 if self.feedback.fresh else self.silent_count + 1
        if commands:
            command = DriveCommand(power, mode, target, torque_permille)
            self._bus.send(self._group.frames([command]))
        self.rows.append(
            Row(
                self.now_s,
                self.stage,
                self.feedback.power_state.name,
                self.feedback.mode_display,
                self.feedback.position_counts,
                self.feedback.torque_raw,
                target,
                torque_permille,
                self.feedback.fresh,
            )
        )
        return self.feedback

    def _receive(self, until_ns: int, *, in_window: bool) -> None:
        feed = self._group.feed if in_window else self._group.feed_between
        while self._clock.now_ns() < until_ns:
            frames = self._bus.receive_until(until_ns, self._clock)
            feed(frames, self._clock.now_ns())
            for frame in frames:
                if frame.can_id == SDO_ANSWER_ID + self.drive.node_id and len(frame.data) == 8:
                    index, sub = _PLACE.unpack_from(frame.data, 1)
                    self._answers[index, sub] = frame.data

    def request(self, index: int, sub: int) -> None:
        """Ask for an object of 32 bits in the cycle; a later turn may have its answer."""
        self._answers.pop((index, sub), None)
        self._bus.send([upload_request(self.drive.node_id, index, sub)])

    def answer(self, index: int, sub: int) -> int | None:
        """The signed answer to `request`; None: there is none, or it is an abort."""
        data = uploaded(self._answers.get((index, sub), b""), index, sub, 32)
        return None if data is None else int.from_bytes(data, "little", signed=True)

    def read(self, index: int, sub: int, *, signed: bool = False) -> int | None:
        """An object by SDO, between two turns; None where the drive gives none."""
        try:
            data = self._port.read(self.drive.node_id, index, sub)
        except (SdoAborted, SdoGarbled, SdoTimeout):
            return None
        return int.from_bytes(data, "little", signed=signed)

    def power_state(self) -> PowerState | None:
        """The power state by SDO: also of a drive whose PDOs have stopped."""
        word = self.read(Object.STATUSWORD, 0)
        return None if word is None else decode_statusword(word)

    def bring_up(self) -> None:
        """Bring it up once more: NMT reset communication also ends a lost connection.

        Raises:
            BringUpRefused, DriveSilent: as `drives.bringup.bring_up`.
        """
        for _ in bring_up([self.plan], self._port, self.cycle, may_switch_off=True):
            pass
        self._next_ns = self._clock.now_ns()

    def leave(self) -> bool:
        """Take the power off, see that it is off, and let the drive forget its master.

        Returns: False if the drive did not show that its power stage is off. Then it keeps its
        watch for the master's heartbeat, which is not sent any more.
        """
        with suppress(BusError):
            for _ in range(LEAVE_CYCLES):
                self.turn(PowerRequest.DISABLE_VOLTAGE)
        end_ns = self._clock.now_ns() + LEAVE_MAX_NS
        while self._clock.now_ns() < end_ns:
            with suppress(DrivesError):
                self._port.write(self.drive.node_id, Object.CONTROLWORD, 0, b"\0\0")
            with suppress(DrivesError):
                if self.power_state() in POWER_STAGE_OFF:
                    reset = nmt_frame(NmtCommand.RESET_COMMUNICATION, self.drive.node_id)
                    self._bus.send_urgent([reset], self._clock.now_ns() + URGENT_NS, self._clock)
                    return True
            with suppress(DrivesError):
                self._port.wait(self._clock.now_ns() + URGENT_NS)
        return False


_PLACE: Final = struct.Struct("<HB")
