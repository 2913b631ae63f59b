"""Pictures: the paper's Fig. 5 from the recorded axis, and speed against error."""

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.signal import butter, sosfiltfilt

from analysis.drawing import (
    AXES,
    BAD,
    ESTIMATE,
    FAINT,
    FRICTION,
    GOOD,
    MEASURED,
    TEXT,
    TRUTH,
    band,
    legend,
    limit_to,
    line,
    style,
    x_label,
)
from analysis.replay import estimate
from gaitd_lab.studies.real_data.comparison import (
    CALIBRATED,
    INVERSE,
    MOMENTUM,
    NOISE,
    PAPER,
    PUBLISHED,
    Comparison,
)
from gaitd_lab.studies.real_data.judgement import mean_response
from gaitd_lab.studies.real_data.situations import Situation, Values
from observer.filter.status import Status
from observer.offline.batch import BatchEstimates

DETAIL_S: Final = (9.2, 12.0)
SLIDE: Final = 1
REFERENCE_HZ: Final = 20.0
"""Edge of the low-pass without delay that gives the friction's reference."""
COLOURS: Final = {
    PUBLISHED: FAINT,
    CALIBRATED: ESTIMATE,
    NOISE: GOOD,
    PAPER: TRUTH,
    MOMENTUM: BAD,
    INVERSE: FRICTION,
}


def draw_axis(found: Comparison) -> Figure:
    """Draw position, velocity, force, friction and disturbance: all of the record, and a detail."""
    seen = found.situations[-1]
    made = estimate(seen.source, found.plain)
    figure = Figure(figsize=(14, 12.5), layout="constrained")
    grid = figure.subplots(5, 2, sharex="col", squeeze=False, width_ratios=[1.5, 1.0])
    time_s = seen.source.recording.time_s
    limits = ((float(time_s[0]), float(time_s[-1])), DETAIL_S)
    for column, (begin_s, end_s) in enumerate(limits):
        rows = (time_s >= begin_s) & (time_s <= end_s)
        panels = [grid[row][column] for row in range(5)]
        _panels(panels, seen, made, found, rows)
        panels[-1].set_xlim(begin_s, end_s)
        x_label(panels[-1], "time since the record began [s]")
    figure.suptitle(
        "The paper's Fig. 5 on a recorded axis (EMPS, validation record)\n"
        f"pulses of {seen.truth_n.max():.0f} N that the observer does not see in the force",
        fontsize=12,
        color=TEXT,
    )
    return figure


def _panels(
    panels: list[Axes],
    seen: Situation,
    made: BatchEstimates,
    found: Comparison,
    rows: np.ndarray,
) -> None:
    axis, time_s = AXES[SLIDE], seen.source.recording.time_s
    exerted, truth = seen.force_n + seen.truth_n, seen.truth_n

    def estimated(panel: Axes, state: int, colour: str = ESTIMATE) -> None:
        value, std = made.state[:, state], made.std[:, state]
        band(panel, time_s, value - std, value + std, colour, "±1σ")
        line(panel, time_s, value, colour, "estimated", 1.2)

    style(panels[0], "(a) position", axis.position)
    line(panels[0], time_s, seen.position_m, MEASURED, "measured", 2.6)
    estimated(panels[0], 1)
    limit_to(panels[0], seen.position_m[rows], share=1.0)
    style(panels[1], "(b) velocity", axis.velocity)
    line(panels[1], time_s, seen.velocity, MEASURED, "central difference", 2.6)
    estimated(panels[1], 3)
    limit_to(panels[1], seen.velocity[rows], share=1.0)
    style(panels[2], "(c) drive force", axis.effort)
    line(panels[2], time_s, exerted, MEASURED, "exerted", 2.0)
    line(panels[2], time_s, seen.force_n, BAD, "seen by the observer", 0.9)
    limit_to(panels[2], exerted[rows], seen.force_n[rows], share=1.0)
    style(panels[3], "(d) friction", axis.effort)
    reference = _friction_reference(seen, exerted, found.mass_kg)
    line(panels[3], time_s, reference, TRUTH, "exerted − m a, no delay", 2.2)
    estimated(panels[3], 5, FRICTION)
    limit_to(panels[3], reference[rows], share=0.98)
    style(panels[4], "(e) disturbance", axis.effort)
    line(panels[4], time_s, truth, TRUTH, "pulses", 2.2)
    estimated(panels[4], 7)
    _mark_gated(panels[4], time_s[(made.status & Status.GATED) != 0])
    limit_to(panels[4], truth[rows], made.state[rows, 7], share=1.0)
    for panel in panels:
        legend(panel)


def _friction_reference(seen: Situation, exerted: Values, mass_kg: float) -> Values:
    """Force that inertia leaves, with pulses and acceleration through a filter without delay."""
    time_s = seen.source.recording.time_s
    force = np.append(exerted[1:], exerted[-1])  # a row's force acted before it
    about = 0.5 * (exerted + force)
    left = about - mass_kg * np.gradient(seen.velocity, time_s)
    rate_hz = 1.0 / float(np.median(np.diff(time_s)))
    low_pass = np.asarray(butter(2, REFERENCE_HZ, fs=rate_hz, output="sos"))
    return np.asarray(sosfiltfilt(low_pass, left), dtype=np.float64)


def _mark_gated(panel: Axes, times: Values) -> None:
    panel.plot(
        times,
        np.full(len(times), 0.03),
        transform=panel.get_xaxis_transform(),
        color=BAD,
        marker="|",
        markersize=6,
        linestyle="",
        label="sample rejected",
    )


def draw_speed(found: Comparison) -> Figure:
    """Draw the mean response to a step, and the false force over the time to 90 % of it."""
    seen = found.situations[-1]
    figure = Figure(figsize=(13, 5.2), layout="constrained")
    steps, errors = figure.subplots(1, 2)
    style(steps, "mean response to all edges of the pulses", "part of the step")
    steps.axhline(1.0, color=FAINT, linewidth=0.7)
    for name, colour in COLOURS.items():
        times, response = mean_response(found.runs[name](seen).force_n, seen)
        steps.plot(1e3 * times, response, color=colour, linewidth=1.5, label=name)
        score = found.scores[name][-1]
        ninety_ms, false_n = 1e3 * score.ninety_s, score.false_n
        if name in found.trade:
            curve = 1e3 * np.array([one[0] for one in found.trade[name]])
            errors.plot(curve, [one[1] for one in found.trade[name]], color=colour, linewidth=1.5)
        errors.plot(ninety_ms, false_n, color=colour, marker="o", linestyle="", label=name)
    steps.set_xlim(-10, 160)
    x_label(steps, "time after the step [ms]")
    steps.legend(fontsize=7.5, frameon=False, loc="lower right", labelcolor=TEXT)
    style(errors, "false force, 150 ms after a step and later", "N rms")
    errors.set_xlim(0, 130)
    errors.set_ylim(1.5, 3.0)
    x_label(errors, "time to 90 % of a step [ms]; lines: other bandwidths")
    return figure
