"""Virtual drives of a configuration on its bus, until a signal or for a duration: `gaitd sim`.

On a simulated bus this process provides the time (`sim_drives/time/server.py`). On any other bus,
and with `--wall-clock`, the drives use the computer's clock (`sim_drives/time/wall_clock.py`).
"""

import contextlib
import gc
import os
import signal
import sys
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from types import FrameType
from typing import Final, NamedTuple

import can
from gaitd_toml import COMMAND_LINE, ConfigError

from daemon.config.trainer import SIMULATED, TrainerFile, drive_names, real_drives
from gaitd_lab.virtual_machine import load_plant, virtual_machine
from sim_drives.build import Machine
from sim_drives.control import ControlSocket, control_socket
from sim_drives.faults.script import FaultCommandError
from sim_drives.plant.truth import TruthLog, truth_path
from sim_drives.time.bus_server import bus_server
from sim_drives.time.server import TimeServer, parse_pace
from sim_drives.time.wall_clock import (
    BusLostError,
    RealTime,
    ServedBus,
    Station,
    now_ns,
    open_bus,
)
from sim_drives.world import World
from simtime.page import PageWriter, page_path

FIFO_PRIORITY: Final = 40
"""SCHED_FIFO where permitted, as a drive's firmware is real-time, too; below the service's core."""
WARM_UP_NS: Final = 20_000_000
NS_PER_S: Final = 1_000_000_000
BUS_LOST: Final = 4


class Options(NamedTuple):
    """Options of the command line, with its names."""

    truth: Path | None
    truth_in_silence: bool
    control: Path | None
    seed: int | None
    duration_s: float | None
    pace: str | None
    wall_clock: bool
    hold: bool
    no_drives: bool
    without: tuple[str, ...]


def run(trainer: TrainerFile, options: Options, said: Callable[[str], None]) -> int:
    """Run the virtual drives until SIGTERM, SIGINT or the end of the duration.

    Args:
        trainer: the configuration.
        options: of the command line.
        said: called once, with the drives and their bus, when they are ready.

    Returns: the exit code.

    Raises:
        ConfigError: an option that does not fit the configuration or the others, or a file.
    """
    is_simulated = trainer.trainer.bus.interface == SIMULATED
    in_simulated_time = is_simulated and not options.wall_clock
    pace_ratio = _pace(options.pace, allowed=in_simulated_time)
    _refuse_foreign(trainer, options, in_simulated_time=in_simulated_time)
    with contextlib.ExitStack() as ending:
        part = _Part(trainer, options, _truth_logs(trainer, options.truth, ending))
        end = _End()
        if in_simulated_time:
            running = _simulated(part, pace_ratio, ending, said)
        else:
            with contextlib.suppress(PermissionError):
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FIFO_PRIORITY))
            running = _by_the_wall(part, ending, said, is_simulated=is_simulated)
        end.at(running, options.duration_s)
        try:
            running.run(end)
        except BusLostError as error:
            print(f"the bus is gone: {error}", file=sys.stderr)
            return BUS_LOST
        return 0


class _End:
    """End condition: SIGTERM, SIGINT, or a duration in the time of the virtual drives."""

    def __init__(self) -> None:
        self._is_wanted = False
        self._running: TimeServer | RealTime | None = None
        self._end_ns: int | None = None
        signal.signal(signal.SIGTERM, self._request)
        signal.signal(signal.SIGINT, self._request)

    def at(self, running: TimeServer | RealTime, duration_s: float | None) -> None:
        """End the run `duration_s` seconds from now; never for None."""
        self._running = running
        if duration_s is not None:
            self._end_ns = running.now_ns + round(duration_s * NS_PER_S)

    def __call__(self) -> bool:
        if self._running is None or self._end_ns is None:
            return self._is_wanted
        return self._is_wanted or self._running.now_ns >= self._end_ns

    def _request(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        self._is_wanted = True


class _Part:
    """Virtual machine of a configuration, built once the first time of its clock is known."""

    def __init__(self, trainer: TrainerFile, options: Options, logs: dict[str, TruthLog]) -> None:
        self.trainer, self.options = trainer, options
        self._logs, self._missing = logs, missing_drives(trainer, options.without)
        self._machine: Machine | None = None

    def warm_up(self) -> None:
        """Compile the plant's code with a separate virtual machine, before the run begins."""
        if not self.options.no_drives:
            virtual_machine(self.trainer, seed=self.options.seed).world.advance_to(WARM_UP_NS)
        gc.freeze()

    def build(self, start_ns: int) -> World:
        """Switch the virtual machine on; without drives, return an empty world."""
        if self.options.no_drives:
            return World((), seed=0, start_ns=start_ns)
        self._machine = virtual_machine(
            self.trainer,
            seed=self.options.seed,
            start_ns=start_ns,
            truth=self._logs,
            without=self._missing,
        )
        return self._machine.world

    @property
    def on_silence(self) -> Callable[[int], None] | None:
        """Function that logs the true state while no SYNC arrives; None if not wanted."""
        return (
            self._machine.record_truth if self._machine and self.options.truth_in_silence else None
        )

    def obey(self, line: str) -> str:
        """Run a command for the virtual drives and return its reply.

        Raises:
            FaultCommandError: the command is invalid, or there are no virtual drives.
        """
        if self._machine is None:
            raise FaultCommandError(f"{line!r}: there are no virtual drives (--no-drives)")
        return self._machine.command(line)


def _pace(text: str | None, *, allowed: bool) -> float:

    if text is not None and not allowed:
        raise ConfigError(COMMAND_LINE, "--pace", text, "only in simulated time")
    try:
        return parse_pace(text or "1")
    except ValueError as error:
        raise ConfigError(COMMAND_LINE, "--pace", text, str(error)) from error


def _refuse_foreign(trainer: TrainerFile, options: Options, *, in_simulated_time: bool) -> None:
    def refuse(option: str, value: object, allowed: str) -> None:
        if value:
            raise ConfigError(COMMAND_LINE, option, value, allowed)

    if not in_simulated_time:
        refuse("--hold", options.hold, "only in simulated time")
    if trainer.trainer.bus.interface != SIMULATED:
        refuse("--wall-clock", options.wall_clock, "only with a simulated bus")
        refuse("--no-drives", options.no_drives, "only with a simulated bus")
    if options.no_drives:
        refuse("--truth", options.truth, "nothing with --no-drives")
        refuse("--without", options.without[:1] and options.without[0], "nothing with --no-drives")


def missing_drives(trainer: TrainerFile, without: Sequence[str] = ()) -> frozenset[str]:
    """Drives that the virtual machine leaves out: real ones, and those of the command line.

    Raises:
        ConfigError: there is no such drive, or all of the configuration are real.
    """
    known, real = drive_names(trainer.trainer), real_drives(trainer.trainer)
    for name in without:
        if name not in known:
            raise ConfigError(COMMAND_LINE, "--without", name, f"one of {', '.join(known)}")
    if real == known:
        allowed = (
            f"true, or the names of the drives to play on {trainer.channel}: without it all of "
            "them are real ones, which must have no second node with their number"
        )
        declared = trainer.trainer.bus.virtual_drives
        raise ConfigError(trainer.path, "bus.virtual_drives", declared, allowed, following="")
    return frozenset((*without, *real))


def _truth_logs(
    trainer: TrainerFile, truth: Path | None, ending: contextlib.ExitStack
) -> dict[str, TruthLog]:
    """One log file for each leg."""
    logs: dict[str, TruthLog] = {}
    if truth is None:
        return logs
    legs = tuple(load_plant(trainer)[1].drives)
    for leg in legs:
        path = truth_path(truth, leg, legs)
        try:
            logs[leg] = TruthLog(path, keep_rows=False)
        except OSError as error:
            raise ConfigError(COMMAND_LINE, "--truth", path, _reason(error)) from error
        ending.callback(logs[leg].close)
    return logs


# --- in simulated time ----------------------------------------------------------------------------


def _simulated(
    part: _Part, pace_ratio: float, ending: contextlib.ExitStack, said: Callable[[str], None]
) -> TimeServer:

    channel = Path(part.trainer.channel)
    part.warm_up()
    with _channel_errors(part.trainer):
        served = ending.enter_context(bus_server(channel))
        page = PageWriter(page_path(channel))
    # Start at a whole second, so that cycles fall on the same instants of the world in each run.
    world = part.build(-(-max(now_ns(), page.left_ns) // NS_PER_S) * NS_PER_S)
    server = TimeServer(
        world,
        served,
        page,
        pace_ratio=pace_ratio,
        begins_held=part.options.hold,
        obey=part.obey,
        on_silence=part.on_silence,
        sync_count=lambda: world.sync_count,
    )
    server.control = _control(part.options.control, server.command, ending)
    said(f"{_drives(world)} on {channel}, in simulated time")
    return server


# --- by the computer's clock ----------------------------------------------------------------------


def _by_the_wall(
    part: _Part,
    ending: contextlib.ExitStack,
    said: Callable[[str], None],
    *,
    is_simulated: bool,
) -> RealTime:

    part.warm_up()
    bus = _served(part, ending) if is_simulated else _opened(part.trainer, ending)
    world = part.build(now_ns())
    listening = _control(part.options.control, part.obey, ending)
    said(f"{_drives(world)} on {bus.channel_info}")
    return RealTime(world, bus, listening, part.on_silence)


def _served(part: _Part, ending: contextlib.ExitStack) -> Station:

    channel = Path(part.trainer.channel)
    with _channel_errors(part.trainer):
        served = ending.enter_context(bus_server(channel))
        return ServedBus(served, PageWriter(page_path(channel)), part.obey)


def _opened(trainer: TrainerFile, ending: contextlib.ExitStack) -> Station:

    table = trainer.trainer.bus
    try:
        return ending.enter_context(
            open_bus(table.interface, table.channel, table.bitrate_bit_per_s)
        )
    except (OSError, ValueError, can.CanError) as error:
        allowed = f"a bus that can be opened as {table.interface} ({_reason(error)})"
        raise ConfigError(
            trainer.path, "bus.channel", table.channel, allowed, following="gaitd doctor"
        ) from error


# --- both -----------------------------------------------------------------------------------------


@contextlib.contextmanager
def _channel_errors(trainer: TrainerFile) -> Generator[None]:

    try:
        yield
    except OSError as error:
        allowed = f"a path where a socket can be made ({_reason(error)})"
        raise ConfigError(
            trainer.path, "bus.channel", trainer.channel, allowed, following=""
        ) from error


def _control(
    path: Path | None, obey: Callable[[str], str], ending: contextlib.ExitStack
) -> ControlSocket | None:

    if path is None:
        return None
    try:
        return ending.enter_context(control_socket(path, obey))
    except OSError as error:
        allowed = f"a path where a socket can be made ({_reason(error)})"
        raise ConfigError(COMMAND_LINE, "--control", path, allowed) from error


def _drives(world: World) -> str:
    return f"virtual drives {', '.join(world.drives) or 'none'}"


def _reason(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)
