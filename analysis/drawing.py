"""Common parts of all pictures: colours, axes, and lines of any length at a fixed cost."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

Values = NDArray[np.float64]

ESTIMATE: Final = "#1f5fa8"
TRUTH: Final = "#e07b00"
"""What is known to be true, and nothing else."""
FRICTION: Final = "#7a5230"
MEASURED: Final = "#6b7280"
GOOD: Final = "#2e7d32"
BAD: Final = "#c62828"
OTHER: Final = "#7b4fa3"
FAINT: Final = "#9aa3ad"
GRID: Final = "#e3e6ea"
TEXT: Final = "#1f2937"

SERIES: Final = (ESTIMATE, OTHER, MEASURED, FRICTION, GOOD, BAD)
"""Colours of things that are compared, in turn."""

SIGMAS: Final = 3.0
DPI: Final = 130

BUCKETS: Final = 3000
"""Points of a drawn line; a longer line is drawn as the extremes of this many stretches."""


class Axis(NamedTuple):
    """Names of an axis of the leg, and the units of its quantities."""

    name: str
    position: str
    velocity: str
    effort: str
    effort_name: str


AXES: Final = (
    Axis("hip", "rad", "rad/s", "N·m", "torque"),
    Axis("slide", "m", "m/s", "N", "force"),
)


def leg_figure(size: tuple[float, float], heights: Sequence[float]) -> tuple[Figure, Any]:
    """Make a figure of a leg over time: a column of panels for each axis, with one time axis."""
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(len(heights), 2, sharex=True, squeeze=False, height_ratios=heights)
    return figure, grid.T


def save(figure: Figure, title: str, path: Path) -> None:
    """Write a figure of a leg as PNG.

    Raises:
        OSError: the file cannot be written.
    """
    figure.suptitle(title, fontsize=12, color=TEXT)
    figure.savefig(path, dpi=DPI, format="png")


def style(axes: Axes, title: str = "", unit: str = "") -> None:
    """Apply the plain style: a grid, no box, the unit at the axis."""
    axes.set_axisbelow(True)
    axes.grid(visible=True, color=GRID, linewidth=0.7)
    axes.tick_params(colors=TEXT, labelsize=8, length=3, color=FAINT)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(FAINT)
    if title:
        axes.set_title(title, loc="left", fontsize=10, color=TEXT, fontweight="bold")
    if unit:
        axes.set_ylabel(unit, fontsize=8, color=TEXT)


def x_label(axes: Axes, words: str) -> None:
    """Name the horizontal axis."""
    axes.set_xlabel(words, fontsize=8, color=TEXT)


def strips(axes: Axes, names: Sequence[str], time: Values, words: str) -> None:
    """Scale the lowest panel, a strip of height 1 for each name over the whole time."""
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlim(float(time[0]), float(max(time[-1], time[0] + 1e-3)))
    x_label(axes, words)


def extremes(time: Values, values: Values, buckets: int = BUCKETS) -> tuple[Values, Values]:
    """Reduce a line to its smallest and largest value in each stretch of time, in turn.

    Args:
        time: shape (n,), increasing.
        values: shape (n,); NaN is a gap, which remains where a whole stretch is NaN.
        buckets: stretches; a line with at most twice as many points is returned unchanged.
    """
    count = len(time)
    if count <= 2 * buckets:
        return time, values
    edges = np.linspace(0, count, buckets + 1).astype(np.intp)[:-1]
    low = np.fmin.reduceat(values, edges)
    high = np.fmax.reduceat(values, edges)
    line = np.empty(2 * buckets)
    line[0::2], line[1::2] = low, high
    return np.repeat(time[edges], 2), line


def band(axes: Axes, time: Values, low: Values, high: Values, colour: str, label: str = "") -> None:
    """A filled band, drawn at a fixed cost."""
    count = len(time)
    if count > 2 * BUCKETS:
        edges = np.linspace(0, count, BUCKETS + 1).astype(np.intp)[:-1]
        time = time[edges]
        low, high = np.fmin.reduceat(low, edges), np.fmax.reduceat(high, edges)
    axes.fill_between(time, low, high, color=colour, alpha=0.18, linewidth=0, label=label or None)


def line(
    axes: Axes, time: Values, values: Values, colour: str, label: str = "", width: float = 1.1
) -> None:
    """A line, drawn at a fixed cost."""
    shown = extremes(time, values)
    axes.plot(*shown, color=colour, linewidth=width, label=label or None, solid_joinstyle="round")


def patient(
    axes: Axes, time: Values, value: Values, std: Values, valid: NDArray[np.bool_], net: Values
) -> None:
    """Draw the estimated effort of the patient; thick where it can be split from friction."""
    split = np.where(valid, value, np.nan)
    band(axes, time, value - SIGMAS * std, value + SIGMAS * std, ESTIMATE, "±3σ")
    line(axes, time, value, ESTIMATE, "", 0.5)
    line(axes, time, split, ESTIMATE, "patient, where it can be split from friction", 1.5)
    axes.axhline(0, color=FAINT, linewidth=0.6)
    limit_to(axes, split, net)


def legend(axes: Axes) -> None:
    """Place the legend beside the title, where it hides no line."""
    axes.legend(
        fontsize=7.5,
        frameon=False,
        loc="lower right",
        bbox_to_anchor=(1.0, 0.98),
        ncols=4,
        borderaxespad=0.1,
        columnspacing=1.2,
        handlelength=1.6,
        labelcolor=TEXT,
    )


def limit_to(axes: Axes, *values: Values, share: float = 0.999) -> None:
    """Scale to this share of all values with a margin; a spike or a wide band may be cut off.

    Args:
        axes: the axes to scale.
        values: any shapes; NaN is ignored.
        share: share of the values that must be visible.
    """
    known = np.concatenate([one[np.isfinite(one)] for one in values])
    if len(known):
        low, high = np.quantile(known, ((1 - share) / 2, (1 + share) / 2)).tolist()
        air = 0.15 * max(high - low, 1e-3)
        axes.set_ylim(low - air, high + air)


def stretches(flags: NDArray[np.bool_], time: Values) -> list[tuple[float, float]]:
    """Find where a flag is set, as (begin, length) in the unit of `time`, for `broken_barh`."""
    if len(flags) == 0:
        return []
    padded = np.concatenate(([False], flags, [False]))
    change = np.flatnonzero(padded[1:] != padded[:-1])
    last = len(time) - 1
    return [
        (float(time[begin]), float(time[min(end, last)] - time[begin]))
        for begin, end in zip(change[0::2], change[1::2], strict=True)
    ]
