"""`gaitd soak`: an hour of gait with the real processes, and faults drawn from a seed."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gaitd.command_line import EXIT_FAILED, CommandError, JsonOption, json_on_stdout
from gaitd.terminal import progress

if TYPE_CHECKING:
    from gaitd_lab.soak.run import Soaked

PRINT_EVERY_S = 60.0


def command(
    minutes: Annotated[float, typer.Option(min=0.2, help="of gait and trouble")] = 60.0,
    seed: Annotated[int, typer.Option(min=0, help="of all that is drawn")] = 1,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE.md", help="write a page and its figure there")
    ] = None,
    wall_clock: Annotated[
        bool, typer.Option("--wall-clock", help="by the computer's clock; on a quiet machine")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Run virtual drives, core and gateway in simulated time, with faults, until the time is over.

    Exit code 0 only if every stop was expected and none was missing, no process ended by itself,
    gait resumed after every stop, and memory kept to its budget.
    """
    from daemon.config.shipped import configs_folder
    from gaitd_lab.processes import ServiceError, Tempo
    from gaitd_lab.soak.figure import draw
    from gaitd_lab.soak.page import failures, page, plain, summary
    from gaitd_lab.soak.run import Soak
    from gaitd_lab.soak.soak_processes import soak_processes, warm_up

    configs = configs_folder("configs", "demo.toml")
    with progress(PRINT_EVERY_S) as stage:
        update = stage("starting", minutes * 60)
        update(0.0, "starting once, to compile what is not compiled yet")
        try:
            warm_up(configs)
        except ServiceError as error:
            raise CommandError(f"gaitd soak: {error}", EXIT_FAILED) from error
        with soak_processes(configs, Tempo("max", wall_clock)) as made:
            found: Soaked = Soak(made, seed, minutes * 60, update).run()
    if report is not None:
        report.parent.mkdir(parents=True, exist_ok=True)
        figure = report.with_suffix(".png")
        told_as = " ".join(("gaitd", *sys.argv[1:]))
        report.write_text(page(found, told_as, figure.name), encoding="utf-8")
        draw(found, figure)
    with json_on_stdout(as_json) as write:
        print(summary(found))
        write(plain(found))
    raise typer.Exit(EXIT_FAILED if failures(found) else 0)
