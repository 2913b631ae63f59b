"""`gaitd sim`: the virtual drives of a configuration on its bus."""

from pathlib import Path
from typing import Annotated

import typer

from gaitd.command_line import ConfigFile


def command(
    config: ConfigFile,
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
    from daemon.config.trainer import load_trainer
    from gaitd_lab.simulation import Options, run

    options = Options(
        truth=truth,
        truth_in_silence=truth_in_silence,
        control=control,
        seed=seed,
        duration_s=duration_s,
        pace=pace,
        wall_clock=wall_clock,
        hold=hold,
        no_drives=no_drives,
        without=tuple(without or ()),
    )
    raise typer.Exit(run(load_trainer(config), options))
