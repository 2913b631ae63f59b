"""The 10 ms loop: sends SYNC, receives samples, runs a cycle, sends commands, handles lateness.

One turn, on absolute grid points:

    until the grid point  keep polling: an emergency is answered at once
    at the grid point     SYNC (and the master's heartbeat), then collect the drives' samples until
                          they are complete, or the window closes (`sync_window.py`)
    then                  one cycle (`cycle.py`), its frames sent, its record published
    at the end            the watchdog is fed, once for every cycle finished in time

Rules:
1. Missed grid points are skipped and counted, never caught up in a burst (`grid.py`).
2. A command whose cycle is over is not sent late; it counts as dropped. A command that meets a full
   queue is dropped too. Commands that stop a drive are sent however late, and are retried within
   the cycle.
3. The watchdog is fed in every mode, also during bring-up, in any state of the drives. A silent
   drive causes a verdict instead (`systemd.py`).
4. SYNC and heartbeat are sent only from here and from bring-up's steps, never from a timer.
5. While the controller is bus-off no frame is sent (`bus_link.py`).
6. An exception in a cycle is a programming error: the drives are stopped once more, then the
   process ends, and the drives' own detection is the backstop.
"""

from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from typing import Final

from gaitd_names import Cause, CyclePart, EventCode, Mode
from msgspec.structs import replace

from daemon.core import cycle
from daemon.core.period import cycles
from daemon.core.runtime import realtime
from daemon.core.runtime.bus_link import Line
from daemon.core.runtime.grid import Grid, longest_part
from daemon.core.runtime.loop_settings import ExitCode, LoopSettings
from daemon.core.runtime.sync_window import Window
from daemon.core.runtime.systemd import Supervision
from daemon.core.safety.joints import is_at_rest
from daemon.core.safety.stop_sequence import Step
from daemon.core.state import Axis, Core
from daemon.core.steps import impedance, persistence, supervisor, wanted
from daemon.core.steps.bring_up import bring_up_core
from daemon.core.tick import Tick
from daemon.ipc.cycle_timing import CycleTiming
from daemon.ipc.record import CycleRecord, GatewayState
from daemon.ipc.transport import IpcChannel
from daemon.system.clock import Clock
from drives.canopen.bus import Frame
from drives.canopen.nmt import NmtCommand, heartbeat_frame, nmt_frame
from drives.cia402.power_state import CANNOT_EXERT_TORQUE
from drives.errors import BringUpRefused, BusError

RETRY_NS: Final = 1_000_000_000
"""Time between two attempts to bring up drives that do not answer."""
SEND_MARGIN_NS: Final = 500_000
"""Commands are sent at the latest this long before the next SYNC."""
LEFT_OUT_MAX: Final = 3
"""Late wake-ups in a row after which the cycle runs anyway, so that its checks run."""
POWER_OFF_CYCLES: Final = cycles(0.5)
"""Longest time at shutdown until the drives show that they are without power."""
SETTLE_CYCLES: Final = cycles(1.5)
"""Longest time at shutdown until the leg is at rest; its pose is checked at the next start."""
STOP_WITHOUT_FEEDBACK_CYCLES: Final = cycles(0.5)


class Loop:
    """The loop of one core. `run` returns after a shutdown request, once ending is safe."""

    def __init__(
        self,
        core: Core,
        settings: LoopSettings,
        ipc: IpcChannel,
        clock: Clock,
        supervision: Supervision,
    ) -> None:
        self._core = core
        self._settings = settings
        self._ipc = ipc
        self._clock = clock
        self._supervision = supervision
        self._line = Line(
            open_bus=settings.open_bus,
            clock=clock,
            sync_overflow=settings.cycle.sync_counter,
            master_node_id=settings.master_node_id,
            bitrate_bit_per_s=settings.bitrate_bit_per_s,
        )
        self._window = Window(self._line, clock, settings.window_ns)
        self._grid = Grid(clock, settings.period_ns)
        self._sync_ns = 0
        self._sync_count = 0
        self._retry_ns = 0
        self._shutdown = False
        self._timing = CycleTiming(0, 0, 0, 0)
        self._dropped_in_a_row = 0
        self._stopped: tuple[int, ...] = ()
        """Node ids of the drives to which NMT stop has been sent."""
        self._power_off_cycles = 0
        self._written = core.persistent
        self.bug: Exception | None = None
        """The exception that ended the loop with ExitCode.BUG."""

    def run(
        self,
        end_requested: Callable[[], bool],
        reload_requested: Callable[[], bool] = lambda: False,
    ) -> ExitCode:
        """Run until a shutdown request, and then until all axes are at rest and without power.

        Args:
            end_requested: read every turn; stays True once a shutdown was requested.
            reload_requested: True once for each request to reload.
        """
        code = ExitCode.BUG
        try:
            code = self._run(end_requested, reload_requested)
        finally:
            self.leave()
            self._supervision.end(self._core, code)
        return code

    def _run(
        self, end_requested: Callable[[], bool], reload_requested: Callable[[], bool]
    ) -> ExitCode:
        try:
            while not (end_requested() and self.may_end()):
                if reload_requested():
                    self._core.report(EventCode.RELOAD_REFUSED)
                self.turn(shutdown=end_requested())
        except BringUpRefused:
            self._publish(cycle.rest(self._core, [], self._tick(self._grid.due_ns)))
            return ExitCode.REFUSED
        except Exception as bug:  # noqa: BLE001 - the one broad catch: it stops the machine
            self._supervision.begin_end()  # the watchdog is not fed from here on
            self._stop_without_feedback()
            self.bug = bug
            return ExitCode.BUG
        return ExitCode.ENDED

    # --- one turn ---------------------------------------------------------------------------

    def turn(self, *, shutdown: bool = False) -> None:
        """Run one turn, from one grid point to the next.

        Args:
            shutdown: a shutdown was requested: moving legs are stopped.

        Raises:
            BringUpRefused: a drive is not the one in the configuration files, or refuses their
                values.
        """
        self._shutdown = shutdown
        if shutdown:
            self._supervision.begin_end()
        if self._core.mode == Mode.OFF and self._clock.now_ns() >= self._retry_ns:
            self._bring_up()
            realtime.tidy()
        gateway_states: list[GatewayState] = []
        try:
            self._await_grid_point()
            self._leave_out_missed()
            gateway_states = self._receive_gateway_states()
            record = self._cycle_once(gateway_states)
        except BusError as error:
            self._lose_bus(error)
            record = cycle.rest(self._core, gateway_states, self._tick(self._clock.now_ns()))
        worked_ns = self._clock.now_ns()
        self._publish(record)
        self._line.load.count(worked_ns)
        self._timing = replace(self._timing, publish_ns=self._clock.now_ns() - worked_ns)
        self._advance_grid()

    def _leave_out_missed(self) -> None:
        """Delay a late SYNC to the next grid point, at most LEFT_OUT_MAX times in a row."""
        for _ in range(LEFT_OUT_MAX):
            missed = self._grid.skip_missed()
            if not missed:
                return
            self._count_missed(missed, CyclePart.WAKE_UP)
            self._await_grid_point()

    def _await_grid_point(self) -> None:
        """Poll the bus until the grid point, and answer alarms at once."""
        if not self._has_drives():
            self._clock.sleep_until(self._grid.due_ns)
            return
        while frames := self._line.receive_until(self._grid.due_ns):
            tick = self._tick(self._clock.now_ns())
            answer = cycle.react(self._core, frames, tick, self._grid.next_cycle)
            if answer:
                self._line.send_urgent(answer, self._grid.due_ns)
            if self._clock.now_ns() >= self._grid.due_ns:
                return  # SYNC does not wait for a continuously busy bus

    def _cycle_once(self, gateway_states: Sequence[GatewayState]) -> CycleRecord:
        begun_ns, begun_utc_ns = self._clock.now_ns(), self._clock.utc_ns()
        line, core, window = self._line, self._core, self._window
        window.begin()
        timing = replace(self._timing, lateness_ns=begun_ns - self._grid.due_ns, answer_ns=0)
        self._core.publish(line.take_notices())
        if not self._has_drives():
            self._timing = replace(timing, collect_ns=0, work_ns=0)
            return cycle.rest(core, gateway_states, self._tick(begun_ns))
        dropped_count = line.dropped_count
        frames = self._sync_and_collect(begun_ns)
        collected_ns = self._clock.now_ns()
        collect_ns = collected_ns - begun_ns
        self._timing = replace(timing, collect_ns=collect_ns, answer_ns=window.answer_ns)
        tick = self._tick(begun_ns, begun_utc_ns)
        self._sync_ns = begun_ns
        outgoing, record = cycle.step(core, frames, gateway_states, tick)
        try:
            if self._has_drives():
                self._send(outgoing)
            else:
                self._end_watch(core.axes)
        except BusError:
            # This cycle's record is published as well; the next record reports the lost bus.
            self._publish(record)
            raise
        dropped = line.dropped_count > dropped_count
        self._dropped_in_a_row = self._dropped_in_a_row + 1 if dropped else 0
        self._timing = replace(self._timing, work_ns=self._clock.now_ns() - collected_ns)
        return record

    def _has_drives(self) -> bool:
        return self._line.is_open and self._core.drives is not None

    def _sync_and_collect(self, sync_ns: int) -> list[Frame]:
        """Send SYNC (and heartbeat), and collect the drives' answers inside the window."""
        line, settings, drives = self._line, self._settings, self._core.drives
        if wanted.is_silenced(self._core) or drives is None:
            return []
        drives.feed_between(line.drain(), sync_ns)
        if line.is_off:
            return []
        outgoing = [line.sync.frame()]
        self._sync_count += 1
        if self._sync_count % settings.heartbeat_cycles == 0:
            outgoing.append(heartbeat_frame(settings.master_node_id))
        return self._window.collect(drives, outgoing, sync_ns)

    def _send(self, outgoing: Sequence[Frame]) -> None:
        """Send commands while their cycle lasts, and NMT stop where a stop has escalated to it."""
        line, core = self._line, self._core
        if wanted.is_silenced(core):
            return
        deadline_ns = self._grid.end_ns - SEND_MARGIN_NS
        if any(axis.stop is not None and axis.stop.step > Step.HOLD for axis in core.axes):
            # A stop is never too late: no newer command is under way, and the drives wait for it.
            line.send_urgent(outgoing, deadline_ns)
        elif self._clock.now_ns() > deadline_ns:
            line.drop(outgoing)
        else:
            line.send(outgoing)
        stopped = wanted.nmt_stopped(core)
        stops = [nmt_frame(NmtCommand.STOP, node) for node in stopped if node not in self._stopped]
        if not stops or line.send_urgent(stops, deadline_ns):
            self._stopped = stopped

    # --- bring-up and loss ------------------------------------------------------------------

    def _bring_up(self) -> None:
        """Run all steps of the bring-up, with a record for every 10 ms."""
        core, settings = self._core, self._settings
        self._retry_ns = self._clock.now_ns() + RETRY_NS
        try:
            self._line.open()
        except BusError as error:
            supervisor.fail_bring_up(core, Cause.BUS_DOWN, "", f"{error.channel}: {error.what}")
            return
        plans = settings.plans.of(core.single_axis)
        port = self._line.port(
            requested=core.reset_cycles_left > 0, meanwhile=self._cycle_without_drives
        )
        # Closed whatever happens meanwhile: it leaves no drive with power then (bringup.py, rule 8)
        with closing(bring_up_core(core, plans, port, settings.cycle)) as steps:
            for _ in steps:
                self._cycle_without_drives()
        self._retry_ns = self._clock.now_ns() + RETRY_NS
        self._window.reset()
        self._stopped = ()
        if core.drives is not None:
            core.drives.bus_state = self._line.bus_state
        if core.verdict.cause == Cause.BUS_DOWN:
            self._line.close()
        self._grid.jump()

    def _cycle_without_drives(self) -> None:
        """Run cycles without drives during bring-up: read gateway states and publish records.

        This also happens while a drive is silent.
        """
        late_ns = self._clock.now_ns() - self._grid.due_ns
        if late_ns < 0:
            return
        self._core.publish(self._line.take_notices())
        self._publish(
            cycle.rest(self._core, self._receive_gateway_states(), self._tick(self._grid.due_ns))
        )
        if late_ns < self._settings.period_ns:
            self._supervision.feed()
        self._grid.jump()

    def _lose_bus(self, error: BusError) -> None:
        supervisor.lose_bus(self._core, f"{error.channel}: {error.what}")
        self._retry_ns = self._clock.now_ns() + RETRY_NS
        self._line.close()

    # --- records and the grid ---------------------------------------------------------------

    def _tick(self, sync_ns: int, sync_utc_ns: int | None = None) -> Tick:
        drives = self._core.drives
        since_ns = sync_ns - self._sync_ns if self._sync_ns else self._settings.period_ns
        return Tick(
            cycle=self._grid.cycle,
            sync_ns=sync_ns,
            sync_utc_ns=self._clock.utc_ns() if sync_utc_ns is None else sync_utc_ns,
            dt_s=since_ns * 1e-9,
            timing=self._timing,
            late=self._grid.missed_in_a_row > 0,
            overruns_in_a_row=self._grid.missed_in_a_row,
            tx_dropped_in_a_row=self._dropped_in_a_row,
            tx_dropped_count=self._line.dropped_count,
            bus_load_ratio=self._settings.bus_load_ratio,
            bus=self._line.record(drives.stray_count if drives is not None else 0),
            shutdown=self._shutdown,
            time_is_simulated=self._clock.is_simulated,
        )

    def _receive_gateway_states(self) -> list[GatewayState]:
        gateway_states = self._ipc.receive()
        self._core.publish(self._ipc.take_notices())
        return gateway_states

    def _publish(self, record: CycleRecord) -> None:
        self._ipc.publish(record)
        self._write_state()
        self._supervision.report(record)

    def _advance_grid(self) -> None:
        missed = self._grid.advance()
        if missed == 0:
            self._supervision.feed()
        else:
            self._count_missed(missed, longest_part(self._timing, self._settings.window_ns))

    def _count_missed(self, missed: int, part: CyclePart) -> None:
        by_part = dict(self._timing.overrun_by_part)
        by_part[part] = by_part.get(part, 0) + missed
        self._timing = replace(
            self._timing, overrun_count=self._grid.missed_count, overrun_by_part=by_part
        )
        if missed > 1:
            self._core.report(EventCode.CYCLES_MISSED, "", missed, part)

    # --- the end ----------------------------------------------------------------------------

    def may_end(self) -> bool:
        """True if all axes are at rest and without power, by their statuswords, or after a timeout.

        Switches the power off when nothing moves any more.
        """
        core = self._core
        if core.drives is None:
            # During a reset the loop goes on: its bring-up switches off drives that hold the leg.
            return core.reset_cycles_left == 0
        if core.mode.active or core.mode == Mode.STOPPING:
            return False
        supervisor.power_off(core, self._grid.cycle)
        self._power_off_cycles += 1
        states = {axis.feedback.power_state for axis in core.axes if axis.feedback is not None}
        if states - CANNOT_EXERT_TORQUE:
            return self._power_off_cycles > POWER_OFF_CYCLES
        at_rest = all(is_at_rest(one.joint, one.limits) for one in core.axes if one.joint.known)
        if not at_rest and self._power_off_cycles <= SETTLE_CYCLES:
            return False
        self._store_poses()
        return True

    def _store_poses(self) -> None:
        persistence.store_poses(self._core, self._clock.utc_ns())
        self._write_state()

    def _write_state(self) -> None:
        if self._core.persistent is not self._written:
            self._written = self._core.persistent
            self._settings.state_file.write(self._written, self._clock.now_ns())

    def _stop_without_feedback(self) -> None:
        """Send quick stop repeatedly without reading feedback, for the duration of a stop."""
        line, drives, period_ns = self._line, self._core.drives, self._settings.period_ns
        if not line.is_open or drives is None:
            return
        stops = impedance.stop_without_feedback(self._core)
        own = heartbeat_frame(self._settings.master_node_id)
        # If the bus is lost as well, the drives stop by their own detection.
        with suppress(BusError):
            for _ in range(STOP_WITHOUT_FEEDBACK_CYCLES):
                next_ns = self._clock.now_ns() + period_ns
                frames = [line.sync.frame(), own, *drives.frames(stops)]
                line.send_urgent(frames, next_ns - SEND_MARGIN_NS)
                self._clock.sleep_until(next_ns)

    def leave(self) -> None:
        """End the watch of the drives that show no power, and close the bus.

        A drive that may have power keeps it: the missing heartbeat is what stops that drive.
        """
        core = self._core
        if self._has_drives() and not core.mode.active:
            with suppress(BusError):
                self._end_watch([axis for axis in core.axes if _shows_no_power(axis)])
        self._line.close()

    def _end_watch(self, axes: Sequence[Axis]) -> None:
        """Send NMT reset communication, so that the missing heartbeat causes no drive fault."""
        resets = [nmt_frame(NmtCommand.RESET_COMMUNICATION, axis.node_id) for axis in axes]
        self._line.send_urgent(resets, self._clock.now_ns() + self._settings.period_ns)


def _shows_no_power(axis: Axis) -> bool:
    return axis.feedback is not None and axis.feedback.power_state in CANNOT_EXERT_TORQUE
