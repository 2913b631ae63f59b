"""`gaitd strides`: how right the patient and the work of strides are in gait, over seeds."""

from pathlib import Path
from typing import Annotated, Final

import typer
from gaitd_names import ExitCode

from gaitd.command_line import (
    JsonOption,
    errors_in_one_line,
    json_on_stdout,
)
from gaitd.terminal import progress, show
from gaitd_lab.commands.demo_file import DemoFile, demo_file, words_of

SEEDS: Final = 10


def command(
    output: Annotated[
        Path, typer.Option(metavar="DIR", help="where table and picture go", file_okay=False)
    ] = Path("out"),
    seeds: Annotated[int, typer.Option(min=1, help="draws of all noise")] = SEEDS,
    config: DemoFile = None,
    as_json: JsonOption = False,
) -> None:
    """Walk on the virtual machine, and compare filter, smoother and strides with the truth."""
    from analysis.recording import RecordingError
    from gaitd_lab.excitation import NotPlayedError
    from gaitd_lab.studies.report import write
    from gaitd_lab.studies.strides import study
    from gaitd_lab.trials import TrialError

    with (
        errors_in_one_line(TrialError, NotPlayedError, RecordingError, code=ExitCode.FAILED),
        json_on_stdout(as_json) as tell,
        progress() as begin,
    ):
        found = study(demo_file(config), seeds, begin)
        show(table.texts() for table in found.tables)
        for path in write(found, output, f"gaitd strides --seeds {seeds}{words_of(config)}"):
            print(f"written      {path}")
        tell(found.tables)
