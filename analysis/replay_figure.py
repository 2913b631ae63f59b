"""Picture of a replay: pose, speed, friction and patient of both axes, and their validity."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from analysis.drawing import (
    AXES,
    BAD,
    BUCKETS,
    ESTIMATE,
    FAINT,
    FRICTION,
    MEASURED,
    leg_figure,
    legend,
    line,
    patient,
    save,
    stretches,
    strips,
    style,
)
from analysis.estimates import shown
from analysis.recording import Recording
from observer.filter.status import Status, Validity
from observer.offline.batch import BatchEstimates

STRIP_HEIGHT: Final = 0.22
GAP_PERIODS: Final = 5.0
"""Limit of the time between two rows; more is drawn as a gap."""
HARMLESS: Final = frozenset({Status.VALID, Status.WARM_UP, Status.ARTIFICIAL})


def draw(recording: Recording, estimates: BatchEstimates, path: Path) -> None:
    """Draw a PNG.

    Raises:
        OSError: the file cannot be written.
    """
    estimates = shown(estimates)
    heights = (1, 1, 1, 1.35, STRIP_HEIGHT * _bits(estimates))
    figure, columns = leg_figure((14, 10.5), heights)
    for index, panels in enumerate(columns):
        _column(panels[:4], *_with_gaps(recording, estimates), index)
        _status_strip(panels[4], recording, estimates)
    name = Path(recording.source).name
    minutes, seconds = divmod(round(recording.duration_s, 1), 60)
    words = f"{name} · {len(recording.time_s)} samples · {minutes:.0f} min {seconds:04.1f} s"
    save(figure, words, path)


def _with_gaps(recording: Recording, estimates: BatchEstimates) -> tuple[Recording, BatchEstimates]:
    """Insert empty rows where rows are missing, so that no line crosses a gap.

    Enough rows are inserted to make a whole stretch of a long line empty.
    """
    step_s = np.diff(recording.time_s)
    period_s = float(np.median(step_s)) if len(step_s) else 0.0
    gaps = np.flatnonzero(step_s > GAP_PERIODS * period_s)
    whole = 2 * (len(recording.time_s) // BUCKETS + 1)
    at = np.repeat(gaps + 1, whole)
    share = np.tile(np.arange(1, whole + 1) / (whole + 1), len(gaps))
    times = recording.time_s[at - 1] + share * step_s[at - 1]

    def empty(values: NDArray[Any]) -> NDArray[Any]:
        return np.insert(values, at, np.nan, axis=0)

    shown = replace(
        recording,
        time_s=np.insert(recording.time_s, at, times),
        position=empty(recording.position),
    )
    return shown, replace(
        estimates,
        state=empty(estimates.state),
        std=empty(estimates.std),
        net=empty(estimates.net),
        validity=np.insert(estimates.validity, at, int(Validity.SPLIT_UNOBSERVABLE), axis=0),
    )


def _column(
    panels: Sequence[Axes], recording: Recording, estimates: BatchEstimates, index: int
) -> None:
    name, position, velocity, effort, _ = AXES[index]
    time = recording.time_s - recording.time_s[0]
    place, speed, friction, push = panels

    style(place, f"{name} position", position)
    line(place, time, recording.position[:, index], MEASURED, "measured", 2.2)
    line(place, time, estimates.state[:, index], ESTIMATE, "estimate", 0.9)
    style(speed, f"{name} speed", velocity)
    line(speed, time, estimates.state[:, 2 + index], ESTIMATE)
    style(friction, f"{name} friction", effort)
    line(friction, time, estimates.state[:, 4 + index], FRICTION)

    style(push, f"{name} patient", effort)
    line(push, time, estimates.net[:, index], FAINT, "net: patient − friction", 0.8)
    value, std = estimates.state[:, 6 + index], estimates.std[:, 6 + index]
    valid = estimates.validity[:, index] == Validity.OK
    patient(push, time, value, std, valid, estimates.net[:, index])
    for panel in (place, push):
        legend(panel)


def _present_bits(estimates: BatchEstimates) -> list[Status]:
    seen = int(np.bitwise_or.reduce(estimates.status)) if len(estimates.status) else 0
    return [bit for bit in Status if bit & seen and bit is not Status.VALID]


def _bits(estimates: BatchEstimates) -> int:
    return max(len(_present_bits(estimates)) + 1, 2)


def _status_strip(panel: Axes, recording: Recording, estimates: BatchEstimates) -> None:
    """Draw one row for each status bit that was ever set, and one for validity."""
    time = recording.time_s - recording.time_s[0]
    bits = _present_bits(estimates)
    style(panel, "status")
    invalid = (estimates.status & Status.VALID) == 0
    panel.broken_barh(stretches(invalid, time), (-0.4, 0.8), color=BAD)
    for row, bit in enumerate(bits, start=1):
        colour = FAINT if bit in HARMLESS else ESTIMATE
        panel.broken_barh(
            stretches((estimates.status & bit) != 0, time), (row - 0.4, 0.8), color=colour
        )
    names = ["not valid", *((bit.name or "").lower().replace("_", " ") for bit in bits)]
    strips(panel, names, time, "time [s]")
