"""`gaitd real-data`: the observer on recordings of others, beside classical estimators."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from gaitd.command_line import (
    DemoFile,
    JsonOption,
    demo_file,
    errors_in_one_line,
    json_on_stdout,
    robot_file,
)
from gaitd.terminal import progress, show


def command(
    recordings: Annotated[
        Path,
        typer.Argument(
            metavar="RECORDINGS",
            help="folder with emps/ and gait_falisse/, as docs/real_data.md says",
            file_okay=False,
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="writes a page and its figures", file_okay=False),
    ] = None,
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

    The recordings are published data sets and not part of gaitd; docs/real_data.md names them.
    """
    from analysis.real_data import hip_moment
    from analysis.recording import RecordingError
    from gaitd_lab.trials import TrialError

    moment = recordings / "gait_falisse" / hip_moment.FILE
    with errors_in_one_line(RecordingError, TrialError), json_on_stdout(as_json) as write:
        if patient is not None:
            hip_moment.write(hip_moment.read(moment), patient)
            print(f"written      {patient}")
            return
        empty = robot_file(robot, "robot_empty.toml")
        write(_judge(recordings, moment, output, empty, demo_file(config)))


def _judge(
    recordings: Path, moment: Path, output: Path | None, robot_file: Path, config: Path
) -> dict[str, list[dict[str, str]]]:
    """Print both tables, write the page, and return the tables by name."""
    from analysis.real_data import emps, hip_moment, strides
    from analysis.real_data.comparison import compare
    from analysis.real_data.page import HEAD, rows, write_page
    from daemon.preflight.robot import load_robot
    from gaitd_lab.measured_patient import CADENCES_HZ, HIP_NM, record

    robot = load_robot(robot_file)
    records, table = emps.read(recordings / "emps"), hip_moment.read(moment)
    with progress() as stage, TemporaryDirectory() as folder:
        update = stage("calibrating")
        found = compare(records, robot, lambda _, share: update(share))
        file = Path(folder) / "moment.csv"
        hip_moment.write(table, file)
        walked = [
            strides.row(
                cadence_hz, list(map(strides.judged, record(config, file, cadence_hz, stage)))
            )
            for cadence_hz in CADENCES_HZ
        ]
    axis = rows(found)
    show((("", HEAD, tuple(axis)), ("Strides", strides.HEAD, tuple(walked))))
    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
        run = f"gaitd real-data RECORDINGS --output {output.name}"
        for path in write_page(output, found, run, (strides.section(HIP_NM, walked),)):
            print(f"written      {path}")
    return {
        name: [dict(zip(head, row, strict=True)) for row in table]
        for name, head, table in (("axis", HEAD, axis), ("strides", strides.HEAD, walked))
    }
