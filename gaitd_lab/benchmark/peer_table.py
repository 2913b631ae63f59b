"""Tables that compare the masters."""

import statistics
from collections.abc import Callable, Sequence
from typing import Final

from rich import box
from rich.table import Table

from gaitd_lab.benchmark.peers import MASTERS, Cell, median_of

US_PER_MS: Final = 1000.0
CYCLE_MS: Final = 10.0
Figure = Callable[[Cell], float]

NAN: Final = float("nan")


def _commanded_us(cell: Cell) -> float:
    return statistics.median([one.commanded_us for one in cell.reactions] or [NAN])


def _shown_us(cell: Cell) -> float:
    return max([one.shown_us for one in cell.reactions] or [NAN])


ROWS: Final[tuple[tuple[str, Figure, str], ...]] = (
    ("SYNC interval, standard deviation", lambda cell: median_of(cell, "jitter_std_us"), "µs"),
    ("SYNC off 10 ms, 99 %", lambda cell: median_of(cell, "jitter_p99_us"), "µs"),
    ("SYNC off 10 ms, worst", lambda cell: median_of(cell, "jitter_worst_us"), "µs"),
    ("last TPDO to last command, median", lambda cell: median_of(cell, "answer_median_us"), "µs"),
    ("last TPDO to last command, 99 %", lambda cell: median_of(cell, "answer_p99_us"), "µs"),
    (
        "cycles without new commands",
        lambda cell: median_of(cell, "without_command_ratio") * 100,
        "%",
    ),
    (
        "computing in a cycle",
        lambda cell: statistics.median(cell.cpu_ratio or [NAN]) * CYCLE_MS * US_PER_MS,
        "µs",
    ),
    ("one processor", lambda cell: statistics.median(cell.cpu_ratio or [NAN]) * 100, "%"),
    ("EMCY to the other's quick stop, median", lambda cell: _commanded_us(cell) / US_PER_MS, "ms"),
    ("EMCY until the other shows it, worst", lambda cell: _shown_us(cell) / US_PER_MS, "ms"),
    ("EMCYs without a quick stop", lambda cell: float(cell.unanswered_count), ""),
)
"""Title, how the figure is found, and its unit."""


def ratios(cells: Sequence[Cell]) -> dict[str, dict[str, float]]:
    """Ratio of each figure of each cell to that of the first master under the same load."""
    found: dict[str, dict[str, float]] = {}
    for loaded in (False, True):
        row = [cell for cell in cells if cell.loaded == loaded]
        base = row[0] if row else None
        for cell in row:
            name = f"{cell.master}, {_load(loaded=loaded)}"
            found[name] = {
                what: _ratio(figure(cell), figure(base)) if base else NAN
                for what, figure, unit in ROWS
                if unit
            }
    return found


def _ratio(value: float, base: float) -> float:
    return value / base if base else NAN


def _load(*, loaded: bool) -> str:
    return "under load" if loaded else "without load"


def tables(title: str, cells: Sequence[Cell]) -> list[Table]:
    """Return one table without load, one with it; ratios are to the first column."""
    return [
        _table(f"{title}, {_load(loaded=loaded)}", [c for c in cells if c.loaded == loaded])
        for loaded in (False, True)
    ]


def _table(title: str, cells: Sequence[Cell]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, title=title, title_justify="left", title_style="bold")
    table.add_column("", no_wrap=True)
    for master in MASTERS:
        if any(cell.master == master.name for cell in cells):
            table.add_column(master.name.replace(", ", "\n"), justify="right", no_wrap=True)
    for what, figure, unit in ROWS:
        values = [figure(cell) for cell in cells]
        table.add_row(what, *(_figure_text(value, values[0], unit) for value in values))
    trouble = [f"{cell.master}: {cell.trouble}" for cell in cells if cell.trouble]
    if trouble:
        table.caption = "not measured: " + "; ".join(trouble)
        table.caption_justify = "left"
    return table


def _figure_text(value: float, first: float, unit: str) -> str:
    if value != value:  # noqa: PLR0124 - not a number
        return "–"
    digits = 0 if not unit or value >= 100 else 1
    word = f"{value:.{digits}f} {unit}".rstrip()
    return word if not unit or not first or value is first else f"{word} ({value / first:.1f}x)"
