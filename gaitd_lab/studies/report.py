"""What a study returns, and the one writer of it: tables of measured quantities, and pictures."""

import math
from collections.abc import Iterable, Mapping, Sequence, Sized
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from analysis import markdown

UNKNOWN: Final = "–"
DPI: Final = 84
PLACE: Final = "numbers"
"""Name of the comments between which a page has its numbers."""


class Measured(NamedTuple):
    """Median and range of a quantity over the draws of all noise that have it, in its unit."""

    value: float
    value_low: float
    value_high: float
    unit: str = ""

    def __str__(self) -> str:
        """Format as `median (low … high) unit`; one number where all draws give the same."""
        median, low, high = map(rounded, self[:3])
        both = median if low == median == high else f"{median} ({low} … {high})"
        return f"{both} {self.unit}".rstrip()


def measured(values: Iterable[float | None], unit: str = "") -> Measured | None:
    """Summarise draws; None without any. None and NaN are draws that have no value."""
    known = np.array([value for value in values if value is not None], dtype=float)
    known = known[np.isfinite(known)]
    if not len(known):
        return None
    return Measured(float(np.median(known)), float(known.min()), float(known.max()), unit)


def rounded(value: float) -> str:
    """Format a number with three digits, whole, or with at most four decimals."""
    if abs(value) >= 100:
        return f"{value:.0f}"
    return f"{value:.3g}" if abs(value) >= 1e-4 or not value else f"{value:.4f}"


Cell = str | float | Measured | None
"""A text, a number, a measured quantity, or nothing."""


class Table(NamedTuple):
    """A table of a report."""

    title: str
    head: tuple[str, ...]
    """Names of the columns, with a unit where all cells share it."""
    rows: Sequence[tuple[Cell, ...]]

    def texts(self) -> tuple[str, tuple[str, ...], tuple[tuple[str, ...], ...]]:
        """Return title, head and rows with each cell as text."""
        return self.title, self.head, tuple(tuple(map(_text, row)) for row in self.rows)


def of_leg(leg: str, legs: Sized) -> str:
    """Words that a title adds for a leg: none on a machine with one leg."""
    return f", {leg} leg" if len(legs) > 1 else ""


class Report(NamedTuple):
    """What a study found."""

    name: str
    """Name of its files."""
    title: str
    tables: tuple[Table, ...]
    figures: Mapping[str, Figure]
    """Pictures by the end of their file's name."""
    passed: bool = True
    """False if a target was missed."""


def write(report: Report, folder: Path, run: str) -> list[Path]:
    """Write NAME.md with all tables and today's date, and its pictures beside it.

    What stands around the numbers of a page that is there is kept.

    Args:
        report: of a study.
        folder: is made if it is not there.
        run: the command line that repeats it.

    Raises:
        OSError: a file cannot be read or written.
        ValueError: the page has the begin of its numbers and no end.
    """
    folder.mkdir(parents=True, exist_ok=True)
    pictures = [folder / f"{report.name}_{end}.png" for end in report.figures]
    for picture, figure in zip(pictures, report.figures.values(), strict=True):
        figure.savefig(picture, dpi=DPI, pil_kwargs={"optimize": True})
    parts = [
        "## Numbers",
        f"`{run}` wrote these numbers on {datetime.now(UTC).date().isoformat()}. A quantity that "
        f"was drawn several times is `median (lowest … highest)`; {UNKNOWN} is a quantity that the "
        "situation does not have.",
    ]
    if pictures:
        names = ", ".join(f"`{picture.name}`" for picture in pictures)
        parts.append(f"The same command draws {names}.")
    for title, head, rows in (table.texts() for table in report.tables):
        parts += [f"### {title}", markdown.table(head, rows)]
    page = folder / f"{report.name}.md"
    made = {PLACE: markdown.page(*parts).rstrip("\n")}
    text = page.read_text("utf-8") if page.is_file() else ""
    if f"<!-- {PLACE}: begin -->" not in text:
        text = f"# {report.title}\n\n<!-- {PLACE}: begin -->\n<!-- {PLACE}: end -->\n"
    page.write_text(markdown.filled(text, made), "utf-8")
    return [page, *pictures]


def _text(cell: Cell) -> str:
    if cell is None or (isinstance(cell, float) and math.isnan(cell)):
        return UNKNOWN
    return rounded(cell) if isinstance(cell, float) else str(cell)
