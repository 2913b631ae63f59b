"""`gaitd ablation`: the observer with each of its options on and off, errors compared."""

from pathlib import Path
from typing import Annotated, Final

import typer
from gaitd_names import ExitCode

from gaitd.command_line import (
    JsonOption,
    errors_in_one_line,
    json_on_stdout,
)
from gaitd.terminal import progress, show
from gaitd_lab.commands.demo_file import DemoFile, demo_file

SEEDS: Final = 5
"""Each takes two minutes; ten are for a night."""


def command(
    output: Annotated[
        Path, typer.Option(metavar="DIR", help="where tables and pictures go", file_okay=False)
    ] = Path("out"),
    seeds: Annotated[int, typer.Option(min=1, help="draws of all noise")] = SEEDS,
    config: DemoFile = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="short trials, matched plant only")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Record trials on the virtual machine, replay each with every option, print the errors."""
    from gaitd_lab.studies.ablation.study import study
    from gaitd_lab.studies.report import write
    from gaitd_lab.trials import TrialError

    run = f"gaitd ablation --seeds {seeds}{' --quick' if quick else ''}"
    with errors_in_one_line(TrialError, code=ExitCode.FAILED), json_on_stdout(as_json) as tell:
        with progress() as stage:
            found = study(demo_file(config), seeds, stage, quick=quick)
        show(table.texts() for table in found.tables)
        for path in write(found, output, run):
            print(f"written      {path}")
        tell(found.tables)
