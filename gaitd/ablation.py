"""`gaitd ablation`: the observer with each of its options on and off, errors compared."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

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
    from analysis.ablation import Ablation, Results, Summary
    from gaitd_lab.trials import Progress

SEEDS: Final = 5
"""Each takes two minutes; ten are for a night."""


def command(
    output: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="writes a page and its figures", file_okay=False),
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, help="draws of all noise")] = SEEDS,
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
        found = _ablation(demo_file(config), seeds, quick)
        print(f"rms errors and shares, hip / slide, N·m / N, medians of {seeds} seeds")
        show(tables(found.medians))
        if output is not None:
            words = " --quick" if quick else ""
            run = f"gaitd ablation --seeds {seeds}{words} --output {output.name}"
            for path in write_page(output, found, run):
                print(f"written      {path}")
        errors = [
            {"situation": situation, "choice": choice, "errors": median}
            for (situation, choice), median in found.medians.items()
        ]
        write({"seeds": seeds, "trials": found.summaries, "results": errors})


def _ablation(config: Path, seeds: int, quick: bool) -> "Ablation":
    from analysis.ablation import over_seeds

    with progress() as stage:
        return over_seeds(
            [
                _draw(config, seed, quick, lambda title, seed=seed: stage(f"{seed}: {title}"))
                for seed in range(1, seeds + 1)
            ]
        )


def _draw(
    config: Path, seed: int, quick: bool, stage: "Callable[[str], Progress]"
) -> "tuple[Results, list[Summary]]":
    from analysis.ablation import Errors, ablate, summary
    from gaitd_lab.ablation_trials import planned, record

    results: dict[tuple[str, str], Errors] = {}
    summaries: list[Summary] = []
    for trial in record(planned(config, quick=quick, seed=seed), stage, seed):
        results |= ablate(trial)
        summaries.append(summary(trial))
    return results, summaries
