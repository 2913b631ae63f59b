"""Strides of a profile as a table for other programs: CSV, or Parquet where pyarrow is there."""

import csv
import importlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from gaitd_session.store import EXPORTED

Rows = Sequence[tuple[object, ...]]


class ExportError(Exception):
    """A table cannot be written: why, and what to do."""


def export(rows: Rows, file: Path) -> None:
    """Write strides with the columns `EXPORTED`; the format is that of the file's suffix.

    Raises:
        ExportError: another suffix, or Parquet without pyarrow.
        OSError: the file cannot be written.
    """
    write = _WRITERS.get(file.suffix)
    if write is None:
        known = " or ".join(_WRITERS)
        raise ExportError(f"{file}: the suffix is `{file.suffix}`, it must be {known}")
    write(rows, file)


def _write_csv(rows: Rows, file: Path) -> None:
    """Write RFC 4180; an empty cell is a number that is not known."""
    with file.open("w", newline="", encoding="utf-8") as opened:
        table = csv.writer(opened)
        table.writerow(EXPORTED)
        table.writerows(rows)


def _write_parquet(rows: Rows, file: Path) -> None:
    try:
        pyarrow: Any = importlib.import_module("pyarrow")
        parquet: Any = importlib.import_module("pyarrow.parquet")
    except ModuleNotFoundError as error:
        raise ExportError(
            f"{file}: Parquet needs pyarrow, which is not installed;"
            " `pip install 'gaitd-session[parquet]'`, or export to a .csv"
        ) from error
    schema = pyarrow.schema([(name, _parquet_type(pyarrow, name)) for name in EXPORTED])
    columns = zip(*rows, strict=True) if rows else [[] for _ in EXPORTED]
    arrays = [
        pyarrow.array(list(column), type=field.type)
        for column, field in zip(columns, schema, strict=True)
    ]
    parquet.write_table(pyarrow.Table.from_arrays(arrays, schema=schema), file)


def _parquet_type(pyarrow: Any, name: str) -> object:  # noqa: ANN401 - an optional module
    if name in {"profile", "kind", "leg"}:
        return pyarrow.string()
    if name.endswith("_ns") or name in {"session", "block", "is_valid"}:
        return pyarrow.int64()
    return pyarrow.float64()


_WRITERS: Final[dict[str, Callable[[Rows, Path], None]]] = {
    ".csv": _write_csv,
    ".parquet": _write_parquet,
}
