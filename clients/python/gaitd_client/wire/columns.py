"""Columns of tables made of messages: names, units and meanings, from the schemas.

The meaning is the description of the message's field. The unit is the joint's where the schema says
`x-quantity`, else the end of the field's name; `1` is a number without one, and a text has none.
The column of a field of an axis has axis and unit in its name: `hip.patient` is `hip_patient_nm`.
"""

from typing import Any, Final, NamedTuple

import msgspec
from gaitd_names import StatusBit
from gaitd_names.joints import JOINTS

from gaitd_client.wire.fields import QUANTITY
from gaitd_client.wire.leg_messages import AxisEstimate, Estimate
from gaitd_client.wire.messages import schema

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


class Column(NamedTuple):
    """One column of a table."""

    name: str
    unit: str
    """Empty for a text."""
    meaning: str
    field: str = ""
    """Field of the message, `hip.patient`; empty: it is the table's own."""
    kind: str = ""
    """Type of that field, of JSON Schema: number, integer, string, ...; not null."""

    @property
    def metadata(self) -> dict[str, str]:
        """What a column tells of itself in a file."""
        return {"unit": self.unit, "meaning": self.meaning}


def columns_of(kind: type[msgspec.Struct]) -> dict[str, Column]:
    """Return the columns of a message, by name: one for each field, without those of its axes."""
    return {
        name: _column(name, name, told)
        for name, told in schema(kind)["properties"].items()
        if name not in JOINTS
    }


def _estimate() -> dict[str, Column]:
    axis_properties = schema(Estimate)["$defs"][AxisEstimate.__name__]["properties"]
    of_leg = columns_of(Estimate)
    found: dict[str, Column] = {}
    for field in schema(Estimate)["properties"]:
        if field not in JOINTS:
            found[field] = of_leg[field]
            continue
        for one, told in axis_properties.items():
            name = _name(field, one, told)
            found[name] = _column(name, one, told, field)
    bits = f"{of_leg['status'].meaning} Bits from the lowest: {', '.join(StatusBit)}."
    found["time_s"] = Column("time_s", "s", "Time of the sample; it does not jump.")
    found["status"] = Column("status", "", bits)
    return found


def _name(axis: str, field: str, told: dict[str, Any]) -> str:
    """Return the name of the column of an axis' field; `_std` is its end, as in the message."""
    value, std = field.removesuffix("_std"), "_std" * field.endswith("_std")
    words = {"axis": axis, "position": _POSITIONS[axis], "effort": _EFFORTS[axis]}
    name = _NAMES.get(value, f"{{axis}}_{value}").format(**words)
    if QUANTITY not in told:
        return name + std
    unit = getattr(JOINTS[axis], told[QUANTITY]).lower().replace("·", "").replace("/", "_per_")
    return f"{name}_{unit}{std}"


def _column(name: str, field: str, told: dict[str, Any], axis: str = "") -> Column:
    kinds = [one["type"] for one in (told, *told.get("anyOf", ())) if "type" in one]
    kind = next(one for one in kinds if one != "null")
    is_number = kind in {"number", "integer"}
    unit = _ENDS.get(field.rpartition("_")[2], "1") if is_number else ""
    if axis and QUANTITY in told:
        unit = getattr(JOINTS[axis], told[QUANTITY])
    path = f"{axis}.{field}" if axis else field
    return Column(name, unit, told["description"], path, kind)


ESTIMATE_COLUMNS: Final = _estimate()
"""Columns of estimates by name; `time_s` and the bits of `status` are the tables' own."""
