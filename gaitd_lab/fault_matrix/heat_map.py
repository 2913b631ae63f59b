"""A picture of the matrix: time from the fault to each cell's stop command, and the way to rest.

The tables of the page have the numbers; here colour alone shows which fault and mode are slow or
go far. Codes of EMCY that react alike share a row, and faults that never stop have none.
"""

import re
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, LinearSegmentedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis.drawing import ESTIMATE, FAINT, GRID, TEXT, save
from gaitd_lab.fault_matrix.cell import CellResult
from gaitd_lab.fault_matrix.faults import FAULTS
from gaitd_lab.fault_matrix.modes import COLUMNS, Group

Measure = Callable[[CellResult], float | None]
Grid = NDArray[np.float64]

WIDTH_IN: Final = 8.0
ROW_IN: Final = 0.19
MARGINS_IN: Final = 3.0
"""Title, colour bars, names of the modes, and the note below."""
FONT_PT: Final = 9
NOTE_WIDTH: Final = 112
REACTION_CYCLES: Final = (0.0, 1.0, 2.0, 5.0, 10.0, 30.0, 100.0, 200.0)
WAY_DEG: Final = (0.0, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 60.0)
COLOURS: Final = LinearSegmentedColormap.from_list("blue", ("#dce9f8", ESTIMATE, "#0b1d38"))


def draw(results: Sequence[CellResult], path: Path) -> None:
    """Write the picture.

    Raises:
        OSError: it cannot be written.
    """
    modes = [one.name for one in COLUMNS.values() if one.group is not Group.IDLE]
    stops = {_row(one.fault) for one in results if one.mode in modes and _is_stop(one)}
    rows = [name for name in dict.fromkeys(map(_row, FAULTS)) if name in stops]
    figure = Figure(figsize=(WIDTH_IN, MARGINS_IN + ROW_IN * len(rows)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    reaction = _grid(results, rows, modes, _reaction_cycles)
    way = _grid(results, rows, modes, lambda one: one.hip_deg if _is_stop(one) else None)
    _panel(figure, left, reaction, modes, REACTION_CYCLES, "reaction [cycles of 10 ms]")
    _panel(figure, right, way, modes, WAY_DEG, "hip moved until rest [deg]")
    left.set_yticks(range(len(rows)), labels=rows, fontsize=FONT_PT)
    others = ", ".join(dict.fromkeys(row for row in map(_row, FAULTS) if row not in stops))
    note = f"Not shown, because they go on in every mode: {others}."
    figure.supxlabel(
        textwrap.fill(note, NOTE_WIDTH), x=0.01, ha="left", fontsize=FONT_PT - 1, color=TEXT
    )
    save(figure, "The slower axis of each fault and mode; white: goes on", path)


def _row(fault: str) -> str:
    """Row of a fault: EMCY of every code that ends in a fault, or is only sent, share one."""
    return re.sub(r"^emcy_.xxx_(\w+)$", r"emcy, any code, \1", fault)


def _is_stop(one: CellResult) -> bool:
    """Return whether a result is a stop, and not a normal end, as of a homing."""
    return one.stopped and bool(one.causes)


def _reaction_cycles(one: CellResult) -> float | None:
    if not _is_stop(one):
        return None
    times = [t for t in (one.told_cycles, one.left_cycles) if t is not None]
    return min(times) if times else None


def _grid(
    results: Sequence[CellResult], rows: Sequence[str], modes: Sequence[str], measure: Measure
) -> Grid:
    """Rows by modes, the largest of each; NaN where there is no value."""
    grid = np.full((len(rows), len(modes)), np.nan)
    for one in results:
        value = measure(one)
        if one.mode in modes and value is not None:
            place = rows.index(_row(one.fault)), modes.index(one.mode)
            grid[place] = np.fmax(grid[place], value)
    return grid


def _panel(
    figure: Figure,
    axes: Axes,
    grid: Grid,
    modes: Sequence[str],
    bounds: Sequence[float],
    title: str,
) -> None:
    shown = np.clip(grid, bounds[0], bounds[-1])
    norm = BoundaryNorm(bounds, COLOURS.N)
    image = axes.imshow(shown, aspect="auto", norm=norm, cmap=COLOURS)
    axes.set_xticks(range(len(modes)), labels=modes, rotation=60, ha="right", fontsize=FONT_PT)
    axes.set_xticks(np.arange(len(modes) + 1) - 0.5, minor=True)
    axes.set_yticks(np.arange(len(grid) + 1) - 0.5, minor=True)
    axes.grid(which="minor", color=GRID, linewidth=0.8)
    axes.tick_params(which="both", length=0, labelcolor=TEXT)
    for spine in axes.spines.values():
        spine.set_color(FAINT)
    bar = figure.colorbar(image, ax=axes, location="top", shrink=0.95, aspect=25, pad=0.01)
    bar.set_label(title, fontsize=FONT_PT + 1, color=TEXT, fontweight="bold")
    bar.ax.tick_params(labelsize=FONT_PT - 1, labelcolor=TEXT, color=FAINT)
