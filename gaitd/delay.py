"""`gaitd delay`: delay between an effort's row and its action, measured from a recording."""

from pathlib import Path
from typing import Annotated

import typer
from gaitd_names import ExitCode

from gaitd.command_line import (
    JsonOption,
    Recorded,
    errors_in_one_line,
    json_on_stdout,
    robot_file,
)


def command(
    recorded: Recorded,
    robot: Annotated[
        Path | None,
        typer.Option(
            help="robot.toml; by default the recording's own, else configs/robot_empty.toml"
        ),
    ] = None,
    leg: Annotated[str | None, typer.Option(help="of a recording with two legs")] = None,
    as_json: JsonOption = False,
) -> None:
    """Measure the delay of torque and force, and print the values to set in robot.toml.

    The recording needs quick efforts while the leg moves: `gaitd mode excite --scenario delay`.
    Exit code 1 if no axis's delay could be measured.
    """
    from analysis.delay import advice, in_words, measure
    from analysis.recording import RecordingError
    from analysis.replay import read
    from daemon.preflight.robot import load_robot

    with errors_in_one_line(RecordingError), json_on_stdout(as_json) as write:
        source = read(recorded, leg)
        made_by, name = source.robot, f"as the service had it, {source.leg} leg"
        if robot is not None or made_by is None:
            path = robot_file(robot, "robot_empty.toml")
            made_by, name = load_robot(path), str(path)
        delays = measure(source.recording, made_by)
        print(f"robot        {name}")
        for one in delays:
            print(f"delay        {in_words(one)}")
        print(f"             {advice(delays)}")
        found = [{**one._asdict(), "known": one.known} for one in delays]
        write({"robot": name, "delays": found, "advice": advice(delays)})
    if not any(one.known for one in delays):
        raise typer.Exit(ExitCode.FAILED)
