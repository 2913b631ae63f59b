"""A session of the history as one HTML page: for a therapist to read, to print, or to keep.

The page needs no other file and no network, and holds nothing that the history does not have.
"""

from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from html import escape
from statistics import fmean
from typing import Final, NamedTuple

from gaitd_texts import Catalogue

from gaitd_session.goals import band_about
from gaitd_session.profile import Goal, Profile
from gaitd_session.store import (
    BlockRow,
    GoalSummary,
    InterruptionRow,
    MarkRow,
    SessionSummary,
    Store,
    StrideRow,
)

NS_PER_S: Final = 1_000_000_000
S_PER_MIN: Final = 60
MARKS: Final = ("#005a8d", "#a34400")
"""Colours of the legs; the second one has squares."""
MARK_PX: Final = 3
TICKS: Final = (0.0, 0.25, 0.5, 0.75, 1.0)
UNKNOWN: Final = "–"
STYLE: Final = """
:root { color-scheme: light; --ink: #14212b; --soft: #44535f; --line: #d5d9d9; --tint: #dff0e7; }
* { box-sizing: border-box; }
body { font: 16px/1.45 "Atkinson Hyperlegible Next", Arial, sans-serif; color: var(--ink);
  background: #fff; max-width: 60rem; margin: 0 auto; padding: 1.25rem; }
h1 { font-size: 1.6rem; margin: 0; } h2 { font-size: 1.15rem; margin: 1.75rem 0 .5rem; }
p { margin: .25rem 0; color: var(--soft); }
dl { display: grid; grid-template-columns: repeat(auto-fit, minmax(7rem, 1fr)); gap: .75rem;
  margin: 1.25rem 0 0; }
dl div { border: 1px solid var(--line); border-radius: 8px; padding: .6rem .75rem; }
dt { color: var(--soft); font-size: .875rem; }
dd { margin: 0; font-size: 1.35rem; font-weight: 600; }
svg { display: block; width: 100%; height: 17rem; overflow: visible; }
svg text { font-size: 13px; fill: var(--soft); }
.plot { padding: .5rem .75rem 2.25rem 3rem; }
table { border-collapse: collapse; width: 100%; }
th, td { text-align: left; padding: .4rem .6rem .4rem 0; border-bottom: 1px solid var(--line); }
th { color: var(--soft); font-weight: 400; font-size: .875rem; }
@media (max-width: 40rem) {
  thead { display: none; } table, tbody, tr, td { display: block; }
  tr { border: 1px solid var(--line); border-radius: 8px; padding: .4rem .75rem; margin: .6rem 0; }
  td { display: flex; justify-content: space-between; gap: 1rem; border: 0; padding: .15rem 0;
    text-align: right; }
  td::before { content: attr(data-head); color: var(--soft); text-align: left; }
}
@media print { body { padding: 0; } h2, table, svg { break-inside: avoid; } }
"""


class ReportError(Exception):
    """There is no such session: what was asked for, and what there is."""


class _Told(NamedTuple):
    """What the history has of one session."""

    summary: SessionSummary
    blocks: Sequence[BlockRow]
    goals: Sequence[GoalSummary]
    strides: Sequence[StrideRow]
    interruptions: Sequence[InterruptionRow]
    marks: Sequence[MarkRow]
    self_test_utc_ns: int


def report(store: Store, profile: Profile, session: int | None, texts: Catalogue) -> str:
    """Return the page of a session; None: the newest one.

    Raises:
        ReportError: the profile has no such session.
        StoreError: the history cannot be read.
    """
    told = _read(store, profile, session)
    parts = (
        *_head(told, profile, texts),
        *_figures(told, texts),
        *_plot(told, profile.goal, texts),
        *_blocks(told, profile.goal, texts),
        *_interruptions(told.interruptions, texts),
        *_marks(told.marks, texts),
        f"<p>{escape(texts.text('report.meaning'))}</p>",
    )
    title = escape(texts.text("report.title"))
    return (
        f'<!doctype html>\n<html lang="{texts.language}">\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{title}</title>\n<style>{STYLE}</style>\n" + "\n".join(parts) + "\n</html>\n"
    )


def _read(store: Store, profile: Profile, session: int | None) -> _Told:
    summaries = {one.number: one for one in store.summaries(profile.id)}
    number = max(summaries, default=0) if session is None else session
    if number not in summaries:
        there = ", ".join(map(str, summaries)) or "none"
        raise ReportError(
            f"{store.file}: profile {profile.id} has no session {number or 'yet'}; it has {there}"
        )
    goals = store.goals(profile.id, profile.goal.band_width_ratio / 2)
    return _Told(
        summaries[number],
        store.blocks(number),
        [one for one in goals if one.session == number],
        store.strides_of(number),
        store.interruptions(number),
        store.marks(profile.id).get(number, ()),
        store.self_test_utc_ns(profile.id),
    )


def _head(told: _Told, profile: Profile, texts: Catalogue) -> Iterator[str]:
    one = told.summary
    yield f"<h1>{escape(texts.text('report.title'))}</h1>"
    words = texts.text("report.session", number=float(one.number), profile=profile.id)
    end = f"{texts.text('label.end')}: {texts.text(f'end.{one.end}')}"
    yield f"<p>{escape(words)} · {_time(one.begun_utc_ns)} · {escape(end)}</p>"
    if told.self_test_utc_ns:
        label = texts.text("label.self_test_passed")
        yield f"<p>{escape(label)}: {_time(told.self_test_utc_ns)}</p>"


def _figures(told: _Told, texts: Catalogue) -> Iterator[str]:
    valid = [one for one in told.strides if one.is_valid]
    works = [one.work_positive_j for one in valid if one.work_positive_j is not None]
    figures = (
        ("walked", f"{told.summary.walked_s / S_PER_MIN:.1f} min"),
        ("steps", f"{len(told.strides)}"),
        ("valid", f"{len(valid)}"),
        ("reached", f"{sum(one.reached_count for one in told.goals)}"),
        ("share", _percent(told.summary.mean_share_ratio)),
        ("work", f"{fmean(works):.1f} J" if works else UNKNOWN),
    )
    yield "<dl>"
    for name, value in figures:
        yield f"<div><dt>{escape(texts.text(f'report.{name}'))}</dt><dd>{value}</dd></div>"
    yield "</dl>"


def _plot(told: _Told, goal: Goal, texts: Catalogue) -> Iterator[str]:
    """Draw the share of each valid step over time; places are shares of the picture."""
    known = [
        (one, share)
        for one in told.strides
        if one.is_valid and (share := one.share_ratio) is not None
    ]
    yield f"<h2>{escape(texts.text('report.shares'))}</h2>"
    if not known:
        yield f"<p>{escape(texts.text('report.no_share'))}</p>"
        return
    begun_ns = min(told.summary.begun_utc_ns, *(one.end_utc_ns for one, _ in known))
    whole_ns = max(max(one.end_utc_ns for one, _ in known) - begun_ns, S_PER_MIN * NS_PER_S)
    legs = sorted({one.leg for one, _ in known}, reverse=True)

    def x(utc_ns: int) -> float:
        return 100 * (utc_ns - begun_ns) / whole_ns

    yield f'<div class="plot"><svg role="img" aria-label="{escape(texts.text("report.shares"))}">'
    for one in told.goals:
        times = [row.end_utc_ns for row, _ in known if (row.block, row.leg) == (one.block, one.leg)]
        if times:
            band = band_about(one.middle_ratio, goal)
            left, width = x(min(times)), x(max(times)) - x(min(times))
            high, tall = 100 * (1 - band.high_ratio), 100 * (band.high_ratio - band.low_ratio)
            yield (
                f'<rect x="{left:.2f}%" y="{high:.2f}%" width="{width:.2f}%" height="{tall:.2f}%"'
                ' fill="#dff0e7"/>'
            )
    for tick in TICKS:
        y = f"{100 * (1 - tick):g}%"
        yield f'<line x1="0" x2="100%" y1="{y}" y2="{y}" stroke="#d5d9d9"/>'
        yield f'<text x="-8" y="{y}" dy="4" text-anchor="end">{tick:.0%}</text>'
        minutes = tick * whole_ns / NS_PER_S / S_PER_MIN
        yield (
            f'<text x="{100 * tick:g}%" y="100%" dy="22" text-anchor="middle">{minutes:.1f}</text>'
        )
    for stride, share in known:
        place, height, number = x(stride.end_utc_ns), 100 * (1 - share), legs.index(stride.leg)
        yield _mark(f"{place:.2f}%", f"{height:.2f}%", number)
    yield "</svg></div>"
    keys = (
        f'<svg style="display:inline-block;width:12px;height:10px">{_mark("5", "5", number)}</svg>'
        f" {escape(texts.subject(leg))}"
        for number, leg in enumerate(legs)
    )
    yield f"<p>{escape(texts.text('report.axes'))} {' · '.join(keys)}</p>"


def _mark(x: str, y: str, number: int) -> str:
    colour = MARKS[number % len(MARKS)]
    if number % len(MARKS) == 0:
        return f'<circle cx="{x}" cy="{y}" r="{MARK_PX}" fill="{colour}"/>'
    shift = f'transform="translate(-{MARK_PX},-{MARK_PX})"'
    side = 2 * MARK_PX
    return f'<rect x="{x}" y="{y}" width="{side}" height="{side}" {shift} fill="{colour}"/>'


def _blocks(told: _Told, goal: Goal, texts: Catalogue) -> Iterator[str]:
    heads = ("block", "kind", "cadence", "walked", "leg", "valid", "reached", "share", "target")
    names = [texts.text(f"report.{head}") for head in heads]
    bands = {(one.block, one.leg): one for one in told.goals}
    rows: list[tuple[str, ...]] = []
    for block in told.blocks:
        mine = [one for one in told.strides if one.block == block.number]
        for leg in sorted({one.leg for one in mine}, reverse=True) or ("",):
            steps = [one for one in mine if one.leg == leg]
            valid = [one for one in steps if one.is_valid]
            shares = [one.share_ratio for one in valid if one.share_ratio is not None]
            found = bands.get((block.number, leg))
            band = found and band_about(found.middle_ratio, goal)
            rows.append(
                (
                    f"{block.number}",
                    texts.text(f"block.{block.kind}"),
                    f"{block.cadence_hz:g}/s",
                    f"{block.walked_s / S_PER_MIN:.1f} / {block.planned_s / S_PER_MIN:.1f} min",
                    texts.subject(leg) or UNKNOWN,
                    f"{len(valid)} / {len(steps)}",
                    f"{found.reached_count}" if found else UNKNOWN,
                    _percent(fmean(shares) if shares else None),
                    f"{band.low_ratio:.0%} … {band.high_ratio:.0%}" if band else UNKNOWN,
                )
            )
    yield f"<h2>{escape(texts.text('report.blocks'))}</h2>"
    yield from _table(names, rows)


def _interruptions(found: Sequence[InterruptionRow], texts: Catalogue) -> Iterator[str]:
    yield f"<h2>{escape(texts.text('report.interruptions'))}</h2>"
    if not found:
        yield f"<p>{escape(texts.text('report.no_interruption'))}</p>"
        return
    heads = [texts.text("report.time"), texts.text("report.why")]
    rows = [(_time(one.utc_ns), texts.interruption(one.reason or one.phase)) for one in found]
    yield from _table(heads, rows)


def _marks(found: Sequence[MarkRow], texts: Catalogue) -> Iterator[str]:
    if found:
        yield f"<h2>{escape(texts.text('report.marks'))}</h2>"
        heads = [texts.text("report.time"), texts.text("report.mark")]
        yield from _table(heads, [(_time(one.utc_ns), one.said) for one in found])


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    cells = "".join(f'<th scope="col">{escape(head)}</th>' for head in heads)
    yield f"<table><thead><tr>{cells}</tr></thead><tbody>"
    for row in rows:
        pairs = zip(heads, row, strict=True)
        cells = "".join(f'<td data-head="{escape(h)}">{escape(cell)}</td>' for h, cell in pairs)
        yield f"<tr>{cells}</tr>"
    yield "</tbody></table>"


def _time(utc_ns: int) -> str:
    return f"{datetime.fromtimestamp(utc_ns / NS_PER_S, UTC):%Y-%m-%d %H:%M:%S} UTC"


def _percent(ratio: float | None) -> str:
    return UNKNOWN if ratio is None else f"{ratio:.0%}"
