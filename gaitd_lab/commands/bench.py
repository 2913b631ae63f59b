"""`gaitd bench`: the project's benchmarks in one run, as one table with ratios and budgets."""

from typing import Annotated

import typer

from daemon.config.shipped import configs_folder
from gaitd.command_line import JsonOption, json_on_stdout

PLAIN_WIDTH = 120
"""Columns of tables that are written to a file."""


def command(
    as_json: JsonOption = False,
    seconds: Annotated[
        float, typer.Option(min=2, max=25, help="of real time for each measurement on the bus")
    ] = 20.0,
    only: Annotated[
        list[str] | None, typer.Option(help="one of the benchmarks, by name; may be repeated")
    ] = None,
) -> None:
    """Run the benchmarks, and print one table of their figures and ratios.

    Names: observer_step, cycle, lateness, lateness_under_load, replay, service, peers, display.
    """
    from rich.console import Console

    from gaitd_lab.benchmark.catalogue import measurements
    from gaitd_lab.benchmark.figures import table

    console = Console(stderr=as_json)
    if not console.is_terminal:
        console = Console(stderr=as_json, width=PLAIN_WIDTH)
    configs = configs_folder("configs", "demo.toml")
    measures = measurements(configs, seconds)
    results = {}
    for name in only or measures:
        if name not in measures:
            raise typer.BadParameter(f"{name!r} is none of {', '.join(measures)}")
        with console.status(f"measuring: {name}"):
            results[name] = measures[name]()
    if not as_json:
        console.print(table([figure for figures in results.values() for figure in figures]))
    with json_on_stdout(as_json) as write:
        write(results)
