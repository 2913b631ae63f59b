"""Strides of a recording as a CSV table, one row for each.

Figures of an axis that are there although its coverage is too small for the message `stride` are
kept, and `validity` says so.
"""

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from gaitd_names.measured import COVERAGE_MIN_RATIO, Validity

from observer.strides import AxisStride, Stride

AXES: Final = (("hip", "nm"), ("slide", "n"))
EFFORTS: Final = ("assist_mean", "assist_peak")
"""Figures whose unit is that of the axis' effort."""


def columns() -> list[str]:
    """Names of the columns; each figure is followed by its standard deviation."""
    return [
        *("number", "begin_s", "duration_s", "cadence_hz", "sample_count"),
        *(_column(axis, unit, figure) for axis, unit in AXES for figure in AxisStride._fields),
        *(f"{axis}_validity" for axis, _ in AXES),
        *("work_positive_j", "work_positive_j_std", "work_negative_j", "work_negative_j_std"),
        *("share_ratio", "share_ratio_std", "status", "baseline_subtracted"),
    ]


def _column(axis: str, unit: str, figure: str) -> str:
    value, std = figure.removesuffix("_std"), "_std" * figure.endswith("_std")
    return f"{axis}_{value}_{unit}{std}" if value in EFFORTS else f"{axis}_{figure}"


def write_csv(strides: Sequence[tuple[float, Stride]], path: Path) -> None:
    """Write strides, each with the time at which it began [s].

    Raises:
        OSError: the file cannot be written.
    """
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns())
        for number, (begin_s, stride) in enumerate(strides, start=1):
            writer.writerow([_text(value) for value in _row(number, begin_s, stride)])


def _row(number: int, begin_s: float, stride: Stride) -> list[float | str | None]:
    return [
        *(number, begin_s, stride.duration_s, stride.cadence_hz, stride.sample_count),
        *stride.hip,
        *stride.slide,
        *(_validity(stride.hip), _validity(stride.slide)),
        *(stride.work_positive_j, stride.work_positive_j_std),
        *(stride.work_negative_j, stride.work_negative_j_std),
        *(stride.share_ratio, stride.share_ratio_std),
        f"0x{stride.status.value:04x}",
        int(stride.baseline_subtracted),
    ]


def _validity(axis: AxisStride) -> Validity:
    if math.isnan(axis.work_positive_j):
        return Validity.BAD
    known = axis.coverage_ratio >= COVERAGE_MIN_RATIO
    return Validity.OK if known else Validity.SPLIT_UNOBSERVABLE


def _text(value: float | str | None) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    return f"{value:.9g}" if isinstance(value, float) else str(value)
