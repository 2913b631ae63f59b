"""Pictures of a calibration: friction over velocity, and residuals before and after."""

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.calibration.quantities import law_of
from analysis.calibration.session import Calibration
from analysis.calibration.start import left_over
from analysis.drawing import AXES, BAD, ESTIMATE, MEASURED, TEXT, legend, limit_to, style, x_label
from observer.mechanism.friction import steady_friction

POINTS_MAX: Final = 2000


def draw_friction(calibration: Calibration) -> Figure:
    """Draw the friction law of both axes, before and after, over the recorded motion."""
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    left = left_over(calibration.fit.frame, calibration.fit.natural, calibration.motion)
    for axis, axes in enumerate(figure.subplots(1, 2)):
        speed = calibration.motion.velocity[:, axis]
        chosen = _thinned(np.flatnonzero(calibration.motion.settled))
        style(axes, f"{AXES[axis].name.title()} friction over velocity", AXES[axis].effort)
        axes.plot(
            speed[chosen], left[chosen, axis], ".", color=MEASURED, ms=2, alpha=0.35, label="motion"
        )
        top = float(np.quantile(np.abs(speed), 0.999)) * 1.05 + 1e-3
        # Dense about zero, where the law is curved.
        grid = np.linspace(-1, 1, 801) ** 3 * top
        before = np.array([one.before for one in calibration.fit.results])
        for natural, colour, words in (
            (before, BAD, "before"),
            (calibration.fit.natural, ESTIMATE, "fitted"),
        ):
            law = law_of(natural, axis)
            values = [steady_friction(law, float(v)) for v in grid]
            axes.plot(grid, values, color=colour, linewidth=1.5, label=words)
        axes.set_xlim(-top, top)
        limit_to(axes, left[chosen, axis], share=0.995)
        x_label(axes, f"velocity, {AXES[axis].velocity}")
        legend(axes)
    return figure


def draw_residuals(calibration: Calibration) -> Figure:
    """Draw the false patient effort in the empty machine, before and after."""
    figure = Figure(figsize=(10, 7.2), layout="constrained")
    rows = figure.subplots(2, 2)
    for axis in range(2):
        over = (
            (calibration.motion.smooth[:, axis], f"position, {AXES[axis].position}"),
            (calibration.motion.velocity[:, axis], f"velocity, {AXES[axis].velocity}"),
        )
        for column, (values, words) in enumerate(over):
            _residual(rows[axis][column], calibration, axis, values, words)
    return figure


def _residual(
    axes: Axes, calibration: Calibration, axis: int, over: np.ndarray, words: str
) -> None:
    title = f"{AXES[axis].name.title()}: false effort over {words.partition(',')[0]}"
    style(axes, title, AXES[axis].effort)
    shown: list[np.ndarray] = []
    for seen, colour, label in (
        (calibration.seen_before, BAD, "before"),
        (calibration.seen_after, ESTIMATE, "after"),
    ):
        chosen = _thinned(np.flatnonzero(seen.moving[:, axis]))
        values = seen.patient[chosen, axis]
        axes.plot(over[chosen], values, ".", color=colour, ms=2.5, alpha=0.4, label=label)
        shown.append(values)
    axes.axhline(0.0, color=TEXT, linewidth=0.7)
    if any(len(values) for values in shown):
        limit_to(axes, *shown, share=0.995)
        legend(axes)
    else:
        axes.text(0.5, 0.5, "did not move", transform=axes.transAxes, ha="center", color=TEXT)
    x_label(axes, words)


def _thinned(rows: np.ndarray) -> np.ndarray:
    return rows[:: max(1, len(rows) // POINTS_MAX)]
