"""`gaitd calibrate`: friction, springs and encoder noise from recordings of the empty machine."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from gaitd_names import ExitCode
from gaitd_toml import COMMAND_LINE, ConfigError

from gaitd.command_line import (
    CommandError,
    JsonOption,
    errors_in_one_line,
    json_on_stdout,
)
from gaitd.terminal import progress, show

if TYPE_CHECKING:
    from analysis.calibration.session import Calibration
    from analysis.replay import Source

SUFFIX = ".robot.toml"


def command(
    recorded: Annotated[
        list[Path],
        typer.Argument(
            metavar="IN...", help="a .csv, a folder of `gaitd record` or a ring: the empty machine"
        ),
    ],
    robot: Annotated[Path, typer.Option(help="robot.toml of the empty machine to begin with")],
    output: Annotated[
        Path | None, typer.Option(help=f"the calibrated robot.toml; by default IN{SUFFIX}")
    ] = None,
    page: Annotated[
        Path | None, typer.Option(metavar="DIR", help="write calibration.md and its pictures")
    ] = None,
    held_out: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="judge on this recording; else on a part of IN"),
    ] = None,
    noise: Annotated[
        bool,
        typer.Option(
            "--noise", help="set the observer's process noise and how wrong the law is, too"
        ),
    ] = False,
    accept: Annotated[
        bool,
        typer.Option(
            "--accept", help="write the result although it misses a limit; the file says so"
        ),
    ] = False,
    leg: Annotated[str | None, typer.Option(help="of recordings with two legs")] = None,
    check: Annotated[
        bool, typer.Option("--check", help="only look for a wrong recline, spring or offset")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Identify friction, springs, inertia and encoder noise, with intervals, from `excite` runs."""
    from analysis.recording import RecordingError
    from daemon.config.edits import EditError

    fitting = {
        "--noise": noise,
        "--accept": accept,
        "--output": output,
        "--page": page,
        "--held-out": held_out and held_out[0],
    }
    for option, given in fitting.items():
        if check and given:
            raise ConfigError(COMMAND_LINE, option, given, "not with --check, which fits nothing")
    output = output or recorded[0].with_name(recorded[0].name + SUFFIX)
    with errors_in_one_line(RecordingError, EditError), json_on_stdout(as_json) as write:
        if check:
            _check(recorded, leg, robot, write)
        else:
            _calibrate(
                recorded,
                leg,
                robot,
                output,
                page,
                held_out or [],
                write,
                noise=noise,
                accept=accept,
            )


def _check(
    recorded: list[Path], leg: str | None, robot_file: Path, write: Callable[[object], None]
) -> None:
    from gaitd_toml import read_toml

    from analysis.calibration.empty_check import check
    from analysis.calibration.session import empty_run
    from daemon.preflight.robot import decoded_robot

    robot = decoded_robot(read_toml(robot_file), to_calibrate=True)
    found = check(robot, empty_run(_sources(recorded, leg), robot))
    print(found)
    write({"passed": found.well, "mechanism": str(found), "check": found})
    if not found.well:
        raise typer.Exit(ExitCode.FAILED)


def _calibrate(
    recorded: list[Path],
    leg: str | None,
    robot_file: Path,
    output: Path,
    page: Path | None,
    held_out: list[Path],
    write_json: Callable[[object], None],
    *,
    noise: bool,
    accept: bool,
) -> None:
    from gaitd_toml import read_toml

    from analysis.calibration.process_noise import LAW_KEYS
    from analysis.calibration.quantities import BRISTLE_KEYS
    from analysis.calibration.robot_file import refuse_missing_lines, write
    from analysis.calibration.session import calibrate
    from daemon.preflight.robot import decoded_robot

    if output.exists() and output.samefile(robot_file):
        allowed = "another name than the file to begin with"
        raise ConfigError(COMMAND_LINE, "--output", output, allowed)
    document = read_toml(robot_file)
    robot = decoded_robot(document, to_calibrate=True)
    refuse_missing_lines(document, "calibrate", (*BRISTLE_KEYS[0], *BRISTLE_KEYS[1]))
    if noise:
        refuse_missing_lines(document, "--noise", (f"observer.{key}" for key in LAW_KEYS))
    with progress() as stage:
        update = stage("calibrating")
        made = calibrate(
            _sources(recorded, leg),
            robot,
            _sources(held_out, leg),
            lambda misfit, share: update(share, f"calibrating  {misfit}"),
            with_noise=noise,
        )
    _report(made)
    if page is not None:
        from analysis.calibration.page import write_page

        print(f"page         {write_page(made, robot_file.name, page)}")
    if made.refused and not accept:
        blame = recorded[0].name
        raise CommandError(f"nothing written: {made.refused}", ExitCode.FAILED, blame=blame)
    if made.needless:
        print(f"nothing written: keep {robot_file}; {made.needless}")
    else:
        values = made.values(", ".join(path.name for path in recorded))
        write(robot_file, output, values, made.missed)
        for limit, reason in made.missed:
            print(f"missed       {limit}: {reason}")
        print(f"written      {output}")
    write_json(
        {
            "written": None if made.needless else output,
            "needless": made.needless,
            "missed_limits": [limit for limit, _ in made.missed],
            "mechanism_of_file": str(made.given_check),
            "mechanism": str(made.check),
            "results": [
                {
                    "key": one.quantity.key,
                    "unit": one.quantity.unit,
                    "before": one.before,
                    "value": one.value,
                    "half_interval": one.half_interval,
                    "not_identified": one.reason,
                }
                for one in made.results
                if one.exists
            ],
            "held_out": made.held_out,
            "before": made.before,
            "after": made.after,
            "bristles": made.bristled,
            "other_law": made.other_law,
            "why_eq_11": made.why_eq_11,
            "behind_gap": made.behind_gap,
        }
    )


def _sources(recorded: list[Path], leg: str | None) -> "list[Source]":
    from analysis.replay import read

    return [read(path, leg) for path in recorded]


def _report(made: "Calibration") -> None:
    from analysis.calibration.advice import advice
    from analysis.calibration.page import tables

    print(f"recording    {', '.join(made.motion.sources)}: {made.motion.duration_s:.1f} s")
    print(f"file         {made.given_check}")
    print(f"mechanism    {made.check}")
    if made.why_eq_11:
        print(f"law          bristles are not used: {made.why_eq_11}")
    for name in made.behind_gap:
        print(f"law          at the {name} no bristles are tried: it has backlash")
    for line in (*advice(made.motion, made.fit.results), *made.too_slow):
        print(f"to do        {line}")
    if len(made.contact_s):
        share = len(made.contact_s) / len(made.motion.time_s)
        print(
            f"contact      {share:.0%} of the rows, from {made.contact_s[0]:.0f} s on, not judged: "
            "an end stop, or it was touched"
        )
    for key, std in made.process_noise.items():
        print(f"noise        {key} = {std:.3g}")
    show(tables(made))
