"""`gaitd sim`: the virtual drives of a configuration, in real time on its bus."""

import contextlib
import gc
import os
import signal
import sys
import time
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    import can

    from daemon.config.trainer import TrainerFile
    from sim_drives.build import Machine
    from sim_drives.control import ControlSocket
    from sim_drives.realtime import RealTime
    from sim_drives.truth import TruthLog

FIFO_PRIORITY = 40
"""A drive's firmware is real-time, too; below the service's core, and only where it is granted."""
GIL_SWITCH_S = 0.0005
"""Of the threads that serve the loopback bus; Python's own 5 ms is half a cycle."""
WARM_UP_NS = 20_000_000
BUS_LOST = 4
COMMAND_LINE = "command line"


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
        float | None, typer.Option("--duration", help="end by itself after so many seconds")
    ] = None,
) -> None:
    """The virtual drives of that configuration, until SIGTERM or Ctrl-C."""
    from daemon.config.trainer import load_trainer
    from sim_drives.realtime import RealTime

    end = _End(duration_s)
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FIFO_PRIORITY))
    trainer = load_trainer(config)
    with contextlib.ExitStack() as ending:
        logs = _truth_logs(trainer, truth, ending)
        bus = _bus(trainer, ending)
        machine = _machine(trainer, seed, logs)
        listening = _control(control, machine, ending)
        on_silence = machine.note_truth if truth_in_silence else None
        raise typer.Exit(
            _run(bus, machine, RealTime(machine.world, bus, listening, on_silence), end)
        )


class _End:
    """Whether it is over: by signal, or by time."""

    def __init__(self, duration_s: float | None) -> None:
        self._asked = False
        self._at_s = None if duration_s is None else time.monotonic() + duration_s
        signal.signal(signal.SIGTERM, self._ask)
        signal.signal(signal.SIGINT, self._ask)

    def __call__(self) -> bool:
        return self._asked or (self._at_s is not None and time.monotonic() >= self._at_s)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        self._asked = True


def _truth_logs(
    trainer: "TrainerFile", truth: Path | None, ending: contextlib.ExitStack
) -> "dict[str, TruthLog]":
    """One file for each leg; with two legs, `_right` and `_left` become part of the name."""
    from daemon.config.strict import ConfigError
    from gaitd.virtual_machine import load_plant
    from sim_drives.truth import TruthLog

    legs = tuple(load_plant(trainer)[1].drives)
    logs: dict[str, TruthLog] = {}
    if truth is None:
        return logs
    for leg in legs:
        path = truth if len(legs) == 1 else truth.with_stem(f"{truth.stem}_{leg}")
        try:
            logs[leg] = TruthLog(path, keep_rows=False)
        except OSError as error:
            raise ConfigError(COMMAND_LINE, "--truth", path, _reason(error)) from error
        ending.callback(logs[leg].close)
    return logs


def _bus(trainer: "TrainerFile", ending: contextlib.ExitStack) -> "can.BusABC":
    import can

    from daemon.config.strict import ConfigError
    from sim_drives.realtime import open_bus

    table = trainer.trainer.bus
    try:
        opened = open_bus(table.interface, table.channel, table.bitrate_bit_per_s)
        return ending.enter_context(opened)
    except (OSError, ValueError, can.CanError) as error:
        allowed = f"a bus that can be opened as {table.interface} ({_reason(error)})"
        raise ConfigError(trainer.path, "bus.channel", table.channel, allowed) from error


def _machine(trainer: "TrainerFile", seed: int | None, logs: "dict[str, TruthLog]") -> "Machine":
    from gaitd.virtual_machine import virtual_machine
    from sim_drives.realtime import now_ns

    virtual_machine(trainer, seed=seed).world.advance_to(WARM_UP_NS)  # compiles, on no clock
    gc.freeze()
    return virtual_machine(trainer, seed=seed, start_ns=now_ns(), truth=logs)


def _control(
    path: Path | None, machine: "Machine", ending: contextlib.ExitStack
) -> "ControlSocket | None":
    from daemon.config.strict import ConfigError
    from sim_drives.control import control_socket

    if path is None:
        return None
    try:
        return ending.enter_context(control_socket(path, machine.command))
    except OSError as error:
        allowed = f"a path where a socket can be made ({_reason(error)})"
        raise ConfigError(COMMAND_LINE, "--control", path, allowed) from error


def _run(bus: "can.BusABC", machine: "Machine", drives: "RealTime", end: _End) -> int:
    from sim_drives.realtime import BusLostError

    print(f"virtual drives {', '.join(machine.world.drives)} on {bus.channel_info}", flush=True)
    sys.setswitchinterval(GIL_SWITCH_S)
    try:
        drives.run(end)
    except BusLostError as error:
        print(f"the bus is gone: {error}", file=sys.stderr)
        return BUS_LOST
    return 0


def _reason(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)
