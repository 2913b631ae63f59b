"""`gaitd delay`: delay between an effort's row and its action, measured from a recording."""

import sys
from pathlib import Path
from typing import Annotated

import typer

EXIT_REFUSED = 2
EXIT_UNKNOWN = 1


def command(
    recorded: Annotated[Path, typer.Argument(metavar="IN", help="a .csv, or a ring of records")],
    robot: Annotated[
        Path | None,
        typer.Option(help="robot.toml; by default the ring's own, else configs/robot_empty.toml"),
    ] = None,
    leg: Annotated[str | None, typer.Option(help="of a ring with two legs")] = None,
) -> None:
    """Measure the delay of torque and force, and print the values to set in robot.toml.

    The recording needs quick efforts while the leg moves: `gaitd mode excite --scenario delay`.
    Exit code 1 if no axis's delay could be measured.
    """
    from analysis.delay import advice, in_words, measure
    from analysis.recording import RecordingError
    from analysis.replay import read
    from daemon.config.settings import Robot
    from daemon.config.strict import load_toml
    from gaitd.places import configs_folder

    try:
        source = read(recorded, leg)
        made_by, name = source.robot, f"as the service had it, {source.leg} leg"
        if robot is not None or made_by is None:
            path = robot or configs_folder("--robot", "robot_empty.toml") / "robot_empty.toml"
            made_by, name = load_toml(path, Robot), str(path)
        delays = measure(source.recording, made_by)
    except RecordingError as error:
        print(error, file=sys.stderr)
        raise typer.Exit(EXIT_REFUSED) from error
    print(f"robot        {name}")
    for one in delays:
        print(f"delay        {in_words(one)}")
    print(f"             {advice(delays)}")
    if not any(one.known for one in delays):
        raise typer.Exit(EXIT_UNKNOWN)
