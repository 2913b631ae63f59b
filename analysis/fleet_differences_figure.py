"""Picture of differences between two results of the same recordings."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.drawing import (
    AXES,
    ESTIMATE,
    FAINT,
    OTHER,
    Axis,
    Values,
    leg_figure,
    legend,
    save,
    style,
)
from analysis.fleet_differences import ALL, Difference

NAMED_MAX: Final = 16
"""More recordings are numbered."""
BESIDE: Final = 0.08
"""Two marks of a recording beside each other, in distances of recordings."""


def draw(found: Sequence[Difference], path: Path) -> Figure:
    """Draw difference, sigma and share of valid rows of each recording, an axis in each column.

    Raises:
        OSError: the file cannot be written.
    """
    figure, columns = leg_figure((12, 8.5), (1.3, 1.0, 1.0))
    for panels, axis in zip(columns, AXES, strict=True):
        _draw_axis(panels, axis, [one for one in found if one.axis == axis.name])
    save(figure, "patient's effort: after minus before, over the rows valid in both", path)
    return figure


def _draw_axis(panels: Sequence[Axes], axis: Axis, found: Sequence[Difference]) -> None:
    by_recording = [one for one in found if one.recording != ALL]
    places = np.arange(len(by_recording))
    difference, sigma, valid = panels
    style(difference, f"{axis.name}: mean and rms of the difference", axis.effort)
    difference.axhline(0.0, color=FAINT, linewidth=0.8)
    style(sigma, "sigma", axis.effort)
    style(valid, "share of valid rows, %")
    for panel, lower, upper, unit in (
        (difference, "difference_mean_si", "difference_rms_si", 1),
        (sigma, "sigma_before_si", "sigma_after_si", 1),
        (valid, "ok_before_ratio", "ok_after_ratio", 100),
    ):
        names = ("mean", "rms") if panel is difference else ("before", "after")
        looks = ((lower, -BESIDE, "s", OTHER), (upper, BESIDE, "o", ESTIMATE))
        for (field, beside, marker, colour), name in zip(looks, names, strict=True):
            values = unit * _numbers(by_recording, field)
            panel.plot(places + beside, values, marker, color=colour, label=name, markersize=5)
        panel.margins(y=0.15)
    legend(difference)
    legend(sigma)
    valid.set_ylim(0.0, 105.0)
    if len(by_recording) <= NAMED_MAX:
        names = [f"{one.recording} {one.leg}" for one in by_recording]
        valid.set_xticks(places, names, rotation=30, ha="right")


def _numbers(found: Sequence[Difference], name: str) -> Values:
    """Return a field of all, NaN where it is none."""
    return np.array([getattr(one, name) for one in found], dtype=np.float64)
