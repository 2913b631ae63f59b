"""`gaitd patients`: what happens to patients who work, and to machines that must stop."""

import os
from pathlib import Path
from typing import Annotated, Final

import typer
from gaitd_toml import COMMAND_LINE, ConfigError

from gaitd.command_line import JsonOption, errors_in_one_line, json_on_stdout
from gaitd.terminal import progress, show
from gaitd_lab.commands.demo_file import DemoFile, demo_file, words_of

SEEDS: Final = 10
DURATION_S: Final = 180.0
JOBS: Final = 2


def command(
    output: Annotated[
        Path, typer.Option(metavar="DIR", help="where the table goes", file_okay=False)
    ] = Path("out"),
    seeds: Annotated[int, typer.Option(min=1, help="draws of all noise")] = SEEDS,
    duration_s: Annotated[
        float, typer.Option("--seconds", min=5.0, help="of gait in each cell")
    ] = DURATION_S,
    patient: Annotated[
        list[str] | None, typer.Option(help="only this patient or control; more than once")
    ] = None,
    cadence_hz: Annotated[
        list[float] | None,
        typer.Option("--cadence", help="only this one, Hz, of patients; more than once"),
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="processes at the same time")] = JOBS,
    config: DemoFile = None,
    as_json: JsonOption = False,
) -> None:
    """Play patients who work, at each cadence and friction, and machines that must stop.

    Ctrl-C ends the work after the cells that are being played, and shows what is known.
    """
    from gaitd_lab.studies.report import Report, write
    from gaitd_lab.studies.working_patients import CADENCES_HZ, NAMES, cells, run, table

    for name in patient or ():
        if name not in NAMES:
            raise ConfigError(COMMAND_LINE, "--patient", name, f"one of {', '.join(NAMES)}")

    with (
        errors_in_one_line(),
        json_on_stdout(as_json) as tell,
        progress(line_every=10.0) as begin,
    ):
        wanted = cells(seeds, patient or NAMES, cadence_hz or CADENCES_HZ)
        update = begin("cells", float(len(wanted)))
        played = {}
        jobs = min(jobs, os.cpu_count() or 1)
        title = f"Medians, {duration_s:g} s of gait each, seeds: {seeds}"
        try:
            for done, one in enumerate(run(demo_file(config), wanted, duration_s, jobs), 1):
                played[one[0].cell] = one
                update(float(done), f"{done} of {len(wanted)} cells")
        except KeyboardInterrupt:
            title += f", ended after {len(played)} of {len(wanted)} cells"
        results = [leg for cell in wanted for leg in played.get(cell, ())]
        found = Report("patients", "Patients who work", (table(title, results),), {})
        show(one.texts() for one in found.tables)
        only = "".join(
            [
                f" --patient '{name}'" if " " in name else f" --patient {name}"
                for name in patient or ()
            ]
            + [f" --cadence {one:g}" for one in cadence_hz or ()]
        )
        lasting = f" --seeds {seeds} --seconds {duration_s:g}"
        for path in write(found, output, f"gaitd patients{lasting}{only}{words_of(config)}"):
            print(f"written      {path}")
        tell(results)
