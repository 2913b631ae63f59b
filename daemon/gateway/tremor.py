"""Tremor: frequency and amplitude of an oscillation that stands out of the patient's effort.

Tremor is rhythmic and lasts; it has 3 to 12 Hz (Deuschl, Bain, Brin, "Consensus statement of the
Movement Disorder Society on tremor", Mov. Disord. 13, Suppl. 3 (1998)), far above a gait of 0.5 Hz.
Each HOP the spectrum of a window of 1.28 s is computed, with a Hann window. An oscillation stands
out if it has most of the power from 2.3 to 12.5 Hz, is larger than AMPLITUDE_MIN, and is there in
each quarter of the window: a sudden effort is not, nor is clonus, which comes in bursts. It is
tremor if most of the newest windows have one frequency.

Only windows without an invalid cycle count. Nothing here reaches the core: tremor is a figure for
people. Clonus, which softens and stops, is detected in `daemon/core/safety/clonus.py`.
"""

import cmath
import math
import statistics
from collections import deque
from collections.abc import Mapping, Sequence
from operator import mul, sub
from typing import Any, Final, NamedTuple

from gaitd_names.joints import JOINTS

PERIOD_S: Final = 0.01
WINDOW: Final = 128
"""Cycles: four periods of the slowest tremor."""
HOP: Final = 16
"""Cycles from one window to the next."""
QUARTER: Final = WINDOW // 4
AMPLITUDE_MIN: Final = {"hip": 0.5, "slide": 2.5}
"""N·m and N: about the effort in this band of a patient who does not tremble, and works."""
FREQUENCY_MIN_HZ: Final = 3.0
FREQUENCY_MAX_HZ: Final = 12.0
BINS: Final = range(3, 17)
"""Multiples of 0.78 Hz around the band, each of which is computed."""
SHARE_MIN: Final = 0.7
"""Least share of the power of all bins that the peak and its neighbours have; of noise 0.2."""
STEADY_MIN: Final = 0.4
"""Least amplitude of a quarter of the window, as a share of the largest one's."""
REMEMBERED: Final = 8
"""Windows of which most must have the oscillation."""
MOST: Final = 6
SPREAD_MAX_HZ: Final = 0.8
"""From the median frequency; about the width of a bin."""
REMEMBERED_CYCLES: Final = 1000
"""A window is forgotten after so long: where an axis rests in each stride, windows are rare."""
KEPT_CYCLES: Final = 500
"""Without a newer window nothing is said after so long."""

_HANN: Final = tuple(0.5 - 0.5 * math.cos(2.0 * math.pi * n / WINDOW) for n in range(WINDOW))
_COS: Final = tuple(
    tuple(w * math.cos(2.0 * math.pi * k * n / WINDOW) for n, w in enumerate(_HANN)) for k in BINS
)
_SIN: Final = tuple(
    tuple(w * math.sin(2.0 * math.pi * k * n / WINDOW) for n, w in enumerate(_HANN)) for k in BINS
)


class Tremor(NamedTuple):
    """An oscillation of the patient's effort."""

    frequency_hz: float
    amplitude: float
    """Amplitude of the wave, N·m or N."""


class AxisTremor:
    """Tremor of one axis, cycle by cycle."""

    def __init__(self, amplitude_min: float, offset: int = 0) -> None:
        """Begin without any cycle.

        Args:
            amplitude_min: of an oscillation that counts, N·m or N.
            offset: of the cycles in which windows end, less than HOP: axes take turns.
        """
        self._amplitude_min, self._offset = amplitude_min, offset
        self._efforts: deque[float] = deque(maxlen=WINDOW + 1)
        self._windows: deque[tuple[int, Tremor | None]] = deque(maxlen=REMEMBERED)
        self._newest: Tremor | None = None
        self._of_stride: list[Tremor | None] = []
        self.now: Tremor | None = None
        """None: there is none, or the newest cycle was not valid."""

    def interrupt(self) -> None:
        """Begin a new window: a cycle was not valid, or is missing."""
        self._efforts.clear()
        self.now = None

    def add(self, cycle: int, effort: float) -> None:
        """Take the patient's effort of a valid cycle, N·m or N."""
        self._efforts.append(effort)
        if len(self._efforts) > WINDOW and cycle % HOP == self._offset:
            self._windows.append((cycle, oscillation(list(self._efforts), self._amplitude_min)))
            self._newest = _common(
                [one for at, one in self._windows if cycle - at <= REMEMBERED_CYCLES]
            )
            self._of_stride.append(self._newest)
        is_old = not self._windows or cycle - self._windows[-1][0] > KEPT_CYCLES
        self.now = None if is_old else self._newest

    def end_stride(self) -> Tremor | None:
        """Return the mean since the last call; None unless more than half of the windows had it."""
        windows, self._of_stride = self._of_stride, []
        found = [one for one in windows if one is not None]
        return _mean(found) if 2 * len(found) > len(windows) else None


class LegTremor:
    """Tremor of both axes of a leg."""

    def __init__(self) -> None:
        """Begin without any cycle."""
        self._axes = {
            name: AxisTremor(AMPLITUDE_MIN[name], index * HOP // len(JOINTS))
            for index, name in enumerate(JOINTS)
        }
        self._cycle: int | None = None

    def add(self, leg: Mapping[str, Any]) -> None:
        """Take the next cycle: the fields of its messages by name (`translate.View.common`)."""
        cycle: int = leg["cycle"]
        follows = self._cycle is None or cycle == self._cycle + 1
        self._cycle = cycle
        for name, axis in self._axes.items():
            effort: float | None = leg[name]["patient"]
            if not follows or effort is None:
                axis.interrupt()
            if effort is not None:
                axis.add(cycle, effort)

    @property
    def now(self) -> dict[str, Tremor | None]:
        """The tremor of each axis; see `AxisTremor.now`."""
        return {name: axis.now for name, axis in self._axes.items()}

    def end_stride(self) -> dict[str, Tremor | None]:
        """The mean tremor of each axis since the last call; see `AxisTremor.end_stride`."""
        return {name: axis.end_stride() for name, axis in self._axes.items()}


def _common(windows: Sequence[Tremor | None]) -> Tremor | None:
    """Return the mean of the oscillations of one frequency, if MOST windows have it."""
    found = [one for one in windows if one is not None]
    if len(found) < MOST:
        return None
    middle_hz = statistics.median(one.frequency_hz for one in found)
    near = [one for one in found if abs(one.frequency_hz - middle_hz) <= SPREAD_MAX_HZ]
    return _mean(near) if len(near) >= MOST else None


def _mean(found: Sequence[Tremor]) -> Tremor:
    return Tremor(*map(statistics.fmean, zip(*found, strict=True)))


def oscillation(efforts: Sequence[float], amplitude_min: float) -> Tremor | None:
    """Return the oscillation that stands out of one window; None if none does.

    The spectrum is that of the differences from cycle to cycle, which have little of the gait. The
    frequency between two bins follows from the ratio of both (Grandke, "Interpolation
    algorithms for discrete Fourier transforms of weighted signals", IEEE Trans. Instrum. Meas. 32
    (1983), for the Hann window).

    Args:
        efforts: WINDOW + 1 cycles.
        amplitude_min: N·m or N.
    """
    values = list(map(sub, efforts[1:], efforts))
    sizes = [
        math.hypot(sum(map(mul, values, cos)), sum(map(mul, values, sin)))
        for cos, sin in zip(_COS, _SIN, strict=True)
    ]
    at = max(range(len(sizes)), key=sizes.__getitem__)
    if not 0 < at < len(sizes) - 1:
        return None
    powers = [size * size for size in sizes]
    if not sum(powers[at - 1 : at + 2]) >= SHARE_MIN * sum(powers):
        return None
    side = 1 if sizes[at + 1] > sizes[at - 1] else -1
    ratio = sizes[at + side] / sizes[at]
    shift = (2.0 * ratio - 1.0) / (ratio + 1.0)
    frequency_hz = (BINS[at] + side * shift) / (WINDOW * PERIOD_S)
    amplitude = sizes[at] / (WINDOW / 4) * (1.0 - shift * shift) / _sinc(shift)
    amplitude /= 2.0 * math.sin(math.pi * frequency_hz * PERIOD_S)
    if not FREQUENCY_MIN_HZ <= frequency_hz <= FREQUENCY_MAX_HZ or amplitude < amplitude_min:
        return None
    return Tremor(frequency_hz, amplitude) if _is_steady(values, frequency_hz) else None


def _sinc(x: float) -> float:
    return math.sin(math.pi * x) / (math.pi * x) if x else 1.0


def _is_steady(values: Sequence[float], frequency_hz: float) -> bool:
    """Whether all quarters of a window have the oscillation in about the same size."""
    turn = cmath.exp(-2j * math.pi * frequency_hz * PERIOD_S)
    sizes: list[float] = []
    for begin in range(0, WINDOW, QUARTER):
        part = values[begin : begin + QUARTER]
        mean, phasor, total = statistics.fmean(part), 1.0 + 0.0j, 0.0j
        for value in part:
            total += (value - mean) * phasor
            phasor *= turn
        sizes.append(abs(total))
    return min(sizes) >= STEADY_MIN * max(sizes)
