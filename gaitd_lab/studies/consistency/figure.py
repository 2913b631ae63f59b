"""Picture of the observer's consistency: NEES and NIS over time, and a minute at rest."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.drawing import ESTIMATE, FAINT, FRICTION, GOOD, legend, line, style, x_label
from gaitd_lab.studies.consistency.measures import SETTLE_ROWS, Consistency, Rest, time_of
from observer.filter.leg_model import STEP_S


def draw(consistency: Consistency, rest: Rest) -> Figure:
    """Draw NEES and NIS in their bands, and sigma at rest."""
    figure = Figure(figsize=(11, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    _chi_squares(left, consistency)
    _rest(right, rest)
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
