"""What a verification found, as rows of text and as the page that lies in the evidence."""

from collections.abc import Iterator, Sequence
from html import escape
from typing import Final

from drives.verification.bench import Row
from drives.verification.evidence import Result
from drives.verification.facts import Fact, FactCode, Judgement

ASKED: Final = {
    FactCode.BRING_UP: "identity, torque base, mapping, limits, option codes, offsets",
    FactCode.SAMPLES: "SYNCs that both TPDOs answer in the window, share",
    FactCode.STATUSWORD_MAPPED: "statusword of TPDO1 and by SDO, different bits",
    FactCode.POSITION_MAPPED: "position of TPDO1 less that by SDO, counts",
    FactCode.ENCODER: "one turn of the motor by hand, share of the file's counts",
    FactCode.ENABLED: "time to operation enabled, s",
    FactCode.STANDSTILL: "motion at a commanded torque of 0, revolutions of the motor",
    FactCode.SIGN: "correlation of motion and commanded torque",
    FactCode.EFFORT_SCALE: "measured torque over commanded torque",
    FactCode.INERTIA: "inertia that the motion shows over the known one",
    FactCode.FOLLOWING: "largest following error over its window",
    FactCode.VELOCITY_UNIT: "velocity 606Ch over that of the positions",
    FactCode.QUICK_STOP_STATE: "end of a quick stop",
    FactCode.QUICK_STOP_WAY: "way of a quick stop over the longest one by 6085h",
    FactCode.SHUTDOWN_STATE: "end of a shutdown",
    FactCode.DISABLE_VOLTAGE_STATE: "end of disable voltage",
    FactCode.COMMAND_LOSS_TIME: "commands left out: time to the reaction, s",
    FactCode.COMMAND_LOSS_STATE: "commands left out: end",
    FactCode.HEARTBEAT_LOSS_TIME: "heartbeat left out: time to the reaction, s",
    FactCode.HEARTBEAT_LOSS_STATE: "heartbeat left out: end",
    FactCode.HEARTBEAT_LOSS_REST: "heartbeat left out: time to rest, s",
    FactCode.HEARTBEAT_LOSS_EMCY: "heartbeat left out: code of the EMCY",
    FactCode.FAULT_RESET: "brought up again, fault reset",
    FactCode.ERROR_CLEARED: "error register after it",
    FactCode.COMPLETED: "played to the end",
}
JUDGED: Final = {
    Judgement.PASSED: "passed",
    Judgement.FAILED: "FAILED",
    Judgement.NOT_MEASURED: "not measured",
}
WIDTH: Final = 900
HEIGHT: Final = 130
LEFT: Final = 70
POINTS_MAX: Final = 1500
STYLE: Final = """
:root { color-scheme: light dark }
body { font: 15px/1.45 system-ui, sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em }
table { border-collapse: collapse; width: 100% }
th, td { text-align: left; padding: .25em .8em .25em 0; border-bottom: 1px solid #8884;
  overflow-wrap: anywhere }
.failed { color: #d32f2f; font-weight: 700 } .not_measured { opacity: .7 }
svg { width: 100%; height: auto } svg text { font: 11px system-ui, sans-serif; fill: currentColor }
"""


def row(fact: Fact) -> tuple[str, str, str, str]:
    """What was asked, found and allowed, and the judgement."""
    allowed = " or ".join(fact.allowed)
    if fact.bounds is not None:
        allowed = " to ".join(_number(fact, one) for one in fact.bounds)
    return ASKED[fact.code], _found(fact), allowed, JUDGED[fact.judgement]


def _number(fact: Fact, value: float) -> str:
    is_code = fact.code is FactCode.HEARTBEAT_LOSS_EMCY
    return f"{int(value):04X}h" if is_code else f"{value:.4g}"


def _found(fact: Fact) -> str:
    if fact.found is None:
        return "–"
    return fact.found if isinstance(fact.found, str) else _number(fact, fact.found)


def counts(facts: Sequence[Fact]) -> str:
    """`21 passed, 1 FAILED, 2 not measured`."""
    return ", ".join(
        f"{count} {text}"
        for judgement, text in JUDGED.items()
        if (count := sum(fact.judgement is judgement for fact in facts))
    )


def html(result: Result) -> str:
    """The page: table of facts and a picture of all that was played."""
    cells = "".join(
        f'<tr class="{fact.judgement}">'
        + "".join(f"<td>{escape(cell)}</td>" for cell in row(fact))
        + "</tr>"
        for fact in result.facts
    )
    time = "simulated time: virtual drives" if result.is_simulated else "the computer's time"
    vendor, product, revision, serial = result.identity
    head = (
        f"{result.drive}, node {result.node_id}; {result.profile}; 1018h: {vendor:X}h, "
        f"{product:X}h, {revision:X}h, {serial}; gaitd {result.gaitd_version}; {result.utc}; {time}"
    )
    refusal = f"<p class=failed>{escape(result.refusal)}</p>" if result.refusal else ""
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width">'
        f"<title>Verification of {escape(result.drive)}</title><style>{STYLE}</style></head><body>"
        f"<h1>Verification of {escape(result.drive)}: {counts(result.facts)}</h1>"
        f"<p>{escape(head)}</p>{refusal}"
        "<table><tr><th>fact</th><th>found</th><th>allowed</th><th></th></tr>"
        f"{cells}</table><h2>What was played</h2>{_picture(result.rows)}</body></html>\n"
    )


def _picture(rows: Sequence[Row]) -> str:
    if len(rows) < 2:
        return "<p>Nothing was moved.</p>"
    kept = rows[:: max(1, len(rows) // POINTS_MAX)]
    panels = (
        ("position, counts", [float(one.position_counts) for one in kept], "#1f78b4"),
        ("commanded torque, counts of 6071h", [float(one.torque_permille) for one in kept], "#888"),
        (
            "measured torque, counts of its object",
            [float(one.torque_raw) for one in kept],
            "#b15928",
        ),
    )
    begin_s, end_s = kept[0].time_s, kept[-1].time_s

    def x(time_s: float) -> float:
        return LEFT + (WIDTH - LEFT - 10) * (time_s - begin_s) / (end_s - begin_s)

    drawn = "".join(
        _panel(name, [x(one.time_s) for one in kept], values, colour, index * HEIGHT)
        for index, (name, values, colour) in enumerate(panels)
    )
    height = len(panels) * HEIGHT + 40
    marks = "".join(
        f'<line x1="{x(time_s):.1f}" x2="{x(time_s):.1f}" y1="0" y2="{height - 40}"'
        f' stroke="#8886"/><text x="{x(time_s) + 3:.1f}" y="{height - 26 + 14 * (index % 2)}">'
        f"{escape(name)}</text>"
        for index, (time_s, name) in enumerate(_stages(rows))
    )
    label = "position, commanded and measured torque over time, with the stages"
    return (
        f'<svg viewBox="0 0 {WIDTH} {height}" role="img" aria-label="{label}">{drawn}{marks}</svg>'
    )


def _stages(rows: Sequence[Row]) -> Iterator[tuple[float, str]]:
    before = ""
    for one in rows:
        if one.stage != before:
            before = one.stage
            yield one.time_s, one.stage


def _panel(name: str, xs: Sequence[float], values: Sequence[float], colour: str, top: float) -> str:
    low, high = min(values), max(values)
    span = high - low or 1.0
    points = " ".join(
        f"{x:.1f},{top + 20 + (HEIGHT - 34) * (high - value) / span:.1f}"
        for x, value in zip(xs, values, strict=True)
    )
    return (
        f'<text x="{LEFT}" y="{top + 12}">{escape(name)}</text>'
        f'<text x="{LEFT - 6}" y="{top + 26}" text-anchor="end">{high:g}</text>'
        f'<text x="{LEFT - 6}" y="{top + HEIGHT - 12}" text-anchor="end">{low:g}</text>'
        f'<polyline fill="none" stroke="{colour}" stroke-width="1.3" points="{points}"/>'
    )
