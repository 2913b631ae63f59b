"""`gaitd sim`: the virtual drives of a configuration on its bus.

On a simulated bus this process provides the time (`sim_drives/time/server.py`). On any other bus,
and with `--wall-clock`, the drives use the computer's clock (`sim_drives/time/wall_clock.py`).
"""

import contextlib
import gc
import os
import signal
import sys
from collections.abc import Callable, Generator
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from daemon.config.trainer import TrainerFile
    from sim_drives.build import Machine
    from sim_drives.control import ControlSocket
    from sim_drives.plant.truth import TruthLog
    from sim_drives.time.server import TimeServer
    from sim_drives.time.wall_clock import RealTime, Station
    from sim_drives.world import EmptyWorld, World

FIFO_PRIORITY = 40
"""SCHED_FIFO where permitted, as a drive's firmware is real-time, too; below the service's core."""
WARM_UP_NS = 20_000_000
NS_PER_S = 1_000_000_000
BUS_LOST = 4
COMMAND_LINE = "command line"
AXES = ("hip", "slide")


def command(
    config: Annotated[Path, typer.Option("--config", help="trainer file", dir_okay=False)],
    truth: Annotated[
        Path | None, typer.Option("--truth", help="CSV of what really happens, a row a SYNC")
    ] = None,
    truth_in_silence: Annotated[
        bool,
        typer.Option("--truth-in-silence", help="and a row every 10 ms while no SYNC comes"),
    ] = False,
    control: Annotated[
        Path | None,
        typer.Option("--control", help="Unix socket for faults and patient; send it `help`"),
    ] = None,
    seed: Annotated[int | None, typer.Option("--seed", help="in place of plant.toml's")] = None,
    duration_s: Annotated[
        float | None, typer.Option("--duration", help="end by itself after so many seconds of its")
    ] = None,
    pace: Annotated[
        str | None,
        typer.Option(
            "--pace", help="of simulated time: a multiple of real time, or max  [default: 1]"
        ),
    ] = None,
    wall_clock: Annotated[
        bool, typer.Option("--wall-clock", help="a simulated bus by the computer's clock")
    ] = False,
    hold: Annotated[
        bool, typer.Option("--hold", help="simulated time stands until a hand lets it go on")
    ] = False,
    no_drives: Annotated[
        bool, typer.Option("--no-drives", help="bus and time alone: the drives are of others")
    ] = False,
    without: Annotated[
        list[str] | None,
        typer.Option(
            "--without", help="a drive, such as right/slide, that another program stands in for"
        ),
    ] = None,
) -> None:
    """Run the virtual drives of a configuration until SIGTERM or Ctrl-C."""
    from daemon.config.trainer import SIMULATED, load_trainer

    trainer = load_trainer(config)
    is_simulated = trainer.trainer.bus.interface == SIMULATED
    in_simulated_time = is_simulated and not wall_clock
    pace_ratio = _pace(pace, allowed=in_simulated_time)
    if hold and not in_simulated_time:
        from daemon.config.strict import ConfigError

        raise ConfigError(COMMAND_LINE, "--hold", hold, "only in simulated time")
    _refuse_foreign(trainer, wall_clock=wall_clock, no_drives=no_drives, truth=truth)
    missing = _missing(trainer, without or [], no_drives=no_drives)
    with contextlib.ExitStack() as ending:
        logs = _truth_logs(trainer, truth, ending)
        part = _Part(
            trainer,
            seed,
            logs,
            missing,
            with_drives=not no_drives,
            with_truth=truth_in_silence,
        )
        end = _End()
        if in_simulated_time:
            running = _simulated(part, pace_ratio, control, ending, begins_held=hold)
        else:
            with contextlib.suppress(PermissionError):
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FIFO_PRIORITY))
            running = _by_the_wall(part, control, ending, is_simulated=is_simulated)
        end.at(running, duration_s)
        raise typer.Exit(_run(running, end))


class _End:
    """End condition: SIGTERM, SIGINT, or a duration in the time of the virtual drives."""

    def __init__(self) -> None:
        self._asked = False
        self._running: TimeServer | RealTime | None = None
        self._end_ns: int | None = None
        signal.signal(signal.SIGTERM, self._ask)
        signal.signal(signal.SIGINT, self._ask)

    def at(self, running: "TimeServer | RealTime", duration_s: float | None) -> None:
        """End the run `duration_s` seconds from now; never for None."""
        self._running = running
        if duration_s is not None:
            self._end_ns = running.now_ns + round(duration_s * NS_PER_S)

    def __call__(self) -> bool:
        if self._running is None or self._end_ns is None:
            return self._asked
        return self._asked or self._running.now_ns >= self._end_ns

    def _ask(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        self._asked = True


class _Part:
    """Virtual machine of a configuration, built once the first time of its clock is known."""

    def __init__(
        self,
        trainer: "TrainerFile",
        seed: int | None,
        logs: "dict[str, TruthLog]",
        missing: frozenset[str],
        *,
        with_drives: bool,
        with_truth: bool,
    ) -> None:
        self.trainer = trainer
        self._seed, self._logs, self._missing = seed, logs, missing
        self._with_drives, self._with_truth = with_drives, with_truth
        self._machine: Machine | None = None

    def warm_up(self) -> None:
        """Compile the plant's code with a separate virtual machine, before the run begins."""
        from gaitd_lab.virtual_machine import virtual_machine

        if self._with_drives:
            virtual_machine(self.trainer, seed=self._seed).world.advance_to(WARM_UP_NS)
        gc.freeze()

    def build(self, start_ns: int) -> "World | EmptyWorld":
        """Switch the virtual machine on; without drives, return an empty world."""
        from gaitd_lab.virtual_machine import virtual_machine
        from sim_drives.world import EmptyWorld

        if not self._with_drives:
            return EmptyWorld(start_ns)
        self._machine = virtual_machine(
            self.trainer,
            seed=self._seed,
            start_ns=start_ns,
            truth=self._logs,
            without=self._missing,
        )
        return self._machine.world

    @property
    def on_silence(self) -> Callable[[int], None] | None:
        """Function that logs the true state while no SYNC arrives; None if not wanted."""
        return self._machine.note_truth if self._machine and self._with_truth else None

    def obey(self, line: str) -> str:
        """Run a command for the virtual drives and return its reply.

        Raises:
            FaultCommandError: the command is invalid, or there are no virtual drives.
        """
        from sim_drives.faults.script import FaultCommandError

        if self._machine is None:
            raise FaultCommandError(f"{line!r}: there are no virtual drives (--no-drives)")
        return self._machine.command(line)


def _pace(text: str | None, *, allowed: bool) -> float:
    from daemon.config.strict import ConfigError
    from sim_drives.time.server import parse_pace

    if text is not None and not allowed:
        raise ConfigError(COMMAND_LINE, "--pace", text, "only in simulated time")
    try:
        return parse_pace(text or "1")
    except ValueError as error:
        raise ConfigError(COMMAND_LINE, "--pace", text, str(error)) from error


def _refuse_foreign(
    trainer: "TrainerFile", *, wall_clock: bool, no_drives: bool, truth: Path | None
) -> None:
    from daemon.config.strict import ConfigError
    from daemon.config.trainer import SIMULATED

    if wall_clock and trainer.trainer.bus.interface != SIMULATED:
        raise ConfigError(COMMAND_LINE, "--wall-clock", True, "only with a simulated bus")
    if no_drives and trainer.trainer.bus.interface != SIMULATED:
        raise ConfigError(COMMAND_LINE, "--no-drives", True, "only with a simulated bus")
    if no_drives and truth is not None:
        raise ConfigError(COMMAND_LINE, "--truth", truth, "nothing with --no-drives")


def _missing(trainer: "TrainerFile", names: list[str], *, no_drives: bool) -> frozenset[str]:
    """Drives that the virtual machine leaves out, checked against the plant's drives."""
    from daemon.config.strict import ConfigError
    from gaitd_lab.virtual_machine import load_plant

    if names and no_drives:
        raise ConfigError(COMMAND_LINE, "--without", names[0], "nothing with --no-drives")
    legs = load_plant(trainer)[1].drives if names else ()
    known = [f"{leg}/{axis}" for leg in legs for axis in AXES]
    for name in names:
        if name not in known:
            raise ConfigError(COMMAND_LINE, "--without", name, f"one of {', '.join(known)}")
    return frozenset(names)


def _truth_logs(
    trainer: "TrainerFile", truth: Path | None, ending: contextlib.ExitStack
) -> "dict[str, TruthLog]":
    """One log file for each leg; with two legs, `_right` and `_left` become part of the name."""
    from daemon.config.strict import ConfigError
    from gaitd_lab.virtual_machine import load_plant
    from sim_drives.plant.truth import TruthLog

    logs: dict[str, TruthLog] = {}
    if truth is None:
        return logs
    legs = tuple(load_plant(trainer)[1].drives)
    for leg in legs:
        path = truth if len(legs) == 1 else truth.with_stem(f"{truth.stem}_{leg}")
        try:
            logs[leg] = TruthLog(path, keep_rows=False)
        except OSError as error:
            raise ConfigError(COMMAND_LINE, "--truth", path, _reason(error)) from error
        ending.callback(logs[leg].close)
    return logs


# --- in simulated time ----------------------------------------------------------------------------


def _simulated(
    part: _Part,
    pace_ratio: float,
    control: Path | None,
    ending: contextlib.ExitStack,
    *,
    begins_held: bool,
) -> "TimeServer":
    from sim_drives.time.bus_server import bus_server
    from sim_drives.time.server import TimeServer
    from sim_drives.time.wall_clock import now_ns
    from simtime.page import PageWriter, page_path

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
        begins_held=begins_held,
        obey=part.obey,
        on_silence=part.on_silence,
        sync_count=lambda: world.sync_count,
    )
    server.control = _control(control, server.command, ending)
    print(f"{_drives(world)} on {channel}, in simulated time", flush=True)
    return server


# --- by the computer's clock ----------------------------------------------------------------------


def _by_the_wall(
    part: _Part, control: Path | None, ending: contextlib.ExitStack, *, is_simulated: bool
) -> "RealTime":
    from sim_drives.time.wall_clock import RealTime, now_ns

    part.warm_up()
    bus = _served(part, ending) if is_simulated else _opened(part.trainer, ending)
    world = part.build(now_ns())
    listening = _control(control, part.obey, ending)
    print(f"{_drives(world)} on {bus.channel_info}", flush=True)
    return RealTime(world, bus, listening, part.on_silence)


def _served(part: _Part, ending: contextlib.ExitStack) -> "Station":
    from sim_drives.time.bus_server import bus_server
    from sim_drives.time.wall_clock import ServedBus
    from simtime.page import PageWriter, page_path

    channel = Path(part.trainer.channel)
    with _channel_errors(part.trainer):
        served = ending.enter_context(bus_server(channel))
        return ServedBus(served, PageWriter(page_path(channel)), part.obey)


def _opened(trainer: "TrainerFile", ending: contextlib.ExitStack) -> "Station":
    import can

    from daemon.config.strict import ConfigError
    from sim_drives.time.wall_clock import open_bus

    table = trainer.trainer.bus
    try:
        return ending.enter_context(
            open_bus(table.interface, table.channel, table.bitrate_bit_per_s)
        )
    except (OSError, ValueError, can.CanError) as error:
        allowed = f"a bus that can be opened as {table.interface} ({_reason(error)})"
        raise ConfigError(trainer.path, "bus.channel", table.channel, allowed) from error


# --- both -----------------------------------------------------------------------------------------


@contextlib.contextmanager
def _channel_errors(trainer: "TrainerFile") -> Generator[None]:
    from daemon.config.strict import ConfigError

    try:
        yield
    except OSError as error:
        allowed = f"a path where a socket can be made ({_reason(error)})"
        raise ConfigError(trainer.path, "bus.channel", trainer.channel, allowed) from error


def _control(
    path: Path | None, obey: Callable[[str], str], ending: contextlib.ExitStack
) -> "ControlSocket | None":
    from daemon.config.strict import ConfigError
    from sim_drives.control import control_socket

    if path is None:
        return None
    try:
        return ending.enter_context(control_socket(path, obey))
    except OSError as error:
        allowed = f"a path where a socket can be made ({_reason(error)})"
        raise ConfigError(COMMAND_LINE, "--control", path, allowed) from error


def _run(running: "TimeServer | RealTime", end: _End) -> int:
    from sim_drives.time.wall_clock import BusLostError

    try:
        running.run(end)
    except BusLostError as error:
        print(f"the bus is gone: {error}", file=sys.stderr)
        return BUS_LOST
    return 0


def _drives(world: "World | EmptyWorld") -> str:
    return f"virtual drives {', '.join(world.drives) or 'none'}"


def _reason(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)
