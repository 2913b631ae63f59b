"""`gaitd fleet estimate SESSIONS... --robot FILE`: many recordings, on this machine or a cluster.

The same call works with the processes of this computer and, with --scheduler, with those of a Dask
cluster whose workers see the same folders and have the same gaitd. Exit codes: 0; 1 some recordings
gave no estimates, the others did; 2 usage or configuration.
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

from gaitd.command_line import (
    EXIT_FAILED,
    EXIT_REFUSED,
    CommandError,
    JsonOption,
    errors_in_one_line,
    json_on_stdout,
)
from gaitd.terminal import progress

if TYPE_CHECKING:
    from distributed import Client, Future

    from analysis.fleet import Result
    from daemon.config.settings import Robot

LOST: Final = "the scheduler was lost; the same call again does what is missing"
CONNECT_S: Final = 10


class Action(StrEnum):
    """Subcommand of `gaitd fleet`."""

    ESTIMATE = "estimate"


def command(
    action: Annotated[Action, typer.Argument(help="what to do with them")],  # noqa: ARG001
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
    as_json: JsonOption = False,
) -> None:
    """Run the observer over many recordings; each leg's estimates become one Parquet file.

    What is there already, of the same code and robot, is kept.
    """
    from analysis.recording import RecordingError
    from daemon.config.strict import read_toml
    from daemon.preflight.robot import decoded_robot

    with errors_in_one_line(RecordingError), json_on_stdout(as_json) as write:
        if scheduler is not None and workers is not None:
            raise CommandError(
                "--workers: the scheduler has its own; give one of both", EXIT_REFUSED
            )
        found = _recordings(sessions)
        document = read_toml(robot)
        made_with = decoded_robot(document)
        output.mkdir(parents=True, exist_ok=True)
        results = list(_all(found, made_with, document.sha256, output, scheduler, workers))
        failed = [one for one in results if one.error]
        for one in failed:
            print(one.error)
        made = [one for one in results if not one.error and not one.kept]
        kept = sum(one.kept for one in results)
        print(f"{len(made)} estimated, {kept} kept, {len(failed)} failed; results in {output}")
        if made:
            hours, cpu_s = (
                sum(one.duration_s for one in made) / 3600,
                sum(one.cpu_s for one in made),
            )
            print(f"{hours:.3g} h of recordings took {cpu_s:.3g} s of processors")
        write([one._asdict() for one in results])
    if failed:
        raise typer.Exit(EXIT_FAILED)


def _recordings(named: list[Path]) -> list[Path]:
    """List the recordings; a folder that is none stands for those in it, by name."""
    from analysis.parquet import OF_LEG, PART
    from analysis.recording import RecordingError

    found: dict[Path, None] = {}
    for path in named:
        if not path.is_dir() or any(path.glob(f"*{OF_LEG}")) or path.suffix == PART:
            found[path] = None
            continue
        inside = [one for one in sorted(path.iterdir()) if one.is_dir() or one.suffix == ".csv"]
        if not inside:
            raise RecordingError(f"{path}: has no recordings, which are folders or .csv files")
        found.update(dict.fromkeys(inside))
    return list(found)


def _all(
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

    key = key_of(digest)
    jobs = [Job(one.absolute(), robot, key, output.absolute()) for one in sessions]
    with (
        _cluster(scheduler, workers or min(os.cpu_count() or 1, len(jobs))) as client,
        progress() as stage,
    ):
        update = stage("recordings", len(jobs))
        if scheduler is None:
            client.run(warm, robot)
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
                f"--scheduler: {scheduler}: {error}", EXIT_REFUSED, blame="--scheduler"
            ) from error
        with client:
            yield client
        return
    with (
        LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=":0") as local,
        Client(local) as client,
    ):
        yield client
