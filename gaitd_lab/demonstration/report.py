"""Text output of a demonstration: one line a second, and the final table."""

import math
from collections.abc import Sequence
from itertools import zip_longest
from typing import Final

import numpy as np
from gaitd_client import wire
from rich import box
from rich.console import Console
from rich.table import Table

from gaitd_lab.demonstration.evaluation import AXES, Row, pairs
from gaitd_lab.demonstration.feed import verdict_text
from gaitd_lab.demonstration.picture import Results, Walk
from gaitd_lab.demonstration.script import Kind, Plan
from gaitd_lab.demonstration.training import TrainingResult
from gaitd_lab.demonstration.view import Moment

NEWEST: Final = 12
SHOWN: Final = ("stiffness_ratio", "assist_mean_nm")
"""Values of the controller's state in the table."""
PLAIN_WIDTH: Final = 132
"""Width of a table in a file."""


def line(moment: Moment) -> str:
    """Return one text line: time, mode, estimate and truth of each axis, lateness, stop."""
    receiver = moment.receiver
    safety = receiver.safety if receiver else None
    words = [f"{moment.elapsed_s:6.1f} s", f"{(safety.mode if safety else None) or 'starting':<12}"]
    if not len(moment.received):
        return "  ".join(words).rstrip()
    for (axis, _, unit), pair in zip(
        AXES, pairs(moment.received, moment.true, NEWEST), strict=True
    ):
        said, wanted, rubs = (_newest(v) for v in (pair.estimate, pair.wanted, pair.friction))
        words.append(f"{axis} patient {said} (true {wanted}) friction {rubs} {unit}")
    if moment.speed_ratio is not None:
        words.append(f"{moment.speed_ratio:.1f} x real time")
    words.append(verdict_text(safety) or (safety.progress if safety else None) or "")
    return "  ".join(words).rstrip()


def _newest(values: np.ndarray) -> str:
    known = values[np.isfinite(values)]
    return f"{known[-1]:6.1f}" if len(known) else "     –"


def as_object(results: Results) -> dict[str, object]:
    """The table of errors and the result as plain data for a program."""
    rows = [
        {
            "span": row.span.title,
            "axis": row.axis,
            "unit": row.unit,
            "score": row.score,
            "rms_bound": row.rms_bound,
            "correlation_min": row.correlation_min,
            "covered_min_ratio": row.covered_min_ratio,
            "passed": row.passed,
        }
        for row in results.rows
    ]
    return {
        "passed": results.passed,
        "trouble": results.trouble,
        "rows": rows,
        "session": results.trained,
    }


def report(results: Results, plan: Plan) -> None:
    """Print the table of errors, the cycle's statistics, and the result."""
    console = Console()
    if not console.is_terminal:
        console = Console(width=PLAIN_WIDTH)
    if results.rows:
        console.print(_errors(results.rows))
    if results.health:
        console.print(_cycles(results.health))
    if results.trained:
        console.print(_whole(results.trained), highlight=False)
        console.print(_blocks(results.trained))
    if results.walks:
        console.print(_help(results.walks))
    elif plan.paper_s == 0:
        console.print("[dim]The paper's experiment was left out: it wants 40 seconds or more.[/]")
    if results.trouble:
        console.print(f"[bold red]{results.trouble}[/]", highlight=False)
    trained = results.trained
    good, bad = (
        ("all within bounds, no stop", "not all within bounds")
        if trained is None
        else (f"{len(trained.blocks)} blocks walked, no interruption", "not walked as planned")
    )
    if results.passed:
        console.print(f"[bold green]{good}[/]")
    elif not results.trouble:
        console.print(f"[bold red]{bad}[/]")


def _errors(rows: Sequence[Row]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, title="estimate against truth", title_justify="left")
    for name in ("span", "axis"):
        table.add_column(name, no_wrap=True)
    for name in ("rms error", "bound", "worst", "bias", "correlation", "bound", "valid", "bound"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("")
    for row in rows:
        found = row.score
        table.add_row(
            row.span.title,
            row.axis,
            f"{_text(found.rms)} {row.unit}",
            f"{row.rms_bound:g}",
            _text(found.worst),
            _text(found.bias),
            "–" if row.span.kind is Kind.PASSIVE else _text(found.correlation, 4),
            f"{row.correlation_min:g}" if row.correlation_min > -1 else "",
            f"{found.covered_ratio:.0%}",
            f"{row.covered_min_ratio:.0%}",
            "[green]✔[/]" if row.passed else "[red]✘[/]",
        )
    return table


def _whole(trained: TrainingResult) -> str:
    """What the history says of the session."""
    told = trained.summary
    return (
        f"session {told.end or 'not ended'}: walked {told.walked_s:.0f} s, interruptions: "
        f"{told.interruption_count}{told.last_interruption and f' ({told.last_interruption})'}"
    )


def _blocks(trained: TrainingResult) -> Table:
    """What the history says of each block."""
    table = Table(box=box.SIMPLE_HEAD)
    for name in ("block", "strides", "known", "share, mean"):
        table.add_column(name, justify="right", no_wrap=True)
    for number, block in enumerate(trained.blocks, 1):
        share = f"{np.mean(block.shares):.0%}" if block.shares else "–"
        table.add_row(str(number), str(block.stride_count), str(len(block.shares)), share)
    return table


def _help(walks: Sequence[Walk]) -> Table:
    """The last strides of the patient who tires, with the newest state of the controller before."""
    table = Table(box=box.SIMPLE_HEAD, title="a patient who tires", title_justify="left")
    for name in ("stride", "share", "with help", "guidance", "assist, N·m"):
        table.add_column(name, justify="right", no_wrap=True)
    alone, helped = (walk.strides for walk in walks) if len(walks) > 1 else (walks[0].strides, ())
    states = {state.for_cycle: state.values for walk in walks for state in walk.helps}
    for number, (one, other) in enumerate(zip_longest(alone, helped), 1):
        values = {} if other is None else states.get(other.cycle, {})
        table.add_row(
            str(number),
            *(
                "–" if it is None or it.share_ratio is None else f"{it.share_ratio:.0%}"
                for it in (one, other)
            ),
            *(f"{v:.2f}" if isinstance(v := values.get(name), float) else "–" for name in SHOWN),
        )
    return table


def _text(value: float, digits: int = 2) -> str:
    return "–" if math.isnan(value) else f"{value:.{digits}f}"


def _cycles(healths: Sequence[wire.Health]) -> Table:
    """Statistics of all cycles: lateness of SYNC, missed cycles."""
    bounds = healths[0].lateness_bound_us
    counts = np.sum([health.lateness_count for health in healths], axis=0)
    table = Table(box=box.SIMPLE_HEAD, title="cycles of 10 ms", title_justify="left")
    for name in ("SYNCs", "late: median", "99 %", "99.9 %", "overruns", "TPDOs late", "lost"):
        table.add_column(name, justify="right")
    table.add_row(
        str(int(counts.sum())),
        *(_quantile(counts, bounds, share) for share in (0.5, 0.99, 0.999)),
        str(sum(health.overrun_count or 0 for health in healths)),
        str(sum(drive.late_count for health in healths for drive in health.drives)),
        str(sum(drive.lost_count for health in healths for drive in health.drives)),
    )
    return table


def _quantile(counts: np.ndarray, bounds: tuple[int, ...], share: float) -> str:
    """Return the class of the histogram that contains this share of all cycles."""
    if counts.sum() == 0:
        return "–"
    place = int(np.searchsorted(np.cumsum(counts), share * counts.sum()))
    return f"≤ {bounds[place]} µs" if place < len(bounds) else f"> {bounds[-1]} µs"
