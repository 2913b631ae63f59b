"""Recordings in: the CSV of the interface, read fast, and refused with the place named.

Columns by name, any order, extra columns ignored: `time_s, hip_angle_rad, slide_position_m,
hip_torque_nm, slide_force_n`. The row at time t holds the positions sampled at t, and the torque
and force that acted from the row before until t. An empty cell is a missing sample.

What a person gets wrong is looked for here, because the observer would accept it in silence:
degrees for radians, millimetres for metres, milliseconds for seconds, rows out of order.
"""

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

COLUMNS: Final = (
    "time_s",
    "hip_angle_rad",
    "slide_position_m",
    "hip_torque_nm",
    "slide_force_n",
)
CHUNK_LINES: Final = 65536
IMPLAUSIBLE_RATIO: Final = 0.01
"""Share of samples beyond the plausible range that makes a unit wrong; fewer are glitches."""

Progress = Callable[[float], None]
"""Told the share done, 0 to 1."""


class RecordingError(Exception):
    """A recording cannot be used: names file, line, column and value, and what is allowed."""


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """What an observer needs of a recording; NaN is a missing sample."""

    source: str
    time_s: NDArray[np.float64]
    """Shape (n,), strictly increasing [s]."""
    position: NDArray[np.float64]
    """Shape (n, 2): hip angle [rad], slide position [m], sampled at time_s."""
    effort: NDArray[np.float64]
    """Shape (n, 2): hip torque [N·m], slide force [N], which acted from the row before."""

    @property
    def duration_s(self) -> float:
        """From the first row to the last."""
        return float(self.time_s[-1] - self.time_s[0])


class _Plausible(NamedTuple):
    """Beyond `limit` in more than IMPLAUSIBLE_RATIO of the samples, `suspicion` is said."""

    column: str
    limit: float
    suspicion: str


PLAUSIBLE: Final = (
    _Plausible("hip_angle_rad", 2.2, "degrees where radians should be"),
    _Plausible("slide_position_m", 5.0, "millimetres where metres should be"),
    _Plausible("hip_torque_nm", 500.0, "millinewton metres where newton metres should be"),
    _Plausible("slide_force_n", 10_000.0, "millinewtons where newtons should be"),
)
PERIOD_MAX_S: Final = 0.5
"""Of the median step between rows; more looks like another unit of time."""


def read_csv(path: Path, progress: Progress | None = None) -> Recording:
    """Read a recording from a CSV file.

    Raises:
        RecordingError: the file cannot be read, lacks a column, is empty, or holds something that
            is no finite number, goes back in time, or is not in the unit of its column.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            indexes = _column_indexes(path, file.readline())
            size = max(path.stat().st_size, 1)
            chunks: list[NDArray[np.float64]] = []
            line, done = 2, 0
            while lines := list(islice(file, CHUNK_LINES)):
                chunks.append(_numbers(path, lines, indexes, line))
                line += len(lines)
                done += sum(map(len, lines))
                if progress:
                    progress(min(done / size, 1.0))
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: is not a text file of comma-separated values") from error
    values = np.concatenate(chunks) if chunks else np.empty((0, len(COLUMNS)))
    return recording(str(path), values)


def recording(source: str, values: NDArray[np.float64]) -> Recording:
    """Check numbers, shape (n, 5) in the order of COLUMNS, and make them a recording.

    Raises:
        RecordingError: see `read_csv`; rows are named by their number, from 1.
    """
    if len(values) == 0:
        raise RecordingError(f"{source}: holds no rows, only its header")
    _check_time(source, values[:, 0])
    _check_finite(source, values)
    for index, column in enumerate(COLUMNS[1:], start=1):
        _check_plausible(source, column, values[:, index])
    return Recording(
        source,
        np.ascontiguousarray(values[:, 0]),
        np.ascontiguousarray(values[:, 1:3]),
        np.ascontiguousarray(values[:, 3:5]),
    )


def _column_indexes(path: Path, header: str) -> tuple[int, ...]:
    names = [name.strip() for name in next(csv.reader([header]), [])]
    if not any(names):
        raise RecordingError(f"{path}: is empty; its first line must name the columns")
    missing = [column for column in COLUMNS if column not in names]
    if missing:
        hint = "; columns are separated by commas" if ";" in header or "\t" in header else ""
        raise RecordingError(
            f"{path}:1: lacks column {', '.join(missing)}; it has {', '.join(names)}{hint}"
        )
    twice = [column for column in COLUMNS if names.count(column) > 1]
    if twice:
        raise RecordingError(f"{path}:1: names column {', '.join(twice)} more than once")
    return tuple(names.index(column) for column in COLUMNS)


def _numbers(
    path: Path, lines: list[str], indexes: tuple[int, ...], first_line: int
) -> NDArray[np.float64]:
    """Numbers of some lines, shape (n, 5); lines that are blank are left out."""
    filled = [line for line in lines if not line.isspace()]
    if not filled:
        return np.empty((0, len(indexes)))
    try:
        return np.loadtxt(
            filled, delimiter=",", usecols=indexes, comments=None, quotechar='"', ndmin=2
        )
    except ValueError:
        # Something is missing or wrong: look at each cell, which also finds out where.
        return _numbers_cell_by_cell(path, lines, indexes, first_line)


def _numbers_cell_by_cell(
    path: Path, lines: Sequence[str], indexes: tuple[int, ...], first_line: int
) -> NDArray[np.float64]:
    rows: list[list[float]] = []
    for number, cells in enumerate(csv.reader(lines), start=first_line):
        if not any(cell.strip() for cell in cells) and len(cells) <= 1:
            continue
        if len(cells) <= max(indexes):
            raise RecordingError(
                f"{path}:{number}: has {len(cells)} cells, too few for column "
                f"{COLUMNS[indexes.index(max(indexes))]}"
            )
        rows.append(
            [
                _number(path, number, column, cells[index])
                for column, index in zip(COLUMNS, indexes, strict=True)
            ]
        )
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(indexes))


def _number(path: Path, line: int, column: str, cell: str) -> float:
    text = cell.strip()
    if not text:
        return np.nan
    try:
        return float(text)
    except ValueError as error:
        raise RecordingError(f"{path}:{line}: {column} is {text!r}, not a number") from error


def _check_time(source: str, time_s: NDArray[np.float64]) -> None:
    unknown = np.flatnonzero(~np.isfinite(time_s))
    if len(unknown):
        raise RecordingError(f"{source}: row {unknown[0] + 1} has no time_s")
    step_s = np.diff(time_s)
    back = np.flatnonzero(step_s <= 0)
    if len(back):
        row = int(back[0])
        raise RecordingError(
            f"{source}: time_s goes from {time_s[row]:.15g} to {time_s[row + 1]:.15g} in row "
            f"{row + 2}; it must increase from row to row"
        )
    if len(step_s) and np.median(step_s) > PERIOD_MAX_S:
        raise RecordingError(
            f"{source}: time_s steps by {np.median(step_s):.6g}; that looks like milliseconds or "
            "smaller units where seconds should be"
        )


def _check_finite(source: str, values: NDArray[np.float64]) -> None:
    rows, columns = np.nonzero(np.isinf(values))
    if len(rows):
        raise RecordingError(
            f"{source}: row {rows[0] + 1} has an infinite {COLUMNS[columns[0]]}; "
            "a missing sample is an empty cell"
        )


def _check_plausible(source: str, column: str, values: NDArray[np.float64]) -> None:
    known = values[~np.isnan(values)]
    if len(known) == 0:
        raise RecordingError(f"{source}: {column} is empty in every row")
    plausible = next(row for row in PLAUSIBLE if row.column == column)
    beyond = np.abs(known) > plausible.limit
    if np.count_nonzero(beyond) > IMPLAUSIBLE_RATIO * len(known):
        worst = known[np.argmax(np.abs(known))]
        raise RecordingError(
            f"{source}: {column} reaches {worst:.6g} and is beyond ±{plausible.limit:g} in "
            f"{np.count_nonzero(beyond)} of {len(known)} rows; that looks like "
            f"{plausible.suspicion}"
        )
