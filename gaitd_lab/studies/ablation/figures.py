"""Figures of the ablation: grouped bars, one figure for each question."""

from collections.abc import Sequence
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.drawing import AXES, SERIES, TEXT, style
from gaitd_lab.studies.ablation.errors import Results
from gaitd_lab.studies.ablation.questions import Question
from gaitd_lab.studies.report import Measured, measured, rounded

BAR_MAX: Final = 0.25
"""Share of a group's width."""


def draw(
    question: Question, situations: Sequence[str], choices: Sequence[str], found: Results
) -> Figure:
    """Draw grouped bars: hip above, slide below, one group for each situation; lines are ranges."""
    figure = Figure(figsize=(9.0, 5.6), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    for axis, panel in enumerate(panels):
        name = AXES[axis].name
        style(panel, f"{name}: rms error of the {question.measured}", AXES[axis].effort)
        panel.grid(visible=False, axis="x")
        spreads = [
            [
                measured(getattr(one, question.measure)[axis] for one in found[situation, choice])
                for choice in choices
            ]
            for situation in situations
        ]
        _bars(panel, spreads, choices)
    panels[1].set_xticks(range(len(situations)), [_wrapped(one) for one in situations])
    figure.suptitle(question.title, x=0.01, ha="left", fontsize=12, color=TEXT, fontweight="bold")
    handles, labels = panels[0].get_legend_handles_labels()
    place = "outside lower center"
    figure.legend(handles, labels, loc=place, ncols=len(labels), frameon=False, labelcolor=TEXT)
    return figure


def _bars(
    panel: Axes, spreads: Sequence[Sequence[Measured | None]], choices: Sequence[str]
) -> None:
    """Draw one group for each row, one colour for each column, each bar with range and number."""
    width = min(0.8 / len(choices), BAR_MAX)
    for column, choice in enumerate(choices):
        panel.bar([0.0], [0.0], color=SERIES[column], label=choice)
        for row, spread in enumerate(one[column] for one in spreads):
            place = row + (column - (len(choices) - 1) / 2) * width
            if spread is None:
                continue
            panel.bar(place, spread.value, 0.92 * width, color=SERIES[column])
            panel.vlines(place, spread.value_low, spread.value_high, color=TEXT, linewidth=1.0)
            panel.annotate(
                rounded(spread.value),
                (place, spread.value_high),
                (0, 2),
                textcoords="offset points",
                ha="center",
                fontsize=7.5,
                color=TEXT,
            )
    panel.margins(y=0.15)


def _wrapped(situation: str) -> str:
    return situation.replace(", ", ",\n", 1)
