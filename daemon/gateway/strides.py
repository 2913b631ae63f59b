"""The message of a completed stride; figures of an axis with too little coverage are null.

Figures of an axis with an invalid sample are NaN in the record, and null, too.
"""

from collections.abc import Mapping
from typing import Any, Final

import msgspec
from gaitd_client import wire
from gaitd_names.measured import COVERAGE_MIN_RATIO

from daemon.gateway.translate import (
    NO_TREMOR,
    View,
    finite_values,
    status_names,
    tremor_fields,
)
from daemon.gateway.tremor import Tremor
from daemon.ipc.record import AxisStrideRecord, StrideRecord


def stride(
    made: StrideRecord,
    view: View,
    seq: int,
    tremors: Mapping[str, Tremor | None] = NO_TREMOR,
) -> wire.Stride:
    """The message LEG/stride; `tremors` of its axes."""
    values = view.common | finite_values(made)
    if min(made.hip.coverage_ratio, made.slide.coverage_ratio) < COVERAGE_MIN_RATIO:
        values |= dict.fromkeys(_OF_BOTH)
    values |= {
        "seq": seq,
        "status": status_names(made.status),
        "status_bits": f"0x{made.status:04X}",
        "hip": _axis(made.hip, tremors["hip"]),
        "slide": _axis(made.slide, tremors["slide"]),
    }
    return msgspec.convert(values, wire.Stride)


def _axis(axis: AxisStrideRecord, tremor: Tremor | None) -> dict[str, Any]:
    if axis.coverage_ratio < COVERAGE_MIN_RATIO:
        none: dict[str, Any] = dict.fromkeys(_FIGURES) | tremor_fields(None)
        return none | {"coverage_ratio": axis.coverage_ratio}
    return finite_values(axis) | tremor_fields(tremor)


_FIGURES: Final = frozenset(AxisStrideRecord.__struct_fields__)
_OF_BOTH: Final = _FIGURES & frozenset(StrideRecord.__struct_fields__)
"""Figures of a leg that are sums over its axes."""
