"""`gaitd baseline`: estimated torque and force of a passive patient, recorded once."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gaitd.command_line import JsonOption, Recorded, errors_in_one_line, json_on_stdout

if TYPE_CHECKING:
    from observer.baseline import Baseline


def command(
    recorded: Recorded,
    robot: Annotated[Path, typer.Option(help="robot.toml that the service runs with")],
    output: Annotated[Path, typer.Option(help="baseline.toml to write")],
    leg: Annotated[str | None, typer.Option(help="of a recording with two legs")] = None,
    as_json: JsonOption = False,
) -> None:
    """Average torque and force by gait phase from a passive run, for `baseline` of a [[leg]]."""
    from analysis.recording import RecordingError

    with errors_in_one_line(RecordingError), json_on_stdout(as_json) as write:
        write({**_record(recorded, robot, output, leg)._asdict(), "written": output})


def _record(recorded: Path, robot_file: Path, output: Path, leg: str | None) -> "Baseline":
    from gaitd_toml import read_toml

    from analysis.recording import RecordingError
    from analysis.replay import columns_of, read, setup_for
    from daemon.config.baseline import baseline_text
    from daemon.preflight.robot import decoded_robot
    from observer.baseline import TooFewError, baseline_of
    from observer.offline.smooth_batch import run_smoothed

    document = read_toml(robot_file)
    robot = decoded_robot(document)
    columns = columns_of(read(recorded, leg))
    try:
        baseline = baseline_of(run_smoothed(setup_for(robot), columns), columns)
    except TooFewError as error:
        raise RecordingError(f"{recorded}: {error}") from error
    output.write_text(baseline_text(baseline, document.sha256, recorded.name), encoding="utf-8")
    hip, slide = abs(baseline.mean).max(axis=0).tolist()
    print(f"recording    {recorded}: {baseline.stride_count} strides, {baseline.cadence_hz:.3f} Hz")
    print(f"largest      hip {hip:.2f} N·m, slide {slide:.1f} N in {len(baseline.mean)} parts")
    print(f"baseline     {output}")
    print(f'             name it in the trainer file: [[leg]] baseline = "{output.name}"')
    return baseline
