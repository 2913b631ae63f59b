"""Picture of the observer's consistency: NEES and NIS, rest, gaps, drift."""

from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.consistency import SETTLE_ROWS, Consistency, Drifted, Gap, Rest, time_of
from analysis.drawing import ESTIMATE, FAINT, FRICTION, GOOD, MEASURED, legend, line, style, x_label
from observer.drift import CORRELATION_MAX
from observer.filter.leg_model import STEP_S

DPI: Final = 100


def draw(
    consistency: Consistency, rest: Rest, gaps: list[Gap], drifted: list[Drifted], path: Path
) -> Figure:
    """Draw four panels: NEES and NIS in their bands, sigma at rest, gaps, friction drift.

    Raises:
        OSError: the file cannot be written.
    """
    figure = Figure(figsize=(11, 7.6), dpi=DPI, layout="constrained")
    (a, b), (c, d) = figure.subplots(2, 2)
    _chi_squares(a, consistency)
    _rest(b, rest)
    _gaps(c, gaps)
    _drift(d, drifted)
    figure.savefig(path)
    return figure


def _chi_squares(axes: Axes, found: Consistency) -> None:
    style(axes, "(a) NEES and NIS, mean of all runs", "chi square")
    time_s = time_of(len(found.nees_over_time))
    for values, band, colour, name in (
        (found.nees_over_time, found.nees, ESTIMATE, "NEES, 8 states"),
        (found.nis_over_time, found.nis, FRICTION, "NIS, 2 samples"),
    ):
        axes.axhspan(band.low, band.high, color=colour, alpha=0.13, linewidth=0)
        line(axes, time_s, values, colour, name)
    axes.axvspan(0.0, SETTLE_ROWS * STEP_S, color=FAINT, alpha=0.15, linewidth=0)
    axes.set_ylim(0.0, 14.0)
    x_label(axes, "time [s]; grey: not counted; bands: 95 %")
    legend(axes)


def _rest(axes: Axes, rest: Rest) -> None:
    style(axes, "(b) a minute at rest, hip", "N·m")
    std = rest.estimates.std[:, 6]
    axes.fill_between(rest.time_s, -std, std, color=ESTIMATE, alpha=0.18, linewidth=0)
    line(axes, rest.time_s, rest.estimates.state[:, 6], ESTIMATE, "patient, ±1σ")
    net = rest.estimates.net_std[:, 0]
    line(axes, rest.time_s, net, GOOD, "±1σ of the net torque")
    line(axes, rest.time_s, -net, GOOD)
    x_label(axes, "time [s]")
    legend(axes)


def _gaps(axes: Axes, gaps: list[Gap]) -> None:
    style(axes, "(c) position at the end of a gap", "largest error of 22 gaps / σ")
    places = np.arange(len(gaps))
    for axis, (name, colour) in enumerate((("hip", ESTIMATE), ("slide", FRICTION))):
        heights = [gap.end_sigmas[axis] for gap in gaps]
        axes.bar(places + 0.2 * (2 * axis - 1), heights, 0.36, color=colour, label=name)
    axes.axhline(3.0, color=MEASURED, linewidth=1.0, linestyle="--")
    axes.set_xticks(places, [f"{1e3 * gap.duration_s:.0f} ms" for gap in gaps])
    axes.text(len(gaps) - 0.55, 3.06, "3σ", fontsize=8, color=MEASURED, ha="right")
    axes.set_ylim(0.0, 3.6)
    legend(axes)


def _drift(axes: Axes, drifted: list[Drifted]) -> None:
    style(axes, "(d) friction that is not as calibrated", "correlation with the motion")
    levels = [100.0 * (one.level_ratio - 1.0) for one in drifted]
    for axis, (name, colour) in enumerate((("hip", ESTIMATE), ("slide", FRICTION))):
        found = [one.correlation[axis] for one in drifted]
        axes.plot(levels, found, color=colour, marker="o", markersize=4, linewidth=1.2, label=name)
    axes.axhspan(-CORRELATION_MAX, CORRELATION_MAX, color=GOOD, alpha=0.10, linewidth=0)
    axes.set_ylim(-1.1, 1.1)
    x_label(axes, "true level above the calibrated one [%]; green: no advice")
    legend(axes)
