"""Measured efforts of a walking person, from a file, over the phase that the plant estimates.

A CSV file, columns found by name, other columns ignored:

    stride_index      a whole number, the same in all rows of a stride
    stride_ratio      time over the stride's duration, 0 to 1, increasing in each stride
    hip_angle_rad     flexion is positive; only its phase is used
    hip_torque_nm     flexion is positive
    slide_force_n     may be absent: 0

The plant's phase is that of the hip angle's fundamental. So the file's own angle, its mean over the
strides, says where in the phase a row belongs, whatever event its strides begin with.
"""

import csv
import math
from collections.abc import Sequence
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]

STRIDES_MAX: Final = 16
SAMPLES: Final = 100
"""Samples of a stride, from phase -pi on."""
ROWS_MIN: Final = 20
"""Fewest rows of a stride: five for each of the four harmonics that a gait effort has."""
ANGLE_MAX_RAD: Final = 2.2
COLUMNS: Final = ("stride_index", "stride_ratio", "hip_angle_rad", "hip_torque_nm")
OPTIONAL: Final = "slide_force_n"


class RecordedError(ValueError):
    """Operator error: the file cannot be used; names line, column, value and what is allowed."""


def read_strides(path: Path) -> Values:
    """Read the strides of a file; shape (strides, SAMPLES, 2), the largest of each axis is 1.

    Raises:
        OSError: the file cannot be read.
        RecordedError: it is not as described above, has too many strides or too few rows in one, or
            its angle does not swing, so that its phase is unknown.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = list(csv.reader(file))
    except (UnicodeDecodeError, csv.Error) as error:
        raise RecordedError("is not a text file of comma-separated values") from error
    strides = _strides(_numbers(lines))
    phase_rad = _phase(strides)
    turns = (np.arange(SAMPLES) / SAMPLES - 0.5) + phase_rad / (2.0 * math.pi)
    made = np.array(
        [
            [np.interp(turns % 1.0, rows[:, 1], rows[:, column], period=1.0) for column in (3, 4)]
            for rows in strides
        ]
    ).transpose(0, 2, 1)
    largest = np.max(np.abs(made), axis=(0, 1))
    if largest[0] == 0.0 and largest[1] == 0.0:
        raise RecordedError("hip_torque_nm is 0 in every row; nothing would act")
    made /= np.where(largest > 0.0, largest, 1.0)
    return np.ascontiguousarray(made)


def _numbers(lines: Sequence[Sequence[str]]) -> Values:
    """Rows of stride, ratio, angle, torque, force; shape (n, 5)."""
    if not lines or not any(lines[0]):
        raise RecordedError("is empty; its first line must name the columns")
    head = [name.strip() for name in lines[0]]
    missing = [name for name in COLUMNS if name not in head]
    if missing:
        raise RecordedError(f"line 1: lacks column {', '.join(missing)}; it has {', '.join(head)}")
    names = [*COLUMNS, *([OPTIONAL] if OPTIONAL in head else [])]
    places = [head.index(name) for name in names]
    made = np.zeros((len(lines) - 1, len(COLUMNS) + 1))
    for row, cells in enumerate(lines[1:]):
        for column, (name, place) in enumerate(zip(names, places, strict=True)):
            made[row, column] = _number(row + 2, name, cells[place] if place < len(cells) else "")
    return made


def _number(line: int, name: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise RecordedError(f"line {line}: {name} is {cell!r}; it must be a finite number")
    if name == "hip_angle_rad" and abs(value) > ANGLE_MAX_RAD:
        allowed = f"-{ANGLE_MAX_RAD} to {ANGLE_MAX_RAD} rad"
        raise RecordedError(f"line {line}: {name} is {value:g}; allowed is {allowed}")
    return value


def _strides(rows: Values) -> list[Values]:
    """Split the rows, and check each stride."""
    split: list[Values] = []
    line = 2
    for number, group in groupby(rows, key=itemgetter(0)):
        stride = np.array(list(group))
        ratio = stride[:, 1]
        if len(stride) < ROWS_MIN:
            raise RecordedError(
                f"line {line}: stride_index {number:g} has {len(stride)} rows; at least {ROWS_MIN} "
                "are needed"
            )
        wrong = np.flatnonzero((ratio < 0.0) | (ratio > 1.0) | (np.diff(ratio, prepend=-1.0) <= 0))
        if len(wrong):
            raise RecordedError(
                f"line {line + int(wrong[0])}: stride_ratio is {ratio[wrong[0]]:g}; it must "
                "increase in a stride, from 0 to 1"
            )
        split.append(stride)
        line += len(stride)
    if not 1 <= len(split) <= STRIDES_MAX:
        raise RecordedError(f"has {len(split)} strides; allowed are 1 to {STRIDES_MAX}")
    return split


def _phase(strides: Sequence[Values]) -> float:
    """Phase of the mean angle's fundamental where a stride begins, as a lag in rad."""
    even = np.arange(SAMPLES) / SAMPLES
    angle = np.mean([np.interp(even, one[:, 1], one[:, 2], period=1.0) for one in strides], axis=0)
    wave = np.sum(angle * np.exp(-2j * math.pi * even))
    if abs(wave) * 2.0 / SAMPLES < math.radians(1.0):
        swing_deg = math.degrees(abs(wave) * 2.0 / SAMPLES)
        raise RecordedError(
            f"hip_angle_rad swings by {swing_deg:.1f} deg in the fundamental; its phase needs 1 "
            "deg at least"
        )
    return float(-np.angle(wave))
