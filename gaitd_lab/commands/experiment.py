"""`gaitd experiment`: the paper's experiment of Figs. 4 and 5, through virtual drives."""

from enum import Enum
from pathlib import Path
from typing import Annotated, Final

import typer
from gaitd_names import ExitCode
from gaitd_toml import COMMAND_LINE, ConfigError

from gaitd.command_line import (
    JsonOption,
    errors_in_one_line,
    json_on_stdout,
)
from gaitd.terminal import progress, show
from gaitd_lab.commands.demo_file import DemoFile, demo_file, words_of

SHORTEST_S: Final = 1.0
SEEDS: Final = 10


class Law(Enum):
    """Friction law of the plant: `paper`, as the observer models it, or another one."""

    PAPER = "paper"
    PAPER_STICKING = "paper_sticking"
    LUGRE = "lugre"


def command(
    output: Annotated[
        Path, typer.Option(metavar="DIR", help="where tables and pictures go", file_okay=False)
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
    every_law: Annotated[
        bool, typer.Option("--every-law", help="play every friction law, one after the other")
    ] = False,
    config: DemoFile = None,
    as_json: JsonOption = False,
) -> None:
    """Play the paper's scenario on the empty virtual machine; print the numbers, draw the figures.

    Numbers are median and range over the seeds; the pictures show the first one. The machine's
    clock is simulated: half a minute takes a few seconds. Exit code 0 only if every scenario was
    played to its end and every seed met every target.
    """
    from gaitd_lab.excitation import EmptyMachine, NotPlayedError
    from gaitd_lab.studies.experiment.study import PLANTS, SCENARIO, study
    from gaitd_lab.studies.report import write
    from gaitd_lab.trials import TrialError
    from sim_drives.plant.settings import FrictionLaw

    if every_law and law:
        raise ConfigError(COMMAND_LINE, "--law", law.value, "not beside --every-law")
    file = demo_file(config)
    first = EmptyMachine(file, None if law is None else FrictionLaw(law.value))
    longest_s = first.longest_s(SCENARIO)
    if seconds is not None and seconds > longest_s:
        raise ConfigError(COMMAND_LINE, "--seconds", seconds, f"at most {longest_s:g}")
    laws = list(PLANTS) if every_law else [first.law]
    chosen = " --every-law" if every_law else f" --law {first.law.value}"
    lasting = f" --seconds {seconds:g}" if seconds else ""
    run = f"gaitd experiment --seeds {seeds}{chosen}{lasting}{words_of(config)}"
    with (
        errors_in_one_line(NotPlayedError, TrialError, code=ExitCode.FAILED),
        json_on_stdout(as_json) as tell,
        progress() as begin,
    ):
        found = study(file, laws, seeds, seconds or longest_s, begin)
        show(table.texts() for table in found.tables)
        for path in write(found, output, run):
            print(f"written      {path}")
        tell({"seeds": seeds, "passed": found.passed, "tables": found.tables})
    raise typer.Exit(0 if found.passed else ExitCode.FAILED)
