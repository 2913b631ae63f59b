"""`gaitd patients`: what happens to patients who work, and to machines that must stop."""

import os
from pathlib import Path
from typing import Annotated, Final

import typer

from gaitd.command_line import DemoFile, JsonOption, demo_file, errors_in_one_line, json_on_stdout
from gaitd.terminal import progress, show

SEEDS: Final = 10
DURATION_S: Final = 180.0
JOBS: Final = 2
PART: Final = "patients"


def command(
    seeds: Annotated[int, typer.Option(min=1, help="draws of all noise")] = SEEDS,
    duration_s: Annotated[
        float, typer.Option("--seconds", min=5.0, help="of gait in each cell")
    ] = DURATION_S,
    jobs: Annotated[int, typer.Option(min=1, help="processes at the same time")] = JOBS,
    page: Annotated[
        Path | None,
        typer.Option(
            help="write the table into this page (docs/patients.md)", exists=True, dir_okay=False
        ),
    ] = None,
    config: DemoFile = None,
    as_json: JsonOption = False,
) -> None:
    """Play patients who work, at each cadence and friction, and machines that must stop."""
    from analysis import markdown
    from gaitd_lab.working_patients import HEAD, cells, run, table

    with (
        errors_in_one_line(ValueError),
        json_on_stdout(as_json) as write,
        progress(line_every=10.0) as begin,
    ):
        if page is not None:
            markdown.filled(page.read_text("utf-8"), {PART: ""})  # refused before the work
        wanted = cells(seeds)
        update = begin("cells", float(len(wanted)))
        played = {}
        jobs = min(jobs, os.cpu_count() or 1)
        for done, one in enumerate(run(demo_file(config), wanted, duration_s, jobs), 1):
            played[one.cell] = one
            update(float(done), f"{done} of {len(wanted)} cells")
        results = [played[cell] for cell in wanted]
        rows = table(results)
        said = f"Medians of {seeds} seeds, {duration_s:g} s of gait each"
        show(((said, HEAD, tuple(rows)),))
        if page is not None:
            part = f"{said}:\n\n{markdown.table(HEAD, rows)}"
            page.write_text(markdown.filled(page.read_text("utf-8"), {PART: part}), "utf-8")
            print(f"page         {page}")
        write(results)
