"""What a soak says in words: the summary on a terminal, docs/soak.md, and whether it has failed."""

import datetime
import platform
from collections import Counter
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from gaitd.soaking import memory
from gaitd.soaking.memory import Life
from gaitd.soaking.play import Soaked
from gaitd.soaking.witness import Judged, Lost, Stop

CORE_MAX_MB: Final = 200.0
GATEWAY_MAX_MB: Final = 120.0
GROWTH_MAX_MB_PER_H: Final = 1.0
MOST_MB: Final = {"core": CORE_MAX_MB, "gateway": GATEWAY_MAX_MB}
"""Design, section 6."""
QUANTILES: Final = (0.5, 0.9, 0.99, 0.999, 0.9999, 1.0)
S_PER_MIN: Final = 60.0
WRONG: Final = (Judged.UNEXPECTED, Judged.MISSED)


def lives(found: Soaked) -> list[Life]:
    """Every process that lived, by part and age."""
    return [life for name, samples in found.memory.items() for life in memory.lives(name, samples)]


def failures(found: Soaked) -> list[str]:
    """Each reason why the soak has not passed."""
    said = [found.trouble] if found.trouble else []
    said += [f"{stop.judged.value}: {_told(stop)}" for stop in _of(found, *WRONG)]
    said += [f"ended by itself: {ending.splitlines()[0]}" for ending in found.endings]
    said += [f"gaitd {part} ended with {code}" for part, code in found.exit_codes.items() if code]
    for life in lives(found):
        most_mb = MOST_MB.get(life.name)
        if most_mb is None:
            continue
        if life.end_mb > most_mb:
            said.append(f"gaitd {life.name} has {life.end_mb:.0f} MB, allowed {most_mb:.0f}")
        growth = life.growth_mb_per_h
        if growth is not None and growth > GROWTH_MAX_MB_PER_H:
            said.append(f"gaitd {life.name} grows by {growth:.2f} MB/h, allowed 1")
    return said


def _of(found: Soaked, *judged: Judged) -> list[Stop]:
    return [stop for stop in found.tally.stops if stop.judged in judged]


def _told(stop: Stop) -> str:
    causes = ", ".join(cause.name.lower() for cause in stop.causes)
    where = f" at {stop.drive}" if stop.drive else ""
    during = f" during {stop.happening}" if stop.happening else " with nothing going wrong"
    seen = f" ({stop.evidence})" if stop.evidence else ""
    return f"{stop.time_s:.1f} s, in {stop.mode}: {stop.category} {causes}{where}{during}{seen}"


def quantiles_us(values: Sequence[float]) -> list[float]:
    """Of QUANTILES."""
    return np.quantile(np.asarray(values), QUANTILES).tolist() if len(values) else []


def summary(found: Soaked) -> str:
    """Aligned text."""
    return "\n\n".join(
        "\n".join((title, *(f"  {name:<44} {value}" for name, value in rows)))
        for title, rows in _blocks(found)
    )


def _blocks(found: Soaked) -> list[tuple[str, list[tuple[str, str]]]]:
    failed = failures(found)
    passed = [("passed", "every stop explained, nothing ended, memory within its budget")]
    return [
        ("The soak", _outline(found)),
        ("Frames and cycles lost, in calm / while something was wrong", _lost(found)),
        ("Stops by judgement and first cause", _counted(_stop_counts(found))),
        (
            "Memory, MB resident: started, warm, end; growth of own pages, MB/h; ring",
            _memory(found),
        ),
        ("Requests of the operator", _counted(found.outcomes)),
        ("Result", [("failed", why) for why in failed] or passed),
    ]


def _outline(found: Soaked) -> list[tuple[str, str]]:
    tally = found.tally
    late = quantiles_us(tally.lateness_us)
    names = ("median", "90 %", "99 %", "99.9 %", "99.99 %", "worst")
    late_words = ", ".join(f"{name} {value:.0f}" for name, value in zip(names, late, strict=False))
    work = quantiles_us(tally.work_us)
    recovery = found.recovery_s
    recovered = (
        f"median {np.median(recovery):.1f} s, longest {max(recovery):.1f} s" if recovery else "–"
    )
    return [
        ("time", f"{found.duration_s:.0f} s of {found.asked_s:.0f} s, seed {found.seed}"),
        ("cycles with SYNC", f"{tally.cycle_count}"),
        ("of them in gait", f"{tally.mode_cycles['gait']}"),
        ("SYNC late, µs", late_words),
        ("work of a cycle, µs", f"median {work[0]:.0f}, 99.9 % {work[3]:.0f}" if work else "–"),
        ("troubles", f"{len(found.happenings)}"),
        ("stops", f"{len(tally.stops)}"),
        ("from a trouble that stopped to gait again", recovered),
        ("core's scheduling", "SCHED_FIFO" if found.realtime else "SCHED_OTHER (FIFO refused)"),
        (
            f"{found.processors} processors, busy",
            f"{found.machine_busy_ratio:.0%}, by these three processes {found.own_busy_ratio:.0%}, "
            f"by other machines {found.stolen_ratio:.1%}",
        ),
        ("starts", ", ".join(f"{name} {count}" for name, count in found.start_count.items())),
        ("setpoints of floods", f"{found.flooded_count}"),
    ]


def _lost(found: Soaked) -> list[tuple[str, str]]:
    tally = found.tally
    samples = [(f"samples of {name} missed", lost) for name, lost in tally.missed.items()]
    rows: list[tuple[str, Lost]] = [
        ("grid points missed (overruns)", tally.overrun),
        *samples,
        ("our frames not sent", tally.tx_dropped),
        ("frames that could not be used", tally.protocol_error),
    ]
    told = [(name, f"{lost.calm_count} / {lost.trouble_count}") for name, lost in rows]
    return [*told, ("records that this program missed", str(found.record_lost_count))]


def _stop_counts(found: Soaked) -> Counter[str]:
    stops = found.tally.stops
    return Counter(f"{stop.judged.value}: {stop.category} {stop.cause}" for stop in stops)


def _counted(counts: Counter[str]) -> list[tuple[str, str]]:
    return [(name, str(count)) for name, count in counts.most_common()] or [("none", "0")]


def _memory(found: Soaked) -> list[tuple[str, str]]:
    return [
        (
            f"gaitd {life.name}, for {life.duration_s:.0f} s, {life.cpu_ratio:.1%} of a processor",
            f"{life.start_mb:.1f}, {life.warm_mb:.1f}, {life.end_mb:.1f}; {_growth(life)}; "
            f"{life.ring_mb:.0f}",
        )
        for life in lives(found)
    ]


def _growth(life: Life) -> str:
    growth = life.growth_mb_per_h
    return "too short a life" if growth is None else f"{growth:+.2f}"


# --- the page -------------------------------------------------------------------------------------

HELD_UP_SHOWN_COUNT: Final = 5
"""Of each cause, stops for which this computer is to blame; all of them are counted."""

_PREFACE: Final = """\
Real processes in real time on the loopback bus: `gaitd sim`, `gaitd core`, `gaitd gateway`. The leg
walks; every few seconds something goes wrong, drawn from a seed (`gaitd/soaking/happenings.py`); an
operator resets, enables and asks for gait again, over Zenoh as `gaitd reset` does. Processes are
killed in the first fifth only, so that memory is told of processes that live on.

A stop is *expected* if the fault matrix ([fault_matrix.md](fault_matrix.md)) names its cause for
what went wrong. It is *the computer held us up* if nothing of ours went wrong and the second before
(for a stop by the observer, which remembers longer: two and a half) shows late SYNCs, missed grid
points or the samples of all drives missing at once, or if other machines on the same hardware had
our processors within two and a half seconds: the loopback bus and the virtual drives are ordinary
processes among others.
Everything else is *unexpected*, and fails the soak."""


def page(found: Soaked, command: str, figure: str) -> str:
    """docs/soak.md."""
    today = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    machine = f"{platform.machine()}, {found.processors} processors, Python"
    parts = [
        "# The soak",
        f"Written by `{command}` on {today}; {machine} {platform.python_version()}.",
        _PREFACE,
        f"![lateness, memory, stops]({figure})",
        *(_table(title, rows) for title, rows in _blocks(found)),
        _table("What went wrong", _counted(Counter(one.name for _, one in found.happenings))),
    ]
    held_up = _of(found, Judged.HELD_UP)
    if held_up:
        parts.append("## When the computer held us up\n")
        shown = first_of_each_cause(held_up)
        parts.append("\n".join(f"- {_told(stop)}" for stop in shown))
        if len(held_up) > len(shown):
            parts.append(f"And {len(held_up) - len(shown)} more of these causes.")
    return "\n\n".join(parts) + "\n"


def first_of_each_cause(stops: Sequence[Stop]) -> list[Stop]:
    """Some of each cause, so that the rare ones can be read, in the order in which they came."""
    seen: Counter[str] = Counter()
    shown: list[Stop] = []
    for stop in stops:
        seen[stop.cause] += 1
        if seen[stop.cause] <= HELD_UP_SHOWN_COUNT:
            shown.append(stop)
    return shown


def _table(title: str, rows: Sequence[tuple[str, str]]) -> str:
    lines = (f"| {name} | {value} |" for name, value in rows)
    return "\n".join((f"## {title}", "", "| what | found |", "| --- | --- |", *lines))


def plain(found: Soaked) -> dict[str, Any]:
    """For a program."""
    return {
        "seed": found.seed,
        "duration_s": found.duration_s,
        "cycle_count": found.tally.cycle_count,
        "lateness_us": dict(
            zip(map(str, QUANTILES), quantiles_us(found.tally.lateness_us), strict=False)
        ),
        "overrun": [found.tally.overrun.calm_count, found.tally.overrun.trouble_count],
        "missed": {
            name: [lost.calm_count, lost.trouble_count] for name, lost in found.tally.missed.items()
        },
        "troubles": [[time_s, str(one)] for time_s, one in found.happenings],
        "stops": [
            {
                "time_s": stop.time_s,
                "mode": stop.mode,
                "category": stop.category,
                "causes": [cause.name.lower() for cause in stop.causes],
                "drive": stop.drive,
                "trouble": stop.happening,
                "judged": stop.judged.value,
                "evidence": stop.evidence,
            }
            for stop in found.tally.stops
        ],
        "memory": [life._asdict() for life in lives(found)],
        "exit_codes": found.exit_codes,
        "endings": found.endings,
        "requests": dict(found.outcomes),
        "failures": failures(found),
    }
