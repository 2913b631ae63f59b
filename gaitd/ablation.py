"""`gaitd ablation`: the observer with each of its options on and off, errors compared."""

import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

if TYPE_CHECKING:
    from analysis.ablation import Errors, Results, Summary

EXIT_REFUSED: Final = 2
TABLE_WIDTH: Final = 130
"""Columns. In a narrower table the numbers would be cut."""
NAME_WIDTH: Final = 32
PAIR_WIDTH: Final = 11
NIS_WIDTH: Final = 4
HEADS: Final = ("moving", "at rest", "friction", "net", "3σ patient", "OK share", "NIS")


def command(
    output: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="writes a page and its figures", file_okay=False),
    ] = None,
    config: Annotated[
        Path | None, typer.Option(help="trainer file; by default configs/demo.toml", dir_okay=False)
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="short trials, matched plant only")
    ] = False,
) -> None:
    """Record trials on the virtual machine, replay each with every option, print the errors."""
    from gaitd.places import configs_folder
    from gaitd_lab.trials import TrialError

    trainer = config or configs_folder("--config", "demo.toml") / "demo.toml"
    try:
        if output is not None:
            output.mkdir(parents=True, exist_ok=True)
        results, summaries = _results(trainer, quick)
        _print(results)
        if output is not None:
            _write(output, results, summaries, quick)
    except TrialError as error:
        print(error, file=sys.stderr)
        raise typer.Exit(1) from error
    except OSError as error:
        print(f"{error.filename}: {error.strerror}", file=sys.stderr)
        raise typer.Exit(EXIT_REFUSED) from error


def _results(config: Path, quick: bool) -> "tuple[Results, list[Summary]]":
    from analysis.ablation import Errors, ablate, summary
    from gaitd_lab.ablation_trials import planned, record

    results: dict[tuple[str, str], Errors] = {}
    summaries: list[Summary] = []
    plan = planned(config, quick=quick)
    with _progress(len(plan)) as told:
        for trial in record(plan, told):
            results |= ablate(trial)
            summaries.append(summary(trial))
    return results, summaries


def _write(output: Path, results: "Results", summaries: "list[Summary]", quick: bool) -> None:
    from analysis.ablation_page import write_page

    command = f"gaitd ablation{' --quick' if quick else ''} --output {output.name}"
    for path in write_page(output, results, summaries, command):
        print(f"written      {path}")


def _print(results: "Results") -> None:
    """Print one table for each question, with the trials and options that answer it."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    from analysis.ablation_figures import answered
    from analysis.ablation_questions import QUESTIONS, WRONG

    console = Console()
    console = Console(width=max(console.width, TABLE_WIDTH))
    console.print("rms errors and shares, hip / slide, N·m / N")
    for question in (*QUESTIONS, *WRONG):
        situations, choices = answered(question, results)
        if not situations:
            continue
        console.print(f"\n[bold]{question.title}[/]")
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
        table.add_column("", no_wrap=True, min_width=NAME_WIDTH)
        for title in HEADS:
            width = NIS_WIDTH if title == HEADS[-1] else PAIR_WIDTH
            table.add_column(title, justify="right", no_wrap=True, min_width=width)
        for situation in situations:
            table.add_row(situation)
            for choice in choices:
                table.add_row(f"  {choice}", *_cells(results[situation, choice]))
        console.print(table)


def _cells(errors: "Errors") -> tuple[str, ...]:
    from analysis.ablation_figures import three_digits
    from analysis.ablation_page import pair

    shown = (errors.patient, errors.patient_at_rest, errors.friction, errors.net)
    shares = (errors.patient_covered, errors.ok_share)
    return (*map(pair, shown), *(pair(one, 2) for one in shares), three_digits(errors.nis))


Told = Callable[[str], Callable[[float], None]]


@contextmanager
def _progress(count: int) -> Generator[Told]:
    """Progress bar over all trials, shown only on a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    with Progress(
        TextColumn("{task.description:<34}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("trials"),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as progress:
        task = progress.add_task("", total=count)
        begun = -1

        def told(title: str) -> Callable[[float], None]:
            nonlocal begun
            begun += 1
            done = begun
            progress.update(task, description=title, completed=done)
            return lambda share: progress.update(task, completed=done + share)

        yield told
