"""Output tables: each number beside its budget."""

from typing import TYPE_CHECKING, Final

from rich import box
from rich.table import Table

from gaitd_lab.benchmark.cycle_parts import WHOLE, Part
from gaitd_lab.benchmark.display_page import SLOWED, Page
from gaitd_lab.benchmark.lateness import Lateness
from gaitd_lab.benchmark.replay_speed import ReplaySpeed
from gaitd_lab.benchmark.scaling import Scaling
from gaitd_lab.benchmark.whole_service import Service

if TYPE_CHECKING:
    from gaitd_lab.peers.observer_step import StepTimes

C_RATIO_MAX: Final = 1.0
FILTERPY_RATIO_MIN: Final = 50.0
GROWTH_RATIO_MAX: Final = 1.2
CYCLE_MEDIAN_MAX_US: Final = 400.0
CYCLE_HIGH_MAX_US: Final = 800.0
LATE_P999_MAX_US: Final = 500.0
COMPUTING_RATIO_MIN: Final = 1000.0
WITH_CSV_RATIO_MIN: Final = 500.0
READY_MAX_S: Final = 5.0
CORE_MAX_MB: Final = 200.0
GATEWAY_MAX_MB: Final = 120.0
DELIVERY_MAX: Final = 2.0
AGE_MEDIAN_MAX_MS: Final = 40.0
AGE_HIGH_MAX_MS: Final = 100.0
FRAMES_MIN_HZ: Final = 30.0
"""Budgets of the design, for an idle desktop core."""
BAR_WIDTH: Final = 30


def _table(title: str, *columns: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, title=title, title_justify="left", title_style="bold")
    for index, column in enumerate(columns):
        left = index == 0 or not column
        table.add_column(column, justify="left" if left else "right", no_wrap=True)
    return table


def _coloured(text: str, good: bool) -> str:
    return f"[green]{text}[/]" if good else f"[yellow]{text}[/]"


def steps(title: str, found: "tuple[StepTimes, ...]") -> Table:
    """Return the table of the observer's step."""
    table = _table(
        title,
        "integrator",
        "observer",
        "from Python",
        "C",
        "to C (≤ 1)",
        "FilterPy",
        "times (≥ 50)",
    )
    for row in found:
        to_c, to_filterpy = row.ratio_to_c, row.speed_up_to_filterpy
        table.add_row(
            f"{row.integrator} x{row.substeps}",
            f"{row.observer_us:.1f} µs",
            f"{row.live_us:.1f} µs",
            "no compiler" if row.c_us is None else f"{row.c_us:.1f} µs",
            "–" if to_c is None else _coloured(f"{to_c:.2f}", to_c <= C_RATIO_MAX),
            "not installed" if row.filterpy_us is None else f"{row.filterpy_us:.0f} µs",
            "–"
            if to_filterpy is None
            else _coloured(f"{to_filterpy:.0f}", to_filterpy >= FILTERPY_RATIO_MIN),
        )
    return table


def scaling(title: str, found: Scaling) -> Table:
    """Return the table of growth with recordings and legs, and of allocations."""
    table = _table(title, "count", "recording", "to one (≤ 1.2)", "leg, live", "to one (≤ 1.2)")
    for row in found.growth:
        table.add_row(
            str(row.together_count),
            f"{row.recording_us:.1f} µs",
            _coloured(f"{row.recording_ratio:.2f}", row.recording_ratio <= GROWTH_RATIO_MAX),
            f"{row.leg_us:.1f} µs",
            _coloured(f"{row.leg_ratio:.2f}", row.leg_ratio <= GROWTH_RATIO_MAX),
        )
    held = found.memory
    table.caption = (
        f"in 1000 steps: {held.compiled_count} allocations by the compiled step; called from "
        f"Python {held.call_count} wrappers of arguments, freed at once; {held.kept_count} objects "
        f"kept, {held.peak_bytes_count} bytes at most; one filter {held.leg_bytes_count} bytes, a "
        f"replayed row {held.row_bytes_count} bytes"
    )
    table.caption_justify = "left"
    return table


def cycle(title: str, found: tuple[Part, ...]) -> Table:
    """Return the table of a cycle's parts."""
    table = _table(title, "part", "median", "99.9 %", "share", "")
    for part in found:
        whole = part.name == WHOLE
        median, high = f"{part.median_us:.0f} µs", f"{part.high_us:.0f} µs"
        table.add_row(
            f"[bold]{part.name}[/] (≤ 400, ≤ 800 µs)" if whole else part.name,
            _coloured(median, part.median_us <= CYCLE_MEDIAN_MAX_US) if whole else median,
            _coloured(high, part.high_us <= CYCLE_HIGH_MAX_US) if whole else high,
            f"{part.share_ratio:.0%}",
            "" if whole else "━" * round(BAR_WIDTH * part.share_ratio),
            end_section=whole,
        )
    return table


def lateness(title: str, found: Lateness) -> Table:
    """Return the histogram of SYNC's lateness."""
    table = _table(title, "SYNC late by", "count", "")
    names = [f"≤ {bound} µs" for bound in found.bound_us] + [f"> {found.bound_us[-1]} µs"]
    most = max(found.class_count)
    for name, count in zip(names, found.class_count, strict=True):
        table.add_row(name, str(count), f"{'━' * round(BAR_WIDTH * count / most):<{BAR_WIDTH}}")
    p999 = _coloured(f"99.9 % {found.p999_us:.0f} µs (≤ 500)", found.p999_us <= LATE_P999_MAX_US)
    table.caption = (
        f"{found.sync_count} SYNCs: median {found.median_us:.0f} µs, 99 % {found.p99_us:.0f} µs, "
        f"{p999}, worst {found.worst_us:.0f} µs; {found.overrun_count} skipped; "
        f"SYNC to last TPDO {found.collect_median_us:.0f} µs"
    )
    table.caption_justify = "left"
    return table


def replay(title: str, found: ReplaySpeed) -> Table:
    """Return the table of replay speed."""
    table = _table(title, "", "times real time", "each row")
    computing = _coloured(
        f"{found.computing_ratio:.0f}", found.computing_ratio >= COMPUTING_RATIO_MIN
    )
    whole = _coloured(f"{found.with_csv_ratio:.0f}", found.with_csv_ratio >= WITH_CSV_RATIO_MIN)
    table.add_row("computing (≥ 1000)", computing, f"{found.computing_us:.1f} µs")
    table.add_row("reading CSV", "", f"{found.reading_us:.1f} µs")
    table.add_row("writing CSV", "", f"{found.writing_us:.1f} µs")
    table.add_row("CSV in and out (≥ 500)", whole, "")
    return table


def service(title: str, found: Service) -> list[Table]:
    """Return the table of start, memory, and delivery time to a subscriber, by part."""
    table = _table(title, "what", "found", "budget")
    for what, value, budget, unit in (
        ("start to ready, warm caches", found.ready_s, READY_MAX_S, "s"),
        ("core, without the ring", found.core_mb, CORE_MAX_MB, "MB"),
        ("gateway, without the ring", found.gateway_mb, GATEWAY_MAX_MB, "MB"),
        ("delivery beyond the cycle, to bare Zenoh", found.delivery_ratio, DELIVERY_MAX, "x"),
    ):
        table.add_row(
            what, _coloured(f"{value:.1f} {unit}", value <= budget), f"≤ {budget:g} {unit}"
        )
    table.caption = f"the ring that core and gateway share {found.ring_mb:.0f} MB"
    table.caption_justify = "left"
    return [table, _delivery(found)]


def display(title: str, found: Page) -> list[Table]:
    """Return the table of the patient's page."""
    table = _table(title, "what", "found", "budget")
    for what, value, budget, unit in (
        ("age of a sample when painted, median", found.age_median_ms, AGE_MEDIAN_MAX_MS, "ms"),
        ("age of a sample when painted, 99 %", found.age_high_ms, AGE_HIGH_MAX_MS, "ms"),
    ):
        table.add_row(
            what, _coloured(f"{value:.1f} {unit}", value <= budget), f"≤ {budget:g} {unit}"
        )
    for what, value_hz in (
        ("frames with both legs", found.frames_hz),
        (f"frames in a browser slowed {SLOWED} times", found.slowed_frames_hz),
    ):
        frames = _coloured(f"{value_hz:.1f} /s", value_hz >= FRAMES_MIN_HZ)
        table.add_row(what, frames, f"≥ {FRAMES_MIN_HZ:g} /s")
    table.add_row("different samples painted", f"{found.samples_hz:.1f} /s", "")
    table.add_row("server, of one processor", f"{100 * found.server_cpu_ratio:.0f} %", "")
    table.add_row("server, memory", f"{found.server_mb:.0f} MB", "")
    table.add_row("browser, of one processor", f"{100 * found.browser_cpu_ratio:.0f} %", "")
    table.add_row(
        "browser, memory, shared pages counted more than once", f"{found.browser_mb:.0f} MB", ""
    )
    return [table]


def _delivery(found: Service) -> Table:
    """Rows from the last TPDO to a subscriber, beside bare Zenoh."""
    one = found.delivery
    table = _table("last TPDO to subscriber, by part", "part", "median", "99 %")
    for name, part in (
        ("work of the cycle, to the frames sent", one.work),
        ("record into the ring, wake-up of the gateway", one.ipc),
        ("gateway: record to message", None),
        ("Zenoh: put to callback", one.zenoh),
        ("[bold]last TPDO to subscriber[/]", one.whole),
        ("of which beyond the work of the cycle", one.beyond),
        ("bare Zenoh: put of another process to callback", found.bare),
    ):
        median_us = part.median_us if part else one.gateway_us
        high = f"{part.high_us:.0f} µs" if part else ""
        table.add_row(name, f"{median_us:.0f} µs", high, end_section=part is one.zenoh)
    return table
