"""The page of an acceptance record: one HTML file with its style and its figures in it."""

import math
from collections.abc import Iterator, Sequence
from html import escape
from itertools import groupby
from pathlib import Path
from typing import Final

from gaitd_client.wire import JOINTS
from gaitd_texts import Catalogue

from analysis.acceptance.record import AcceptanceRecord, Finding, Judgement, Section, StopTrace
from analysis.acceptance.words import finding_texts

WIDTH: Final = 420
HEIGHT: Final = 110
LEFT: Final = 62
"""Room for the numbers of the vertical axis, px; BOTTOM for those of time."""
BOTTOM: Final = 20
FOLDED_LINES: Final = 12
"""A longer section that has nothing wrong is folded."""
STYLE: Final = """
body { font: 15px/1.45 system-ui, sans-serif; color: #1f2937; max-width: 72em; margin: 2em auto;
  padding: 0 1em }
h1 { font-size: 1.5em } h2 { font-size: 1.1em; margin: 1.6em 0 .4em }
table { border-collapse: collapse; width: 100% }
th, td { text-align: left; vertical-align: top; padding: .3em .7em .3em 0;
  border-bottom: 1px solid #e3e6ea; overflow-wrap: anywhere }
th { font-weight: 600; color: #4b5563 } td.j, th.j { width: 8em; white-space: nowrap }
.w3 { width: 30% }
.passed { color: #1b6e20 } .failed { color: #b71c1c; font-weight: 700 }
.not_measured { color: #8a4b00 } .noted { color: #4b5563 }
.stops { display: grid; grid-template-columns: repeat(auto-fill, minmax(420px, 1fr)); gap: 1em }
figure { margin: 0 } figcaption { font-weight: 600 }
svg text { font: 10px system-ui, sans-serif; fill: #1f2937 }
summary { cursor: pointer; color: #4b5563 }
"""


def write(record: AcceptanceRecord, texts: Catalogue, path: Path) -> None:
    """Write the page in the language of the texts.

    Raises:
        OSError: the file cannot be written.
    """
    path.write_text(html(record, texts), encoding="utf-8")


def html(record: AcceptanceRecord, texts: Catalogue) -> str:
    """Return the page as text."""

    def said(member: str) -> str:
        return texts.text(f"record.{member}")

    counts = ", ".join(
        f"{record.count(one)} {texts.text(f'judgement.{one}')}"
        for one in Judgement
        if record.count(one)
    )
    title = f"{said('title')}: {texts.subject(record.drive)}"
    verdict = _word(record.judgement, texts)
    if record.judgement is Judgement.NOT_MEASURED:
        verdict = f'<span class="not_measured">{escape(said("not_all_measured"))}</span>'
    verified = "" if record.profile_verified_on_hardware else f" ({said('not_verified')})"
    head = {
        "drive": f"{record.drive}, {said('node')} {record.node_id}",
        "begun": record.utc,
        "version": record.gaitd_version,
        "profile": record.profile + verified,
        "core": record.core_boot_id or said("no_core"),
    }
    rows = "".join(
        f"<tr><th>{escape(said(name))}</th><td>{escape(value)}</td></tr>"
        for name, value in head.items()
    )
    files = "".join(
        f"<tr><td>{escape(name)}</td><td><code>{escape(digest)}</code></td></tr>"
        for name, digest in sorted(record.sha256.items())
    )
    order = tuple(Section)
    findings = sorted(record.findings, key=lambda one: order.index(one.section))
    parts = groupby(findings, key=lambda one: one.section)
    sections = "".join(_section(section, list(found), texts) for section, found in parts)
    stops = "".join(_stop(stop, texts) for stop in record.stops)
    figures = f"<h2>{escape(said('stops'))}</h2><div class=stops>{stops}</div>" if stops else ""
    return (
        f'<!doctype html><html lang="{texts.language}"><head><meta charset="utf-8">'
        f"<title>{escape(title)}</title><style>{STYLE}</style></head>"
        f"<body><h1>{escape(title)}: {verdict}</h1>"
        f"<p>{escape(counts)}. {escape(said('legend'))}</p>"
        f"<table>{rows}</table>{sections}{figures}"
        f"<h2>{escape(said('files'))}</h2><details><summary>SHA-256</summary>"
        f"<table>{files}</table></details></body></html>\n"
    )


def _word(judged: Judgement, texts: Catalogue) -> str:
    return f'<span class="{judged}">{escape(texts.text(f"judgement.{judged}"))}</span>'


def _section(section: Section, findings: Sequence[Finding], texts: Catalogue) -> str:
    asked, measured, allowed, verdict = (
        escape(texts.text(f"record.{one}")) for one in ("asked", "measured", "allowed", "verdict")
    )
    head = (
        f"<tr><th class=w3>{asked}</th><th class=w3>{measured}</th><th>{allowed}</th>"
        f"<th class=j>{verdict}</th></tr>"
    )
    table = f"<table>{head}{''.join(_line(one, texts) for one in findings)}</table>"
    good = all(one.judgement in {Judgement.PASSED, Judgement.NOTED} for one in findings)
    if good and len(findings) > FOLDED_LINES:
        summary = escape(texts.text("record.all_passed", count=str(len(findings))))
        table = f"<details><summary>{summary}</summary>{table}</details>"
    return f"<h2>{escape(texts.text(f'section.{section}'))}</h2>{table}"


def _line(finding: Finding, texts: Catalogue) -> str:
    cells = "".join(f"<td>{escape(one)}</td>" for one in finding_texts(texts, finding))
    return f"<tr>{cells}<td class=j>{_word(finding.judgement, texts)}</td></tr>"


# --- figures --------------------------------------------------------------------------------------


def _stop(stop: StopTrace, texts: Catalogue) -> str:
    joint = JOINTS[stop.drive.partition("/")[2]]
    panels = (
        ("position", joint.position, stop.position_si, "#6b7280"),
        ("velocity", joint.velocity, stop.velocity_si_per_s, "#1f5fa8"),
        ("effort", joint.effort, stop.effort_si, "#7a5230"),
    )
    drawn = "".join(
        _panel(
            stop,
            f"{texts.text(f'record.{name}')}, {unit}",
            values,
            colour,
            index * (HEIGHT + BOTTOM),
        )
        for index, (name, unit, values, colour) in enumerate(panels)
    )
    height = len(panels) * (HEIGHT + BOTTOM)
    title = f"{stop.category}, {texts.text(f'stopped.{stop.cause}')}"
    rest = texts.text("record.no_rest")
    if stop.rest_s is not None and stop.distance_si is not None:
        known = {"rest_ms": 1e3 * stop.rest_s, "way_si": stop.distance_si}
        rest = texts.about("record.rest", stop.drive, known)
    caption = f"<figcaption>{escape(title)}: {escape(rest)}</figcaption>"
    size = f'viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}"'
    label = escape(f"{title}: {texts.text('record.over_time')}", quote=True)
    return f'<figure>{caption}<svg {size} role="img" aria-label="{label}">{drawn}</svg></figure>'


def _panel(
    stop: StopTrace, name: str, values: Sequence[float | None], colour: str, top: int
) -> str:
    known = [one for one in values if one is not None]
    if not known or len(stop.time_s) < 2:
        return f'<text x="{LEFT}" y="{top + 20}">{escape(name)}: –</text>'
    low, high = min(known), max(known)
    low, high = (low, high) if high - low > 1e-9 else (low - 1, high + 1)
    begin, end = stop.time_s[0], stop.time_s[-1]

    def x(time_s: float) -> float:
        return LEFT + (WIDTH - LEFT - 6) * (time_s - begin) / (end - begin)

    def y(value: float) -> float:
        return top + 16 + (HEIGHT - 22) * (high - value) / (high - low)

    lines = [
        f'<polyline fill="none" stroke="{colour}" stroke-width="1.5" points="{points}"/>'
        for points in _stretches(
            [(x(t), v if v is None else y(v)) for t, v in zip(stop.time_s, values, strict=True)]
        )
    ]
    marks = [(0.0, "#c62828")] + ([] if stop.rest_s is None else [(stop.rest_s, "#2e7d32")])
    rules = "".join(
        f'<line x1="{x(t):.1f}" x2="{x(t):.1f}" y1="{top + 14}" y2="{top + HEIGHT}"'
        f' stroke="{mark}" stroke-dasharray="3 3"/>'
        for t, mark in marks
    )
    axis = "".join(
        f'<text x="{LEFT - 5}" y="{y(value) + 3:.1f}" text-anchor="end">{value:.3g}</text>'
        f'<line x1="{LEFT}" x2="{WIDTH - 6}" y1="{y(value):.1f}" y2="{y(value):.1f}"'
        ' stroke="#e3e6ea"/>'
        for value in (low, high, *([0.0] if low < 0 < high and _apart(low, high) else []))
    )
    step = _tick(end - begin)
    ticks = "".join(
        f'<text x="{x(k * step):.1f}" y="{top + HEIGHT + 12}" text-anchor="middle">'
        f"{k * step:g}{' s' if k == 0 else ''}</text>"
        for k in range(math.ceil(begin / step), math.floor(end / step) + 1)
    )
    title = f'<text x="{LEFT}" y="{top + 10}">{escape(name)}</text>'
    return f"{title}{axis}{rules}{''.join(lines)}{ticks}"


def _stretches(points: Sequence[tuple[float, float | None]]) -> Iterator[str]:
    """Lines between missing samples, as SVG has points."""
    part: list[str] = []
    for x, y in (*points, (0.0, None)):
        if y is not None:
            part.append(f"{x:.1f},{y:.1f}")
        elif part:
            yield " ".join(part)
            part = []


def _apart(low: float, high: float) -> bool:
    """True if a label at 0 is clear of those at both ends."""
    return min(-low, high) > 0.15 * (high - low)


def _tick(span_s: float) -> float:
    """Time between two labels: five of them or so."""
    step = 10.0 ** math.floor(math.log10(span_s / 2))
    return next(step * k for k in (1, 2, 5, 10) if span_s / (step * k) <= 6)
