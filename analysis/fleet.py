"""Many recordings at once: the observer over each with one robot file, on one machine or on many.

One recording is one task. Its result is one Parquet file for each leg, named by the three things
that it depends on: the recording's content, the code of the observer, and the robot. So a second
call does only what is missing, a lost worker costs the task that it had, and a lost scheduler
nothing that was finished. A file is written beside its place and renamed: no half result has its
name.
"""

import hashlib
import os
import secrets
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import analysis
import observer
from analysis import parquet
from analysis.estimates import COLUMNS
from analysis.recording import RecordingError, recording
from analysis.replay import Source, estimate, legs_of, read
from daemon.config.settings import Robot
from daemon.config.strict import ConfigError
from daemon.system.files import sync_folder
from observer.filter.leg_observer import TuningError

RESULTS: Final = "estimates"
HASH_DIGITS: Final = 12
CODE: Final = (
    (observer, "**/*.py"),
    (analysis, "replay.py"),
    (analysis, "recording.py"),
    (analysis, "parquet.py"),
)
"""Files on which the bits of a result depend."""
PIECE: Final = ".piece"


class Job(NamedTuple):
    """One recording, and what its estimates are made with."""

    session: Path
    robot: Robot
    key: str
    """Hash of code and robot."""
    output: Path


class Result(NamedTuple):
    """What one leg of a recording gave."""

    session: str
    leg: str
    rows: int
    duration_s: float
    cpu_s: float
    file: str
    """Empty if there is none."""
    error: str
    kept: bool
    """True if an earlier call had made it."""


def code_hash() -> str:
    """Hash of the code, and of the compiler, of which estimates are the result."""
    digest = hashlib.sha256()
    for name in ("numba", "llvmlite", "numpy"):
        digest.update(f"{name} {version(name)}\0".encode())
    for package, pattern in CODE:
        folder = Path(package.__path__[0])
        for file in sorted(folder.glob(pattern)):
            digest.update(file.relative_to(folder).as_posix().encode() + b"\0")
            digest.update(file.read_bytes() + b"\0")
    return digest.hexdigest()[:HASH_DIGITS]


def key_of(robot_sha256: str) -> str:
    """Key of all results that this code makes with the robot file of this hash."""
    return f"{code_hash()}_{robot_sha256[:HASH_DIGITS]}"


def content_hash(session: Path) -> str:
    """Hash of a recording's inputs: another recording of the same name is another task."""
    files = parquet.files_of(session).values() if session.is_dir() else (session,)
    digest = hashlib.sha256()
    for file in files:
        with file.open("rb") as opened:
            digest.update(hashlib.file_digest(opened, "sha256").digest())
    return digest.hexdigest()[:HASH_DIGITS]


def run_job(job: Job, cpu_clock_s: Callable[[], float]) -> list[Result]:
    """Estimate all legs of one recording; an error of the recording is a result, too.

    Args:
        job: recording, robot, and where the result goes.
        cpu_clock_s: processor time of this process.
    """
    try:
        legs: tuple[str | None, ...] = legs_of(job.session) or (None,)
        content = content_hash(job.session)
        return [_run_leg(job, leg, content, cpu_clock_s) for leg in legs]
    except (RecordingError, OSError) as error:
        return [Result(str(job.session), "", 0, 0.0, 0.0, "", str(error), kept=False)]


def _run_leg(job: Job, leg: str | None, content: str, cpu_clock_s: Callable[[], float]) -> Result:
    name = ".".join((job.session.stem, leg or "leg", content, job.key, RESULTS, "parquet"))
    file = job.output / name
    if file.exists():
        try:
            rows = pq.read_metadata(file).num_rows
        except pa.ArrowInvalid as error:
            text = f"{file}: is no whole Parquet file; delete it: {error}"
            return Result(str(job.session), leg or "", 0, 0.0, 0.0, "", text, kept=False)
        return Result(str(job.session), leg or "", rows, 0.0, 0.0, str(file), "", kept=True)
    begin_s = cpu_clock_s()
    try:
        source = read(job.session, leg)
        made = estimate(source, job.robot)
    except (RecordingError, ConfigError, TuningError, OSError) as error:
        return Result(str(job.session), leg or "", 0, 0.0, 0.0, "", str(error), kept=False)
    time_s = source.recording.time_s
    parts = (time_s, made.state, made.std, made.net, made.nis, made.status)
    values = np.column_stack(parts)
    table = pa.table({name: values[:, at] for at, name in enumerate(COLUMNS)})
    told = {"session": str(job.session), "leg": leg or "", "key": job.key}
    table = table.replace_schema_metadata({f"gaitd.{name}": text for name, text in told.items()})
    # Two workers may have the same task after one seemed lost: each has a piece of its own.
    piece = file.with_name(f"{file.name}.{secrets.token_hex(4)}{PIECE}")
    with piece.open("wb") as opened:
        pq.write_table(table, opened, compression="zstd")
        opened.flush()
        os.fsync(opened.fileno())
    piece.replace(file)
    sync_folder(file.parent)
    return Result(
        str(job.session),
        leg or "",
        len(time_s),
        float(time_s[-1] - time_s[0]),
        cpu_clock_s() - begin_s,
        str(file),
        "",
        kept=False,
    )


def warm(robot: Robot) -> None:
    """Load the compiled kernels of a process, so that no session pays for them."""
    rows = np.zeros((3, 5))
    rows[:, 0] = (0.0, 0.01, 0.02)
    estimate(Source(recording("warm-up", rows), None, "", None), robot)
