"""Columns of a recording's tables: names, types, units and meanings, from the messages' schemas.

Each column has the metadata `unit` and `meaning`. The meaning is the description of the message's
field. The unit is the joint's where the schema says `x-quantity`, else the end of the field's name;
`1` is a number without one, and a text has an empty one.

The column of a field of an axis has axis and unit in its name: `hip.patient` is `hip_patient_nm`.
`time_utc` is the time of the cycle's SYNC; `core_boot_id` and `cycle` join the tables of a
recording, and those of several.
"""

from collections.abc import Iterator
from operator import attrgetter
from typing import Any, Final

import msgspec
import pyarrow as pa
from gaitd_client import StatusBit, wire
from gaitd_client.wire.fields import QUANTITY
from gaitd_names.joints import JOINTS

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
LEFT_OUT: Final = ("core_boot_id", "leg", "status", "covariance")
"""Fields of the message that are not in the stream: constant, or large (half of all bytes)."""
UTC: Final = pa.timestamp("ns", tz="UTC")
STATUS: Final = "status_bits"

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
_ENDS: Final = {"ns": "ns", "s": "s", "hz": "Hz"}
"""Units by the end of a name."""
_ESTIMATE: Final = wire.schema(wire.Estimate)
_AXIS: Final = _ESTIMATE["$defs"][wire.AxisEstimate.__name__]["properties"]
_EVENT: Final = wire.schema(wire.Event)["properties"]


def _field(name: str, kind: Arrow, unit: str, meaning: str) -> Arrow:
    return pa.field(name, kind, metadata={"unit": unit, "meaning": meaning})


def _fields() -> Iterator[tuple[str, Arrow]]:
    """Yield the columns of the stream: field of the message (`hip.patient`), and column."""
    for field in msgspec.structs.fields(wire.Estimate):
        if field.name in JOINTS:
            for one in msgspec.structs.fields(wire.AxisEstimate):
                path = f"{field.name}.{one.name}"
                yield path, _column(_name(field.name, one.name), one, _AXIS, field.name)
        elif field.name not in LEFT_OUT:
            yield field.name, _column(field.name, field, _ESTIMATE["properties"])


def _name(axis: str, field: str) -> str:
    """Return the name of the column of an axis' field; `_std` is its end, as in the message."""
    value, std = field.removesuffix("_std"), "_std" * field.endswith("_std")
    words = {"axis": axis, "position": _POSITIONS[axis], "effort": _EFFORTS[axis]}
    name = _NAMES.get(value, f"{{axis}}_{value}").format(**words)
    quantity = _AXIS[field].get(QUANTITY)
    if quantity is None:
        return name + std
    unit = getattr(JOINTS[axis], quantity).lower().replace("·", "").replace("/", "_per_")
    return f"{name}_{unit}{std}"


def _column(
    name: str,
    field: msgspec.structs.FieldInfo,
    properties: dict[str, dict[str, Any]],
    axis: str | None = None,
) -> Arrow:
    kind = _type_of(name, field)
    told = properties[field.name]
    unit = "" if kind == pa.string() else _ENDS.get(field.name.rpartition("_")[2], "1")
    if axis is not None and QUANTITY in told:
        unit = getattr(JOINTS[axis], told[QUANTITY])
    return _field(name, kind, unit, told["description"])


def _type_of(name: str, field: msgspec.structs.FieldInfo) -> Arrow:
    text = str(field.type)
    if name == STATUS:
        return pa.uint32()
    if "float" in text:
        return pa.float64() if name in DOUBLES else pa.float32()
    return pa.int64() if "int" in text else pa.string()


_STREAMED: Final = dict(_fields())
STREAM_SCHEMA: Final = pa.schema(list(_STREAMED.values()))
"""Columns of the stream of a leg."""
FIELDS: Final = {field.name: field.type for field in STREAM_SCHEMA}
CELLS_OF: Final = attrgetter(*_STREAMED)
"""Returns the cells of a row, of a message."""

_HEAD: Final = (
    _field("time_s", pa.float64(), "s", "Time since the first row: the sum of measured steps."),
    _field("time_utc", UTC, "ns", _ESTIMATE["properties"]["sample_time_ns"]["description"]),
    _field("core_boot_id", pa.string(), "", _EVENT["core_boot_id"]["description"]),
    STREAM_SCHEMA.field("cycle"),
)
_BITS: Final = _field(
    "status",
    pa.uint32(),
    "",
    f"{_ESTIMATE['properties']['status']['description']} Bits from the lowest: "
    f"{', '.join(StatusBit)}.",
)
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
        _field("time_utc", UTC, "ns", _EVENT["time_ns"]["description"]),
        *(
            _field(
                name,
                pa.int64() if name == "cycle" else pa.string(),
                "1" if name == "cycle" else "",
                _EVENT[name]["description"],
            )
            for name in ("core_boot_id", "cycle", "id", "priority", "kind", "code", "cause")
        ),
        _field("subject", pa.string(), "", _EVENT["subject"]["description"]),
        _field("values_json", pa.string(), "", _EVENT["values"]["description"]),
        _field("said", pa.string(), "", _EVENT["said"]["description"]),
    ]
)
