"""Text of a demonstration: one line a second, and the tables at the end."""

from collections.abc import Iterator, Sequence
from itertools import zip_longest
from typing import Final

import numpy as np
from gaitd_client import wire

from gaitd_lab.demonstration.evaluation import (
    AXES,
    Results,
    Walk,
    axis_title,
    errors,
    pairs,
)
from gaitd_lab.demonstration.feed import TEXTS, verdict_text
from gaitd_lab.demonstration.script import Kind
from gaitd_lab.demonstration.training import TrainingResult
from gaitd_lab.demonstration.view import Moment
from gaitd_lab.studies.report import UNKNOWN, Table

NEWEST: Final = 12


def line(moment: Moment) -> str:
    """Return one text line: time, mode, estimate and truth of each axis, lateness, stop."""
    receiver = moment.receiver
    safety = receiver.safety if receiver else None
    words = [f"{moment.elapsed_s:6.1f} s", f"{(safety.mode if safety else None) or 'starting':<12}"]
    if not any(len(tracks.received) for tracks in moment.legs.values()):
        return "  ".join(words).rstrip()
    legs = pairs(moment.legs, NEWEST)
    for leg, both in legs.items():
        for (axis, _, unit), pair in zip(AXES, both, strict=True):
            said, wanted, rubs = (_newest(v) for v in (pair.estimate, pair.wanted, pair.friction))
            name = axis_title(leg, axis, legs)
            words.append(f"{name} patient {said} (true {wanted}) friction {rubs} {unit}")
    if moment.speed_ratio is not None:
        words.append(f"{moment.speed_ratio:.1f} x real time")
    words.append(verdict_text(safety) or TEXTS.progress(safety.progress if safety else None))
    return "  ".join(words).rstrip()


def _newest(values: np.ndarray) -> str:
    known = values[np.isfinite(values)]
    return f"{known[-1]:6.1f}" if len(known) else "     –"


def as_object(results: Results, trained: TrainingResult | None) -> dict[str, object]:
    """The table of errors and the result as plain data for a program."""
    rows = [{**row._asdict(), "span": row.span.title, "passed": row.passed} for row in results.rows]
    return {"trouble": results.trouble, "rows": rows, "session": trained}


def tables(results: Results, trained: TrainingResult | None) -> Iterator[Table]:
    """Return what is known: errors, the cycles' statistics, a session, a patient who tires."""
    if results.rows:
        yield errors(results.rows)
    if results.health:
        yield _cycles(results.health)
    if trained:
        yield _session(trained)
    if any(span.kind is Kind.TIRING for span in results.spans):
        yield _help(results.walks)


def _session(trained: TrainingResult) -> Table:
    """Return what the history says of the session, and of each block."""
    told = trained.summary
    title = (
        f"session {told.end or 'not ended'}: walked {told.walked_s:.0f} s, interruptions: "
        f"{told.interruption_count}{told.last_interruption and f' ({told.last_interruption})'}"
    )
    rows = [
        (str(number), str(block.stride_count), str(len(block.shares)), _mean(block.shares))
        for number, block in enumerate(trained.blocks, 1)
    ]
    return Table(title, ("block", "strides", "known", "share, mean"), rows)


def _mean(shares: Sequence[float]) -> str:
    return f"{np.mean(shares):.0%}" if shares else UNKNOWN


def _help(walks: Sequence[Walk]) -> Table:
    """Return the strides of the patient who tires, with the newest state of the controller."""
    alone, helped = (walk.strides for walk in walks) if len(walks) > 1 else (walks[0].strides, ())
    states = {state.for_cycle: state for walk in walks for state in walk.helps}
    rows: list[tuple[str, ...]] = []
    for number, (one, other) in enumerate(zip_longest(alone, helped), 1):
        state = None if other is None else states.get(other.cycle)
        told = (
            (None, None)
            if state is None
            else (state.values.get("stiffness_ratio"), state.hip.get("assist_mean"))
        )
        texts = (f"{value:.2f}" if isinstance(value, float) else UNKNOWN for value in told)
        rows.append((str(number), _share(one), _share(other), *texts))
    head = ("stride", "share", "with help", "guidance", "assist, N·m")
    return Table("a patient who tires", head, rows)


def _share(stride: wire.Stride | None) -> str:
    share_ratio = None if stride is None else stride.share_ratio
    return UNKNOWN if share_ratio is None else f"{share_ratio:.0%}"


def _cycles(healths: Sequence[wire.Health]) -> Table:
    """Return the statistics of all cycles: lateness of SYNC, missed cycles."""
    bounds = healths[0].lateness_bound_us
    counts = np.sum([health.lateness_count for health in healths], axis=0)
    drives = [drive for health in healths for drive in health.drives]
    row = (
        str(int(counts.sum())),
        *(_quantile(counts, bounds, share) for share in (0.5, 0.99, 0.999)),
        str(sum(health.overrun_count or 0 for health in healths)),
        str(sum(drive.late_count for drive in drives)),
        str(sum(drive.lost_count for drive in drives)),
    )
    head = ("SYNCs", "late: median", "99 %", "99.9 %", "overruns", "TPDOs late", "lost")
    return Table("cycles of 10 ms", head, [row])


def _quantile(counts: np.ndarray, bounds: tuple[int, ...], share: float) -> str:
    """Return the class of the histogram that contains this share of all cycles."""
    if counts.sum() == 0:
        return UNKNOWN
    place = int(np.searchsorted(np.cumsum(counts), share * counts.sum()))
    return f"≤ {bounds[place]} µs" if place < len(bounds) else f"> {bounds[-1]} µs"
