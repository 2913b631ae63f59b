"""Results of the sessions, for a terminal and as a page of docs/."""

from collections import Counter

from analysis import markdown
from gaitd_lab.fuzz.tally import Broken, Tally

_PREFACE = """\
Each session is a seed: the real loop on the virtual machine in lock-step, among random requests,
stops, faults, lost frames, late loops, controllers good and bad, and deaths of each process.
`gaitd_lab/fuzz/invariants.py` says what must never happen and how it is judged: from the frames
on the wire and the truth of the plant. The tests run some minutes of it
(`tests/gaitd/test_fuzz.py`)."""
TRACE_SHOWN = 60
"""Trace lines printed before a violation."""


def rerun(broken: Broken) -> str:
    """Return the command that runs one session again."""
    seconds = broken.session_s
    return f"gaitd fuzz --seed {broken.seed} --minutes {seconds / 60:g}"


def description(broken: Broken) -> str:
    """Describe a violation, the events before it, and how to reproduce it."""
    lines = (
        f"VIOLATION with seed {broken.seed} ({broken.variant}): {broken.violation}",
        *(f"  {line}" for line in broken.trace[-TRACE_SHOWN:]),
        f"again: {rerun(broken)}",
    )
    return "\n".join(lines)


def summary(tally: Tally) -> str:
    """Return all counts as aligned text."""
    parts = [
        f"{tally.simulated_s:.0f} s in {tally.session_count} sessions, {tally.cycle_count} cycles",
        *(_block(title, counts) for title, counts in _counts(tally)),
        f"violations: {len(tally.broken) or 'none'}",
    ]
    return "\n\n".join(parts)


def page(tally: Tally, command: str) -> str:
    """Return docs/random_hour.md."""
    return markdown.page(
        "# The random hour",
        f"Written by `{command}`; the numbers are of that run.",
        _PREFACE,
        f"{tally.simulated_s:.0f} s of simulated time in {tally.session_count} sessions, "
        f"{tally.cycle_count} cycles, {tally.stolen_count} frames lost on the way. "
        f"Violations: **{len(tally.broken) or 'none'}**.",
        *(_section(title, counts) for title, counts in _counts(tally)),
        *(f"```\n{description(broken)}\n```" for broken in tally.broken),
    )


def _counts(tally: Tally) -> tuple[tuple[str, Counter[str]], ...]:
    return (
        ("Cycles by mode", tally.modes),
        ("Stops by category and cause", tally.stops),
        ("Requests by outcome", tally.requests),
        ("What else happened", tally.events),
        ("Faults of drives", tally.faults),
        ("Setpoints of controllers", tally.setpoints),
        ("Invariants, how often each was looked at", tally.checked),
    )


def _block(title: str, counts: Counter[str]) -> str:
    width = max(map(len, counts), default=0)
    rows = (f"  {name.ljust(width)}  {count:8d}" for name, count in counts.most_common())
    return "\n".join((title, *rows))


def _section(title: str, counts: Counter[str]) -> str:
    rows = [(name, str(count)) for name, count in counts.most_common()]
    return f"## {title}\n\n{markdown.table(('what', 'how often'), rows)}"
