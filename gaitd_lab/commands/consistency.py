"""`gaitd consistency`: the observer's standard deviations, status bits and advice, checked."""

from pathlib import Path
from typing import Annotated, Final

import typer
from gaitd_names import ExitCode

from gaitd.command_line import (
    JsonOption,
    errors_in_one_line,
    json_on_stdout,
    robot_file,
)
from gaitd.terminal import progress, show

RUNS: Final = 200
SEEDS: Final = 10


def command(
    output: Annotated[
        Path,
        typer.Option(metavar="DIR", help="where tables and picture go", file_okay=False),
    ] = Path("out"),
    robot: Annotated[
        Path | None,
        typer.Option(help="robot.toml; by default configs/robot_empty.toml", dir_okay=False),
    ] = None,
    runs: Annotated[int, typer.Option(min=2, help="of the Monte Carlo")] = RUNS,
    seeds: Annotated[int, typer.Option(min=1, help="of rest, gaps and drift")] = SEEDS,
    as_json: JsonOption = False,
) -> None:
    """Measure the observer's consistency on a plant whose noise is known; print and draw it.

    Exit code 0 only if NEES and NIS are in their chi-square bands, and errors in gaps in 3 sigma
    with every seed.
    """
    from daemon.preflight.robot import load_robot
    from gaitd_lab.studies.consistency.measures import plant_of
    from gaitd_lab.studies.consistency.study import study
    from gaitd_lab.studies.report import write

    file = robot_file(robot, "robot_empty.toml")
    plant = plant_of(load_robot(file))
    with errors_in_one_line(), json_on_stdout(as_json) as tell, progress() as stage:
        found = study(plant, runs, seeds, stage)
        print(f"robot        {file}")
        show(table.texts() for table in found.tables)
        for path in write(found, output, f"gaitd consistency --runs {runs} --seeds {seeds}"):
            print(f"written      {path}")
        tell({"robot": file, "passed": found.passed, "tables": found.tables})
    raise typer.Exit(0 if found.passed else ExitCode.FAILED)
