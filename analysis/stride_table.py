"""Strides of a recording as a CSV table, one row for each."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from observer.strides import AxisStride, Stride

AXES: Final = (("hip", "nm"), ("slide", "n"))


def columns() -> list[str]:
    """Names of the columns; each figure is followed by its standard deviation."""
    names = ["number", "begin_s", "duration_s", "cadence_hz", "sample_count"]
    for axis, unit in AXES:
        for figure in _figures(unit):
            names += [f"{axis}_{figure}", f"{axis}_{figure}_std"]
        names.append(f"{axis}_coverage_ratio")
    for figure in ("work_positive_j", "work_negative_j", "share_ratio"):
        names += [figure, f"{figure}_std"]
    return [*names, "status", "baseline_subtracted"]


def _figures(unit: str) -> tuple[str, ...]:
    assist = (f"assist_mean_{unit}", f"assist_peak_{unit}")
    return (
        *("work_positive_j", "work_negative_j"),
        *assist,
        *("power_mean_w", "power_peak_w", "share_ratio"),
    )


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
        *_axis(stride.hip),
        *_axis(stride.slide),
        *(stride.work_positive_j, stride.work_positive_j_std),
        *(stride.work_negative_j, stride.work_negative_j_std),
        *(stride.share_ratio, stride.share_ratio_std),
        f"0x{stride.status.value:04x}",
        int(stride.baseline),
    ]


def _axis(axis: AxisStride) -> list[float | None]:
    """Values in the order of AxisStride, which is that of the columns."""
    return list(axis)


def _text(value: float | str | None) -> str:
    if value is None:
        return ""
    return f"{value:.9g}" if isinstance(value, float) else str(value)
