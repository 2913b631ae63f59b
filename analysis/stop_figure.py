"""Picture of a stop: motion of the leg, state of the drives, and state of the service."""

from collections.abc import Callable, Sequence
from itertools import groupby
from math import nan
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis.drawing import (
    BAD,
    ESTIMATE,
    FAINT,
    FRICTION,
    GOOD,
    MEASURED,
    TEXT,
    band,
    legend,
    limit_to,
    line,
    style,
)
from analysis.stop_recording import StopRecording, cause_words, known, utc_words
from daemon.ipc.record import CycleRecord, DriveRecord, StopCategory
from daemon.wire.fields import POWER_STATES, Validity

AXES: Final = (("hip", "rad", "rad/s", "N·m"), ("slide", "m", "m/s", "N"))
"""Name, and units of position, speed and effort."""
SIGMAS: Final = 3.0
DPI: Final = 130
_PATIENT: Final = 6
"""Index into the observer's states: hip, then slide."""
_CATEGORY: Final = {
    StopCategory.NONE: FAINT,
    StopCategory.S2: "#f2b705",
    StopCategory.S1: "#e07b00",
    StopCategory.S0: BAD,
}


def draw(told: StopRecording, leg: str, path: Path) -> None:
    """Draw one leg as a PNG.

    Raises:
        OSError: the file cannot be written.
    """
    figure = Figure(figsize=(14, 11), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(5, 2, sharex=True, squeeze=False, height_ratios=[1, 1, 1, 1.2, 0.75])
    time = np.array([told.from_stop_s(record) for record in told.records])
    index = told.header.leg_names.index(leg)
    for axis in range(2):
        panels = [grid[row][axis] for row in range(5)]
        _column(panels[:4], told.records, time, (leg, index, axis))
        _strips(panels[4], told.records, time, f"{leg}/{AXES[axis][0]}")
        for panel in panels:
            panel.axvline(0.0, color=BAD, linewidth=1.1, zorder=0.5)
    kept = told.kept
    where = f", {kept.drive}" if kept.drive else ""
    figure.suptitle(
        f"{cause_words(kept.cause)}{where} · {utc_words(kept.stop_utc_ns)} · {leg} leg",
        fontsize=12,
        color=TEXT,
    )
    figure.savefig(path, dpi=DPI, format="png")


def _column(
    panels: Sequence[Axes],
    records: Sequence[CycleRecord],
    time: NDArray[np.float64],
    place: tuple[str, int, int],
) -> None:
    leg, index, axis = place
    name, position_unit, velocity_unit, effort_unit = AXES[axis]
    drives = [_drive(record, f"{leg}/{name}") for record in records]
    legs = [record.legs[index] if len(record.legs) > index else None for record in records]
    where, speed, effort, patient = panels

    style(where, f"{name} position", position_unit)
    reference = _of(legs, lambda one: one.reference[axis])
    line(where, time, reference, GOOD, "wanted", 1.8)
    line(where, time, _of(drives, lambda one: one.position_si), MEASURED, "measured", 1.2)
    style(speed, f"{name} speed, from the encoder", velocity_unit)
    line(speed, time, _of(drives, lambda one: one.velocity_si), MEASURED)
    style(effort, f"{name} effort of the drive", effort_unit)
    line(effort, time, _of(drives, lambda one: one.target_effort_si), GOOD, "commanded", 1.8)
    line(effort, time, _of(drives, lambda one: one.effort_si), FRICTION, "measured", 1.1)

    style(patient, f"{name} effort of the patient", effort_unit)
    value = _of(legs, lambda one: one.state[_PATIENT + axis])
    std = _of(legs, lambda one: one.std[_PATIENT + axis])
    usable = _of(legs, lambda one: 1.0 if one.validity[axis] == Validity.OK else np.nan)
    band(patient, time, value - SIGMAS * std, value + SIGMAS * std, ESTIMATE, "±3σ")
    line(patient, time, value, ESTIMATE, "", 0.5)
    line(patient, time, value * usable, ESTIMATE, "where it can be told", 1.5)
    patient.axhline(0, color=FAINT, linewidth=0.6)
    limit_to(patient, value * usable, _of(legs, lambda one: one.net[axis]))
    for panel in (where, effort, patient):
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
            [record.mode.name.lower() for record in records],
            [GOOD if record.mode.active else FAINT for record in records],
        ),
        (
            "verdict",
            [record.verdict.cause.name.lower() for record in records],
            [_CATEGORY[record.verdict.category] for record in records],
        ),
        (drive, *_states(records, drive)),
    )
    for row, (_, words, colours) in enumerate(rows):
        _strip(panel, row, list(zip(words, colours, strict=True)), time)
    panel.set_yticks(range(len(rows)), [name for name, _, _ in rows])
    panel.set_ylim(len(rows) - 0.5, -0.5)
    panel.set_xlim(float(time[0]), float(max(time[-1], time[0] + 1e-3)))
    panel.set_xlabel("seconds from the stop", fontsize=8, color=TEXT)


def _states(records: Sequence[CycleRecord], name: str) -> tuple[list[str], list[str]]:
    drives = [_drive(record, name) for record in records]
    states = [POWER_STATES[drive.power_state] if drive else "unknown" for drive in drives]
    colours = {"operation_enabled": GOOD, "fault": BAD, "quick_stop_active": "#e07b00"}
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
