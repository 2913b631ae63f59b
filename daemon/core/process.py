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

from daemon.clock import MonotonicClock
from daemon.config.bundle import Settings
from daemon.core import realtime
from daemon.core.build import NS_PER_MS, Built, build, ring_header
from daemon.core.loop import Loop
from daemon.core.loop_settings import ExitCode, LoopSettings
from daemon.core.notebook import Notebook, NoteKeeper
from daemon.core.warm import warm_up
from daemon.holding import directory_errors, hold
from daemon.sd_notify import Notifier
from daemon.seam import CoreSeam, RingHeader
from drives.bus import CanBus
from drives.busload import BusLoad, bus_load

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


class EndRequest:
    """SIGTERM and SIGINT as a question that the loop asks once a turn."""

    def __init__(self) -> None:
        self._asked = False
        signal.signal(signal.SIGTERM, self._ask)
        signal.signal(signal.SIGINT, self._ask)

    def __call__(self) -> bool:
        """Whether somebody has asked the process to end."""
        return self._asked

    def _ask(self, _signal: int, _frame: FrameType | None) -> None:
        self._asked = True


def run_core(settings: Settings, notify_address: str | None) -> ExitCode:
    """Run the core until it is asked to end; both axes are at rest and without power then.

    Raises:
        ConfigError: a directory cannot be written, is full, or another core holds it.
    """
    asked_to_end = EndRequest()
    with _directories(settings):
        return _run(settings, notify_address, asked_to_end)


def _run(
    settings: Settings, notify_address: str | None, asked_to_end: Callable[[], bool]
) -> ExitCode:
    clock = MonotonicClock()
    boot_id = uuid.uuid4().hex
    notebook = _notebook(settings)
    built = build(settings, boot_id, notebook.notes)
    warm_up(build(settings, boot_id, notebook.notes))
    seam = _seam(settings, ring_header(settings, boot_id, clock.utc_ns(), version("gaitd")))
    supervisor = Notifier(notify_address)
    loop = Loop(built.core, loop_settings(settings, built, notebook), seam, clock, supervisor)
    refused = realtime.prepare(settings.trainer.cycle.realtime_priority)
    for line in (bus_load_line(settings, built), *refused):
        built.core.events.append(line)
        _say(f"gaitd core: {line}")
    try:
        code = loop.run(asked_to_end)
    finally:
        seam.close()
        notebook.close()
        supervisor.close()
    if loop.bug is not None:
        _say("".join(traceback.format_exception(loop.bug)))
    if code == ExitCode.REFUSED:
        _say(f"gaitd core: {built.core.verdict.detail}")
    return code


def _say(text: str) -> None:
    """For who reads the log: one that is full or gone is no reason to run or end otherwise."""
    with contextlib.suppress(OSError):
        print(text, file=sys.stderr)


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


def loop_settings(settings: Settings, built: Built, notebook: NoteKeeper) -> LoopSettings:
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
        open_bus=lambda: CanBus.open(bus.interface, bus.channel, bus.bitrate_bit_per_s),
        notebook=notebook,
    )
