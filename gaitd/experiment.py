"""`gaitd experiment`: the paper's experiment of Figs. 4 and 5, through virtual drives."""

from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from daemon.config.strict import COMMAND_LINE, ConfigError
from gaitd.command_line import (
    EXIT_FAILED,
    CommandError,
    DemoFile,
    JsonOption,
    demo_file,
    errors_in_one_line,
    json_on_stdout,
)
from gaitd.terminal import progress, show

if TYPE_CHECKING:
    from gaitd_lab.experiment_seeds import Draws

SHORTEST_S: Final = 1.0
SEEDS: Final = 10


class Law(Enum):
    """Friction law of the plant: `paper`, as the observer models it, or another one."""

    PAPER = "paper"
    PAPER_STICKING = "paper_sticking"
    LUGRE = "lugre"


def command(
    output: Annotated[
        Path, typer.Option(metavar="DIR", help="where the pictures go", file_okay=False)
    ] = Path("out"),
    seeds: Annotated[int, typer.Option(min=1, help="draws of all noise, from plant.toml's on")] = (
        SEEDS
    ),
    law: Annotated[
        Law | None, typer.Option(help="friction of the plant; by default plant.toml's")
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option(min=SHORTEST_S, help="of the scenario; by default all of it"),
    ] = None,
    page: Annotated[
        Path | None,
        typer.Option(
            help="play every law, and write the tables into this page (docs/experiment.md)",
            exists=True,
            dir_okay=False,
        ),
    ] = None,
    config: DemoFile = None,
    as_json: JsonOption = False,
) -> None:
    """Play the paper's scenario on the empty virtual machine; print the numbers, draw the figures.

    Numbers are median and range over the seeds; the pictures show the first one. The machine's
    clock is simulated: half a minute takes a few seconds. Exit code 0 only if every scenario was
    played to its end and every seed met every target.
    """
    from analysis.markdown import filled
    from gaitd_lab.excitation import EmptyMachine, NotPlayedError
    from gaitd_lab.experiment_seeds import PARTS, PLANTS, SCENARIO, draw, with_tables
    from gaitd_lab.trials import TrialError
    from sim_drives.plant.settings import FrictionLaw

    if page is not None and (law or seconds):
        raise ConfigError(COMMAND_LINE, "--page", page, "neither --law nor --seconds beside it")
    file = demo_file(config)
    first = EmptyMachine(file, None if law is None else FrictionLaw(law.value))
    longest_s = first.longest_s(SCENARIO)
    if seconds is not None and seconds > longest_s:
        raise ConfigError(COMMAND_LINE, "--seconds", seconds, f"at most {longest_s:g}")
    laws = [first.law] if page is None else list(PLANTS)
    with (
        errors_in_one_line(ValueError),
        errors_in_one_line(NotPlayedError, TrialError, code=EXIT_FAILED),
        json_on_stdout(as_json) as write,
        progress() as begin,
    ):
        output.mkdir(parents=True, exist_ok=True)
        if page is not None:
            filled(page.read_text("utf-8"), dict.fromkeys(PARTS, ""))  # refused before the work
        drawn: list[Draws] = []
        for one in laws:
            machines = [EmptyMachine(file, one, first.seed + number) for number in range(seeds)]
            drawn.append(draw(machines, seconds or longest_s, begin))
            _print_numbers(drawn[-1])
            if drawn[-1].trouble:
                raise CommandError(drawn[-1].trouble, EXIT_FAILED)
        for picture in _draw(drawn[0], output):
            print(f"picture      {picture}")
        if page is not None:
            page.write_text(with_tables(page.read_text("utf-8"), drawn, file, begin), "utf-8")
            print(f"page         {page}")
        figures = {draws.machine.law.value: draws.figures() for draws in drawn}
        judged = [one.judged for table in figures.values() for one in table if one.judged]
        passed = all(one.met for one in judged)
        write({"seeds": seeds, "passed": passed, "figures": figures})
    raise typer.Exit(0 if passed else EXIT_FAILED)


def _print_numbers(draws: "Draws") -> None:
    machine = draws.machine
    print(f"plant        friction law {machine.law.value}, {len(draws.rows)} seeds")
    if machine.note:
        print(f"note         {machine.note}")
    if draws.rows:
        cells = tuple(figure.cells() for figure in draws.figures())
        show((("", ("median (range)", "hip", "slide", "target", ""), cells),))


def _draw(draws: "Draws", output: Path) -> tuple[Path, ...]:
    from analysis.accuracy import moving
    from analysis.experiment import marks
    from analysis.experiment_figures import draw_axis, draw_details
    from gaitd_lab.experiment_seeds import SCENARIO

    machine, run = draws.machine, draws.run
    subtitle = (
        f"scenario {SCENARIO} through CAN frames, empty machine, "
        f"plant friction {machine.law.value}; grey: at rest"
    )
    hip, slide, details = (
        output / f"experiment_{name}.png" for name in ("hip", "slide", "details")
    )
    draw_axis(run, 0, subtitle, hip)
    draw_axis(run, 1, subtitle, slide)
    when = marks(machine.settings.trainer.excite[SCENARIO])
    open_gate = moving(run.true_velocity, machine.frictions)
    draw_details(run, when, open_gate, machine.frictions[1], subtitle, details)
    return hip, slide, details
