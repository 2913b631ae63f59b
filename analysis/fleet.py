"""Many recordings at once with one robot file, on one machine or on many.

One recording is one task. Its result is one Parquet file for each leg, named by the three things
that it depends on: the recording's content, the code, and the robot. So a second call does only
what is missing, a lost worker costs the task that it had, and a lost scheduler nothing that was
finished. A file is written beside its place and renamed: no half result has its name.
"""

import hashlib
import os
import secrets
from collections.abc import Callable
from datetime import UTC, datetime
from enum import StrEnum, auto
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from gaitd_client import Mode
from gaitd_client.wire.columns import ESTIMATE_COLUMNS
from gaitd_toml import ConfigError

import analysis
import observer
from analysis import parquet, replay, self_tests
from analysis.estimates import COLUMNS, VALIDITY_NAMES, shown
from analysis.recording import RecordingError
from analysis.replay import estimate, is_recorded, legs_of, read
from daemon.config.settings import Robot
from daemon.system.files import sync_folder
from observer.filter.leg_observer import TuningError

Arrow = Any
"""A type of pyarrow, which has no annotations."""


class Work(StrEnum):
    """What is made of each recording, and the end of its file's name."""

    ESTIMATES = auto()
    FRICTION = auto()


HASH_DIGITS: Final = 12
_COMMON: Final = (
    (observer, "**/*.py"),
    (analysis, "replay.py"),
    (analysis, "estimates.py"),
    (analysis, "recording.py"),
    (analysis, "parquet.py"),
)
CODE: Final = {
    Work.ESTIMATES: _COMMON,
    Work.FRICTION: (
        *_COMMON,
        (analysis, "self_tests.py"),
        (analysis, "calibration/motion.py"),
        (analysis, "calibration/start.py"),
    ),
}
"""Files on which the bits of a result depend."""
LIBRARIES: Final = {
    Work.ESTIMATES: ("numba", "llvmlite", "numpy"),
    Work.FRICTION: ("numba", "llvmlite", "numpy", "scipy"),
}
PIECE: Final = ".piece"


class Job(NamedTuple):
    """One recording, and what its result is made with."""

    work: Work
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


class Made(NamedTuple):
    """A result before it is written."""

    table: Arrow
    duration_s: float
    """Duration of the recording."""


def key_of(work: Work, robot_sha256: str) -> str:
    """Key of all results that this code makes with the robot file of this hash."""
    digest = hashlib.sha256()
    for name in LIBRARIES[work]:
        digest.update(f"{name} {version(name)}\0".encode())
    for package, pattern in CODE[work]:
        folder = Path(package.__path__[0])
        for file in sorted(folder.glob(pattern)):
            digest.update(file.relative_to(folder).as_posix().encode() + b"\0")
            digest.update(file.read_bytes() + b"\0")
    return f"{digest.hexdigest()[:HASH_DIGITS]}_{robot_sha256[:HASH_DIGITS]}"


def content_hash(session: Path, work: Work) -> str:
    """Hash of what is read of a recording: another one of the same name is another task."""
    files = list(parquet.files_of(session).values()) if session.is_dir() else [session]
    if work is Work.FRICTION:
        files += [parquet.estimated(file) for file in files]
    digest = hashlib.sha256()
    for file in files:
        with file.open("rb") as opened:
            digest.update(hashlib.file_digest(opened, "sha256").digest())
    return digest.hexdigest()[:HASH_DIGITS]


def run_job(job: Job, cpu_clock_s: Callable[[], float]) -> list[Result]:
    """Make the result of each leg of one recording; an error of it is a result, too.

    Args:
        job: recording, robot, and where the result goes.
        cpu_clock_s: processor time of this process.
    """
    try:
        legs = _legs(job)
        content = content_hash(job.session, job.work)
        return [_run_leg(job, leg, content, cpu_clock_s) for leg in legs]
    except (RecordingError, OSError) as error:
        return [Result(str(job.session), "", 0, 0.0, 0.0, "", str(error), kept=False)]


def _legs(job: Job) -> tuple[str | None, ...]:
    legs = legs_of(job.session)
    if job.work is Work.FRICTION and not (legs and is_recorded(job.session)):
        raise RecordingError(
            f"{job.session}: has no modes, so no self-test can be found in it; "
            "recordings of `gaitd record` have them"
        )
    return legs or (None,)


def _run_leg(job: Job, leg: str | None, content: str, cpu_clock_s: Callable[[], float]) -> Result:
    name = ".".join((job.session.stem, leg or "leg", content, job.key, job.work, "parquet"))
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
        table, duration_s = MAKERS[job.work](job.session, leg, job.robot)
    except (RecordingError, ConfigError, TuningError, OSError) as error:
        return Result(str(job.session), leg or "", 0, 0.0, 0.0, "", str(error), kept=False)
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
        len(table),
        duration_s,
        cpu_clock_s() - begin_s,
        str(file),
        "",
        kept=False,
    )


def _estimates(session: Path, leg: str | None, robot: Robot) -> Made:
    source = read(session, leg)
    made = shown(estimate(source, robot))
    parts = (source.recording.time_s, made.state, made.std, made.net, made.nis)
    numbers = np.column_stack(parts)
    columns = [pa.array(values, mask=np.isnan(values)) for values in numbers.T]
    columns += [pa.array(names) for names in VALIDITY_NAMES[made.validity].T]
    columns.append(pa.array(made.status))
    fields = [
        pa.field(name, values.type, metadata=ESTIMATE_COLUMNS[name].metadata)
        for name, values in zip(COLUMNS, columns, strict=True)
    ]
    table = pa.table(columns, schema=pa.schema(fields))
    return Made(table, source.recording.duration_s)


def _friction(session: Path, leg: str | None, robot: Robot) -> Made:
    """One row for each axis of each self-test."""
    stays = parquet.stays_in(session, leg or "", Mode.SELF_TEST)
    rows = [
        {
            "trainer": stays.trainer,
            "recording": stays.id,
            "leg": leg,
            "axis": axis,
            "begun_utc": datetime.fromtimestamp(test.begun_utc_ns * 1e-9, UTC),
            **found._asdict(),
        }
        for test in stays.found
        for axis, found in zip(self_tests.AXES, self_tests.friction_of(test, robot), strict=True)
    ]
    return Made(pa.Table.from_pylist(rows, FRICTION_SCHEMA), stays.duration_s)


FRICTION_SCHEMA: Final = pa.schema(
    [
        *((name, pa.string()) for name in ("trainer", "recording", "leg", "axis")),
        ("begun_utc", pa.timestamp("us")),
        *(
            (name, {float: pa.float64(), int: pa.int64(), str: pa.string()}[kind])
            for name, kind in self_tests.AxisFriction.__annotations__.items()
        ),
    ]
)
MAKERS: Final[dict[Work, Callable[[Path, str | None, Robot], Made]]] = {
    Work.ESTIMATES: _estimates,
    Work.FRICTION: _friction,
}


def warm(work: Work, robot: Robot) -> None:
    """Load the compiled kernels of a process, so that no session pays for them."""
    if work is Work.FRICTION:
        self_tests.warm_up(robot)
    else:
        replay.warm_up(robot)
