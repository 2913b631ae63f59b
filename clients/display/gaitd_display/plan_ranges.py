"""What a plan may allow: the bounds of its fields on the wire, and the caps of the service."""

from collections.abc import Mapping
from typing import Any, Final

import msgspec
from gaitd_client import AxisPlan, PlanLimits
from msgspec import inspect

CAPS: Final = {"hip": "assist_max_nm", "slide": "assist_max_n"}
"""Key in `limits.toml` of the cap that a plan cannot exceed, by axis, which is its table."""


class Range(msgspec.Struct, frozen=True):
    """Allowed values of a field, in its unit."""

    value_low: float
    value_high: float
    has_low: bool
    """The lower end is allowed."""


def plan_ranges(limits: Mapping[str, Any]) -> dict[str, Range]:
    """Return the range of each field of `PlanLimits`; `AXIS_assist_max` is that of an axis.

    Args:
        limits: `limits.toml` of the running service; empty: not known yet.
    """
    fields = msgspec.structs.fields(PlanLimits)
    ranges = {
        field.name: _range(inspect.type_info(field.type))
        for field in fields
        if field.name not in CAPS
    }
    (assist,) = msgspec.structs.fields(AxisPlan)
    allowed = _range(inspect.type_info(assist.type))
    for axis, key in CAPS.items():
        cap = limits.get(axis, {}).get(key, allowed.value_high)
        high = min(cap, allowed.value_high)
        ranges[f"{axis}_{assist.name}"] = msgspec.structs.replace(allowed, value_high=high)
    return ranges


def _range(kind: inspect.Type) -> Range:
    """Return the range of a number, or of a number that may be absent."""
    if isinstance(kind, inspect.Metadata):
        return _range(kind.type)
    if isinstance(kind, inspect.UnionType):
        return next(_range(one) for one in kind.types if isinstance(one, inspect.FloatType))
    if not isinstance(kind, inspect.FloatType) or kind.le is None:
        raise TypeError(f"{kind}: a number with an upper bound is needed")
    return Range(kind.gt or kind.ge or 0.0, kind.le, has_low=kind.gt is None)
