"""`gaitd ablation`: the observer with each of its options on and off, errors compared."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gaitd.command_line import (
    EXIT_FAILED,
    DemoFile,
    JsonOption,
    demo_file,
    errors_in_one_line,
    json_on_stdout,
)
from gaitd.terminal import progress, show

if TYPE_CHECKING:
    from analysis.ablation import Results, Summary


def command(
    output: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="writes a page and its figures", file_okay=False),
    ] = None,
    config: DemoFile = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="short trials, matched plant only")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Record trials on the virtual machine, replay each with every option, print the errors."""
    from analysis.ablation_page import tables, write_page
    from gaitd_lab.trials import TrialError

    with errors_in_one_line(TrialError, code=EXIT_FAILED), json_on_stdout(as_json) as write:
        if output is not None:
            output.mkdir(parents=True, exist_ok=True)
        results, summaries = _results(demo_file(config), quick)
        print("rms errors and shares, hip / slide, N·m / N")
        show(tables(results))
        if output is not None:
            run = f"gaitd ablation{' --quick' if quick else ''} --output {output.name}"
            for path in write_page(output, results, summaries, run):
                print(f"written      {path}")
        errors = [
            {"situation": situation, "choice": choice, "errors": found}
            for (situation, choice), found in results.items()
        ]
        write({"trials": summaries, "results": errors})


def _results(config: Path, quick: bool) -> "tuple[Results, list[Summary]]":
    from analysis.ablation import Errors, ablate, summary
    from gaitd_lab.ablation_trials import planned, record

    results: dict[tuple[str, str], Errors] = {}
    summaries: list[Summary] = []
    with progress() as stage:
        for trial in record(planned(config, quick=quick), stage):
            results |= ablate(trial)
            summaries.append(summary(trial))
    return results, summaries
