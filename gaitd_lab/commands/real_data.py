"""`gaitd real-data`: the observer on recordings of others, beside classical estimators."""

from pathlib import Path
from typing import Annotated

import typer

from gaitd.command_line import (
    JsonOption,
    errors_in_one_line,
    json_on_stdout,
    robot_file,
)
from gaitd.terminal import progress, show
from gaitd_lab.commands.demo_file import DemoFile, demo_file


def command(
    recordings: Annotated[
        Path,
        typer.Argument(
            metavar="RECORDINGS",
            help="folder with emps/ and gait_falisse/, as docs/evidence/real_data.md says",
            file_okay=False,
        ),
    ],
    output: Annotated[
        Path, typer.Option(metavar="DIR", help="where tables and pictures go", file_okay=False)
    ] = Path("out"),
    patient: Annotated[
        Path | None,
        typer.Option(metavar="CSV", help="only write the measured hip moment, for plant.toml"),
    ] = None,
    robot: Annotated[
        Path | None, typer.Option(help="robot.toml; by default configs/robot_empty.toml")
    ] = None,
    config: DemoFile = None,
    as_json: JsonOption = False,
) -> None:
    """Judge the observer on a recorded servo axis, and strides with a measured patient.

    The recordings are published data sets and not part of gaitd: docs/evidence/real_data.md.
    """
    from analysis.recording import RecordingError
    from daemon.preflight.robot import load_robot
    from gaitd_lab.studies.real_data import hip_moment
    from gaitd_lab.studies.real_data.study import study
    from gaitd_lab.studies.report import write
    from gaitd_lab.trials import TrialError

    with errors_in_one_line(RecordingError, TrialError), json_on_stdout(as_json) as tell:
        if patient is not None:
            moment = recordings / "gait_falisse" / hip_moment.FILE
            hip_moment.write(hip_moment.read(moment), patient)
            print(f"written      {patient}")
            return
        empty = load_robot(robot_file(robot, "robot_empty.toml"))
        with progress() as stage:
            found = study(recordings, empty, demo_file(config), stage)
        show(table.texts() for table in found.tables)
        for path in write(found, output, "gaitd real-data RECORDINGS"):
            print(f"written      {path}")
        tell(found.tables)
