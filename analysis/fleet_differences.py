"""Differences between two results of the same recordings: of two robot files, or two versions.

Two results belong together if leg and content of the recording are the same; the key in their names
is another one. The patient's effort is compared in those rows in which both are valid for the axis.
"""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
from gaitd_names.measured import Validity

from analysis.drawing import AXES, Axis
from analysis.fleet import Arrow, Work
from analysis.recording import RecordingError

NAME: Final = "estimate_differences"
"""Name of the table's files, without suffix."""
ALL: Final = "all"
PATIENT: Final = {"hip": "hip_patient_nm", "slide": "slide_patient_n"}


class _Sums(NamedTuple):
    """Sums over rows: what recordings can be pooled by."""

    rows: int
    ok_before: int
    ok_after: int
    both: int
    difference_si: float
    square_si: float
    variance_before_si: float
    variance_after_si: float


class Difference(NamedTuple):
    """One axis of one leg of a recording, or of all. None: no row is valid in both."""

    recording: str
    """Its name and folder; `all`: pooled by rows, over all legs."""
    leg: str
    axis: str
    row_count: int
    ok_before_ratio: float
    """Share of the rows in which the axis is valid."""
    ok_after_ratio: float
    both_ok_count: int
    difference_mean_si: float | None
    """Patient's effort, after minus before: N·m, N. Like all that follows over the rows in which
    both are valid."""
    difference_rms_si: float | None
    sigma_before_si: float | None
    """Root of the mean variance of the patient's effort."""
    sigma_after_si: float | None


SCHEMA: Final = pa.schema(
    [
        (name, pa.string() if kind is str else pa.int64() if kind is int else pa.float64())
        for name, kind in Difference.__annotations__.items()
    ]
)


def before(after: Path, folder: Path) -> Path:
    """Return the other result of a recording.

    Args:
        after: a result.
        folder: of the other results; it may be the same one.

    Raises:
        RecordingError: there is none, or there are several.
    """
    *_, leg, content, key, _, _ = after.name.split(".")
    found: dict[str, Path] = {}
    for file in sorted(folder.glob(f"*.{leg}.{content}.*.{Work.ESTIMATES}.parquet")):
        found[file.name.split(".")[-3]] = file
    same = found.pop(key, None)
    if not found:
        only = f", only that of the same version and robot file: {same}" if same else ""
        raise RecordingError(
            f"{folder}: has no other result of the recording of {after.name}{only};"
            " `gaitd fleet estimate` with the other robot file or version makes it"
        )
    if len(found) > 1:
        names = ", ".join(file.name for file in found.values())
        raise RecordingError(
            f"{folder}: has several results of the recording of {after.name}: {names};"
            " a folder with those of one version and one robot file is needed"
        )
    return next(iter(found.values()))


def differences(
    results: Iterable[tuple[Path, Path]], folder: Path
) -> tuple[list[Difference], list[str]]:
    """Compare results with the others of the same recordings.

    Args:
        results: recording, and its result.
        folder: of the other results.

    Returns: two rows for each result, one for each axis, in their order, then two of all; and what
    is wrong with those that cannot be compared.
    """
    made: list[Difference] = []
    errors: list[str] = []
    all_sums: dict[str, list[_Sums]] = {axis.name: [] for axis in AXES}
    for recording, result in results:
        try:
            of_axes = _sums(before(result, folder), result)
        except RecordingError as error:
            errors.append(str(error))
            continue
        name = "/".join(recording.with_suffix("").parts[-2:])
        for axis, sums in zip(AXES, of_axes, strict=True):
            all_sums[axis.name].append(sums)
            made.append(_difference(name, result.name.split(".")[-5], axis, sums))
    for axis in AXES if made else ():
        pooled = _Sums._make(map(sum, zip(*all_sums[axis.name], strict=True)))
        made.append(_difference(ALL, "", axis, pooled))
    return made, errors


def _sums(old: Path, new: Path) -> list[_Sums]:
    first, second = _table(old), _table(new)
    if not first["time_s"].equals(second["time_s"]):
        raise RecordingError(f"{new}: has other rows than {old}")
    made: list[_Sums] = []
    for axis in AXES:
        name = PATIENT[axis.name]
        ok = [table[f"{axis.name}_validity"].to_numpy() == Validity.OK for table in (first, second)]
        both = ok[0] & ok[1]
        effort, std = (
            [table[column].to_numpy()[both] for table in (first, second)]
            for column in (name, f"{name}_std")
        )
        by = effort[1] - effort[0]
        made.append(
            _Sums(
                rows=len(both),
                ok_before=int(np.count_nonzero(ok[0])),
                ok_after=int(np.count_nonzero(ok[1])),
                both=int(np.count_nonzero(both)),
                difference_si=float(np.sum(by)),
                square_si=float(np.sum(by**2)),
                variance_before_si=float(np.sum(std[0] ** 2)),
                variance_after_si=float(np.sum(std[1] ** 2)),
            )
        )
    return made


def _table(file: Path) -> Arrow:
    columns = ["time_s"]
    for axis in AXES:
        name = PATIENT[axis.name]
        columns += [name, f"{name}_std", f"{axis.name}_validity"]
    try:
        table = pq.read_table(file, columns=columns)
    except (pa.ArrowInvalid, OSError) as error:
        raise RecordingError(f"{file}: cannot be read: {error}") from error
    if missing := set(columns) - set(table.column_names):
        raise RecordingError(f"{file}: lacks column {', '.join(sorted(missing))}")
    return table


def _difference(recording: str, leg: str, axis: Axis, sums: _Sums) -> Difference:
    def mean(total: float) -> float | None:
        return total / sums.both if sums.both else None

    def root(total: float) -> float | None:
        return math.sqrt(total / sums.both) if sums.both else None

    return Difference(
        recording,
        leg,
        axis.name,
        sums.rows,
        sums.ok_before / sums.rows,
        sums.ok_after / sums.rows,
        sums.both,
        mean(sums.difference_si),
        root(sums.square_si),
        root(sums.variance_before_si),
        root(sums.variance_after_si),
    )


def write(found: Sequence[Difference], folder: Path) -> None:
    """Write `estimate_differences.parquet` and `.csv`.

    Raises:
        OSError: a file cannot be written.
    """
    table = pa.Table.from_pylist([one._asdict() for one in found], SCHEMA)
    pq.write_table(table, folder / f"{NAME}.parquet")
    pyarrow.csv.write_csv(table, folder / f"{NAME}.csv")
