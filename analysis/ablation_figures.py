"""Figures of the ablation: grouped bars, one figure for each question, and the coverage."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.ablation import Ablation, Results
from analysis.ablation_choices import SHIPPED
from analysis.ablation_questions import Question
from analysis.drawing import (
    AXES,
    ESTIMATE,
    FAINT,
    GOOD,
    MEASURED,
    OTHER,
    SERIES,
    TEXT,
    style,
    x_label,
)

DPI: Final = 110
BAR_MAX: Final = 0.25
"""Share of a group's width."""
COVERED: Final = 0.9973
"""Coverage of 3 sigma by a Gaussian."""
COVERAGES: Final = (
    ("patient_covered", "patient, axis OK", ESTIMATE, "o"),
    ("patient_at_rest_covered", "patient, at rest", OTHER, "D"),
    ("net_covered", "net", GOOD, "s"),
    ("velocity_covered", "velocity", MEASURED, "^"),
)
"""Field of `ablation.Errors`, label, colour and marker."""


def answered(question: Question, results: Results) -> tuple[list[str], list[str]]:
    """Return the situations and choices of a question that have results."""
    situations = [one for one in question.situations if (one, SHIPPED) in results]
    known = {choice for _, choice in results}
    return situations, [one for one in question.choices if one in known]


def draw_question(question: Question, found: Ablation, path: Path) -> None:
    """Draw grouped bars: hip above, slide below, one group for each situation; lines are ranges.

    Raises:
        OSError: the file cannot be written.
    """
    situations, choices = answered(question, found.medians)
    figure = Figure(figsize=(9.0, 5.6), dpi=DPI, layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    for axis, panel in enumerate(panels):
        name = AXES[axis].name
        style(panel, f"{name}: rms error of the {question.measured}", AXES[axis].effort)
        panel.grid(visible=False, axis="x")
        medians, *draws = (
            np.array(
                [
                    [getattr(one[situation, choice], question.measure)[axis] for choice in choices]
                    for situation in situations
                ]
            )
            for one in (found.medians, *found.draws)
        )
        _bars(panel, medians, np.array(draws), choices)
    panels[1].set_xticks(range(len(situations)), [_wrapped(one) for one in situations])
    _save(figure, question.title, panels[0], path)


def draw_coverage(situations: Sequence[str], results: Results, path: Path) -> None:
    """Draw the share of samples within 3 sigma for each situation, with the shipped settings.

    Raises:
        OSError: the file cannot be written.
    """
    figure = Figure(figsize=(9.0, 1.6 + 0.27 * len(situations)), dpi=DPI, layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    rows = np.arange(len(situations))
    for axis, panel in enumerate(panels):
        style(panel, AXES[axis].name)
        panel.axvline(COVERED, color=FAINT, linewidth=1.0, linestyle="--")
        for place, (field, label, colour, marker) in enumerate(COVERAGES):
            shares = [getattr(results[one, SHIPPED], field)[axis] for one in situations]
            offset = 0.18 * (place - 1.5)
            panel.plot(
                shares, rows + offset, marker, color=colour, label=label, markersize=4.5, alpha=0.9
            )
        panel.set_xlim(0.37, 1.02)
        x_label(panel, "share of samples within 3 sigma")
    panels[0].set_yticks(rows, situations)
    panels[0].set_ylim(len(situations) - 0.5, -0.5)
    _save(figure, "Measured 3-sigma coverage, as shipped (dashed: 0.9973)", panels[0], path)


def _save(figure: Figure, title: str, panel: Axes, path: Path) -> None:
    """Write a figure with a title above and the legend of one panel below."""
    figure.suptitle(title, x=0.01, ha="left", fontsize=12, color=TEXT, fontweight="bold")
    handles, labels = panel.get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="outside lower center",
        ncols=len(labels),
        frameon=False,
        fontsize=9,
        labelcolor=TEXT,
    )
    figure.savefig(path)


def _bars(panel: Axes, values: np.ndarray, draws: np.ndarray, choices: Sequence[str]) -> None:
    """Draw one group for each row, one colour for each column, each bar with range and number."""
    low, high = np.fmin.reduce(draws), np.fmax.reduce(draws)
    width = min(0.8 / len(choices), BAR_MAX)
    for column, choice in enumerate(choices):
        places = np.arange(len(values)) + (column - (len(choices) - 1) / 2) * width
        heights = values[:, column]
        panel.bar(places, heights, 0.92 * width, color=SERIES[column], label=choice)
        panel.vlines(places, low[:, column], high[:, column], color=TEXT, linewidth=1.0)
        for place, height, top in zip(places, heights, high[:, column], strict=True):
            known = np.isfinite(height)
            panel.annotate(
                three_digits(height),
                (place, top if known else 0.0),
                (0, 2),
                textcoords="offset points",
                ha="center",
                va="bottom",
                fontsize=7.5,
                color=TEXT if known else FAINT,
            )
    panel.margins(y=0.15)


def three_digits(value: float) -> str:
    """Format a number with three significant digits or less: 0.11, 1.09, 12.4, 120."""
    if np.isnan(value):
        return "–"
    return f"{value:.2f}" if value < 9.995 else f"{value:.1f}" if value < 99.95 else f"{value:.0f}"


def _wrapped(situation: str) -> str:
    return situation.replace(", ", ",\n", 1)
