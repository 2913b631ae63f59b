"""The 10 ms loop: sends SYNC, receives samples, runs a cycle, sends commands, handles lateness.

One turn, on absolute grid points:

    until the grid point  keep polling: an emergency is answered at once
    at the grid point     SYNC (and the master's heartbeat), then collect the drives' samples until
                          they are complete, or the window closes (`sync_window.py`)
    then                  one cycle (`cycle.py`), its frames sent (`commands.py`), its record
                          published
    at the end            the watchdog is fed, once for every cycle finished in time

Rules:
1. Missed grid points are skipped and counted, never caught up in a burst (`grid.py`).
2. The watchdog is fed in every mode, also during bring-up, in any state of the drives. A silent
   drive causes a verdict instead (`systemd.py`).
3. SYNC and heartbeat are sent only from here and from bring-up's steps, never from a timer.
4. An exception in a cycle is a programming error: the drives are stopped once more, then the
   process ends, and the drives' own detection is the backstop.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Final

from gaitd_names import CyclePart, EventCode, ExitCode, Mode
from msgspec.structs import replace

from daemon.core import cycle
from daemon.core.runtime import realtime
from daemon.core.runtime.bring_up import BringUp
from daemon.core.runtime.bus_link import Line
from daemon.core.runtime.commands import Commands
from daemon.core.runtime.grid import Grid, count_missed, longest_part
from daemon.core.runtime.loop_settings import LoopSettings
from daemon.core.runtime.shutdown import (
    PowerOff,
    end_watch,
    may_exert_torque,
    shows_no_power,
    stop_without_feedback,
)
from daemon.core.runtime.sync_window import NO_ANSWERS, Window
from daemon.core.runtime.systemd import Supervision
from daemon.core.safety.stop_sequence import Step
from daemon.core.state import Core
from daemon.core.steps import persistence, supervisor, wanted
from daemon.core.tick import Tick
from daemon.ipc.cycle_timing import CycleTiming
from daemon.ipc.record import CycleRecord, GatewayState
from daemon.ipc.transport import IpcChannel
from daemon.system.clock import Clock
from drives.errors import BringUpRefused, BusError

LEFT_OUT_MAX: Final = 3
"""Late wake-ups in a row after which the cycle runs anyway, so that its checks run."""


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
        self._window = Window(
            self._line,
            clock,
            settings.window_ns,
            settings.heartbeat_cycles,
            settings.master_node_id,
        )
        self._bring_up = BringUp(core, settings.plans, settings.cycle, self._line, clock)
        self._commands = Commands(self._line, clock)
        self._grid = Grid(clock, settings.period_ns)
        self._power_off = PowerOff()
        self._sync_ns = 0
        self._shutdown = False
        self._timing = CycleTiming(0, 0, 0, 0)
        self._dropped_in_a_row = 0
        self._written = core.persistent
        self.bug: Exception | None = None
        """The exception that ended the loop with ExitCode.UNAVAILABLE."""

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
        code = ExitCode.UNAVAILABLE
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
            return ExitCode.DRIVE
        except Exception as bug:  # noqa: BLE001 - the one broad catch: it stops the machine
            self.bug = bug  # first: what follows may fail, too
            self._supervision.begin_end()  # the watchdog is not fed from here on
            stop_without_feedback(self._core, self._line, self._clock, self._settings)
            self._write_state()
            return ExitCode.UNAVAILABLE
        return ExitCode.DONE

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
        if self._bring_up.is_due:
            if self._bring_up.run(meanwhile=self._cycle_without_drives):
                self._window.reset()
                self._commands.reset()
                self._grid.jump()
            realtime.tidy()
        gateway_states: list[GatewayState] = []
        try:
            self._await_grid_point()
            self._leave_out_missed()
            gateway_states = self._receive_gateway_states()
            record = self._cycle_once(gateway_states)
        except BusError as error:
            self._bring_up.lose_bus(error)
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
        line, core, drives = self._line, self._core, self._core.drives
        lateness_ns = begun_ns - self._grid.due_ns
        core.publish(line.take_notices())
        if drives is None or not line.is_open:
            self._timing = replace(
                self._timing, lateness_ns=lateness_ns, collect_ns=0, answer_ns=0, work_ns=0
            )
            return cycle.rest(core, gateway_states, self._tick(begun_ns))
        dropped_count = line.dropped_count
        is_silenced = wanted.is_silenced(core)
        answers = NO_ANSWERS if is_silenced else self._window.collect(drives, begun_ns)
        collected_ns = self._clock.now_ns()
        self._timing = replace(
            self._timing,
            lateness_ns=lateness_ns,
            collect_ns=collected_ns - begun_ns,
            answer_ns=answers.answer_ns,
        )
        tick = self._tick(begun_ns, begun_utc_ns)
        self._sync_ns = begun_ns
        outgoing, record = cycle.step(core, answers.frames, gateway_states, tick)
        try:
            if not self._has_drives():
                end_watch(line, core.axes, self._clock.now_ns() + self._settings.period_ns)
            elif not wanted.is_silenced(core):
                self._commands.send(
                    outgoing,
                    wanted.nmt_stopped(core),
                    self._grid.end_ns,
                    urgent=any(axis.stop and axis.stop.step > Step.HOLD for axis in core.axes),
                )
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
        self._timing = count_missed(self._timing, missed, part)
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
        if not self._power_off.is_over(core.axes):
            return False
        if not may_exert_torque(core.axes):
            persistence.store_poses(core, self._clock.utc_ns())
            self._write_state()
        return True

    def _write_state(self) -> None:
        if self._core.persistent is not self._written:
            self._written = self._core.persistent
            self._settings.state_file.write(self._written, self._clock.now_ns())

    def leave(self) -> None:
        """End the watch of the drives that show no power, and close the bus.

        A drive that may have power keeps it: the missing heartbeat is what stops that drive.
        """
        core = self._core
        if self._has_drives() and not core.mode.active:
            unpowered = [axis for axis in core.axes if shows_no_power(axis)]
            with suppress(BusError):
                end_watch(self._line, unpowered, self._clock.now_ns() + self._settings.period_ns)
        self._line.close()
