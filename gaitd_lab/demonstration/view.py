"""The live view: estimate, truth, and state of the service."""

from datetime import UTC, datetime
from typing import Final, Literal, NamedTuple

import numpy as np
from gaitd_client import wire
from rich import box
from rich.console import Group, RenderableType
from rich.layout import Layout
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from analysis.accuracy import score
from gaitd_lab.demonstration.curves import Chart, Curve, Values
from gaitd_lab.demonstration.evaluation import AXES, BOUNDS, Pair, pairs
from gaitd_lab.demonstration.feed import Receiver, Track, verdict_text
from gaitd_lab.demonstration.script import Scene

WINDOW_S: Final = 16.0
"""Time of four strides."""
RATE_HZ: Final = 100
LEAST_SPAN: Final = (10.0, 50.0)
"""Least span of the axes of torque and force, so that noise does not fill the screen."""
LEAST_FRICTION_SPAN: Final = (10.0, 100.0)
ESTIMATE, TRUTH, FRICTION = "cyan+", "orange", "magenta+"
"""Colour names of plotext."""
RICH: Final = {ESTIMATE: "bright_cyan", TRUTH: "dark_orange", FRICTION: "bright_magenta"}
MODE_STYLE: Final = {
    "ready": "bold black on green3",
    "hold": "bold black on bright_cyan",
    "gait": "bold black on bright_cyan",
    "excite": "bold black on bright_cyan",
    "stopping": "bold white on red3",
    "fault": "bold white on red3",
}
EVENT_STYLE: Final = {"high": "bold red", "medium": "yellow", "low": "bright_cyan"}
EVENTS_SHOWN: Final = 6
SMALL_EVENTS_SHOWN: Final = 3
ROOMY_COLUMNS, ROOMY_LINES = 120, 34
"""Size from which on everything fits."""
BAR: Final = " ▁▂▃▄▅▆▇█"


class Moment(NamedTuple):
    """Content of the view at one moment."""

    now_ns: int
    elapsed_s: float
    scene: Scene
    scene_s: float
    """Time since the scene began."""
    speed_ratio: float | None
    """Ratio of the time to the computer's; None before it is known."""
    receiver: Receiver | None
    received: Track
    true: Track
    pages: str = ""
    """Where pages are; empty without one."""


def picture(moment: Moment, width: int, height: int) -> Layout:
    """Return the whole screen, in the given columns and lines.

    A small one, as a terminal of 80 x 24, shows the patient's efforts, the error and the events;
    friction is shown as a number, and the state of the service is left out.
    """
    small = width < ROOMY_COLUMNS or height < ROOMY_LINES
    return _small_picture(moment) if small else _whole_picture(moment)


def _small_picture(moment: Moment) -> Layout:
    screen = Layout()
    screen.split_column(
        Layout(_header(moment), size=4),
        Layout(name="curves"),
        Layout(name="below", size=SMALL_EVENTS_SHOWN + 2),
    )
    both = pairs(moment.received, moment.true, round(WINDOW_S * RATE_HZ))
    panels = (Layout(_patient_panel(pair, moment.now_ns, at)) for at, pair in enumerate(both))
    screen["curves"].split_row(*panels)
    screen["below"].split_row(
        Layout(_box(f"error, last {WINDOW_S:.0f} s", _error_table(both, moment)), size=40),
        Layout(_events(moment.receiver, SMALL_EVENTS_SHOWN)),
    )
    return screen


def _whole_picture(moment: Moment) -> Layout:
    screen = Layout()
    screen.split_column(
        Layout(_header(moment), size=4),
        Layout(name="curves", ratio=3),
        Layout(name="friction", ratio=2),
        Layout(name="below", size=EVENTS_SHOWN + 2),
    )
    both = pairs(moment.received, moment.true, round(WINDOW_S * RATE_HZ))
    for row, panel in (("curves", _patient_panel), ("friction", _friction_panel)):
        screen[row].split_row(
            *(Layout(panel(pair, moment.now_ns, index)) for index, pair in enumerate(both))
        )
    screen["below"].split_row(
        Layout(_service(moment.receiver), ratio=4),
        Layout(_errors(both, moment), ratio=4),
        Layout(_events(moment.receiver, EVENTS_SHOWN), ratio=5),
    )
    return screen


# --- header ---------------------------------------------------------------------------------


def _header(moment: Moment) -> RenderableType:
    safety = moment.receiver.safety if moment.receiver else None
    mode = (safety.mode if safety else None) or "starting"
    left = Text.assemble(
        (f" {mode.replace('_', ' ')} ", MODE_STYLE.get(mode, "bold black on yellow3")),
        "  ",
        (moment.scene.title, "bold"),
    )
    speed = "" if moment.speed_ratio is None else f"{moment.speed_ratio:.1f} × real time  "
    right = Text(f"{speed}{moment.elapsed_s:5.0f} s ", style="dim")
    line = Table.grid(expand=True)
    line.add_column(ratio=1, no_wrap=True, overflow="ellipsis")
    line.add_column(justify="right", no_wrap=True)
    line.add_row(left, right)
    return Panel(
        Group(line, _second_line(moment, safety)),
        title="[bold]gaitd demo[/]  virtual drives, CAN frames, observer, Zenoh",
        title_align="left",
        subtitle=f"[bold]{moment.pages}[/]" if moment.pages else None,
        subtitle_align="right",
        border_style="grey50",
        padding=(0, 1),
    )


def _second_line(moment: Moment, safety: wire.Safety | None) -> Text:
    cause = verdict_text(safety)
    if cause:
        return Text(cause, style="bold red", no_wrap=True, overflow="ellipsis")
    if moment.scene.lasting_s:
        return _progress_bar(moment.scene_s, moment.scene.lasting_s)
    said = (safety.progress if safety else None) or "waiting for the service"
    return Text(f"no stop; {said}", style="dim", no_wrap=True, overflow="ellipsis")


def _progress_bar(done_s: float, whole_s: float, width: int = 40) -> Text:
    filled = round(width * min(done_s / whole_s, 1.0))
    return Text.assemble(
        ("━" * filled, "bright_cyan"),
        ("━" * (width - filled), "grey30"),
        (f"  {min(done_s, whole_s):.0f} of {whole_s:.0f} s", "dim"),
        ("   no stop", "green"),
    )


# --- curves ---------------------------------------------------------------------------------


def _patient_panel(pair: Pair, now_ns: int, index: int) -> Panel:
    axis, _, unit = AXES[index]
    time_s = _seconds(pair, now_ns)
    quantity = "torque" if axis == "hip" else "force"
    curves = [
        Curve("truth", TRUTH, time_s, pair.wanted),
        Curve("estimate", ESTIMATE, time_s, pair.estimate),
    ]
    return _panel(f"{axis}: patient {quantity}", unit, curves, LEAST_SPAN[index])


def _friction_panel(pair: Pair, now_ns: int, index: int) -> Panel:
    axis, _, unit = AXES[index]
    time_s = _seconds(pair, now_ns)
    curves = [
        Curve("truth", TRUTH, time_s, pair.true_friction),
        Curve("estimate", FRICTION, time_s, pair.friction),
    ]
    return _panel(f"{axis}: friction", unit, curves, LEAST_FRICTION_SPAN[index])


def _seconds(pair: Pair, now_ns: int) -> Values:
    return np.asarray((pair.time_ns - now_ns) * 1e-9, dtype=np.float64)


def _panel(title: str, unit: str, curves: list[Curve], least_span: float) -> Panel:
    legend = Text()
    for curve in curves:
        legend.append(" ━ ", RICH[curve.colour])
        legend.append(curve.label, "default")
        legend.append(f"{_number(_newest(curve.values))} ", "bold")
    return Panel(
        Chart(curves, WINDOW_S, least_span),
        title=f"[bold]{title}[/], {unit}",
        title_align="left",
        subtitle=legend,
        subtitle_align="right",
        border_style="grey50",
        padding=0,
    )


def _newest(values: Values) -> float:
    """Return the newest value of the last tenth of a second."""
    last = values[-10:]
    known = last[np.isfinite(last)]
    return float(known[-1]) if len(known) else np.nan


def _number(value: float | None, digits: int = 1) -> str:
    return "    –" if value is None or not np.isfinite(value) else f"{value:5.{digits}f}"


# --- lower part -----------------------------------------------------------------------------


def _grid(*justify: Literal["left", "right"]) -> Table:
    grid = Table.grid(padding=(0, 2, 0, 0))
    for one in justify:
        grid.add_column(justify=one, no_wrap=True)
    return grid


def _errors(both: tuple[Pair, Pair], moment: Moment) -> Panel:
    text = Text("At rest friction and patient cannot be told apart: nothing is shown.", "dim")
    table = _error_table(both, moment)
    return _box(f"error, last {WINDOW_S:.0f} s", Group(table, Text(""), text))


def _error_table(both: tuple[Pair, Pair], moment: Moment) -> Table:
    grid = _grid("left", "right", "right", "right")
    grid.add_row("", "[dim]rms[/]", "[dim]bound[/]", "[dim]valid[/]")
    bound = BOUNDS.get(moment.scene.kind)
    for index, (axis, _, unit) in enumerate(AXES):
        found = score(both[index].estimate, both[index].wanted)
        limit = "" if bound is None else f"{bound[index]:g} {unit}"
        colour = "default" if bound is None else "green" if found.rms <= bound[index] else "yellow"
        covered = f"{found.covered_ratio:.0%}"
        grid.add_row(axis, f"[{colour}]{_number(found.rms, 2)} {unit}[/]", limit, covered)
    return grid


def _service(receiver: Receiver | None) -> Panel:
    health = receiver.health if receiver else None
    grid = _grid("left", "right")
    if receiver is None or health is None:
        grid.add_row("[dim]no word yet[/]", "")
        return _box("service", grid)
    bars = "".join(_bar(count) for count in health.lateness_count)
    p50, worst = health.lateness_p50_us, health.lateness_max_us
    grid.add_row("SYNC late, median", f"{_number(p50, 0)} µs")
    grid.add_row("SYNC late, worst", f"{_number(worst, 0)} µs")
    grid.add_row("all SYNCs, early to late", f"[bright_cyan]{bars}[/]")
    grid.add_row("cycle's work, worst", f"{_number(health.work_max_us, 0)} µs")
    grid.add_row("overruns", f"{health.overrun_count}")
    lost = sum(drive.lost_count for drive in health.drives)
    late = sum(drive.late_count for drive in health.drives)
    grid.add_row("TPDOs late, lost", f"{late}, {lost}")
    return _box("service, last second", grid)


def _bar(count: int) -> str:
    """Bar of one histogram class, logarithmic: ten times as many is two steps higher."""
    if count == 0:
        return "[grey30]·[/]"
    return BAR[min(1 + round(1.6 * np.log10(count)), len(BAR) - 1)]


def _events(receiver: Receiver | None, shown: int) -> Panel:
    newest = list(receiver.events)[-shown:] if receiver else []
    lines = [
        Text.assemble(
            (f"{datetime.fromtimestamp(event.time_ns * 1e-9, UTC).astimezone():%H:%M:%S} ", "dim"),
            (event.text, EVENT_STYLE.get(event.priority, "default")),
            no_wrap=True,
            overflow="ellipsis",
        )
        for event in newest
    ]
    return _box("events", Group(*lines))


def _box(title: str, body: RenderableType) -> Panel:
    return Panel(
        body,
        title=f"[bold]{title}[/]",
        title_align="left",
        border_style="grey50",
        box=box.ROUNDED,
        padding=(0, 1),
    )
