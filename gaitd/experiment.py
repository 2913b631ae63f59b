"""`gaitd experiment`: the paper's experiment of Figs. 4 and 5, through virtual drives."""

import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

if TYPE_CHECKING:
    from analysis.delay import Delay
    from analysis.experiment import Row, Run
    from gaitd_lab.excitation import EmptyMachine

SCENARIO: Final = "paper"
DELAY: Final = "delay"
SHORTEST_S: Final = 1.0
PLAIN_WIDTH: Final = 120
"""Columns of a table that is written to a file."""


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
    config: Annotated[
        Path | None, typer.Option(help="trainer file; by default configs/demo.toml", dir_okay=False)
    ] = None,
) -> None:
    """Play the paper's scenario on the empty virtual machine; print the numbers, draw the figures.

    The machine's clock is simulated: half a minute takes a few seconds. Exit code 0 only if the
    scenario was played to its end.
    """
    from daemon.config.strict import ConfigError
    from gaitd.places import configs_folder
    from gaitd_lab.excitation import EmptyMachine, NotPlayedError
    from sim_drives.plant.settings import FrictionLaw

    trainer = config or configs_folder("--config", "demo.toml") / "demo.toml"
    machine = EmptyMachine(trainer, None if law is None else FrictionLaw(law.value))
    longest_s = machine.longest_s(SCENARIO)
    if seconds is not None and seconds > longest_s:
        raise ConfigError("command line", "--seconds", seconds, f"at most {longest_s:g}")
    try:
        output.mkdir(parents=True, exist_ok=True)
        trouble = _experiment(machine, seconds or longest_s, output)
    except NotPlayedError as error:
        print(error, file=sys.stderr)
        raise typer.Exit(1) from error
    except OSError as error:
        print(f"{error.filename}: {error.strerror}", file=sys.stderr)
        raise typer.Exit(2) from error
    if trouble:
        print(trouble, file=sys.stderr)
        raise typer.Exit(1)


def _experiment(machine: "EmptyMachine", seconds: float, output: Path) -> str:
    """Play the scenario, print and draw its results; return the trouble, or an empty text."""
    with _progress() as told:
        played = machine.play(SCENARIO, seconds, told("the paper's scenario", seconds))
        delays = _delays(machine, played.run, told)
    run = played.run
    duration_s = len(run.time_s) * machine.step_s
    print(f"scenario     {SCENARIO}: {duration_s:.2f} s of {seconds:g} s, empty machine")
    print(f"plant        friction law {machine.law.value}, seed {machine.seed}")
    if machine.note:
        print(f"note         {machine.note}")
    if duration_s >= SHORTEST_S:
        _print_numbers(machine, run)
    _print_delays(delays)
    if duration_s >= SHORTEST_S:
        for picture in _draw(machine, run, output):
            print(f"picture      {picture}")
    return played.trouble


def _delays(machine: "EmptyMachine", run: "Run", told: "Told") -> "tuple[Delay, Delay] | str":
    """Measure the delays in the delay scenario, or in `run` if there is none; else why not."""
    from analysis.delay import measure
    from analysis.recording import Recording, RecordingError
    from gaitd_lab.excitation import NotPlayedError

    try:
        if DELAY in machine.settings.trainer.excite:
            seconds = machine.longest_s(DELAY)
            run = machine.play(DELAY, seconds, told("quick efforts, for the delay", seconds)).run
        recording = Recording("the scenario", run.time_s, run.measured, run.exerted)
        return measure(recording, machine.settings.robot)
    except (NotPlayedError, RecordingError) as error:
        return str(error)


def _print_numbers(machine: "EmptyMachine", run: "Run") -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    from analysis.experiment import marks
    from analysis.experiment_table import rows
    from analysis.replay import setup_for
    from sim_drives.plant.settings import FrictionLaw

    console = Console()
    if not console.is_terminal:
        console = Console(width=PLAIN_WIDTH)
    table = Table(box=box.SIMPLE_HEAD)
    for title in ("", "hip", "slide", "target"):
        table.add_column(title, justify="left" if title in {"", "target"} else "right")
    when = marks(machine.settings.trainer.excite[SCENARIO])
    setup = setup_for(machine.settings.robot)
    matched = machine.law is not FrictionLaw.LUGRE
    for row in rows(run, when, machine.frictions, setup, matched=matched):
        target = row.target
        if row.met is not None:
            target = f"[green]{target}, met[/]" if row.met else f"[yellow]{target}, missed[/]"
        table.add_row(*_cells(row), target)
    console.print(table)


def _cells(row: "Row") -> tuple[str, str, str]:
    def number(value: float | None, unit: str) -> str:
        return "–" if value is None else f"{value:.3g} {unit}".rstrip()

    one_axis = (not row.hip_unit or not row.slide_unit) and (row.hip is None or row.slide is None)
    hip, slide = number(row.hip, row.hip_unit), number(row.slide, row.slide_unit)
    if one_axis:
        hip = "" if not row.hip_unit and row.slide_unit else hip
        slide = "" if not row.slide_unit else slide
    return row.name, hip, slide


def _print_delays(delays: "tuple[Delay, Delay] | str") -> None:
    from analysis.delay import advice, in_words

    if isinstance(delays, str):
        print(f"delay        not measured: {delays}")
        return
    for one in delays:
        print(f"delay        {in_words(one)}")
    print(f"             {advice(delays)}")


def _draw(machine: "EmptyMachine", run: "Run", output: Path) -> tuple[Path, ...]:
    from analysis.experiment import marks, moving
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
    draw_details(run, when, moving(run, machine.frictions), machine.frictions[1], subtitle, details)
    return hip, slide, details


Told = Callable[[str, float], Callable[[float], None]]


@contextmanager
def _progress() -> Generator[Told]:
    """Progress bar for each scenario, in simulated seconds, shown only on a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    seconds = TextColumn("{task.completed:4.1f} of {task.total:g} s simulated")
    with Progress(
        TextColumn("{task.description:<30}"),
        BarColumn(),
        seconds,
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as progress:

        def told(title: str, total_s: float) -> Callable[[float], None]:
            task = progress.add_task(title, total=total_s)
            return lambda done_s: progress.update(task, completed=done_s)

        yield told
