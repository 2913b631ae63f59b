"""`gaitd baseline`: what a minute with a passive patient says of the robot file."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gaitd.command_line import JsonOption, Recorded, errors_in_one_line, json_on_stdout

if TYPE_CHECKING:
    from observer.baseline import Baseline, NotPassiveError


def command(
    recorded: Recorded,
    robot: Annotated[Path, typer.Option(help="robot.toml that the service runs with")],
    output: Annotated[Path, typer.Option(help="baseline.toml to write")],
    leg: Annotated[str | None, typer.Option(help="of a recording with two legs")] = None,
    as_json: JsonOption = False,
) -> None:
    """Learn the errors of the robot file from a passive run, as a file for a leg's `baseline`."""
    from analysis.recording import RecordingError

    with errors_in_one_line(RecordingError), json_on_stdout(as_json) as write:
        write({**_record(recorded, robot, output, leg)._asdict(), "written": output})


def _record(recorded: Path, robot_file: Path, output: Path, leg: str | None) -> "Baseline":
    from gaitd_toml import read_toml

    from analysis.recording import RecordingError
    from analysis.replay import columns_of, read, setup_for
    from daemon.config.baseline import baseline_text
    from daemon.config.robot import frictional
    from daemon.preflight.robot import decoded_robot
    from observer.baseline import NotPassiveError, baseline_of
    from observer.offline.smooth_batch import run_smoothed

    document = read_toml(robot_file)
    robot = decoded_robot(document)
    columns = columns_of(read(recorded, leg))
    try:
        smooth = run_smoothed(setup_for(robot), columns)
        baseline = baseline_of(smooth, columns, frictional(robot))
    except NotPassiveError as error:
        raise RecordingError(f"{recorded}: {_why_not(error)}") from error
    output.write_text(baseline_text(baseline, document.sha256, recorded.name), encoding="utf-8")
    hip_nm, slide_n = baseline.kept_std
    print(f"recording    {recorded}: {baseline.stride_count} strides, {baseline.cadence_hz:.3f} Hz")
    print(f"unexplained  hip {hip_nm:.2f} N·m, slide {slide_n:.1f} N, which sigma keeps")
    print(f"baseline     {output}")
    print(f'             name it in the trainer file: [[leg]] baseline = "{output.name}"')
    return baseline


def _why_not(error: "NotPassiveError") -> str:
    from observer.baseline import BINS, Unfit

    name, unit = (("hip", "N·m"), ("slide", "N"))[error.axis]
    value, limit = error.value, error.limit
    if error.why is Unfit.FEW_STRIDES:
        return f"has {value:.0f} strides; a baseline needs at least {limit:.0f}"
    if error.why is Unfit.FEW_SAMPLES:
        return (
            f"the {name}'s patient is known in {value:.0f} of {BINS} parts of the stride; at least "
            f"{limit:.0f} are needed: use a higher cadence or amplitude"
        )
    if error.why is Unfit.IMPLAUSIBLE:
        return (
            f"the {name} asks for an error of {value:.1f} standard deviations of a parameter of the"
            f" robot file; at most {limit:g} are plausible: let the patient relax and record again,"
            " or calibrate the machine"
        )
    return (
        f"the {name}'s patient differs from stride to stride by {value:.2f} {unit}; at most "
        f"{limit:g} {unit} are a passive patient's: let the patient relax, and record again"
    )
