"""`gaitd consistency`: the observer's standard deviations, status bits and advice, checked."""

from pathlib import Path
from typing import Annotated, Final

import typer

from gaitd.command_line import (
    EXIT_FAILED,
    JsonOption,
    errors_in_one_line,
    json_on_stdout,
    robot_file,
)
from gaitd.terminal import progress

RUNS: Final = 200
STEPS: Final = 400
LEVEL_RATIOS: Final = (0.8, 0.9, 0.95, 0.98, 1.0, 1.02, 1.05, 1.1, 1.2)


def command(
    output: Annotated[
        Path, typer.Option(metavar="DIR", help="where the picture goes", file_okay=False)
    ] = Path("out"),
    robot: Annotated[
        Path | None,
        typer.Option(help="robot.toml; by default configs/robot_empty.toml", dir_okay=False),
    ] = None,
    runs: Annotated[int, typer.Option(min=2, help="of the Monte Carlo")] = RUNS,
    as_json: JsonOption = False,
) -> None:
    """Measure the observer's consistency on a plant whose noise is known; print and draw it.

    Exit code 0 only if NEES and NIS are in their chi-square bands, and errors in gaps in 3 sigma.
    """
    from analysis.consistency import drifting, gaps, monte_carlo, offsets, plant_of, still
    from analysis.consistency_figure import draw
    from analysis.consistency_text import lines
    from daemon.config.settings import Robot
    from daemon.config.strict import load_toml

    file = robot_file(robot, "robot_empty.toml")
    plant = plant_of(load_toml(file, Robot))
    with progress() as stage:
        found = monte_carlo(plant, runs, STEPS, stage("Monte Carlo"))
    rest, lost, drifted = still(plant), gaps(plant), drifting(plant, LEVEL_RATIOS)
    jumps = offsets(plant)
    picture = output / "consistency.png"
    passed = found.nees.inside and found.nis.inside and all(max(gap.sigmas) <= 3.0 for gap in lost)
    with errors_in_one_line(), json_on_stdout(as_json) as write:
        print(f"robot        {file}")
        print("\n".join(lines(plant, found, runs, rest, lost, drifted, jumps)))
        output.mkdir(parents=True, exist_ok=True)
        draw(found, rest, lost, drifted, picture)
        print(f"picture      {picture}")
        write(
            {
                "robot": file,
                "passed": passed,
                "monte_carlo": found,
                "patient_rms_at_rest": rest.patient_rms,
                "gaps": lost,
                "drift": drifted,
                "offsets": jumps,
                "picture": picture,
            }
        )
    raise typer.Exit(0 if passed else EXIT_FAILED)
