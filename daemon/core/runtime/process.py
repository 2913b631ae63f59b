"""The core's process: configuration in, real-time wishes, the loop until somebody ends it.

Everything is built, compiled and warm before the drives are brought up; from then on nothing is
imported, compiled or allocated that stays.
"""

import contextlib
import signal
import sys
import traceback
import uuid
from collections.abc import Callable, Generator
from importlib.metadata import version
from types import FrameType
from typing import Final

from daemon.config.bundle import Settings
from daemon.config.trainer import SIMULATED
from daemon.core.runtime import realtime
from daemon.core.runtime.build import NS_PER_MS, Built, build, ring_header
from daemon.core.runtime.in_step import InStepSeam
from daemon.core.runtime.loop import Loop
from daemon.core.runtime.loop_settings import ExitCode, LoopSettings
from daemon.core.runtime.state_file import Notebook, NoteKeeper
from daemon.core.runtime.systemd import ERROR, INFORMATIONAL, WARNING, Supervision
from daemon.core.runtime.warm_up import warm_up
from daemon.ipc.transport import CoreSeam, RingHeader
from daemon.system.bus_choice import BusChoice, choose_bus
from daemon.system.journal import Journal
from daemon.system.lock import directory_errors, hold
from daemon.system.sd_notify import Notifier
from drives.canopen.bus import Bus
from drives.canopen.bus_load import BusLoad, bus_load
from drives.errors import BusError
from simtime.wire import Role

PART: Final = "core"


@contextlib.contextmanager
def _directories(settings: Settings) -> Generator[None]:
    """Both directories made, and ours alone, before anything in them is touched."""
    config = settings.file.path
    with (
        hold(config, "paths.runtime", settings.runtime, PART),
        hold(config, "paths.state", settings.state, PART),
    ):
        yield


def _notebook(settings: Settings) -> Notebook:
    with directory_errors(settings.file.path, "paths.state", settings.state):
        return Notebook(settings.state)


def _seam(settings: Settings, header: RingHeader) -> CoreSeam:
    with directory_errors(settings.file.path, "paths.runtime", settings.runtime):
        return CoreSeam(settings.runtime, header)


class Wishes:
    """SIGTERM, SIGINT and SIGHUP as questions that the loop asks once a turn."""

    def __init__(self) -> None:
        self._end = self._reload = self._waits = False
        signal.signal(signal.SIGTERM, self._ask_end)
        signal.signal(signal.SIGINT, self._ask_end)
        signal.signal(signal.SIGHUP, self._ask_reload)

    def wait(self) -> None:
        """From now on who asks for the end is made to wait for it: drives may move."""
        self._waits = True

    def end(self) -> bool:
        """Whether somebody has asked the process to end."""
        return self._end

    def reload(self) -> bool:
        """Whether somebody has asked to read the configuration again, since this was asked."""
        asked, self._reload = self._reload, False
        return asked

    def _ask_end(self, _signal: int, _frame: FrameType | None) -> None:
        self._end = True
        if not self._waits:
            raise SystemExit(int(ExitCode.ENDED))

    def _ask_reload(self, _signal: int, _frame: FrameType | None) -> None:
        self._reload = True


def run_core(
    settings: Settings, notify_address: str | None, log: Journal, *, has_watchdog: bool = False
) -> ExitCode:
    """Run the core until it is asked to end; both axes are at rest and without power then.

    Args:
        settings: what the files say.
        notify_address: of the supervisor.
        log: of what it does.
        has_watchdog: a supervisor watches it by the computer's clock.

    Raises:
        ConfigError: a directory cannot be written, is full, or another core holds it.
    """
    wishes = Wishes()
    with _directories(settings):
        return _run(settings, notify_address, log, wishes, has_watchdog=has_watchdog)


def _run(
    settings: Settings,
    notify_address: str | None,
    log: Journal,
    wishes: Wishes,
    *,
    has_watchdog: bool,
) -> ExitCode:
    is_simulated = settings.trainer.bus.interface == SIMULATED
    boot_id = uuid.uuid4().hex
    notebook = _notebook(settings)
    built = build(settings, boot_id, notebook.notes)
    warm_up(build(settings, boot_id, notebook.notes))
    bus = _bus(settings, has_watchdog=has_watchdog)
    clock = bus.clock
    if is_simulated:
        with contextlib.suppress(BusError):  # a server that comes later is found by the loop
            bus.open_bus()
    header = ring_header(settings, boot_id, clock.utc_ns(), version("gaitd"))
    core_seam = seam = _seam(settings, header)
    if is_simulated:
        lock = settings.runtime / "gateway.lock"
        seam = InStepSeam(core_seam, boot_id, lock, bus.is_in_step, bus.say_here)
    supervisor = Notifier(notify_address)
    supervision = Supervision(supervisor, log, settings.trainer.shutdown.effect)
    grid = loop_settings(settings, built, notebook, bus.open_bus)
    loop = Loop(built.core, grid, seam, clock, supervision)
    cycle = settings.trainer.cycle
    # In simulated time nothing is late, and a process that others wait for must let them run.
    is_real = has_watchdog or not is_simulated
    refused = realtime.prepare(cycle.realtime_priority, cycle.realtime_cpus) if is_real else []
    for line in (bus_load_line(settings, built), *refused):
        built.core.events.append(line)
        _say(log, line, WARNING if line in refused else INFORMATIONAL)
    try:
        wishes.wait()
        code = loop.run(wishes.end, wishes.reload)
    finally:
        core_seam.close()
        notebook.close()
        supervisor.close()
    if loop.bug is not None:
        _say(log, "".join(traceback.format_exception(loop.bug)), ERROR)
    if code == ExitCode.REFUSED:
        _say(log, built.core.verdict.detail, ERROR)
    return code


def _say(log: Journal, text: str, priority: int) -> None:
    """For who reads the log: one that is full or gone is no reason to run or end otherwise."""
    if log.is_open:
        log.tell(text, priority, {"GAITD_EVENT": "core"})
        return
    with contextlib.suppress(OSError):
        print(f"gaitd core: {text}", file=sys.stderr)


def bus_load_line(settings: Settings, built: Built) -> str:
    """What our frames take of the bus at worst, and what they may."""
    trainer, load = settings.trainer, _bus_load(settings, built)
    return (
        f"the bus will be busy at most {load.busy_ratio:.1%} of the time "
        f"(allowed {trainer.bus.load_max_ratio:.0%}), the frames of one cycle take at most "
        f"{load.burst_s * 1e3:.2f} ms"
    )


def _bus_load(settings: Settings, built: Built) -> BusLoad:
    heartbeat_ms = settings.trainer.cycle.master_heartbeat_ms
    rate_bit_per_s = settings.trainer.bus.bitrate_bit_per_s
    return bus_load(settings.drives, built.cycle, heartbeat_ms, rate_bit_per_s)


def _bus(settings: Settings, *, has_watchdog: bool) -> BusChoice:
    bus = settings.trainer.bus
    return choose_bus(
        bus.interface,
        settings.file.channel,
        bus.bitrate_bit_per_s,
        role=Role.IN_STEP,
        name=PART,
        wall_clock_only=has_watchdog,
    )


def loop_settings(
    settings: Settings, built: Built, notebook: NoteKeeper, open_bus: Callable[[], Bus]
) -> LoopSettings:
    """The grid and the bus, as the configuration wants them."""
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
        notebook=notebook,
    )
