"""Bounds of each real reversal of a motor or an encoder: when it is found, how far the leg moves.

`reversals.csv` has what happened before a mismatch of effort and motion could be a person's, when
each was stopped as a wrong sign. No cell may be found later, or let the leg move farther: what
excuses a person must hide no fault. A cell is of one seed, so it has its own moment and patient.
An empty time means that nothing stopped within the time of the cell; its distances are bounds too.
Where a leg takes another course today, its cell was played without that excuse: in a self-test the
reversed hip, seeds 1 and 4, sticks longer before it runs away.
"""

import csv
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

from gaitd_lab.fault_matrix.cell import CellResult

TABLE: Final = Path(__file__).with_name("reversals.csv")
FAULTS: Final = ("encoder_reversed", "wrong_sign")
ROUNDED_DEG: Final = 0.05
ROUNDED_MM: Final = 0.5
"""Margins for another machine's last digits."""

Key = tuple[str, str, str, int]
"""Fault, mode, axis and seed."""


class Bound(NamedTuple):
    """Bounds of one cell."""

    told_cycles: float | None
    """None: it did not stop."""
    hip_deg: float
    slide_mm: float


@cache
def bounds() -> Mapping[Key, Bound]:
    """Return the bound of each recorded cell."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        return {
            (row["fault"], row["mode"], row["axis"], int(row["seed"])): Bound(
                float(row["told_cycles"]) if row["told_cycles"] else None,
                float(row["hip_deg"]),
                float(row["slide_mm"]),
            )
            for row in csv.DictReader(file)
        }


def exceeded(cell: CellResult) -> Iterator[str]:
    """Describe each bound that a cell exceeds; nothing for a cell without a bound."""
    bound = bounds().get((cell.fault, cell.mode, cell.axis, cell.seed))
    if bound is None:
        return
    told = cell.told_cycles
    if bound.told_cycles is not None and (told is None or told > bound.told_cycles):
        yield f"a reversal told after {told} cycles, before it was {bound.told_cycles:g}"
    if cell.hip_deg > bound.hip_deg + ROUNDED_DEG:
        yield f"a reversal moved the hip by {cell.hip_deg:g} deg, before {bound.hip_deg:g}"
    if cell.slide_mm > bound.slide_mm + ROUNDED_MM:
        yield f"a reversal moved the slide by {cell.slide_mm:g} mm, before {bound.slide_mm:g}"
