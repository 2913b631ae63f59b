"""Picture of friction by week: median and range of the self-tests of each trainer."""

from itertools import groupby
from math import ceil
from operator import attrgetter
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import date2num
from matplotlib.figure import Figure

from analysis.drawing import DPI, FAINT, SERIES, legend, style, x_label
from analysis.friction_weeks import Advice, Merged, Week
from analysis.self_tests import AXES

NAMED_MAX: Final = len(SERIES)
"""More trainers cannot be told apart: those that drift are named, the others are grey."""

TICKS_MAX: Final = 10
BESIDE_DAYS: Final = 0.25
"""Between the bars of two trainers in the same week."""


def draw(merged: Merged, path: Path) -> Figure:
    """Draw the ratio to the robot file over the weeks, a panel for each axis.

    Raises:
        OSError: the file cannot be written.
    """
    figure = Figure(figsize=(11, 6.5), layout="constrained")
    drifting = {one[:2] for one in merged.trends if one.advice is Advice.CALIBRATE}
    legs = sorted({one[:2] for one in merged.weeks}, key=lambda one: (one not in drifting, one))
    colours = dict(zip(legs, SERIES, strict=False))
    if len(legs) > NAMED_MAX:
        colours = {leg: colour for leg, colour in colours.items() if leg in drifting}
    panels = figure.subplots(len(AXES), 1, sharex=True)
    for panel, axis in zip(panels, AXES, strict=True):
        style(panel, f"{axis}: friction in the self-tests, to the robot file's; median and range")
        panel.axhline(1.0, color=FAINT, linewidth=0.8)
        of_axis = [one for one in merged.weeks if one.axis == axis]
        for at, (leg, weeks) in enumerate(groupby(of_axis, attrgetter("trainer", "leg"))):
            _draw_leg(panel, list(weeks), leg, colours.get(leg), (at % NAMED_MAX) * BESIDE_DAYS)
        if colours:
            legend(panel)
    weeks = sorted({one.week for one in merged.weeks})
    shown = weeks[:: ceil(len(weeks) / TICKS_MAX)]
    panels[-1].set_xticks(date2num(shown), map(str, shown))
    x_label(panels[-1], "week, from its Monday")
    figure.savefig(path, dpi=DPI, format="png")
    return figure


def _draw_leg(
    panel: Axes, weeks: list[Week], leg: tuple[str, str], colour: str | None, beside_days: float
) -> None:
    medians = [one.median_ratio for one in weeks]
    below = [one.median_ratio - one.lowest_ratio for one in weeks]
    above = [one.highest_ratio - one.median_ratio for one in weeks]
    panel.errorbar(
        np.asarray(date2num([one.week for one in weeks])) + beside_days,
        medians,
        (below, above),
        color=colour or FAINT,
        label=" ".join(leg) if colour else None,
        marker="o",
        markersize=4,
        linewidth=1.3 if colour else 0.7,
        capsize=2,
    )
