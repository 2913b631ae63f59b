"""The one table of the benchmarks: our figure, that of a peer in the same run, ratio and budget."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from rich import box
from rich.table import Table

NOT_MEASURED: Final = "–"
LARGE: Final = 100.0
"""From here on a number has no decimals."""


class Figure(NamedTuple):
    """One row; the budget is of the ratio where there is a peer, and of the value elsewhere."""

    what: str
    value: float
    """NaN: it could not be measured."""
    unit: str
    peer: str = ""
    """Name of the peer."""
    peer_value: float = math.nan
    """Value of the peer, in the same unit."""
    at_most: float = math.inf
    at_least: float = -math.inf

    @property
    def ratio(self) -> float:
        """Ratio to the peer; NaN without one."""
        return self.value / self.peer_value if self.peer_value else math.nan

    @property
    def is_met(self) -> bool:
        """True if the figure keeps its budget; a figure without one does."""
        judged = self.ratio if self.peer else self.value
        unbounded = self.at_most == math.inf and self.at_least == -math.inf
        return unbounded or self.at_least <= judged <= self.at_most

    @property
    def budget(self) -> str:
        """The budget as text."""
        unit = "" if self.peer else f" {self.unit}"
        if self.at_most < math.inf:
            return f"≤ {self.at_most:g}{unit}"
        return f"≥ {self.at_least:g}{unit}" if self.at_least > -math.inf else ""


def table(figures: Sequence[Figure]) -> Table:
    """Return all figures as one table; a missed budget is yellow."""
    made = Table(box=box.SIMPLE_HEAD)
    for number, column in enumerate(("what", "gaitd", "peer", "its value", "ratio", "budget")):
        made.add_column(column, justify="right" if number in {1, 3, 4, 5} else "left")
    for one in figures:
        made.add_row(
            one.what,
            _text(one.value, one.unit),
            one.peer,
            _text(one.peer_value, one.unit) if one.peer else "",
            _text(one.ratio, "") if one.peer else "",
            one.budget,
            style="" if one.is_met else "yellow",
        )
    return made


def _text(value: float, unit: str) -> str:
    if math.isnan(value):
        return NOT_MEASURED
    number = f"{value:.0f}" if abs(value) >= LARGE else f"{value:.3g}"
    return f"{number} {unit}".rstrip()
