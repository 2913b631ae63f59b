"""The core's process: configuration, real-time settings, and the loop until a shutdown request.

Everything is built, compiled and warm before the drives are brought up; from then on there are no
imports, no compilation and no lasting allocations.
"""

import contextlib
import signal
import traceback
import uuid
from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from pathlib import Path
from types import FrameType
from typing import Final

from gaitd_names import EventCode, ExitCode

from daemon.config.bundle import Settings
from daemon.config.trainer import SIMULATED
from daemon.core.runtime import realtime
from daemon.core.runtime.build import NS_PER_MS, Built, build, ring_header
from daemon.core.runtime.loop import Loop
from daemon.core.runtime.loop_settings import LoopSettings
from daemon.core.runtime.state_file import StateFile, StateStore
from daemon.core.runtime.systemd import ERROR, INFORMATIONAL, WARNING, Supervision
from daemon.core.runtime.texts import event_text, verdict_text
from daemon.core.runtime.warm_up import warm_up
from daemon.ipc.report import Event
from daemon.ipc.transport import CoreChannel, RingHeader
from daemon.system.bus_choice import bus_of, choose_bus
from daemon.system.journal import Journal, to_stderr
from daemon.system.lock import directory_errors
from daemon.system.sd_notify import Notifier
from drives.bringup.bus_load import BusLoad, bus_load
from drives.canopen.bus import Bus
from drives.errors import BusError
from observer.jit import compiling, is_cached

PART: Final = "core"

_DAEMON: Final = Path(__file__).resolve().parents[2]


def _state_file(settings: Settings) -> StateFile:
    with directory_errors(settings.file.path, "paths.state", settings.state):
        return StateFile(settings.state)


def _ipc(settings: Settings, header: RingHeader) -> CoreChannel:
    with directory_errors(settings.file.path, "paths.runtime", settings.runtime):
        return CoreChannel(settings.runtime, header)


class ShutdownSignals:
    """Requests by SIGTERM, SIGINT and SIGHUP, which the loop reads once a turn."""

    def __init__(self) -> None:
        self._end = self._reload = self._waits = False
        signal.signal(signal.SIGTERM, self._request_end)
        signal.signal(signal.SIGINT, self._request_end)
        signal.signal(signal.SIGHUP, self._request_reload)

    def wait(self) -> None:
        """Stop exiting at once on a request to end, because drives may move from now on."""
        self._waits = True

    def end(self) -> bool:
        """True if the process was requested to end."""
        return self._end

    def reload(self) -> bool:
        """True if a reload was requested since the last call."""
        requested, self._reload = self._reload, False
        return requested

    def _request_end(self, _signal: int, _frame: FrameType | None) -> None:
        self._end = True
        if not self._waits:
            raise SystemExit(int(ExitCode.DONE))

    def _request_reload(self, _signal: int, _frame: FrameType | None) -> None:
        self._reload = True


def run_core(
    settings: Settings,
    notify_address: str | None,
    log: Journal,
    begun: Callable[[], None],
    *,
    has_watchdog: bool = False,
) -> ExitCode:
    """Run the core until it is requested to end; all axes are at rest and without power then.

    Args:
        settings: the loaded configuration; its directories exist, and the caller holds their locks.
        notify_address: notify socket of systemd.
        log: journal for the core's messages.
        begun: called when the loop begins.
        has_watchdog: systemd monitors the process by the computer's clock.

    Raises:
        ConfigError: a directory cannot be written, or is full.
    """
    signals = ShutdownSignals()
    is_simulated = settings.trainer.bus.interface == SIMULATED
    place = bus_of(settings.file)
    bus = choose_bus(place, name=PART, is_core=True, wall_clock_only=has_watchdog)
    clock = bus.clock
    boot_id = uuid.uuid4().hex
    state_file = _state_file(settings)
    built = build(settings, boot_id, state_file.persistent)
    if not is_cached(_DAEMON):
        text = "compiling what a cycle computes, once on this machine: a minute or two"
        _log(log, text, INFORMATIONAL)
    with compiling(partial(_tell_compiled, log)):
        warm_up(build(settings, boot_id, state_file.persistent))
    # In simulated time there are no deadlines, and real-time priority would block other processes.
    is_real = has_watchdog or not is_simulated
    if is_simulated:
        with contextlib.suppress(BusError):  # the loop retries if the server starts later
            bus.open_bus()
            is_real = is_real or not clock.is_simulated
    header = ring_header(settings, boot_id, clock.utc_ns(), version("gaitd"))
    core_channel = _ipc(settings, header)
    ipc = bus.in_step(core_channel, boot_id, settings.runtime / "gateway.lock")
    supervisor = Notifier(notify_address)
    supervision = Supervision(supervisor, log, settings.trainer.shutdown.effect)
    grid = loop_settings(settings, built, state_file, bus.open_bus)
    loop = Loop(built.core, grid, ipc, clock, supervision)
    cycle = settings.trainer.cycle
    refused = realtime.prepare(cycle.realtime_priority, cycle.realtime_cpus) if is_real else []
    events = [bus_load_event(settings, built), *refused]
    built.core.publish(events)
    for event in events:
        _log(log, event_text(event), WARNING if event in refused else INFORMATIONAL)
    try:
        signals.wait()
        begun()
        code = loop.run(signals.end, signals.reload)
    finally:
        core_channel.close()
        state_file.close()
        supervisor.close()
    if loop.bug is not None:
        _log(log, "".join(traceback.format_exception(loop.bug)), ERROR)
    if code == ExitCode.DRIVE:
        _log(log, verdict_text(built.core.verdict), ERROR)
    return code


def _log(log: Journal, text: str, priority: int) -> None:
    """Write a line to the log; a log that is full or closed does not affect the core."""
    if log.is_open:
        log.write(text, priority, {"GAITD_EVENT": "core"})
        return
    to_stderr(f"gaitd core: {text}")


def _tell_compiled(log: Journal, done: int, known: int) -> None:
    _log(log, f"compiled {done} of about {known} functions", INFORMATIONAL)


def bus_load_event(settings: Settings, built: Built) -> Event:
    """The computed worst-case bus load and its allowed value."""
    load = _bus_load(settings, built)
    values = load.busy_ratio, settings.trainer.bus.load_max_ratio, load.burst_s
    return Event(EventCode.BUS_LOAD, values=values)


def _bus_load(settings: Settings, built: Built) -> BusLoad:
    heartbeat_ms = settings.trainer.cycle.master_heartbeat_ms
    rate_bit_per_s = settings.trainer.bus.bitrate_bit_per_s
    return bus_load(settings.drives, built.cycle, heartbeat_ms, rate_bit_per_s)


def loop_settings(
    settings: Settings, built: Built, state_file: StateStore, open_bus: Callable[[], Bus]
) -> LoopSettings:
    """The settings of the loop from the configuration."""
    cycle, bus = settings.trainer.cycle, settings.trainer.bus
    return LoopSettings(
        plans=built.plans,
        cycle=built.cycle,
        period_ns=cycle.period_ms * NS_PER_MS,
        window_ns=int(cycle.window_ms * NS_PER_MS),
        heartbeat_cycles=max(cycle.master_heartbeat_ms // cycle.period_ms, 1),
        master_node_id=cycle.master_node_id,
        bus_load_ratio=_bus_load(settings, built).busy_ratio,
        bitrate_bit_per_s=bus.bitrate_bit_per_s,
        open_bus=open_bus,
        state_file=state_file,
    )
