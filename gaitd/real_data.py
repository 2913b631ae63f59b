"""`gaitd real-data`: the observer on recordings of real machines, beside classical estimators."""

from pathlib import Path
from typing import Annotated

import typer

from gaitd.command_line import JsonOption, errors_in_one_line, json_on_stdout, robot_file
from gaitd.terminal import progress, show


def command(
    recordings: Annotated[
        Path,
        typer.Argument(
            metavar="RECORDINGS",
            help="folder with emps/DATA_EMPS.mat and emps/DATA_EMPS_PULSES.mat",
            file_okay=False,
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="writes a page and its figures", file_okay=False),
    ] = None,
    robot: Annotated[
        Path | None, typer.Option(help="robot.toml; by default configs/robot_empty.toml")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Calibrate on one recording of a servo axis, judge on another whose disturbance is known.

    The recordings are published benchmarks and not part of gaitd; docs/real_data.md names them.
    """
    from analysis.real_data.comparison import compare
    from analysis.real_data.emps import read
    from analysis.real_data.page import HEAD, rows, write_page
    from analysis.recording import RecordingError
    from daemon.config.settings import Robot
    from daemon.config.strict import load_toml

    empty = load_toml(robot_file(robot, "robot_empty.toml"), Robot)
    with errors_in_one_line(RecordingError), json_on_stdout(as_json) as write:
        records = read(recordings / "emps")
        with progress() as stage:
            update = stage("calibrating")
            found = compare(records, empty, lambda _, share: update(share))
        table = tuple(rows(found))
        show((("", HEAD, table),))
        write([dict(zip(HEAD, row, strict=True)) for row in table])
        if output is not None:
            output.mkdir(parents=True, exist_ok=True)
            run = f"gaitd real-data RECORDINGS --output {output.name}"
            for path in write_page(output, found, run):
                print(f"written      {path}")
