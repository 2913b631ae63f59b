"""The live view: estimate, truth, and state of the service."""

from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from typing import Final, Literal, NamedTuple

import numpy as np
from gaitd_client import wire
from rich.console import Group, RenderableType
from rich.layout import Layout
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text, TextType

from analysis.accuracy import score
from gaitd_lab.demonstration.curves import Chart, Curve, Values
from gaitd_lab.demonstration.evaluation import AXES, BOUNDS, Pair, Pairs, axis_title, pairs
from gaitd_lab.demonstration.feed import TEXTS, LegTracks, Receiver, verdict_text
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
ERROR_COLUMNS: Final = 40
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
    legs: Mapping[str, LegTracks]
    """Empty until the first act has begun."""
    pages: str = ""
    """Where pages are; empty without one."""


def picture(moment: Moment, width: int, height: int) -> Layout:
    """Return the whole screen, in the given columns and lines.

    A small one, as a terminal of 80 x 24, shows the patient's efforts, the error and the events;
    friction and the state of the service are left out. Two legs leave no room for friction.
    """
    is_small = width < ROOMY_COLUMNS or height < ROOMY_LINES
    shown = SMALL_EVENTS_SHOWN if is_small else EVENTS_SHOWN
    legs = pairs(moment.legs or {"": LegTracks.new()}, round(WINDOW_S * RATE_HZ))
    has_friction = not is_small and len(legs) == 1
    screen = Layout()
    screen.split_column(
        Layout(_header(moment), size=4),
        *(Layout(_row(legs, leg, _patient, moment.now_ns), ratio=3) for leg in legs),
        *(
            Layout(_row(legs, leg, _friction, moment.now_ns), ratio=2)
            for leg in legs
            if has_friction
        ),
        Layout(name="below", size=shown + 2),
    )
    screen["below"].split_row(
        Layout(_service(moment.receiver), visible=not is_small, ratio=4),
        Layout(_errors(legs, moment), ratio=4, minimum_size=ERROR_COLUMNS),
        Layout(_events(moment.receiver, shown), ratio=5),
    )
    return screen


def _header(moment: Moment) -> Panel:
    safety = moment.receiver.safety if moment.receiver else None
    mode = (safety.mode if safety else None) or "starting"
    left = Text.assemble(
        (f" {mode.replace('_', ' ')} ", MODE_STYLE.get(mode, "bold black on yellow3")),
        "  ",
        (moment.scene.title, "bold"),
    )
    speed = "" if moment.speed_ratio is None else f"{moment.speed_ratio:.1f} × real time  "
    line = Table.grid(expand=True)
    line.add_column(ratio=1, no_wrap=True, overflow="ellipsis")
    line.add_column(justify="right", no_wrap=True)
    line.add_row(left, Text(f"{speed}{moment.elapsed_s:5.0f} s ", style="dim"))
    return _box(
        "gaitd demo[/]  virtual drives, CAN frames, observer, Zenoh",
        Group(line, _second_line(moment, safety)),
        f"[bold]{moment.pages}[/]" if moment.pages else None,
    )


def _second_line(moment: Moment, safety: wire.Safety | None) -> RenderableType:
    cause, whole_s = verdict_text(safety), moment.scene.lasting_s
    if cause:
        return Text(cause, style="bold red", no_wrap=True, overflow="ellipsis")
    if not whole_s:
        said = (safety.progress if safety else None) or "waiting for the service"
        return Text(f"no stop; {said}", style="dim", no_wrap=True, overflow="ellipsis")
    done_s = min(moment.scene_s, whole_s)
    line = Table.grid(padding=(0, 2, 0, 0))
    bar = ProgressBar(whole_s, done_s, width=40, complete_style="bright_cyan")
    line.add_row(bar, f"[dim]{done_s:.0f} of {whole_s:.0f} s[/]", "[green]no stop[/]")
    return line


# --- curves ---------------------------------------------------------------------------------


def _row(
    legs: Pairs, leg: str, panel: Callable[[Pair, int, int, str], Panel], now_ns: int
) -> Layout:
    """Return hip and slide of a leg, side by side."""
    row = Layout()
    row.split_row(
        *(
            Layout(panel(pair, now_ns, index, axis_title(leg, AXES[index][0], legs)))
            for index, pair in enumerate(legs[leg])
        )
    )
    return row


def _patient(pair: Pair, now_ns: int, index: int, axis: str) -> Panel:
    time_s = _seconds(pair, now_ns)
    curves = (
        Curve("truth", TRUTH, time_s, pair.wanted),
        Curve("estimate", ESTIMATE, time_s, pair.estimate),
    )
    title = f"{axis}: {('patient torque', 'patient force')[index]}"
    return _panel(title, index, curves, LEAST_SPAN[index])


def _friction(pair: Pair, now_ns: int, index: int, axis: str) -> Panel:
    time_s = _seconds(pair, now_ns)
    curves = (
        Curve("truth", TRUTH, time_s, pair.true_friction),
        Curve("estimate", FRICTION, time_s, pair.friction),
    )
    return _panel(f"{axis}: friction", index, curves, LEAST_FRICTION_SPAN[index])


def _seconds(pair: Pair, now_ns: int) -> Values:
    return np.asarray((pair.time_ns - now_ns) * 1e-9, dtype=np.float64)


def _panel(title: str, index: int, curves: Sequence[Curve], least_span: float) -> Panel:
    _, _, unit = AXES[index]
    legend = Text()
    for curve in curves:
        legend.append(" ━ ", RICH[curve.colour])
        legend.append(curve.label, "default")
        legend.append(f"{_number(_newest(curve.values))} ", "bold")
    chart = Chart(curves, WINDOW_S, least_span)
    return _box(f"{title}[/], {unit}", chart, legend, padding=0)


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


def _errors(legs: Pairs, moment: Moment) -> Panel:
    grid = _grid("left", "right", "right", "right")
    grid.add_row("", "[dim]rms[/]", "[dim]bound[/]", "[dim]valid[/]")
    bound = BOUNDS.get(moment.scene.kind)
    for leg, both in legs.items():
        for index, ((axis, _, unit), pair) in enumerate(zip(AXES, both, strict=True)):
            found = score(pair.estimate, pair.wanted)
            limit, colour = "", "default"
            if bound is not None:
                limit = f"{bound.rms[index]:g} {unit}"
                colour = "green" if found.rms <= bound.rms[index] else "yellow"
            name, covered = axis_title(leg, axis, legs), f"{found.covered_ratio:.0%}"
            grid.add_row(name, f"[{colour}]{_number(found.rms, 2)} {unit}[/]", limit, covered)
    text = "[dim]At rest friction and patient cannot be told apart: nothing is shown.[/]"
    return _box(f"error, last {WINDOW_S:.0f} s", Group(grid, "", text))


def _service(receiver: Receiver | None) -> Panel:
    health = receiver.health if receiver else None
    grid = _grid("left", "right")
    if health is None:
        grid.add_row("[dim]no word yet[/]", "")
        return _box("service", grid)
    bars = "".join(_bar(count) for count in health.lateness_count)
    grid.add_row("SYNC late, median", f"{_number(health.lateness_p50_us, 0)} µs")
    grid.add_row("SYNC late, worst", f"{_number(health.lateness_max_us, 0)} µs")
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
    newest = receiver.events[-shown:] if receiver else []
    lines = [
        Text.assemble(
            (f"{datetime.fromtimestamp(event.time_ns * 1e-9, UTC).astimezone():%H:%M:%S} ", "dim"),
            (TEXTS.event(event), EVENT_STYLE.get(event.priority, "default")),
            no_wrap=True,
            overflow="ellipsis",
        )
        for event in newest
    ]
    return _box("events", Group(*lines))


def _box(
    title: str, body: RenderableType, subtitle: TextType | None = None, padding: int = 1
) -> Panel:
    """Frame a part of the screen; its title is bold up to a closing tag of its own."""
    return Panel(
        body,
        title=f"[bold]{title}",
        title_align="left",
        subtitle=subtitle,
        subtitle_align="right",
        border_style="grey50",
        padding=(0, padding),
    )
