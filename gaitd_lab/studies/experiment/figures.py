"""Pictures of the experiment: one for each axis with the paper's five panels, and two details."""

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis.drawing import (
    AXES,
    BAD,
    ESTIMATE,
    FAINT,
    FRICTION,
    MEASURED,
    TEXT,
    TRUTH,
    band,
    legend,
    limit_to,
    line,
    stretches,
    style,
)
from gaitd_lab.studies.experiment.measures import Marks, Run, Transfer, transfer
from observer.filter.leg_model import STEP_S
from observer.filter.status import Status, Validity
from observer.mechanism.friction import FrictionParameters, static_friction_of

Values = NDArray[np.float64]
Flags = NDArray[np.bool_]

SUBTITLE_IN: Final = 0.38
"""Distance below the upper edge."""
TIME: Final = "time since the scenario began [s]"
FIGURES: Final = (4, 5)
"""Numbers in the paper, by axis."""
REST: Final = "#eceff2"
DERIVATIVE: Final = "#c9cfd6"
BEFORE_S: Final = 0.15
PEAK_AFTER_S: Final = 0.25
ONSET_BEFORE_S: Final = 0.5
ONSET_AFTER_S: Final = 1.0


def draw_axis(run: Run, index: int, subtitle: str) -> Figure:
    """Draw position, velocity, input, friction and disturbance of one axis over the whole run.

    Args:
        run: as played.
        index: 0 for the hip, 1 for the slide.
        subtitle: what was played, and with which plant.
    """
    figure = Figure(figsize=(11, 13), layout="constrained")
    panels = list(figure.subplots(5, 1, sharex=True, height_ratios=[1, 1.15, 1, 1.15, 1.25]))
    for panel in panels:
        _shade_rest(panel, run, index)
    _position(panels[0], run, index)
    _velocity(panels[1], run, index)
    _input(panels[2], run, index)
    _friction(panels[3], run, index)
    _disturbance(panels[4], run, index)
    panels[4].set_xlabel(TIME, fontsize=8.5, color=TEXT)
    panels[4].set_xlim(0.0, float(run.time_s[-1]) + STEP_S)
    title = f"The paper's Fig. {FIGURES[index]}, played again: {AXES[index].name}"
    return _titled(figure, title, subtitle)


def draw_details(
    run: Run,
    marks: Marks,
    open_gate: Flags,
    slide_friction: FrictionParameters,
    subtitle: str,
) -> Figure:
    """Draw two magnified details: the velocity's peak after the step, and low-pass and memory.

    Args:
        run: as played.
        marks: times of the scenario.
        open_gate: shape (n, 2), where the axis truly moves.
        slide_friction: friction of the plant, for its static law.
        subtitle: what was played.
    """
    figure = Figure(figsize=(13, 9), layout="constrained")
    grid = figure.subplots(3, 2, squeeze=False, height_ratios=[1, 1.2, 1.2])
    _peak_detail([grid[row][0] for row in range(3)], run, marks)
    _memory_detail([grid[row][1] for row in range(3)], run, marks, open_gate, slide_friction)
    return _titled(figure, "Two details, magnified", subtitle)


def _titled(figure: Figure, title: str, subtitle: str) -> Figure:
    figure.suptitle(f"{title}\n", fontsize=13, color=TEXT, fontweight="bold")
    below = 1 - SUBTITLE_IN / figure.get_size_inches()[1]
    figure.text(0.5, below, subtitle, ha="center", va="center", fontsize=9, color=MEASURED)
    return figure


# --- the five panels --------------------------------------------------------------------------


def _position(panel: Axes, run: Run, index: int) -> None:
    style(panel, "(a) position", AXES[index].position)
    line(panel, run.time_s, run.measured[:, index], MEASURED, "measured", 2.6)
    _estimate(panel, run, index, "estimated, ±1σ")
    legend(panel)


def _velocity(panel: Axes, run: Run, index: int) -> None:
    style(panel, "(b) velocity", AXES[index].velocity)
    line(panel, run.time_s, run.derivative[:, index], DERIVATIVE, "difference of positions", 0.9)
    line(panel, run.time_s, run.true_velocity[:, index], TRUTH, "true", 2.2)
    _estimate(panel, run, 2 + index, "estimated, ±1σ")
    limit_to(panel, run.true_velocity[:, index], run.state[:, 2 + index], share=1.0)
    legend(panel)


def _input(panel: Axes, run: Run, index: int) -> None:
    axis = AXES[index]
    seen = run.exerted[:, index] - run.artificial[:, index]
    style(panel, f"(c) drive {axis.effort_name}", axis.effort)
    line(panel, run.time_s, run.exerted[:, index], MEASURED, "exerted, as measured", 2.0)
    line(panel, run.time_s, seen, BAD, "seen by the observer: exerted − d_art", 0.9)
    legend(panel)


def _friction(panel: Axes, run: Run, index: int) -> None:
    style(panel, "(d) friction", AXES[index].effort)
    line(panel, run.time_s, run.true_friction[:, index], TRUTH, "true", 2.2)
    _estimate(panel, run, 4 + index, "estimated, ±1σ", FRICTION)
    legend(panel)


def _disturbance(panel: Axes, run: Run, index: int) -> None:
    axis = AXES[index]
    value, std = run.state[:, 6 + index], run.std[:, 6 + index]
    split = np.where(run.validity[:, index] == Validity.OK, value, np.nan)
    style(panel, f"(e) disturbance: what a patient's {axis.effort_name} would be", axis.effort)
    line(panel, run.time_s, run.artificial[:, index], TRUTH, "d_art", 2.2)
    band(panel, run.time_s, value - std, value + std, ESTIMATE, "±1σ")
    line(panel, run.time_s, value, ESTIMATE, "", 0.6)
    line(panel, run.time_s, split, ESTIMATE, "estimated; thin: at rest, not published", 1.5)
    limit_to(panel, run.artificial[:, index], value, share=1.0)
    _mark_gated(panel, run)
    legend(panel)


def _estimate(
    panel: Axes, run: Run, state: int, label: str, colour: str = ESTIMATE, width: float = 1.1
) -> None:
    value, std = run.state[:, state], run.std[:, state]
    band(panel, run.time_s, value - std, value + std, colour)
    line(panel, run.time_s, value, colour, label, width)


def _shade_rest(panel: Axes, run: Run, index: int) -> None:
    """Shade the times without a valid split of friction and disturbance."""
    _shade(panel, run.validity[:, index] != Validity.OK, run.time_s)


def _shade(panel: Axes, flags: Flags, time_s: Values) -> None:
    for begin_s, length_s in stretches(flags, time_s):
        panel.axvspan(begin_s, begin_s + length_s, color=REST, linewidth=0, zorder=0)


def _mark_gated(panel: Axes, run: Run) -> None:
    """Mark each rejected sample at the lower edge."""
    times = run.time_s[(run.status & Status.GATED) != 0]
    if len(times):
        panel.plot(
            times,
            np.full(len(times), 0.02),
            transform=panel.get_xaxis_transform(),
            color=BAD,
            marker="|",
            markersize=7,
            linestyle="",
            label="sample rejected",
        )


# --- the two details --------------------------------------------------------------------------


def _peak_detail(panels: list[Axes], run: Run, marks: Marks) -> None:
    shown = run.between(marks.step_s - BEFORE_S, marks.step_end_s + PEAK_AFTER_S)
    torque, velocity, friction = panels
    style(torque, "hip torque", "N·m")
    style(velocity, "hip velocity", "rad/s")
    style(friction, "hip friction", "N·m")
    if not len(shown.time_s):
        _nothing(panels)
        return
    line(torque, shown.time_s, shown.exerted[:, 0], MEASURED, "exerted, as measured", 1.8)
    velocity.plot(
        shown.time_s,
        shown.derivative[:, 0],
        color=FAINT,
        marker=".",
        markersize=3,
        linewidth=0.6,
        label="difference of positions",
    )
    line(velocity, shown.time_s, shown.true_velocity[:, 0], TRUTH, "true", 2.6)
    _estimate(velocity, shown, 2, "estimated, ±1σ", width=1.3)
    line(friction, shown.time_s, shown.true_friction[:, 0], TRUTH, "true", 2.6)
    _estimate(friction, shown, 4, "estimated, ±1σ", FRICTION, 1.3)
    _finish(panels, shown)


def _memory_detail(
    panels: list[Axes], run: Run, marks: Marks, open_gate: Flags, friction: FrictionParameters
) -> None:
    begin_s, end_s = marks.onset_s - ONSET_BEFORE_S, marks.onset_s + ONSET_AFTER_S
    shown = run.between(begin_s, end_s)
    speed, rubbing, disturbance = panels
    style(speed, "slide velocity", "m/s")
    style(rubbing, "slide friction", "N")
    style(disturbance, "slide disturbance", "N")
    if not len(shown.time_s):
        _nothing(panels)
        return
    line(speed, shown.time_s, shown.derivative[:, 1], DERIVATIVE, "difference of positions", 0.9)
    line(speed, shown.time_s, shown.true_velocity[:, 1], TRUTH, "true", 2.6)
    _estimate(speed, shown, 3, "estimated, ±1σ", width=1.3)
    static = np.array([static_friction_of(friction, float(v)) for v in shown.true_velocity[:, 1]])
    line(rubbing, shown.time_s, static, FAINT, "static law at the true speed", 0.9)
    line(rubbing, shown.time_s, shown.true_friction[:, 1], TRUTH, "true", 2.6)
    _estimate(rubbing, shown, 5, "estimated, ±1σ", FRICTION, 1.3)
    line(disturbance, shown.time_s, shown.artificial[:, 1], TRUTH, "d_art", 2.6)
    _estimate(disturbance, shown, 7, "estimated, ±1σ", width=1.3)
    found = transfer(run, marks, open_gate)
    if found is not None:
        _mark_transfer(panels, found)
    for panel, values in ((speed, shown.true_velocity), (rubbing, shown.true_friction)):
        limit_to(panel, values[:, 1], share=1.0)
    _finish(panels, shown)
    closed = ~open_gate[(run.time_s >= begin_s) & (run.time_s < end_s), 1]
    for panel in panels:
        _shade(panel, closed, shown.time_s)


def _mark_transfer(panels: list[Axes], found: Transfer) -> None:
    """Draw lines at the onset of the disturbance, of motion, and where nine tenths are found."""
    moved_s, reached_s = found.onset_s + found.motion_s, found.onset_s + found.reached_s
    for panel in panels:
        panel.axvline(moved_s, color=TEXT, linewidth=0.8, linestyle="--")
        panel.axvline(reached_s, color=ESTIMATE, linewidth=0.8, linestyle=":")
    _note(panels[0], moved_s, 0.05, "gate opens", TEXT)
    _note(panels[1], moved_s, 0.05, "low-pass", TEXT)
    _note(panels[1], moved_s, 0.05, "memory", TEXT, left=True)
    late_ms = round(1e3 * found.after_motion_s)
    words = f"90 % found {abs(late_ms)} ms {'before' if late_ms < 0 else 'after'} motion"
    _note(panels[2], max(moved_s, reached_s), 0.4, words, ESTIMATE)


def _note(
    panel: Axes, time_s: float, height: float, words: str, colour: str, *, left: bool = False
) -> None:
    panel.annotate(
        words,
        (time_s, height),
        xycoords=("data", "axes fraction"),
        xytext=(-4 if left else 4, 0),
        textcoords="offset points",
        ha="right" if left else "left",
        fontsize=8,
        color=colour,
    )


def _finish(panels: list[Axes], shown: Run) -> None:
    for panel in panels:
        panel.set_xlim(float(shown.time_s[0]), float(shown.time_s[-1]))
        legend(panel)
    panels[-1].set_xlabel(TIME, fontsize=8.5, color=TEXT)


def _nothing(panels: list[Axes]) -> None:
    for panel in panels:
        panel.text(
            0.5, 0.5, "not played", transform=panel.transAxes, ha="center", fontsize=9, color=FAINT
        )
