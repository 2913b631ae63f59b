"""Input of recordings: the CSV format, read fast, and refused with the place of an error.

Columns are found by name, in any order, extra columns are ignored: `time_s, hip_angle_rad,
slide_position_m, hip_torque_nm, slide_force_n`. The row at time t holds the positions sampled at t,
and the torque and force that acted from the previous row to t. An empty cell is a missing sample.

Times may begin anywhere. Those of the epoch (1.7e9 s) are doubles 0.24 µs apart: the steps between
rows are off by so much, and estimates by less than 0.01 of their sigma.

Typical errors of an operator are detected here, because the observer would accept them silently:
degrees for radians, millimetres for metres, milliseconds for seconds, rows out of order.
"""

import contextlib
import csv
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
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
ROWS_MAX: Final = 2_000_000
"""Longest recording: 5.5 hours at 10 ms. Replay takes 0.8 kB a row, with its smoother 1.6 kB."""
IMPLAUSIBLE_RATIO: Final = 0.01
"""Share of samples beyond the plausible range that means a wrong unit; fewer are glitches."""
IMPLAUSIBLE_ROWS: Final = 50
"""The same for this many moving rows in a row: half a second, longer than a glitch."""

_EMPTY_CELL: Final = re.compile(r"(?:(?<=,)|^)[ \t]*(?=,|[\r\n]*\Z)")

Progress = Callable[[float], None]
"""Called with the share done, 0 to 1."""
Place = Callable[[int], str]
"""Returns the place of row `index`, from 0: file and line, or file and row."""


class RecordingError(Exception):
    """A recording cannot be used: names file, line, column and value, and what is allowed."""


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Inputs of an observer; NaN is a missing sample."""

    source: str
    time_s: NDArray[np.float64]
    """Shape (n,), strictly increasing [s]."""
    position: NDArray[np.float64]
    """Shape (n, 2): hip angle [rad], slide position [m], sampled at time_s."""
    effort: NDArray[np.float64]
    """Shape (n, 2): hip torque [N·m], slide force [N], which acted from the previous row to this
    one."""

    @property
    def duration_s(self) -> float:
        """Time from the first row to the last."""
        return float(self.time_s[-1] - self.time_s[0])


class _Plausible(NamedTuple):
    """Limit of a column: `suspicion` is reported if over IMPLAUSIBLE_RATIO of samples exceed it."""

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
PERIOD_MIN_S: Final = 0.0002
"""Limit of the median step between rows; beyond, another unit of time is likely."""


def read_csv(path: Path, progress: Progress | None = None) -> Recording:
    """Read a recording from a CSV file.

    Raises:
        RecordingError: the file cannot be read, lacks a column, is empty, or holds something that
            is no finite number, goes back in time, or is not in the unit of its column.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            header = _header(path, file.readline())
            size = max(path.stat().st_size, 1)
            chunks: list[NDArray[np.float64]] = []
            line, done = 2, 0
            while lines := list(islice(file, CHUNK_LINES)):
                chunks.append(_numbers(path, lines, header, line))
                line += len(lines)
                check_row_count(str(path), sum(map(len, chunks)))
                done += sum(map(len, lines))
                if progress:
                    progress(min(done / size, 1.0))
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(f"{path}: is not a text file of comma-separated values") from error
    values = np.concatenate(chunks) if chunks else np.empty((0, len(COLUMNS)))
    return recording(str(path), values, lambda row: f"{path}:{_line_of(path, row)}")


def recording(source: str, values: NDArray[np.float64], place: Place | None = None) -> Recording:
    """Check numbers, shape (n, 5) in the order of COLUMNS, and convert them to a recording.

    Args:
        source: its name in messages.
        values: NaN is a missing sample; no time may be missing.
        place: names a row in messages; by default its number, from 1.

    Raises:
        RecordingError: see `read_csv`.
    """
    if len(values) == 0:
        raise RecordingError(f"{source}: holds no rows, only its header")
    where = place or partial(_row_of, source)
    _check_time(source, values[:, 0], where)
    _check_finite(values, where)
    for index, column in enumerate(COLUMNS[1:], start=1):
        _check_plausible(source, column, values[:, index], where)
    return Recording(
        source,
        np.ascontiguousarray(values[:, 0]),
        np.ascontiguousarray(values[:, 1:3]),
        np.ascontiguousarray(values[:, 3:5]),
    )


def check_row_count(source: str, count: int) -> None:
    """Check the number of rows, before more memory is taken than a computer has.

    Raises:
        RecordingError: more than ROWS_MAX.
    """
    if count > ROWS_MAX:
        raise RecordingError(
            f"{source}: has more than {ROWS_MAX} rows, which is the most that fits into memory; "
            "split it, each part is estimated on its own after its first seconds of motion"
        )


def _row_of(source: str, row: int) -> str:
    return f"{source}: row {row + 1}"


def _line_of(path: Path, row: int) -> int:
    """Line of a row, counted as in `_numbers`: blank lines are no rows."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        filled = (number for number, line in enumerate(file, 1) if number > 1 and line.strip())
        return next(islice(filled, row, None))


class _Header(NamedTuple):
    """Positions of the needed columns, in the order of COLUMNS, and the number of columns."""

    indexes: tuple[int, ...]
    cell_count: int


def _header(path: Path, header: str) -> _Header:
    names = [name.strip() for name in next(csv.reader([header], skipinitialspace=True), [])]
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
    return _Header(tuple(names.index(column) for column in COLUMNS), len(names))


def _numbers(path: Path, lines: list[str], header: _Header, first_line: int) -> NDArray[np.float64]:
    """Parse lines into numbers, shape (n, 5); blank lines are left out."""
    filled = [line for line in lines if not line.isspace()]
    if not filled:
        return np.empty((0, len(COLUMNS)))
    if all(line.count(",") == header.cell_count - 1 for line in filled):
        # A ValueError means a missing or wrong cell: gaps are filled first, then each cell is
        # checked,
        # which also gives the place.
        with contextlib.suppress(ValueError):
            return _loaded(filled, header)
        with contextlib.suppress(ValueError):
            return _loaded(_gaps_named(filled), header)
    return _numbers_cell_by_cell(path, lines, header, first_line)


def _loaded(lines: list[str], header: _Header) -> NDArray[np.float64]:
    return np.loadtxt(
        lines, delimiter=",", usecols=header.indexes, comments=None, quotechar='"', ndmin=2
    )


def _gaps_named(lines: list[str]) -> list[str]:
    """Write empty cells as `nan`, which the fast reader accepts."""
    return [_EMPTY_CELL.sub("nan", line) for line in lines]


def _numbers_cell_by_cell(
    path: Path, lines: Sequence[str], header: _Header, first_line: int
) -> NDArray[np.float64]:
    rows: list[list[float]] = []
    for number, cells in enumerate(csv.reader(lines, skipinitialspace=True), start=first_line):
        if not any(cell.strip() for cell in cells) and len(cells) <= 1:
            continue
        _check_count(path, number, cells, header)
        rows.append(
            [
                _number(path, number, column, cells[index])
                for column, index in zip(COLUMNS, header.indexes, strict=True)
            ]
        )
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(COLUMNS))


def _check_count(path: Path, line: int, cells: list[str], header: _Header) -> None:
    """Check the number of cells; empty cells behind the last column are allowed."""
    wanted = header.cell_count
    if len(cells) < wanted:
        raise RecordingError(f"{path}:{line}: has {len(cells)} cells, too few for {wanted} columns")
    if any(cell.strip() for cell in cells[wanted:]):
        raise RecordingError(
            f"{path}:{line}: has {len(cells)} cells, too many for {wanted} columns; "
            "decimals are written with a point"
        )


def _number(path: Path, line: int, column: str, cell: str) -> float:
    text = cell.strip()
    if not text:
        return np.nan
    try:
        return float(text if "_" not in text else "no number")
    except ValueError as error:
        raise RecordingError(
            f"{path}:{line}: {column} is {text!r}, not a number; a missing sample is an empty cell"
        ) from error


def _check_time(source: str, time_s: NDArray[np.float64], where: Place) -> None:
    unknown = np.flatnonzero(~np.isfinite(time_s))
    if len(unknown):
        row = int(unknown[0])
        raise RecordingError(
            f"{where(row)}: has no time_s but {time_s[row]}; every row needs a finite number"
        )
    step_s = np.diff(time_s)
    back = np.flatnonzero(step_s <= 0)
    if len(back):
        row = int(back[0])
        raise RecordingError(
            f"{where(row + 1)}: time_s goes from {time_s[row]:.15g} to {time_s[row + 1]:.15g}; "
            "it must increase from row to row"
        )
    _check_period(source, step_s)


def _check_period(source: str, step_s: NDArray[np.float64]) -> None:
    period_s = float(np.median(step_s)) if len(step_s) else PERIOD_MAX_S
    if PERIOD_MIN_S <= period_s <= PERIOD_MAX_S:
        return
    units = (
        "milliseconds or smaller units" if period_s > PERIOD_MAX_S else "minutes or larger units"
    )
    raise RecordingError(
        f"{source}: time_s steps by {period_s:.6g} (median), allowed is {PERIOD_MIN_S:g} to "
        f"{PERIOD_MAX_S:g}; that looks like {units} where seconds should be"
    )


def _check_finite(values: NDArray[np.float64], where: Place) -> None:
    rows, columns = np.nonzero(np.isinf(values))
    if len(rows):
        raise RecordingError(
            f"{where(int(rows[0]))}: {COLUMNS[columns[0]]} is infinite; "
            "a missing sample is an empty cell"
        )


def _check_plausible(source: str, column: str, values: NDArray[np.float64], where: Place) -> None:
    known = ~np.isnan(values)
    if not known.any():
        raise RecordingError(f"{source}: {column} is empty in every row")
    plausible = next(row for row in PLAUSIBLE if row.column == column)
    beyond = np.abs(values) > plausible.limit
    count, of = int(np.count_nonzero(beyond)), int(np.count_nonzero(known))
    if count <= IMPLAUSIBLE_RATIO * of and not _moves_beyond(values, beyond):
        return
    first = int(np.argmax(beyond))
    worst = values[int(np.argmax(np.where(known, np.abs(values), 0.0)))]
    raise RecordingError(
        f"{where(first)}: {column} is {values[first]:.6g}, reaches {worst:.6g} and is beyond "
        f"±{plausible.limit:g} in {count} of {of} rows; that looks like {plausible.suspicion}"
    )


def _moves_beyond(values: NDArray[np.float64], beyond: NDArray[np.bool_]) -> bool:
    """True if some stretch of rows is all beyond and moves: neither a glitch nor a dead sensor."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], beyond, [False]))))
    return any(
        end - begin >= IMPLAUSIBLE_ROWS and np.ptp(values[begin:end]) > 0.0
        for begin, end in zip(edges[0::2].tolist(), edges[1::2].tolist(), strict=True)
    )
