"""Columns of a recording's tables: types here, units and meanings from the messages' schemas.

Each column has the metadata `unit` and `meaning` (`gaitd_client.wire.columns`). `time_utc` is the
time of the cycle's SYNC; `core_boot_id` and `cycle` join the tables of a recording, and those of
several.
"""

from operator import attrgetter
from typing import Any, Final

import pyarrow as pa
from gaitd_client import wire
from gaitd_client.wire.columns import ESTIMATE_COLUMNS, Column, columns_of

Arrow = Any
"""A type of pyarrow, which has no annotations."""

INPUTS: Final = {
    "hip_angle_rad": "measured_hip_angle_rad",
    "slide_position_m": "measured_slide_position_m",
    "hip_torque_nm": "hip_torque_nm",
    "slide_force_n": "slide_force_n",
}
"""Columns of the recording besides the time, and the column of the stream for each."""
DOUBLES: Final = (*INPUTS.values(), "dt_s")
LEFT_OUT: Final = ("core_boot_id", "leg", "status", "covariance", "time_s")
"""Columns that are not in the stream: constant, large (half of all bytes), or made at the end."""
UTC: Final = pa.timestamp("ns", tz="UTC")
STATUS: Final = "status_bits"

_EVENT: Final = columns_of(wire.Event)


def _field(column: Column, kind: Arrow, name: str = "") -> Arrow:
    return pa.field(name or column.name, kind, metadata=column.metadata)


def _type_of(column: Column) -> Arrow:
    if column.name == STATUS:
        return pa.uint32()
    if column.kind == "number":
        return pa.float64() if column.name in DOUBLES else pa.float32()
    return pa.int64() if column.kind == "integer" else pa.string()


_STREAMED: Final = [one for name, one in ESTIMATE_COLUMNS.items() if name not in LEFT_OUT]
STREAM_SCHEMA: Final = pa.schema([_field(one, _type_of(one)) for one in _STREAMED])
"""Columns of the stream of a leg."""
FIELDS: Final = {field.name: field.type for field in STREAM_SCHEMA}
CELLS_OF: Final = attrgetter(*(one.field for one in _STREAMED))
"""Returns the cells of a row, of a message."""

_HEAD: Final = (
    _field(ESTIMATE_COLUMNS["time_s"], pa.float64()),
    _field(ESTIMATE_COLUMNS["sample_time_ns"], UTC, "time_utc"),
    _field(ESTIMATE_COLUMNS["core_boot_id"], pa.string()),
    STREAM_SCHEMA.field("cycle"),
)
_BITS: Final = _field(ESTIMATE_COLUMNS["status"], pa.uint32())
_NOT_ESTIMATED: Final = {*INPUTS.values(), "dt_s", STATUS, "sample_time_ns", "cycle"}
ESTIMATED: Final = tuple(name for name in FIELDS if name not in _NOT_ESTIMATED)
"""Columns of the estimates that are those of the stream."""
RECORDING_SCHEMA: Final = pa.schema(
    [
        *_HEAD,
        *(STREAM_SCHEMA.field(field).with_name(name) for name, field in INPUTS.items()),
        STREAM_SCHEMA.field("dt_s"),
        _BITS,
    ]
)
ESTIMATES_SCHEMA: Final = pa.schema(
    [*_HEAD, *(STREAM_SCHEMA.field(name) for name in ESTIMATED), _BITS]
)
EVENTS_SCHEMA: Final = pa.schema(
    [
        _field(_EVENT["time_ns"], UTC, "time_utc"),
        *(
            _field(_EVENT[name], _type_of(_EVENT[name]))
            for name in ("core_boot_id", "cycle", "id", "priority", "kind", "code", "cause")
        ),
        _field(_EVENT["subject"], pa.string()),
        _field(_EVENT["values"], pa.string(), "values_json"),
        _field(_EVENT["said"], pa.string()),
    ]
)
