"""Estimates of one leg: an Arrow stream while they come, two Parquet files at the end.

A Parquet file that was killed has no footer and cannot be read. An Arrow stream is a row of
batches, each complete in itself: after a kill all batches that were written can be read.

`LEG.recording.parquet` has the columns of a recording as CSV, so `gaitd replay` reads it, and what
is exported of it as CSV. `LEG.estimates.parquet` has the fields of the message `estimate`, without
covariance; the column of a field of an axis has axis and unit in its name: `hip.patient` is
`hip_patient_nm`. Inputs are doubles, so that a replay gives the same bits; estimates are floats.
"""

import os
from collections.abc import Iterator
from operator import attrgetter
from pathlib import Path
from typing import Any, Final

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq
from gaitd_client import StatusBit, wire
from gaitd_client.wire.fields import QUANTITY
from gaitd_names.joints import JOINTS

from gaitd_record.about import INTEGER_MAX

Arrow = Any
"""A type of pyarrow, which has no annotations."""

STREAM: Final = ".arrows"
RECORDING: Final = ".recording.parquet"
ESTIMATES: Final = ".estimates.parquet"
ENDS: Final = (RECORDING, ESTIMATES)
INPUTS: Final = {
    "hip_angle_rad": "measured_hip_angle_rad",
    "slide_position_m": "measured_slide_position_m",
    "hip_torque_nm": "hip_torque_nm",
    "slide_force_n": "slide_force_n",
}
"""Columns of the recording besides the time, and the column of the stream for each."""
LEFT_OUT: Final = ("core_boot_id", "leg", "status", "covariance")
"""Fields of the message without a column: constant, or large (half of all bytes)."""
_POSITIONS: Final = {"hip": "hip_angle", "slide": "slide_position"}
_EFFORTS: Final = {"hip": "hip_torque", "slide": "slide_force"}
_NAMES: Final = {
    "position": "{position}",
    "innovation": "innovation_{axis}",
    "measured_position": "measured_{position}",
    "effort": "{effort}",
    "artificial": "artificial_{axis}",
    "reference_position": "reference_{position}",
    "assist": "assist_{axis}",
}
"""Names of columns without their unit, by the field of an axis; others are `AXIS_FIELD`."""
DOUBLES: Final = (*INPUTS.values(), "dt_s")
ROW_GROUP_ROWS: Final = 60_000
"""Ten minutes."""
NS_PER_S: Final = 1_000_000_000

_AXIS_SCHEMA: Final = wire.schema(wire.Estimate)["$defs"][wire.AxisEstimate.__name__]["properties"]


def _fields() -> Iterator[tuple[str, str, Arrow]]:
    """Yield the columns of the stream: name, field of the message (`hip.patient`), type."""
    for field in msgspec.structs.fields(wire.Estimate):
        if field.name in JOINTS:
            for one in msgspec.structs.fields(wire.AxisEstimate):
                name = _column_of(field.name, one.name)
                yield name, f"{field.name}.{one.name}", _type_of(name, one)
        elif field.name not in LEFT_OUT:
            yield field.name, field.name, _type_of(field.name, field)


def _column_of(axis: str, field: str) -> str:
    """Return the name of the column of an axis' field; `_std` is its end, as in the message."""
    value, std = field.removesuffix("_std"), "_std" * field.endswith("_std")
    words = {"axis": axis, "position": _POSITIONS[axis], "effort": _EFFORTS[axis]}
    name = _NAMES.get(value, f"{{axis}}_{value}").format(**words)
    quantity = _AXIS_SCHEMA[field].get(QUANTITY)
    if quantity is None:
        return name + std
    unit = getattr(JOINTS[axis], quantity).lower().replace("·", "").replace("/", "_per_")
    return f"{name}_{unit}{std}"


def _type_of(name: str, field: msgspec.structs.FieldInfo) -> Arrow:
    text = str(field.type)
    if name == "status_bits":
        return pa.uint32()
    if "float" in text:
        return pa.float64() if name in DOUBLES else pa.float32()
    return pa.int64() if "int" in text else pa.string()


FIELDS: Final = {name: kind for name, _, kind in _fields()}
"""Columns of the stream."""
_CELLS_OF: Final = attrgetter(*(field for _, field, _ in _fields()))
SCHEMA: Final = pa.schema(list(FIELDS.items()))
LARGEST: Final = {"status_bits": 2**32 - 1}
"""Largest values of the integers that are no int64."""
ESTIMATED: Final = tuple(
    name for name in FIELDS if name not in {*INPUTS.values(), "status_bits", "dt_s"}
)
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
        self._writer = pa.ipc.new_stream(self._file, SCHEMA)
        self._decoder = msgspec.json.Decoder(wire.Estimate)
        self._rows: list[tuple[object, ...]] = []

    def add(self, payload: bytes) -> None:
        """Take a message `estimate`.

        Raises:
            ValueError: it is none.
        """
        cells = _CELLS_OF(self._decoder.decode(payload))
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
        self._writer.write_batch(pa.record_batch(columns, schema=SCHEMA))
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
    if name == "status_bits":
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


def write_parquet(stream: Path, period_ns: int, metadata: dict[bytes, bytes]) -> None:
    """Write both Parquet files of a stream, beside it.

    Args:
        stream: `LEG.arrows`.
        period_ns: of the cycle.
        metadata: of the files.

    Raises:
        OSError: a file cannot be written.
    """
    paths = [stream.with_name(stream.name.removesuffix(STREAM) + end) for end in ENDS]
    drafts = [path.with_name(f"{path.name}.new") for path in paths]
    recording = pa.schema(
        [("time_s", pa.float64())]
        + [(name, pa.float64()) for name in INPUTS]
        + [("dt_s", pa.float64()), ("status", pa.uint32()), ("cycle", pa.int64())],
        metadata=metadata,
    )
    estimated = [(name, FIELDS[name]) for name in ESTIMATED]
    estimates = pa.schema(
        [("time_s", pa.float64()), *estimated, ("status", pa.uint32())], metadata=metadata
    )
    clock = _Clock(period_ns)
    with _parquet(drafts[0], recording) as inputs, _parquet(drafts[1], estimates) as outputs:
        for table in _tables(stream):
            status = table["status_bits"]
            time_s = clock.times_s(table)
            known = _running(table)
            measured = {
                name: [
                    v if k else None for v, k in zip(table[field].to_pylist(), known, strict=True)
                ]
                for name, field in INPUTS.items()
            }
            more = {"dt_s": table["dt_s"], "status": status, "cycle": table["cycle"]}
            inputs.write_table(pa.table({"time_s": time_s, **measured, **more}, schema=recording))
            outputs.write_table(
                pa.table(
                    {"time_s": time_s, **{n: table[n] for n in ESTIMATED}, "status": status},
                    schema=estimates,
                )
            )
    for draft, path in zip(drafts, paths, strict=True):
        with draft.open("rb") as file:
            os.fsync(file.fileno())
        draft.replace(path)


def _parquet(path: Path, schema: Arrow) -> Arrow:
    """Floats by their bytes, other columns by a dictionary: half the size of the defaults."""
    numbers = [field.name for field in schema if pa.types.is_floating(field.type)]
    others = [field.name for field in schema if field.name not in numbers]
    options: dict[str, Any] = {"use_dictionary": others, "use_byte_stream_split": numbers}
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
        for bits, nis in zip(
            table["status_bits"].to_pylist(), table["mean_nis"].to_pylist(), strict=True
        )
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
