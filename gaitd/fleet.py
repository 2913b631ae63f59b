"""`gaitd fleet estimate` and `friction`: many recordings, on this machine or a cluster.

The same call works with the processes of this computer and, with --scheduler, with those of a Dask
cluster whose workers see the same folders and have the same gaitd. Exit codes: 0; 1 some recordings
gave no result, the others did; 2 usage or configuration.
"""

import os
import time
from collections.abc import Generator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer
from gaitd_names import ExitCode
from gaitd_names.joints import JOINTS

from gaitd.command_line import (
    CommandError,
    JsonOption,
    errors_in_one_line,
    json_on_stdout,
)
from gaitd.terminal import progress, show

if TYPE_CHECKING:
    from distributed import Client, Future

    from analysis.fleet import Result, Work
    from analysis.fleet_differences import Difference
    from analysis.friction_weeks import Merged
    from daemon.config.settings import Robot
    from gaitd.terminal import Table

LOST: Final = "the scheduler was lost; the same call again does what is missing"
CONNECT_S: Final = 10


CHANGE_MAX_PERCENT: Final = 10.0
WEEKS_SHOWN_MAX: Final = 100
"""More are printed of those axes only that ask to act."""


class Action(StrEnum):
    """Subcommand of `gaitd fleet`."""

    ESTIMATE = "estimate"
    FRICTION = "friction"


def command(
    action: Annotated[
        Action,
        typer.Argument(
            help="estimate: the observer over each; friction: of each self-test in them, by week"
        ),
    ],
    sessions: Annotated[
        list[Path], typer.Argument(metavar="SESSIONS...", help="recordings; or folders of them")
    ],
    robot: Annotated[Path, typer.Option(help="robot.toml, for all of them")],
    output: Annotated[Path, typer.Option(metavar="FOLDER", help="of the results")],
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="of a Dask cluster, as tcp://host:8786")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="processes of this computer; by default one per core")
    ] = None,
    change: Annotated[
        float,
        typer.Option(
            metavar="PERCENT", min=0.0, help="friction: a larger change asks for a calibration"
        ),
    ] = CHANGE_MAX_PERCENT,
    against: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="estimate: compare with results of another robot file or version, in this folder",
        ),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="PNG", help="draw friction over the weeks; with --against, all"),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Make one result of each leg of many recordings, one Parquet file each; friction: merge them.

    What is there already, of the same code and robot, is kept.
    """
    from gaitd_toml import read_toml

    from analysis.fleet import Work
    from analysis.recording import RecordingError
    from daemon.preflight.robot import decoded_robot

    work = Work.FRICTION if action is Action.FRICTION else Work.ESTIMATES
    with errors_in_one_line(RecordingError), json_on_stdout(as_json) as write:
        if scheduler is not None and workers is not None:
            raise CommandError(
                "--workers: the scheduler has its own; give one of both", ExitCode.USAGE
            )
        _check_options(work, against, plot)
        found = _recordings(sessions)
        document = read_toml(robot)
        made_with = decoded_robot(document)
        output.mkdir(parents=True, exist_ok=True)
        results = list(_all(work, found, made_with, document.sha256, output, scheduler, workers))
        failed = [one for one in results if one.error]
        for one in failed:
            print(one.error)
        made = [one for one in results if not one.error and not one.kept]
        kept = sum(one.kept for one in results)
        print(f"{len(made)} made, {kept} kept, {len(failed)} failed; results in {output}")
        if made:
            hours, cpu_s = (
                sum(one.duration_s for one in made) / 3600,
                sum(one.cpu_s for one in made),
            )
            print(f"{hours:.3g} h of recordings took {cpu_s:.3g} s of processors")
        told = [one._asdict() for one in results]
        errors: list[str] = []
        if work is Work.FRICTION:
            write({"recordings": told, **_friction(results, output, change, plot)})
        elif against is not None:
            differences, errors = _differences(results, against, output, plot)
            write({"recordings": told, "differences": differences, "not_compared": errors})
        else:
            write(told)
    if failed or errors:
        raise typer.Exit(ExitCode.FAILED)


def _check_options(work: "Work", against: Path | None, plot: Path | None) -> None:
    from analysis.fleet import Work

    if against is not None and work is not Work.ESTIMATES:
        raise CommandError("--against: only of `gaitd fleet estimate`", ExitCode.USAGE)
    if against is not None and not against.is_dir():
        raise CommandError(f"--against: {against}: is no folder", ExitCode.USAGE, blame="--against")
    if plot is not None and work is Work.ESTIMATES and against is None:
        raise CommandError(
            "--plot: only of `gaitd fleet friction`, or with --against", ExitCode.USAGE
        )


def _differences(
    results: "list[Result]", against: Path, output: Path, plot: Path | None
) -> "tuple[list[Difference], list[str]]":
    """Compare with other results of the same recordings; returns the rows, and errors."""
    from analysis.fleet_differences import differences, write

    made = [(Path(one.session), Path(one.file)) for one in results if one.file]
    found, errors = differences(sorted(made), against)
    for text in errors:
        print(text)
    if not found:
        return found, errors
    write(found, output)
    show([_difference_table(found)])
    if plot is not None:
        from analysis.fleet_differences_figure import draw

        draw(found, plot)
        print(f"picture      {plot}")
    return found, errors


def _difference_table(found: "list[Difference]") -> "Table":
    from analysis.fleet_differences import ALL

    of_one = [one for one in found if one.recording != ALL]
    title = "patient's effort, after minus before, where both are valid"
    if len(of_one) > WEEKS_SHOWN_MAX:
        of_one = sorted(of_one, key=lambda one: -(one.difference_rms_si or 0.0))[:WEEKS_SHOWN_MAX]
        title = f"{title}; the {WEEKS_SHOWN_MAX} largest"
    pooled = [one for one in found if one.recording == ALL]
    heads = ("recording", "axis", "rows", "mean", "rms", "sigma", "valid")
    return (
        title,
        heads,
        tuple(
            (
                one.recording,
                f"{one.leg}/{one.axis}".removeprefix("/"),
                f"{one.both_ok_count} of {one.row_count}",
                *_in_unit(one),
                f"{one.ok_before_ratio:.1%} → {one.ok_after_ratio:.1%}",
            )
            for one in (*of_one, *pooled)
        ),
    )


def _in_unit(one: "Difference") -> tuple[str, str, str]:
    if one.difference_mean_si is None:
        return "", "", ""
    unit = JOINTS[one.axis].effort
    sigma = f"{one.sigma_before_si:.3g} → {one.sigma_after_si:.3g} {unit}"
    return f"{one.difference_mean_si:+.3g} {unit}", f"{one.difference_rms_si:.3g} {unit}", sigma


def _friction(
    results: "list[Result]", output: Path, change_percent: float, plot: Path | None
) -> dict[str, object]:
    """Merge and show friction; returns the tables."""
    from analysis.friction_weeks import merge

    for one in results:
        if not one.error and not one.rows:
            print(f"{one.session}: {one.leg}: has no self-test")
    files = [Path(one.file) for one in results if one.file]
    if not any(one.rows for one in results):
        print("no self-test was found")
        return {"weeks": [], "trends": [], "unused": []}
    merged = merge(files, output, change_percent / 100)
    for one in merged.unused:
        print(f"{one.trainer}: {one.leg}/{one.axis}: {one.begun_utc:%F %R} not used: {one.fault}")
    show(_tables(merged, change_percent))
    if plot is not None:
        from analysis.friction_figure import draw

        draw(merged, plot)
        print(f"picture      {plot}")
    return merged._asdict()


def _tables(merged: "Merged", change_percent: float) -> "list[Table]":
    from analysis.friction_weeks import Advice

    trends = sorted(merged.trends, key=lambda one: one.advice is not Advice.CALIBRATE)
    asking = {one[:3] for one in trends if one.advice is Advice.CALIBRATE}
    weeks, title = merged.weeks, "friction by week, as ratio to the robot file's"
    if len(weeks) > WEEKS_SHOWN_MAX:
        weeks, title = [one for one in weeks if one[:3] in asking], f"{title}; only where to act"
    advice = {
        Advice.NONE: "",
        Advice.CALIBRATE: f"changed by more than {change_percent:g} %: look at it, then calibrate",
        Advice.TOO_FEW: Advice.TOO_FEW.value,
    }
    return [
        (
            title,
            ("trainer", "axis", "week", "tests", "median", "range", "mean, 95 %", "median, SI"),
            tuple(
                (
                    one.trainer,
                    f"{one.leg}/{one.axis}",
                    f"{one.week}",
                    f"{one.test_count}",
                    f"{one.median_ratio:.3f}",
                    f"{one.lowest_ratio:.3f} … {one.highest_ratio:.3f}",
                    f"{one.mean_ratio:.3f}"
                    + (f" ± {one.half_width_ratio:.3f}" if one.half_width_ratio else ""),
                    f"{one.friction_si:.3g} {'N·m' if one.axis == 'hip' else 'N'}",
                )
                for one in weeks
            ),
        ),
        (
            "trend over all self-tests",
            ("trainer", "axis", "tests", "weeks", "% a week, 95 %", "change, %", "advice"),
            tuple(
                (
                    one.trainer,
                    f"{one.leg}/{one.axis}",
                    f"{one.test_count}",
                    f"{one.span_weeks:.1f}",
                    _percent(
                        one.growth_ratio_per_week, one.low_ratio_per_week, one.high_ratio_per_week
                    ),
                    _percent(one.change_ratio),
                    advice[one.advice],
                )
                for one in trends
            ),
        ),
    ]


def _percent(value: float | None, low: float | None = None, high: float | None = None) -> str:
    if value is None:
        return ""
    text = f"{100 * value:+.2f}"
    return text if low is None or high is None else f"{text} ({100 * low:+.2f} … {100 * high:+.2f})"


def _recordings(named: list[Path]) -> list[Path]:
    """List the recordings; a folder that is none stands for those in it, by name."""
    from analysis.parquet import ESTIMATED, OF_LEG, PART, SUFFIX
    from analysis.recording import RecordingError

    found: dict[Path, None] = {}
    for path in named:
        if not path.is_dir() or any(path.glob(f"*{OF_LEG}")) or path.suffix == PART:
            found[path] = None
            continue
        inside: list[Path] = []
        for one in sorted(path.iterdir()):
            is_file = one.suffix.lower() in {".csv", SUFFIX} and not one.name.endswith(ESTIMATED)
            if one.is_dir() or is_file:
                inside.append(one)
            else:
                print(f"{one}: left out: is no folder, .csv file or {SUFFIX} file of a recording")
        if not inside:
            raise RecordingError(f"{path}: has no recordings: folders, .csv or {SUFFIX} files")
        found.update(dict.fromkeys(inside))
    return list(found)


def _all(
    work: "Work",
    sessions: list[Path],
    robot: "Robot",
    digest: str,
    output: Path,
    scheduler: str | None,
    workers: int | None,
) -> "Generator[Result]":
    """Give the results of each recording as it is done."""
    from distributed import as_completed

    from analysis.fleet import Job, key_of, run_job, warm

    key = key_of(work, digest)
    jobs = [Job(work, one.absolute(), robot, key, output.absolute()) for one in sessions]
    with (
        _cluster(scheduler, workers or min(os.cpu_count() or 1, len(jobs))) as client,
        progress() as stage,
    ):
        update = stage("recordings", len(jobs))
        if scheduler is None:
            client.run(warm, work, robot)
        futures = client.map(run_job, jobs, cpu_clock_s=time.process_time, pure=False)
        sessions_of = {future.key: job.session for future, job in zip(futures, jobs, strict=True)}
        for done, future in enumerate(as_completed(futures), start=1):
            yield from _results(future, sessions_of[future.key])
            update(done)


def _results(future: "Future[list[Result]]", session: Path) -> "list[Result]":
    from analysis.fleet import Result

    # Not an error of a recording: those are results. Workers that end three times with one task, or
    # that have another gaitd, cost this recording. A result that was made may be lost on the way.
    try:
        if future.status == "finished":
            return future.result()
        reason = str(future.exception()) if future.status == "error" else LOST
    except (OSError, CancelledError):
        reason = LOST
    return [Result(str(session), "", 0, 0.0, 0.0, "", f"{session}: {reason}", kept=False)]


@contextmanager
def _cluster(scheduler: str | None, workers: int) -> "Generator[Client]":
    """Connect to a cluster, or make one of the processes of this computer."""
    import logging

    from distributed import Client, LocalCluster

    # Lost workers and schedulers are told as results; their tracebacks help no reader.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    if scheduler is not None:
        try:
            client = Client(scheduler, timeout=CONNECT_S)
        except (OSError, ValueError) as error:
            raise CommandError(
                f"--scheduler: {scheduler}: {error}", ExitCode.USAGE, blame="--scheduler"
            ) from error
        with client:
            yield client
        return
    with (
        LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=":0") as local,
        Client(local) as client,
    ):
        yield client
