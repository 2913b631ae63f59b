"""Input of recordings that `gaitd record` has made: the observer's inputs of a leg as Parquet.

A recording is a folder with `LEG.recording.parquet` for each leg, which may also be named alone.
Columns are those of a recording as CSV, found by name; another Parquet file with them is read, too.
What `gaitd record` knew of robot, versions and losses is in the file's metadata.
"""

from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from analysis.recording import (
    COLUMNS,
    Place,
    Recording,
    RecordingError,
    check_row_count,
    recording,
)
from daemon.config.settings import Robot
from daemon.ipc.decoding import Decoder, RefusedError

Arrow = Any
"""A type of pyarrow, which has no annotations."""

SUFFIX: Final = ".parquet"
OF_LEG: Final = f".recording{SUFFIX}"
ESTIMATED: Final = f".estimates{SUFFIX}"
MCAP: Final = ".mcap"
PART: Final = ".part"
OF_RECORDER: Final = ("status", "dt_s")
"""Columns of `gaitd record` besides those of a CSV."""
ABOUT: Final = b"gaitd"
END: Final = b"gaitd.end"
LEG: Final = b"gaitd.leg"


class Read(NamedTuple):
    """A leg's recording and what it says of itself."""

    recording: Recording
    robot: Robot | None
    """As the service had it; None for a file of another program."""
    leg: str
    status: NDArray[np.int64]
    """Shape (n,): bits of status.Status; 0 for a file of another program."""
    about: tuple[tuple[str, str], ...]
    """Names and values."""
    first_step_s: float | None
    """Step of the first row, where the service's observer started with it."""


class Stay(NamedTuple):
    """Rows of one leg during a stay of the service in one mode."""

    begun_utc_ns: int
    recording: Recording


class Stays(NamedTuple):
    """All stays of a recording in one mode."""

    trainer: str
    id: str
    duration_s: float
    """Duration of the whole recording."""
    found: tuple[Stay, ...]


class _About(msgspec.Struct, frozen=True):
    id: str
    trainer: str
    core_boot_id: str
    gaitd_version: str
    robot: dict[str, Any]


class _Stop(msgspec.Struct, frozen=True):
    category: str
    cause: str


class _End(msgspec.Struct, frozen=True):
    ended: str
    lost: str
    """JSON: number of messages by key."""
    stops: str
    """JSON: list of stops."""


class _Ended(NamedTuple):
    how: str
    lost: dict[str, int]
    stops: list[_Stop]


_ABOUT: Final = Decoder(msgspec.json.Decoder(_About).decode)
_END: Final = Decoder(msgspec.json.Decoder(_End).decode)
_LOST: Final = Decoder(msgspec.json.Decoder(dict[str, int]).decode)
_STOPS: Final = Decoder(msgspec.json.Decoder(list[_Stop]).decode)


def files_of(path: Path) -> dict[str, Path]:
    """Return the file of each leg, by the leg's name; empty for a file of another program.

    Raises:
        RecordingError: it is no recording, or not finished.
    """
    if path.suffix == PART:
        raise RecordingError(
            f"{path}: is not finished; `gaitd record --finish --output {path.parent}` does that"
        )
    if path.is_dir():
        found = {file.name.removesuffix(OF_LEG): file for file in path.glob(f"*{OF_LEG}")}
        if not found:
            raise RecordingError(
                f"{path}: has no file LEG{OF_LEG}; a folder must be a recording of `gaitd record`"
            )
        return dict(sorted(found.items(), reverse=True))
    if path.suffix.lower() == MCAP:
        raise RecordingError(f"{path}: has no inputs of the observer; name its folder")
    if not path.exists():
        raise RecordingError(f"{path}: No such file or directory")
    metadata = _schema(path).metadata or {}
    return {metadata[LEG].decode(errors="replace"): path} if LEG in metadata else {}


def read(path: Path, leg: str | None = None) -> Read:
    """Read one leg; the first one if None.

    Raises:
        RecordingError: it cannot be used; names file, column, and what is allowed.
    """
    files = files_of(path)
    name = leg or next(iter(files), "")
    if leg is not None and leg not in files:
        raise RecordingError(
            f"{path}: has no leg {leg}, only {', '.join(files) or 'an unnamed one'}"
        )
    file = files.get(name, path)
    schema = _schema(file)
    about, end = _metadata(file, schema)
    # Another program may have taken the five columns of a recording, with its metadata.
    own = OF_RECORDER if about is not None and set(OF_RECORDER) <= set(schema.names) else ()
    _check_columns(file, schema, (*COLUMNS, *own))
    check_row_count(str(file), pq.read_metadata(file).num_rows)
    values = _values(file, (*COLUMNS, *own))
    first, first_step_s, status = 0, None, np.zeros(len(values), dtype=np.int64)
    if own:
        status = values[:, len(COLUMNS)].astype(np.int64)
        first, first_step_s = _start(file, values)
    robot, unused = None, ()
    if about is not None:
        try:
            robot = _robot(file, about)
        except RecordingError as error:
            if own:
                raise
            unused = (("robot", f"not that of the file: {error}"),)
    return Read(
        recording(str(file), values[first:, : len(COLUMNS)], _place(file, first)),
        robot,
        name,
        status[first:],
        (*(() if about is None else _lines(about, end)), *unused),
        first_step_s,
    )


def estimated(inputs: Path) -> Path:
    """Return the file of estimates beside the inputs of a leg: it has the same rows."""
    return inputs.with_name(inputs.name.removesuffix(OF_LEG) + ESTIMATED)


def stays_in(path: Path, leg: str, mode: str) -> Stays:
    """Read the rows in which the service was in a mode, of one leg of a recording.

    Args:
        path: folder or file of `gaitd record`.
        leg: one of `files_of`.
        mode: as the message `estimate` names it.

    Raises:
        RecordingError: it cannot be used; names file, column, and what is allowed.
    """
    inputs = files_of(path)[leg]
    beside = estimated(inputs)
    about, _ = _metadata(inputs, _schema(inputs))
    if about is None:
        raise RecordingError(f"{inputs}: its metadata name no trainer; it is none of gaitd record")
    told = _table(beside, ("cycle", "mode", "time_utc"))
    utc_ns = told["time_utc"].cast(pa.int64()).to_numpy()
    is_in = told["mode"].to_numpy() == mode
    edges = np.flatnonzero(np.diff(np.concatenate(([False], is_in, [False]))))
    found: list[Stay] = []
    if len(edges):
        values, cycles = _values(inputs, COLUMNS), _table(inputs, ("cycle",))["cycle"]
        if cycles != told["cycle"]:
            raise RecordingError(f"{beside}: has other cycles than {inputs.name} beside it")
        for begin, end in zip(edges[0::2].tolist(), edges[1::2].tolist(), strict=True):
            rows = recording(str(inputs), values[begin:end], _place(inputs, begin))
            found.append(Stay(int(utc_ns[begin]), rows))
    duration_s = 1e-9 * float(utc_ns[-1] - utc_ns[0]) if len(utc_ns) else 0.0
    return Stays(about.trainer, about.id, duration_s, tuple(found))


def _schema(file: Path) -> Arrow:
    try:
        return pq.read_schema(file)
    except pa.ArrowInvalid as error:
        raise RecordingError(f"{file}: is no whole Parquet file: {error}") from error
    except OSError as error:
        raise RecordingError(f"{file}: {error.strerror or error}") from error


def _check_columns(file: Path, schema: Arrow, wanted: tuple[str, ...]) -> None:
    missing = [column for column in wanted if column not in schema.names]
    if missing:
        raise RecordingError(
            f"{file}: lacks column {', '.join(missing)}; it has {', '.join(schema.names)}"
        )
    for column in wanted:
        kind = schema.field(column).type
        if not (pa.types.is_floating(kind) or pa.types.is_integer(kind)):
            raise RecordingError(f"{file}: column {column} is {kind}, must be a number")


def _table(file: Path, columns: tuple[str, ...]) -> Arrow:
    try:
        table = pq.read_table(file, columns=list(columns))
    except (pa.ArrowInvalid, OSError) as error:
        raise RecordingError(f"{file}: cannot be read: {error}") from error
    if missing := set(columns) - set(table.column_names):
        raise RecordingError(f"{file}: lacks column {', '.join(sorted(missing))}")
    return table


def _place(file: Path, first: int) -> Place:
    return lambda row: f"{file}: row {first + row + 1}"


def _values(file: Path, columns: tuple[str, ...]) -> NDArray[np.float64]:
    """Return the columns as doubles, NaN where a cell is empty."""
    table = _table(file, columns)
    if len(table) == 0:
        return np.empty((0, len(columns)))
    return np.column_stack([table[name].cast(pa.float64()).to_numpy() for name in columns])


def _metadata(file: Path, schema: Arrow) -> tuple[_About | None, _Ended | None]:
    found = schema.metadata or {}
    try:
        about = _ABOUT.decode(found[ABOUT]) if ABOUT in found else None
        end = None
        if END in found:
            told = _END.decode(found[END])
            lost, stops = _LOST.decode(told.lost.encode()), _STOPS.decode(told.stops.encode())
            end = _Ended(told.ended, lost, stops)
    except RefusedError as error:
        raise RecordingError(f"{file}: its metadata are of another version: {error}") from error
    return about, end


def _robot(file: Path, about: _About) -> Robot:
    try:
        return msgspec.convert(about.robot, Robot)
    except msgspec.ValidationError as error:
        raise RecordingError(f"{file}: its robot cannot be used: {error}") from error


def _start(file: Path, values: NDArray[np.float64]) -> tuple[int, float | None]:
    """Return the first row in which the observer ran, and its step; None: it ran before."""
    complete = np.flatnonzero(~np.isnan(values[:, 1:3]).any(axis=1))
    if not len(complete):
        raise RecordingError(f"{file}: the observer ran in none of its {len(values)} rows")
    first = int(complete[0])
    step_s = float(values[first, -1])
    return first, step_s if first and np.isfinite(step_s) else None


def _lines(about: _About, end: _Ended | None) -> list[tuple[str, str]]:
    trainer = f"{about.trainer}, gaitd {about.gaitd_version}, core {about.core_boot_id}"
    lines = [("recorded", f"{trainer}, id {about.id}")]
    if end is not None:
        lines.append(("ended", end.how))
        lines += [("stop", f"{stop.category} {stop.cause}") for stop in end.stops]
        lines += [("lost", f"{count} messages of {key}") for key, count in sorted(end.lost.items())]
    return lines
