"""Estimates of one leg: an Arrow stream while they come, two Parquet files at the end.

A Parquet file that was killed has no footer and cannot be read. An Arrow stream is a row of
batches, each complete in itself: after a kill all batches that were written can be read.

`LEG.recording.parquet` has the columns of a recording as CSV, so `gaitd replay` reads it, and what
is exported of it as CSV. `LEG.estimates.parquet` has the fields of the message `estimate`, without
covariance. `columns.py` has the columns of both. Inputs are doubles, so that a replay gives the
same bits; estimates are floats.
"""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq
from gaitd_client import StatusBit, wire

from gaitd_record.about import INTEGER_MAX, About
from gaitd_record.columns import (
    CELLS_OF,
    ESTIMATED,
    ESTIMATES_SCHEMA,
    FIELDS,
    INPUTS,
    RECORDING_SCHEMA,
    STATUS,
    STREAM_SCHEMA,
    Arrow,
)
from gaitd_record.disk import replace

STREAM: Final = ".arrows"
RECORDING: Final = ".recording.parquet"
ESTIMATES: Final = ".estimates.parquet"
ENDS: Final = (RECORDING, ESTIMATES)
ROW_GROUP_ROWS: Final = 60_000
"""Ten minutes."""
NS_PER_S: Final = 1_000_000_000

COUNTS: Final = ("time_utc", "cycle", "seq")
"""Columns that grow by the same from row to row."""
LARGEST: Final = {STATUS: 2**32 - 1}
"""Largest values of the integers that are no int64."""
NOT_RUNNING: Final = (
    1 << list(StatusBit).index(StatusBit.WARM_UP),
    1 << list(StatusBit).index(StatusBit.UNREFERENCED),
)
"""The only bit of a row before the observer has started."""


class LegStream:
    """Estimates of one leg on their way to the disk."""

    def __init__(self, path: Path) -> None:
        """Create the file.

        Raises:
            OSError: it cannot be written.
        """
        self._file = path.open("xb")
        self._writer = pa.ipc.new_stream(self._file, STREAM_SCHEMA)
        self._decoder = msgspec.json.Decoder(wire.Estimate)
        self._rows: list[tuple[object, ...]] = []

    def add(self, payload: bytes) -> None:
        """Take a message `estimate`.

        Raises:
            ValueError: it is none.
        """
        cells = CELLS_OF(self._decoder.decode(payload))
        self._rows.append(tuple(map(_cell, FIELDS, cells)))

    def sync(self) -> None:
        """Bring all rows to the disk.

        Raises:
            OSError: they cannot be written.
        """
        if not self._rows:
            return
        rows, self._rows = self._rows, []
        columns = [
            pa.array(cells, kind)
            for cells, kind in zip(zip(*rows, strict=True), FIELDS.values(), strict=True)
        ]
        self._writer.write_batch(pa.record_batch(columns, schema=STREAM_SCHEMA))
        self._file.flush()
        os.fdatasync(self._file.fileno())

    def close(self) -> None:
        """Write the end of the stream.

        Raises:
            OSError: it cannot be written.
        """
        try:
            self.sync()
            self._writer.close()
        finally:
            self._file.close()


def _cell(name: str, value: object) -> object:
    if name == STATUS:
        value = int(str(value), 16)
    if isinstance(value, int) and not 0 <= value <= LARGEST.get(name, INTEGER_MAX):
        raise ValueError(f"{name}: {value} is out of range")
    return value


def batches(path: Path) -> Iterator[Arrow]:
    """Yield what a stream has, up to its end or to where it is torn."""
    with path.open("rb") as file:
        try:
            reader = pa.ipc.open_stream(file)
            while True:
                batch = reader.read_next_batch()
                batch.validate(full=True)
                yield batch
        except (StopIteration, pa.ArrowInvalid, OSError):
            return


def write_parquet(stream: Path, about: About, metadata: dict[bytes, bytes]) -> None:
    """Write both Parquet files of a stream, beside it.

    Args:
        stream: `LEG.arrows`.
        about: of the recording.
        metadata: of the files.

    Raises:
        OSError: a file cannot be written.
    """
    paths = [stream.with_name(stream.name.removesuffix(STREAM) + end) for end in ENDS]
    drafts = [path.with_name(f"{path.name}.new") for path in paths]
    recording = RECORDING_SCHEMA.with_metadata(metadata)
    estimates = ESTIMATES_SCHEMA.with_metadata(metadata)
    clock = _Clock(about.period_ns)
    with parquet(drafts[0], recording) as inputs, parquet(drafts[1], estimates) as outputs:
        for table in _tables(stream):
            known = _running(table)
            both = {
                "time_s": clock.times_s(table),
                "time_utc": table["sample_time_ns"],
                "core_boot_id": [about.core_boot_id] * len(table),
                "cycle": table["cycle"],
                "status": table[STATUS],
            }
            measured = {
                name: [
                    v if k else None for v, k in zip(table[field].to_pylist(), known, strict=True)
                ]
                for name, field in INPUTS.items()
            }
            inputs.write_table(
                pa.table({**both, **measured, "dt_s": table["dt_s"]}, schema=recording)
            )
            outputs.write_table(
                pa.table({**both, **{n: table[n] for n in ESTIMATED}}, schema=estimates)
            )
    for draft, path in zip(drafts, paths, strict=True):
        replace(draft, path)


def parquet(path: Path, schema: Arrow) -> Arrow:
    """Open a file: floats by their bytes, counts by differences, others by a dictionary.

    Half the size of the defaults.
    """
    numbers = [field.name for field in schema if pa.types.is_floating(field.type)]
    counts = [name for name in COUNTS if name in schema.names]
    others = [name for name in schema.names if name not in {*numbers, *counts}]
    options: dict[str, Any] = {
        "use_dictionary": others,
        "use_byte_stream_split": numbers,
        "column_encoding": dict.fromkeys(counts, "DELTA_BINARY_PACKED"),
    }
    return pq.ParquetWriter(path, schema, compression="zstd", **options)


def _tables(stream: Path) -> Iterator[Arrow]:
    """Yield the rows in large parts, as a Parquet file wants them."""
    waiting: list[Arrow] = []
    row_count = 0
    for batch in batches(stream):
        waiting.append(batch)
        row_count += batch.num_rows
        if row_count >= ROW_GROUP_ROWS:
            yield pa.Table.from_batches(waiting).combine_chunks()
            waiting, row_count = [], 0
    if waiting:
        yield pa.Table.from_batches(waiting).combine_chunks()


def _running(table: Arrow) -> list[bool]:
    """Return for each row whether the observer ran: before, its axes may not be referenced."""
    return [
        bits not in NOT_RUNNING or nis is not None
        for bits, nis in zip(table[STATUS].to_pylist(), table["mean_nis"].to_pylist(), strict=True)
    ]


class _Clock:
    """Time of each row since the first, from the measured steps; over a gap from the cycles.

    Steps are whole nanoseconds, and a time in s is rounded by less than half of one: the steps can
    be found again exactly. The UTC times are not used, because they may jump.
    """

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._time_ns = 0
        self._cycle: int | None = None

    def times_s(self, table: Arrow) -> list[float]:
        """Return the times of the rows that come next."""
        times: list[float] = []
        for cycle, dt_s in zip(table["cycle"].to_pylist(), table["dt_s"].to_pylist(), strict=True):
            if self._cycle is not None:
                grid_ns = (cycle - self._cycle) * self._period_ns
                step_ns = grid_ns if dt_s is None else round(dt_s * NS_PER_S)
                is_next = abs(step_ns - grid_ns) < self._period_ns / 2
                self._time_ns += max(step_ns if is_next else grid_ns, 1)
            self._cycle = cycle
            times.append(self._time_ns * 1e-9)
        return times
