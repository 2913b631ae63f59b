"""Picture of the strides of a recording: work of each, and the patient over gait phase."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from analysis.drawing import AXES, BAD, ESTIMATE, FAINT, GOOD, TEXT, legend, style, x_label
from observer.filter.status import Validity
from observer.offline.batch import BatchEstimates
from observer.strides import AxisStride, Stride

DPI: Final = 100
SHOWN_MAX: Final = 60
"""More bars are not distinguishable: only the last strides are drawn."""


def draw(
    strides: Sequence[tuple[int, Stride]],
    time_s: NDArray[np.float64],
    smooth: BatchEstimates,
) -> Figure:
    """Draw the work of each stride with its sigma, and the smoothed patient effort over phase.

    Args:
        strides: each with its first row.
        time_s: of the rows.
        smooth: the smoothed recording.
    """
    figure = Figure(figsize=(11, 7), dpi=DPI, layout="constrained")
    panels = figure.subplots(2, 2, width_ratios=[1.6, 1.0])
    shown = strides[-SHOWN_MAX:]
    for axis, names in enumerate(AXES):
        _bars(panels[axis][0], shown, len(strides) - len(shown), names.name)
        _over_phase(panels[axis][1], shown, time_s, smooth, axis, names.effort)
    return figure


def _bars(panel: Axes, shown: Sequence[tuple[int, Stride]], before: int, name: str) -> None:
    style(panel, f"{name}: patient's work in each stride, ±1σ", "J")
    numbers = [before + index for index in range(1, len(shown) + 1)]
    for of_axis, colour, label in (
        ([_of(stride, name).work_positive_j for _, stride in shown], GOOD, "with the motion"),
        ([_of(stride, name).work_negative_j for _, stride in shown], BAD, "against it"),
    ):
        panel.bar(numbers, of_axis, 0.7, color=colour, label=label)
    for number, (_, stride) in zip(numbers, shown, strict=True):
        axis = _of(stride, name)
        for value, std in (
            (axis.work_positive_j, axis.work_positive_j_std),
            (axis.work_negative_j, axis.work_negative_j_std),
        ):
            panel.plot([number, number], [value - std, value + std], color=TEXT, linewidth=1.2)
    panel.axhline(0.0, color=FAINT, linewidth=0.8)
    x_label(panel, "stride")
    panel.xaxis.set_major_locator(MaxNLocator(integer=True))
    legend(panel)


def _over_phase(
    panel: Axes,
    shown: Sequence[tuple[int, Stride]],
    time_s: NDArray[np.float64],
    smooth: BatchEstimates,
    axis: int,
    unit: str,
) -> None:
    style(panel, "all strides over their phase, smoothed", unit)
    panel.axhline(0.0, color=FAINT, linewidth=0.8)
    for begin, stride in shown:
        rows = slice(begin, begin + stride.sample_count)
        known = smooth.validity[rows, axis] == Validity.OK
        phase = 100.0 * (time_s[rows] - time_s[begin]) / stride.duration_s
        patient = np.where(known, smooth.state[rows, 6 + axis], np.nan)
        panel.plot(phase, patient, color=ESTIMATE, linewidth=0.8, alpha=0.5)
    panel.set_xlim(0.0, 100.0)
    x_label(panel, "stride [%], from a rise of the hip; gaps: at rest")


def _of(stride: Stride, name: str) -> AxisStride:
    return stride.hip if name == "hip" else stride.slide
