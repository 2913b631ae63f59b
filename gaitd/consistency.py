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
from gaitd.terminal import progress, show

RUNS: Final = 200
STEPS: Final = 400
SEEDS: Final = 10
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
    seeds: Annotated[int, typer.Option(min=1, help="of rest, gaps and drift")] = SEEDS,
    page: Annotated[
        Path | None,
        typer.Option(
            help="write the tables into this page (docs/consistency.md)",
            exists=True,
            dir_okay=False,
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Measure the observer's consistency on a plant whose noise is known; print and draw it.

    Exit code 0 only if NEES and NIS are in their chi-square bands, and errors in gaps in 3 sigma
    with every seed.
    """
    from analysis import markdown
    from analysis.consistency import drifting, gaps, monte_carlo, offsets, plant_of, still
    from analysis.consistency_figure import draw
    from analysis.consistency_text import PARTS, Draws, headline, offset_lines, tables
    from daemon.preflight.robot import load_robot

    file = robot_file(robot, "robot_empty.toml")
    plant = plant_of(load_robot(file))
    if page is not None:
        with errors_in_one_line(ValueError):  # refused before the work
            markdown.filled(page.read_text("utf-8"), dict.fromkeys(PARTS, ""))
    draws = Draws([], [], [])
    with progress() as stage:
        found = monte_carlo(plant, runs, STEPS, stage("Monte Carlo"))
        update = stage("rest, gaps and drift", float(seeds))
        for seed in range(1, seeds + 1):
            draws.rests.append(still(plant, seed=seed))
            draws.gaps.append(gaps(plant, seed=seed))
            draws.drifted.append(drifting(plant, LEVEL_RATIOS, seed))
            update(seed)
    made, jumps = tables(plant, found, draws), offsets(plant)
    picture = output / "consistency.png"
    within = all(max(gap.sigmas) <= 3.0 for lost in draws.gaps for gap in lost)
    passed = found.nees.inside and found.nis.inside and within
    with errors_in_one_line(), json_on_stdout(as_json) as write:
        print(f"robot        {file}")
        print(headline(found, runs, seeds))
        show(made)
        print(offset_lines(jumps))
        output.mkdir(parents=True, exist_ok=True)
        draw(found, draws.rests[0], draws.gaps[0], draws.drifted[0], picture)
        if page is not None:
            parts = {
                name: markdown.table(one.head, one.rows)
                for name, one in zip(PARTS, made, strict=True)
            }
            page.write_text(markdown.filled(page.read_text("utf-8"), parts), "utf-8")
        print(f"picture      {picture}")
        write(
            {
                "robot": file,
                "passed": passed,
                "monte_carlo": found,
                "patient_rms_at_rest": [rest.patient_rms for rest in draws.rests],
                "gaps": draws.gaps,
                "drift": draws.drifted,
                "offsets": jumps,
                "picture": picture,
            }
        )
    raise typer.Exit(0 if passed else EXIT_FAILED)
