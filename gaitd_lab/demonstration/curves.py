"""Curves in a terminal: plotext draws them in braille dots, rich puts them into a panel."""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import plotext
from numpy.typing import NDArray
from rich.console import Console, ConsoleOptions, RenderResult
from rich.text import Text

Values = NDArray[np.float64]

POINTS_MAX: Final = 400
"""Points of one curve: more than braille dots fit side by side."""


class Curve(NamedTuple):
    """One curve; NaN is a gap."""

    label: str
    colour: str
    """Colour name of plotext."""
    time_s: Values
    values: Values


class Chart:
    """Curves over the last seconds, in the size that rich allots."""

    def __init__(self, curves: Sequence[Curve], window_s: float, least_span: float) -> None:
        """Store the curves; they are drawn when the size is known.

        Args:
            curves: the later ones on top; time 0 is now.
            window_s: seconds shown.
            least_span: the value axis shows at least plus and minus this.
        """
        self._curves = curves
        self._window_s = window_s
        self._least_span = least_span

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Draw in the available size."""
        height = options.height or 12
        text = _drawn(self._curves, options.max_width, height, self._window_s, self._span())
        yield Text.from_ansi(text, no_wrap=True, end="")

    def _span(self) -> float:
        known = [np.abs(curve.values[np.isfinite(curve.values)]) for curve in self._curves]
        largest = max((float(one.max()) for one in known if len(one)), default=0.0)
        return max(self._least_span, _round_up(1.05 * largest))


def _round_up(value: float) -> float:
    """Round up to the next of 1, 2, 3, 5, 7 times a power of ten, so that the axis is steady."""
    if value <= 0:
        return 0.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1, 2, 3, 5, 7, 10) if step * power >= value))


def _drawn(curves: Sequence[Curve], width: int, height: int, window_s: float, span: float) -> str:
    plotext.terminal.limit(False, False)  # rich decides the size
    figure: Any = plotext.figure
    figure.clear()
    figure.theme("colorless")
    figure.canvas("default")
    figure.legend(False)
    figure.plot_size(width, height)
    figure.axes(False, axis="x", side="upper")
    figure.axes(False, axis="y", side="right")
    for curve in curves:
        for piece in _pieces(curve):
            marker = plotext.marker("braille", plotext.pixel(curve.colour))
            signal = figure.signal(piece.time_s.tolist(), piece.values.tolist(), marker=marker)
            figure.draw(signal.lines(True))
    figure.ruler("x").lim(-window_s, 0).ticks(_ticks(-window_s, 0, 5))
    figure.ruler("y").lim(-span, span).ticks(_ticks(-span, span, 5))
    return figure.build().string().rstrip("\n")


def _ticks(low: float, high: float, count: int) -> list[float]:
    return np.linspace(low, high, count).tolist()


def _pieces(curve: Curve) -> list[Curve]:
    """Return the pieces between gaps, thinned: a curve is drawn point by point."""
    step = max(1, len(curve.time_s) // POINTS_MAX)
    time_s, values = curve.time_s[::step], curve.values[::step]
    known = np.isfinite(values)
    edges = np.flatnonzero(np.diff(known.astype(np.int8))) + 1
    return [
        Curve(curve.label, curve.colour, part_time, part)
        for part_time, part in zip(np.split(time_s, edges), np.split(values, edges), strict=True)
        if len(part) > 1 and np.isfinite(part[0])
    ]
