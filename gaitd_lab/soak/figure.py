"""A picture of a soak: memory of each process, every stop on a time line; lateness of SYNC."""

from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.drawing import (
    BAD,
    DPI,
    ESTIMATE,
    FRICTION,
    GOOD,
    MEASURED,
    OTHER,
    TEXT,
    legend,
    style,
    x_label,
)
from gaitd_lab.soak.record_monitor import Classification
from gaitd_lab.soak.run import Soaked

SIZE_IN: Final = (10.0, 9.0)
S_PER_MIN: Final = 60.0
LEAST_US, MOST_US = 1.0, 30_000.0
COLOURS: Final = {"sim": MEASURED, "core": ESTIMATE, "gateway": FRICTION}
MARKS: Final = {
    Classification.EXPECTED: ("o", GOOD),
    Classification.UNEXPECTED: ("X", BAD),
    Classification.MISSED: ("D", OTHER),
}


def draw(found: Soaked, path: Path) -> None:
    """Write the picture.

    Raises:
        OSError: it cannot be written.
    """
    figure = Figure(figsize=SIZE_IN, layout="constrained")
    heights = (1.2, 2.2, 1.0) if found.wall_clock else (1.2, 2.2)
    memory, stops, *late = figure.subplots(len(heights), 1, height_ratios=heights)
    for axes in late:  # in simulated time nothing is late
        _lateness(axes, found)
    _memory(memory, found)
    _stops(stops, found)
    figure.savefig(path, dpi=DPI, format="png")


def _lateness(axes: Axes, found: Soaked) -> None:
    late_us = np.clip(np.asarray(found.tally.lateness_us), LEAST_US, MOST_US)
    axes.hist(late_us, bins=np.geomspace(LEAST_US, MOST_US, 90).tolist(), color=ESTIMATE)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.axvline(500.0, color=TEXT, linewidth=0.8, linestyle="--")
    style(axes, "Lateness of SYNC", "cycles")
    x_label(axes, "SYNC left late by, µs (dashed: budget of 99.9 % under SCHED_FIFO)")


def _memory(axes: Axes, found: Soaked) -> None:
    for name, samples in found.memory.items():
        for number, pid in enumerate(dict.fromkeys(one.pid for one in samples)):
            life = [one for one in samples if one.pid == pid]
            minutes = [one.time_s / S_PER_MIN for one in life]
            label = f"gaitd {name}" if number == 0 else "_nolegend_"
            axes.plot(minutes, [one.rss_mb for one in life], color=COLOURS[name], label=label)
            own_mb = [one.own_mb for one in life]
            axes.plot(minutes, own_mb, color=COLOURS[name], linewidth=0.8, linestyle=":")
    style(axes, "Resident memory; dotted: own pages", "MB")
    axes.set_ylim(bottom=0.0)
    axes.set_xlim(0.0, found.duration_s / S_PER_MIN)
    legend(axes)


def _stops(axes: Axes, found: Soaked) -> None:
    stops = found.tally.stops
    causes = sorted({stop.cause for stop in stops}, reverse=True)
    for judged, (mark, colour) in MARKS.items():
        shown = [stop for stop in stops if stop.judged is judged]
        minutes = [stop.time_s / S_PER_MIN for stop in shown]
        rows = [causes.index(stop.cause) for stop in shown]
        axes.scatter(minutes, rows, marker=mark, color=colour, s=22, label=judged.value)
    deaths = [time_s for time_s, one in found.happenings if one.actor.value == "SIGKILL"]
    for time_s in deaths:
        axes.axvline(time_s / S_PER_MIN, color=BAD, linewidth=0.6, alpha=0.5)
    style(axes, "Stops by their first cause")
    axes.set_yticks(range(len(causes)), labels=causes, fontsize=8)
    axes.set_xlim(0.0, found.duration_s / S_PER_MIN)
    x_label(axes, "minutes (red lines: a process was killed)")
    legend(axes)
