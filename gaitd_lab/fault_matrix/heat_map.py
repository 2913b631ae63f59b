"""A picture of the matrix: time from the fault to each cell's stop command, or its stop."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from gaitd_lab.fault_matrix.cell import CellResult
from gaitd_lab.fault_matrix.faults import FAULTS
from gaitd_lab.fault_matrix.modes import COLUMNS, Group

Measure = Callable[[CellResult], float | None]

SIZE_IN: Final = (10.0, 17.0)
INK_RATIO: Final = 0.1
"""Share of the darkest colour above which a number is white."""
LEAST_CYCLES: Final = 0.1
MOST_CYCLES: Final = 200.0
LEAST_DEG: Final = 0.1
MOST_DEG: Final = 60.0


def draw(results: Sequence[CellResult], path: Path) -> None:
    """Write the picture.

    Raises:
        OSError: it cannot be written.
    """
    modes = [one.name for one in COLUMNS.values() if one.group is not Group.IDLE]
    figure = Figure(figsize=SIZE_IN, dpi=110, layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    reaction = _grid(results, modes, _reaction_cycles)
    distance = _grid(results, modes, lambda one: one.hip_deg if _is_stop(one) else None)
    _panel(figure, left, reaction, modes, (LEAST_CYCLES, MOST_CYCLES), "reaction, cycles")
    _panel(figure, right, distance, modes, (LEAST_DEG, MOST_DEG), "hip moved until rest, deg")
    left.set_yticks(range(len(FAULTS)), labels=list(FAULTS), fontsize=7)
    figure.suptitle("The slower axis of each fault and mode; grey: goes on, nothing to stop")
    figure.savefig(path, format="png")


def _is_stop(one: CellResult) -> bool:
    """Return whether a result is a stop, and not a normal end, as of a homing."""
    return one.stopped and bool(one.causes)


def _reaction_cycles(one: CellResult) -> float | None:
    if not _is_stop(one):
        return None
    times = [t for t in (one.told_cycles, one.left_cycles) if t is not None]
    return min(times) if times else None


def _grid(
    results: Sequence[CellResult], modes: Sequence[str], measure: Measure
) -> NDArray[np.float64]:
    """Faults by modes; NaN where there is no value."""
    grid = np.full((len(FAULTS), len(modes)), np.nan)
    rows = {name: number for number, name in enumerate(FAULTS)}
    for one in results:
        value = measure(one)
        if one.mode in modes and value is not None:
            place = rows[one.fault], modes.index(one.mode)
            grid[place] = np.fmax(grid[place], value)
    return grid


def _panel(
    figure: Figure,
    axes: Axes,
    grid: NDArray[np.float64],
    modes: Sequence[str],
    span: tuple[float, float],
    title: str,
) -> None:
    axes.set_facecolor("0.88")
    image = axes.imshow(np.clip(grid, *span), aspect="auto", norm=LogNorm(*span), cmap="viridis_r")
    axes.set_xticks(range(len(modes)), labels=list(modes), rotation=60, ha="right", fontsize=8)
    axes.set_title(title, fontsize=10)
    for row in range(grid.shape[0]):
        for column in range(grid.shape[1]):
            value = grid[row, column]
            if np.isfinite(value):
                ink = "white" if value > INK_RATIO * span[1] else "black"
                words = f"{value:.3g}"
                axes.text(column, row, words, ha="center", va="center", fontsize=5.5, color=ink)
    figure.colorbar(image, ax=axes, location="top", shrink=0.8, aspect=30, pad=0.005)
