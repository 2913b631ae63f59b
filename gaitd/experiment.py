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
    from analysis.experiment import Row, Run
    from gaitd_lab.excitation import EmptyMachine

SCENARIO: Final = "paper"
SHORTEST_S: Final = 1.0


class Law(Enum):
    """Friction law of the plant: `paper`, as the observer models it, or another one."""

    PAPER = "paper"
    PAPER_STICKING = "paper_sticking"
    LUGRE = "lugre"


def command(
    output: Annotated[
        Path, typer.Option(metavar="DIR", help="where the pictures go", file_okay=False)
    ] = Path("out"),
    law: Annotated[
        Law | None, typer.Option(help="friction of the plant; by default plant.toml's")
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option(min=SHORTEST_S, help="of the scenario; by default all of it"),
    ] = None,
    config: DemoFile = None,
    as_json: JsonOption = False,
) -> None:
    """Play the paper's scenario on the empty virtual machine; print the numbers, draw the figures.

    The machine's clock is simulated: half a minute takes a few seconds. Exit code 0 only if the
    scenario was played to its end.
    """
    from gaitd_lab.excitation import EmptyMachine, NotPlayedError
    from sim_drives.plant.settings import FrictionLaw

    machine = EmptyMachine(demo_file(config), None if law is None else FrictionLaw(law.value))
    longest_s = machine.longest_s(SCENARIO)
    if seconds is not None and seconds > longest_s:
        raise ConfigError(COMMAND_LINE, "--seconds", seconds, f"at most {longest_s:g}")
    with (
        errors_in_one_line(NotPlayedError, code=EXIT_FAILED),
        json_on_stdout(as_json) as write,
    ):
        output.mkdir(parents=True, exist_ok=True)
        trouble, table = _experiment(machine, seconds or longest_s, output)
        if not trouble:
            write({"law": machine.law, "seed": machine.seed, "rows": table})
    if trouble:
        raise CommandError(trouble, EXIT_FAILED)


def _experiment(
    machine: "EmptyMachine", seconds: float, output: Path
) -> "tuple[str, tuple[Row, ...]]":
    """Play the scenario, print and draw its results.

    Returns: the trouble, or an empty text; and the rows of the table.
    """
    from analysis.delay import advice, in_words
    from observer.filter.leg_model import STEP_S

    with progress() as begin:
        played = machine.play(SCENARIO, seconds, begin("the paper's scenario", seconds))
        delays = machine.delays(played.run, begin)
    duration_s = len(played.run.time_s) * STEP_S
    print(f"scenario     {SCENARIO}: {duration_s:.2f} s of {seconds:g} s, empty machine")
    print(f"plant        friction law {machine.law.value}, seed {machine.seed}")
    if machine.note:
        print(f"note         {machine.note}")
    table = _print_numbers(machine, played.run) if duration_s >= SHORTEST_S else ()
    if isinstance(delays, str):
        print(f"delay        not measured: {delays}")
    else:
        print("".join(f"delay        {in_words(one)}\n" for one in delays), end="")
        print(f"             {advice(delays)}")
    if duration_s >= SHORTEST_S:
        for picture in _draw(machine, played.run, output):
            print(f"picture      {picture}")
    return played.trouble, table


def _print_numbers(machine: "EmptyMachine", run: "Run") -> "tuple[Row, ...]":
    from analysis.experiment import marks
    from analysis.experiment_table import cells, rows
    from analysis.replay import setup_for
    from sim_drives.plant.settings import FrictionLaw

    when = marks(machine.settings.trainer.excite[SCENARIO])
    setup = setup_for(machine.settings.robot)
    matched = machine.law is not FrictionLaw.LUGRE
    table = rows(run, when, machine.frictions, setup, matched=matched)
    show((("", ("", "hip", "slide", "target"), tuple(map(cells, table))),))
    return table


def _draw(machine: "EmptyMachine", run: "Run", output: Path) -> tuple[Path, ...]:
    from analysis.accuracy import moving
    from analysis.experiment import marks
    from analysis.experiment_figures import draw_axis, draw_details

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
