"""`gaitd matrix`: every fault in every mode on both axes, in lock-step, checked and documented."""

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from gaitd_names import ExitCode

from gaitd.command_line import JsonOption, full_name, json_text
from gaitd.completion import axes
from gaitd.terminal import progress, show
from gaitd_lab.commands.demo_file import DemoFile, demo_file, words_of

if TYPE_CHECKING:
    from gaitd_lab.fault_matrix.cell import Cell, CellResult
    from gaitd_lab.studies.report import Table

JOBS_MAX = 2
CELLS = "fault_matrix_cells"
"""Name of a page of some cells."""


def command(
    config: DemoFile = None,
    fault: Annotated[
        list[str] | None, typer.Option(help="only this row, or a pair as A+B@3; more than once")
    ] = None,
    mode: Annotated[list[str] | None, typer.Option(help="only this column; more than once")] = None,
    axis: Annotated[
        str, typer.Option(help="only this axis, for example right/hip", autocompletion=axes)
    ] = "",
    seed: Annotated[int, typer.Option(min=0, help="of all that is random")] = 1,
    output: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="write the page there; of some cells, or of two legs, a list of them",
            file_okay=False,
        ),
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="processes at the same time")] = JOBS_MAX,
    json: JsonOption = False,
) -> None:
    """Run the cells of the fault matrix. Exit code 0 only if each keeps every law, else 1."""
    from daemon.config.trainer import drive_names, load_trainer
    from gaitd_lab.fault_matrix.evaluation import broken
    from gaitd_lab.fault_matrix.page import command as again
    from gaitd_lab.fault_matrix.page import page
    from gaitd_lab.fault_matrix.run import cells
    from gaitd_lab.studies.report import Report, write

    file = demo_file(config)
    drives = drive_names(load_trainer(file).trainer)
    chosen = full_name(axis, drives, "--axis") if axis else ""
    _check_names(fault or [], mode or [], chosen, drives)
    wanted = cells(fault or (), mode or (), (chosen,) if chosen else drives)
    results = _run(file, wanted, seed, min(jobs, os.cpu_count() or 1))
    bad = [(one, reasons) for one in results if (reasons := broken(one))]
    if json:
        _print_json(results, config)
    elif len(results) < SHOWN_MAX:
        show((_table(results).texts(),))
    if output is not None and wanted == cells():
        _write(page(results), output)
    elif output is not None:
        options = (("--fault", fault), ("--mode", mode), ("--axis", [chosen] if chosen else []))
        words = [word for name, values in options for one in values or () for word in (name, one)]
        run = " ".join(("gaitd matrix", *words, "--seed", str(seed)))
        report = Report(CELLS, "Cells of the fault matrix", (_table(results),), {})
        print(*write(report, output, run + words_of(config)), sep="\n", file=sys.stderr)
    for one, reasons in bad:
        print(f"{again(one)}{words_of(config)}: {'; '.join(reasons)}", file=sys.stderr)
    print(f"{len(results)} cells, {len(bad)} of them break a law", file=sys.stderr)
    raise typer.Exit(ExitCode.FAILED if bad else 0)


SHOWN_MAX = 200
"""Largest number of cells printed; more cells need a page (--output)."""


def _check_names(faults: list[str], modes: list[str], axis: str, drives: tuple[str, ...]) -> None:
    from gaitd_lab.fault_matrix.faults import FAULTS
    from gaitd_lab.fault_matrix.modes import COLUMNS
    from gaitd_lab.fault_matrix.pairs import parts_of

    def single(name: str) -> str:
        """One fault of a pair to look up; a pair is known if both of its faults are."""
        try:
            pair = parts_of(name)
        except KeyError:
            return name
        return pair.first.name if pair is not None else name

    for option, names, known in (
        ("--fault", [single(name) for name in faults], tuple(FAULTS)),
        ("--mode", modes, tuple(COLUMNS)),
        ("--axis", [axis] if axis else [], drives),
    ):
        for name in names:
            if name not in known:
                raise typer.BadParameter(
                    f"{name!r}, known are: {', '.join(known)}", param_hint=option
                )


def _run(trainer: Path, wanted: "list[Cell]", seed: int, jobs: int) -> "list[CellResult]":
    """Run the cells and return them in the order of `wanted`, with progress on stderr."""
    from gaitd_lab.fault_matrix.run import run

    results: list[CellResult] = []
    with progress(line_every=0.0) as stage:
        update = stage("cells", len(wanted))
        for part in run(trainer, wanted, seed, jobs):
            results += part
            update(len(results), f"{len(results)} of {len(wanted)} cells")
    place = {cell: number for number, cell in enumerate(wanted)}
    return sorted(results, key=lambda one: place[one.cell])


def _print_json(results: "list[CellResult]", config: Path | None) -> None:
    import msgspec

    from gaitd_lab.fault_matrix.evaluation import broken
    from gaitd_lab.fault_matrix.page import command as again

    lines = [
        {
            **msgspec.to_builtins(one),
            "broken": broken(one),
            "command": again(one) + words_of(config),
        }
        for one in results
    ]
    print(json_text(lines))


def _table(results: "list[CellResult]") -> "Table":
    from gaitd_lab.fault_matrix.page import entry
    from gaitd_lab.studies.report import Table

    rows = [(one.fault, one.mode, one.axis or "all", entry([one])) for one in results]
    return Table("Fault matrix", ("fault", "mode", "axis", "what it did"), rows)


def _write(page: str, output: Path) -> None:
    from gaitd_lab.fault_matrix.page import PAGE

    output.mkdir(parents=True, exist_ok=True)
    (output / PAGE).write_text(page, encoding="utf-8")
    print(output / PAGE, file=sys.stderr)
