"""`gaitd strides`: how right the patient and the work of strides are in gait, over seeds."""

from pathlib import Path
from typing import Annotated, Final

import typer

from gaitd.command_line import (
    EXIT_FAILED,
    DemoFile,
    JsonOption,
    demo_file,
    errors_in_one_line,
    json_on_stdout,
)
from gaitd.terminal import progress, show

SEEDS: Final = 10
PART: Final = "accuracy"


def command(
    seeds: Annotated[int, typer.Option(min=1, help="draws of all noise")] = SEEDS,
    page: Annotated[
        Path | None,
        typer.Option(
            help="write the table into this page (docs/strides.md)", exists=True, dir_okay=False
        ),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="PNG", help="draw the strides of an active patient, of one seed"),
    ] = None,
    config: DemoFile = None,
    as_json: JsonOption = False,
) -> None:
    """Walk on the virtual machine, and compare filter, smoother and strides with the truth."""
    from analysis import markdown
    from analysis.recording import RecordingError
    from gaitd_lab.excitation import NotPlayedError
    from gaitd_lab.gait_accuracy import HEAD, cases, draw, table
    from gaitd_lab.trials import TrialError

    with (
        errors_in_one_line(ValueError),
        errors_in_one_line(TrialError, NotPlayedError, RecordingError, code=EXIT_FAILED),
        json_on_stdout(as_json) as write,
        progress() as begin,
    ):
        if page is not None:
            markdown.filled(page.read_text("utf-8"), {PART: ""})  # refused before the work
        found = cases(demo_file(config), range(1, seeds + 1), begin)
        rows = table(found)
        said = f"median (range) of {seeds} seeds"
        show(((said, HEAD, tuple(rows)),))
        if page is not None:
            text = page.read_text("utf-8")
            part = f"{said.capitalize()}:\n\n{markdown.table(HEAD, rows)}"
            page.write_text(markdown.filled(text, {PART: part}), "utf-8")
            print(f"page         {page}")
        if picture is not None:
            draw(demo_file(config), picture, begin("picture"))
            print(f"picture      {picture}")
        write([{"situation": one.situation.name, "figures": one.figures} for one in found])
