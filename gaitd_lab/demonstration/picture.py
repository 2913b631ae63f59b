"""The picture of a demonstration: estimate and truth, their difference, friction, lateness."""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from gaitd_client import wire
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter

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
    Values,
    band,
    legend,
    limit_to,
    line,
    style,
    x_label,
)
from gaitd_lab.demonstration.evaluation import AXES, Pair, Row, Span
from gaitd_lab.demonstration.script import Kind
from gaitd_lab.demonstration.training import TrainingResult

QUIET_S: Final = 1.0
NAME_WIDTH: Final = 12
NAME_HEIGHT: Final = 0.25
"""Share of a panel that is kept free for the names above all lines."""
GAPS: Final = (
    "A gap in an estimate: the axis rests, or has just begun to move. Patient and friction "
    "can then not be told apart, and neither is published.\n"
    "A gap in all lines: the service is not running, between two parts of the demonstration.\n"
    "One run, with one draw of the noise; docs/strides.md and docs/experiment.md have medians and "
    "ranges over ten."
)
SHADES: Final = {
    Kind.INTERLUDE: "#f3f4f6",
    Kind.PASSIVE: "#e8f1e4",
    Kind.ACTIVE: "#e4eefb",
    Kind.TIRING: "#e4eefb",
    Kind.OPEN_LOOP: "#fbf1e0",
}


class Walk(NamedTuple):
    """Strides of a patient who tires."""

    strides: Sequence[wire.Stride]
    helps: Sequence[wire.ControllerState]
    """Empty without help."""


class Results(NamedTuple):
    """All results of a demonstration."""

    pairs: tuple[Pair, Pair]
    spans: Sequence[Span]
    rows: Sequence[Row]
    health: Sequence[wire.Health]
    """The last lateness of each act; only with the computer's clock, simulated time has none."""
    trouble: str
    """Reason of an early end; empty if it was complete."""
    walks: Sequence[Walk] = ()
    """Strides of a patient who tires, without help and with it."""
    trained: TrainingResult | None = None
    """The session of a training; None: none was played."""

    @property
    def passed(self) -> bool:
        """True if all errors are within bounds, nothing stopped, and something was evaluated.

        A training has passed if its session was walked as planned.
        """
        if self.trained is not None:
            return not self.trouble and self.trained.passed
        return not self.trouble and bool(self.rows) and all(row.passed for row in self.rows)


def draw(results: Results, path: Path) -> None:
    """Draw a PNG.

    Raises:
        OSError: the file cannot be written.
    """
    figure = Figure(figsize=(14, 10.5), layout="constrained")
    grid = figure.subplots(4, 2, squeeze=False, height_ratios=[1.5, 1.0, 1.0, 0.9])
    begin_ns = min((span.begin_ns for span in results.spans), default=0)
    for index, pair in enumerate(results.pairs):
        _column([grid[row][index] for row in range(3)], results, pair, index, begin_ns)
    _lateness(grid[3][0], results.health)
    _table(grid[3][1], results)
    verdict = "all within bounds" if results.passed else results.trouble or "out of bounds"
    figure.suptitle(
        f"gaitd demo: the patient as estimated through CAN frames, and as scripted · {verdict}",
        fontsize=13,
        color=TEXT if results.passed else BAD,
    )
    figure.supxlabel(GAPS, x=0.01, ha="left", fontsize=9, color=TEXT)
    figure.savefig(path, dpi=DPI, format="png")


class _Curves(NamedTuple):
    """Data of one axis, ready to draw: seconds, and NaN where there was no message."""

    time: Values
    estimate: Values
    std: Values
    wanted: Values
    friction: Values
    true_friction: Values


def _curves(pair: Pair, begin_ns: int) -> _Curves:
    time = np.asarray((pair.time_ns - begin_ns) * 1e-9, dtype=np.float64)
    # Between two acts there are no messages: no line is drawn across the gap.
    quiet = np.flatnonzero(np.diff(time) > QUIET_S) + 1
    values = (pair.estimate, pair.std, pair.wanted, pair.friction, pair.true_friction)
    return _Curves(
        np.insert(time, quiet, time[quiet]),
        *(np.insert(one, quiet, np.nan) for one in values),
    )


def _column(panels: list[Axes], results: Results, pair: Pair, index: int, begin_ns: int) -> None:
    axis, _, unit = AXES[index]
    curves = _curves(pair, begin_ns)
    time, estimate, std = curves.time, curves.estimate, curves.std
    patient, error, rubbing = panels
    for panel in panels:
        _shade(panel, results.spans, begin_ns)
        if len(time):
            panel.set_xlim(float(time[0]), float(time[-1]))
    quantity = "torque" if axis == "hip" else "force"

    style(patient, f"{axis}: patient {quantity}", unit)
    _name_spans(patient, results.spans, begin_ns)
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


def _lateness(panel: Axes, healths: Sequence[wire.Health]) -> None:
    if not healths:
        panel.axis("off")
        said = "simulated time: nothing is late\n`gaitd demo --wall-clock` shows how late SYNC is"
        panel.text(0.0, 0.8, said, fontsize=9, color=TEXT, transform=panel.transAxes)
        return
    style(panel, "lateness of SYNC", "cycles")
    bounds = healths[0].lateness_bound_us
    counts = np.sum([health.lateness_count for health in healths], axis=0)
    names = [*(f"≤ {_duration(bound)}" for bound in bounds), f"> {_duration(bounds[-1])}"]
    panel.bar(range(len(counts)), np.maximum(counts, 0.5), color=ESTIMATE, width=0.8)
    panel.set_yscale("log")
    panel.set_ylim(0.5, max(float(counts.max()) * 3, 10))
    panel.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    panel.set_xticks(range(len(names)), names, rotation=40, ha="right", fontsize=7)
    for place, count in enumerate(counts):
        if count:
            panel.text(place, count * 1.15, f"{count}", ha="center", fontsize=7, color=TEXT)


def _duration(us: int) -> str:
    return f"{us / 1000:g} ms" if us >= 1000 else f"{us} µs"


def _table(panel: Axes, results: Results) -> None:
    panel.axis("off")
    if not results.rows:
        return
    cells: list[list[str]] = []
    colours: list[str] = []
    for row in results.rows:
        # A constant zero patient has no correlation.
        asked = row.span.kind is not Kind.PASSIVE and not np.isnan(row.score.correlation)
        correlation = f"{row.score.correlation:.3f}" if asked else "–"
        cells.append(
            [
                f"{row.span.title}",
                row.axis,
                f"{row.score.rms:.2f} {row.unit}",
                f"{row.rms_bound:g} {row.unit}",
                correlation,
                f"{row.score.covered_ratio:.0%}",
            ]
        )
        colours.append(GOOD if row.passed else BAD)
    table = panel.table(
        cellText=cells,
        colLabels=["span", "axis", "rms error", "bound", "correlation", "valid"],
        colWidths=[0.44, 0.08, 0.15, 0.13, 0.12, 0.08],
        loc="center",
        cellLoc="left",
        edges="horizontal",
    )
    table.auto_set_font_size(False)
    table.set_fontsize(8)
    table.scale(1, 1.25)
    for (line_number, column), cell in table.get_celld().items():
        cell.set_edgecolor(FAINT)
        cell.set_linewidth(0.5)
        cell.get_text().set_color(TEXT)
        if line_number > 0 and column == 2:
            cell.get_text().set_color(colours[line_number - 1])
            cell.get_text().set_fontweight("bold")
