"""Picture of a stop: motion of the leg, state of the drives, and state of the service."""

from collections.abc import Callable, Sequence
from itertools import groupby
from math import nan
from pathlib import Path
from typing import Any, Final

import numpy as np
from gaitd_names import POWER_STATES, StopCategory
from gaitd_texts import Catalogue
from matplotlib.axes import Axes
from numpy.typing import NDArray

from analysis.drawing import (
    AXES,
    BAD,
    FAINT,
    FRICTION,
    GOOD,
    MEASURED,
    OTHER,
    TEXT,
    leg_figure,
    legend,
    line,
    patient,
    save,
    strips,
    style,
)
from analysis.stop_recording import StopRecording, known, stop_text, utc_text
from daemon.ipc.record import CycleRecord, DriveRecord
from observer.filter.status import Validity

_CATEGORY: Final = {
    StopCategory.NONE: FAINT,
    StopCategory.S2: "#f2b705",
    StopCategory.S1: "#e07b00",
    StopCategory.S0: BAD,
}


def draw(recording: StopRecording, leg: str, path: Path, texts: Catalogue) -> None:
    """Draw one leg as a PNG, with the operator's sentence of the stop.

    Raises:
        OSError: the file cannot be written.
    """
    figure, columns = leg_figure((14, 11), (1, 1, 1, 1.2, 0.75))
    time = np.array([recording.from_stop_s(record) for record in recording.records])
    index = recording.header.leg_names.index(leg)
    for axis, panels in enumerate(columns):
        _column(panels[:4], recording.records, time, (leg, index, axis))
        _strips(panels[4], recording.records, time, f"{leg}/{AXES[axis].name}")
        for panel in panels:
            panel.axvline(0.0, color=BAD, linewidth=1.1, zorder=0.5)
    stopped = utc_text(recording.kept.stop_utc_ns)
    words = f"{stop_text(recording, texts)} · {stopped} · {leg} leg"
    save(figure, words, path)


def _column(
    panels: Sequence[Axes],
    records: Sequence[CycleRecord],
    time: NDArray[np.float64],
    place: tuple[str, int, int],
) -> None:
    leg, index, axis = place
    name, position_unit, velocity_unit, effort_unit, _ = AXES[axis]
    drives = [_drive(record, f"{leg}/{name}") for record in records]
    axes = [
        record.legs[index].axes[axis] if len(record.legs) > index else None for record in records
    ]
    where, speed, effort, push = panels

    style(where, f"{name} position", position_unit)
    reference = _of(axes, lambda one: one.reference_position)
    line(where, time, reference, GOOD, "wanted", 1.8)
    line(where, time, _of(drives, lambda one: one.position), MEASURED, "measured", 1.2)
    style(speed, f"{name} speed, from the encoder", velocity_unit)
    line(speed, time, _of(drives, lambda one: one.velocity), MEASURED)
    style(effort, f"{name} effort of the drive", effort_unit)
    line(effort, time, _of(drives, lambda one: one.target_effort), GOOD, "commanded", 1.8)
    line(effort, time, _of(drives, lambda one: one.effort), FRICTION, "measured", 1.1)

    style(push, f"{name} effort of the patient", effort_unit)
    value = _of(axes, lambda one: one.patient)
    std = _of(axes, lambda one: one.patient_std)
    valid = _of(axes, lambda one: one.validity) == Validity.OK
    patient(push, time, value, std, valid, _of(axes, lambda one: one.net))
    for panel in (where, effort, push):
        legend(panel)


def _drive(record: CycleRecord, name: str) -> DriveRecord | None:
    return next((drive for drive in record.drives if drive.name == name), None)


def _of(rows: Sequence[Any], figure: Callable[[Any], float | None]) -> NDArray[np.float64]:
    """Collect one value of all rows; NaN where it is missing or unknown."""
    found = (nan if row is None else known(figure(row)) for row in rows)
    return np.fromiter(found, dtype=np.float64, count=len(rows))


def _strips(
    panel: Axes, records: Sequence[CycleRecord], time: NDArray[np.float64], drive: str
) -> None:
    """Draw mode, verdict and the drive's own state as text along the time."""
    style(panel, "mode, verdict and drive")
    rows: tuple[tuple[str, list[str], list[str]], ...] = (
        (
            "mode",
            [record.mode for record in records],
            [GOOD if record.mode.active else FAINT for record in records],
        ),
        (
            "verdict",
            [record.verdict.cause for record in records],
            [_CATEGORY[record.verdict.category] for record in records],
        ),
        (drive, *_states(records, drive)),
    )
    for row, (_, words, colours) in enumerate(rows):
        _strip(panel, row, list(zip(words, colours, strict=True)), time)
    strips(panel, [name for name, _, _ in rows], time, "seconds from the stop")


def _states(records: Sequence[CycleRecord], name: str) -> tuple[list[str], list[str]]:
    drives = [_drive(record, name) for record in records]
    states = [POWER_STATES[drive.power_state] if drive else "unknown" for drive in drives]
    colours = {"operation_enabled": GOOD, "fault": BAD, "quick_stop_active": OTHER}
    return states, [colours.get(state, FAINT) for state in states]


def _strip(panel: Axes, row: int, cells: list[tuple[str, str]], time: NDArray[np.float64]) -> None:
    """Draw bars of equal text; a bar that is too short has no text."""
    begin, whole = 0, float(time[-1] - time[0]) or 1.0
    for (words, colour), group in groupby(cells):
        count = len(list(group))
        end = min(begin + count, len(time) - 1)
        start_s, length_s = float(time[begin]), float(time[end] - time[begin])
        panel.broken_barh([(start_s, length_s)], (row - 0.4, 0.8), color=colour, alpha=0.55)
        if length_s / whole > 0.011 * len(words):
            at = start_s + length_s / 2
            panel.text(
                at, row, words.replace("_", " "), fontsize=7, color=TEXT, ha="center", va="center"
            )
        begin += count
