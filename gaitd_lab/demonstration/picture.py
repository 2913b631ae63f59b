"""The picture of a demonstration: estimate and truth, their difference, friction, the errors."""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.drawing import (
    BAD,
    DPI,
    ESTIMATE,
    FAINT,
    FRICTION,
    GOOD,
    SIGMAS,
    TEXT,
    TRUTH,
    band,
    legend,
    limit_to,
    line,
    style,
    x_label,
)
from gaitd_lab.demonstration.evaluation import (
    AXES,
    Pair,
    Results,
    Span,
    axis_title,
    errors,
)
from gaitd_lab.demonstration.script import Kind

QUIET_NS: Final = 1_000_000_000
NAME_WIDTH: Final = 12
NAME_HEIGHT: Final = 0.25
"""Share of a panel that is kept free for the names above all lines."""
GAPS: Final = (
    "A gap in an estimate: the axis rests, or has just begun to move. Patient and friction "
    "can then not be told apart, and neither is published.\n"
    "A gap in all lines: the service is not running, between two parts of the demonstration.\n"
    "±3σ also holds what the robot file states as not sure ([uncertainty]); this virtual machine "
    "is exactly as its file says.\n"
    "One run, with one draw of the noise; docs/evidence has medians and ranges over ten."
)
SHADES: Final = {
    Kind.INTERLUDE: "#f3f4f6",
    Kind.PASSIVE: "#e8f1e4",
    Kind.ACTIVE: "#e4eefb",
    Kind.TIRING: "#e4eefb",
    Kind.OPEN_LOOP: "#fbf1e0",
}
WIDTHS: Final = (0.26, 0.07, 0.1, 0.08, 0.08, 0.08, 0.1, 0.09, 0.06, 0.08)
"""Widths of the columns of the table of errors, as shares."""
ROWS: Final = (1.5, 1.0, 1.0)
"""Heights of a leg's panels."""
RMS: Final = 2
"""Column of the error that is drawn in the colour of the result."""


def draw(results: Results, path: Path) -> None:
    """Draw a PNG.

    Raises:
        OSError: the file cannot be written.
    """
    legs = results.pairs
    count = max(len(legs), 1)
    figure = Figure(figsize=(14, 2.0 + 8.5 * count), layout="constrained")
    grid = figure.add_gridspec(3 * count + 1, 2, height_ratios=[*ROWS * count, 0.9 * count])
    begin_ns = min((span.begin_ns for span in results.spans), default=0)
    for number, (leg, both) in enumerate(legs.items()):
        for index, pair in enumerate(both):
            panels = [figure.add_subplot(grid[3 * number + row, index]) for row in range(3)]
            axis = axis_title(leg, AXES[index][0], legs)
            _column(panels, results.spans, pair, axis, AXES[index][2], begin_ns)
    _table(figure.add_subplot(grid[-1, :]), results)
    verdict = "all within bounds" if results.passed else results.trouble or "out of bounds"
    figure.suptitle(
        f"gaitd demo: the patient as estimated through CAN frames, and as scripted · {verdict}",
        fontsize=13,
        color=TEXT if results.passed else BAD,
    )
    figure.supxlabel(GAPS, x=0.01, ha="left", fontsize=9, color=TEXT)
    figure.savefig(path, dpi=DPI, format="png")


def _without_lines_across_gaps(pair: Pair) -> Pair:
    """Put a NaN into each gap between two acts, in which there are no messages."""
    gaps = np.flatnonzero(np.diff(pair.time_ns) > QUIET_NS) + 1
    return Pair(
        np.insert(pair.time_ns, gaps, pair.time_ns[gaps]),
        *(np.insert(values, gaps, np.nan) for values in pair[1:]),
    )


def _column(
    panels: list[Axes], spans: Sequence[Span], pair: Pair, axis: str, unit: str, begin_ns: int
) -> None:
    curves = _without_lines_across_gaps(pair)
    estimate, std = curves.estimate, curves.std
    time = np.asarray((curves.time_ns - begin_ns) * 1e-9, dtype=np.float64)
    patient, error, rubbing = panels
    for panel in panels:
        _shade(panel, spans, begin_ns)
        if len(time):
            panel.set_xlim(float(time[0]), float(time[-1]))
    quantity = "torque" if unit == "N·m" else "force"

    style(patient, f"{axis}: patient {quantity}", unit)
    _name_spans(patient, spans, begin_ns)
    band(patient, time, estimate - SIGMAS * std, estimate + SIGMAS * std, ESTIMATE, "±3σ")
    line(patient, time, curves.wanted, TRUTH, "truth", 2.2)
    line(patient, time, estimate, ESTIMATE, "estimate, where published", 1.1)
    limit_to(patient, curves.wanted, estimate)
    low, high = patient.get_ylim()
    patient.set_ylim(low, low + (high - low) / (1.0 - NAME_HEIGHT))
    legend(patient)

    style(error, f"{axis}: estimate − truth, where the estimate is published", unit)
    line(error, time, estimate - curves.wanted, ESTIMATE, "", 0.8)
    limit_to(error, estimate - curves.wanted, share=0.99)

    style(rubbing, f"{axis}: friction", unit)
    line(rubbing, time, curves.true_friction, TRUTH, "truth", 2.2)
    line(rubbing, time, curves.friction, FRICTION, "estimate", 1.0)
    legend(rubbing)
    x_label(rubbing, "time [s]")


def _seconds(span: Span, begin_ns: int) -> tuple[float, float]:
    return (span.begin_ns - begin_ns) * 1e-9, (span.end_ns - begin_ns) * 1e-9


def _shade(panel: Axes, spans: Sequence[Span], begin_ns: int) -> None:
    for span in spans:
        panel.axvspan(*_seconds(span, begin_ns), color=SHADES[span.kind], linewidth=0, zorder=0)


def _name_spans(panel: Axes, spans: Sequence[Span], begin_ns: int) -> None:
    for span in spans:
        if span.kind is not Kind.INTERLUDE:
            begin_s, end_s = _seconds(span, begin_ns)
            panel.text(
                (begin_s + end_s) / 2,
                0.97,
                textwrap.fill(span.title.removeprefix("gait, ").removeprefix("the "), NAME_WIDTH),
                transform=panel.get_xaxis_transform(),
                ha="center",
                va="top",
                fontsize=8,
                color=TEXT,
            )


def _table(panel: Axes, results: Results) -> None:
    panel.axis("off")
    if not results.rows:
        return
    _, head, rows = errors(results.rows).texts()
    count = len(WIDTHS)
    table = panel.table(
        cellText=[row[:count] for row in rows],
        colLabels=head[:count],
        colWidths=WIDTHS,
        loc="center",
        cellLoc="left",
        colLoc="left",
        edges="horizontal",
    )
    table.auto_set_font_size(False)
    table.set_fontsize(9)
    table.scale(1, 1.25)
    for (number, column), cell in table.get_celld().items():
        cell.set_edgecolor(FAINT)
        cell.set_linewidth(0.5)
        cell.get_text().set_color(TEXT)
        if number > 0 and column == RMS:
            cell.get_text().set_color(GOOD if results.rows[number - 1].passed else BAD)
            cell.get_text().set_fontweight("bold")
