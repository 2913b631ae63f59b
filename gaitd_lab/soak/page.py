"""Text results of a soak: the terminal summary, docs/soak.md, and the pass criteria."""

import datetime
import platform
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, astuple
from typing import Any, Final

import numpy as np

from analysis import markdown
from daemon.wire.names import name_of
from gaitd_lab.soak.memory import Life
from gaitd_lab.soak.record_monitor import Classification, Lost, Stop
from gaitd_lab.soak.run import Soaked

CORE_MAX_MB: Final = 200.0
GATEWAY_MAX_MB: Final = 120.0
GROWTH_MAX_MB_PER_H: Final = 1.0
MOST_MB: Final = {"core": CORE_MAX_MB, "gateway": GATEWAY_MAX_MB}
"""Limit of the design, section 6."""
QUANTILES: Final = (0.5, 0.9, 0.99, 0.999, 0.9999, 1.0)
WRONG: Final = (Classification.UNEXPECTED, Classification.MISSED)


def failures(found: Soaked) -> list[str]:
    """Return each reason why the soak has not passed."""
    said = [found.trouble] if found.trouble else []
    said += [f"{stop.judged.value}: {_told(stop)}" for stop in _of(found, *WRONG)]
    said += [f"ended by itself: {ending.splitlines()[0]}" for ending in found.endings]
    said += [f"gaitd {part} ended with {code}" for part, code in found.exit_codes.items() if code]
    for life in found.lives:
        most_mb = MOST_MB.get(life.name)
        if most_mb is None:
            continue
        if life.end_mb > most_mb:
            said.append(f"gaitd {life.name} has {life.end_mb:.0f} MB, allowed {most_mb:.0f}")
        growth = life.growth_mb_per_h
        if growth is not None and growth > GROWTH_MAX_MB_PER_H:
            said.append(f"gaitd {life.name} grows by {growth:.2f} MB/h, allowed 1")
    return said


def _of(found: Soaked, *judged: Classification) -> list[Stop]:
    return [stop for stop in found.tally.stops if stop.judged in judged]


def _told(stop: Stop) -> str:
    causes = ", ".join(map(name_of, stop.causes))
    where = f" at {stop.drive}" if stop.drive else ""
    during = f" during {stop.happening}" if stop.happening else " with nothing going wrong"
    seen = f" ({stop.evidence})" if stop.evidence else ""
    return f"{stop.time_s:.1f} s, in {stop.mode}: {stop.category} {causes}{where}{during}{seen}"


def quantiles_us(values: Sequence[float]) -> list[float]:
    """Return the values of QUANTILES."""
    return np.quantile(np.asarray(values), QUANTILES).tolist() if len(values) else []


def summary(found: Soaked) -> str:
    """Return the summary as aligned text."""
    return "\n\n".join(
        "\n".join((title, *(f"  {name:<44} {value}" for name, value in rows)))
        for title, rows in _blocks(found)
    )


def _blocks(found: Soaked) -> list[tuple[str, list[tuple[str, str]]]]:
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
        ("Result", [("failed", why) for why in failures(found)] or passed),
    ]


def _outline(found: Soaked) -> list[tuple[str, str]]:
    tally = found.tally
    recovery = found.recovery_s
    recovered = (
        f"median {np.median(recovery):.1f} s, longest {max(recovery):.1f} s" if recovery else "–"
    )
    return [
        ("time", f"{found.duration_s:.0f} s of {found.asked_s:.0f} s, seed {found.seed}"),
        ("cycles with SYNC", f"{tally.cycle_count}"),
        ("of them in gait", f"{tally.mode_cycles['gait']}"),
        *(_by_the_wall(found) if found.wall_clock else _simulated(found)),
        ("troubles", f"{len(found.happenings)}"),
        ("stops", f"{len(tally.stops)}"),
        ("from a trouble that stopped to gait again", recovered),
        ("time of processor, all three processes", f"{found.cpu_s:.0f} s"),
        ("starts", ", ".join(f"{name} {count}" for name, count in found.start_count.items())),
        ("setpoints of floods", f"{found.flooded_count}"),
    ]


def _simulated(found: Soaked) -> list[tuple[str, str]]:
    ratio = found.duration_s / found.wall_s
    return [("time of the computer", f"{found.wall_s:.0f} s: {ratio:.1f} × real time")]


def _by_the_wall(found: Soaked) -> list[tuple[str, str]]:
    names = ("median", "90 %", "99 %", "99.9 %", "99.99 %", "worst")
    late = zip(names, quantiles_us(found.tally.lateness_us), strict=False)
    work = quantiles_us(found.tally.work_us)
    return [
        ("SYNC late, µs", ", ".join(f"{name} {value:.0f}" for name, value in late)),
        ("work of a cycle, µs", f"median {work[0]:.0f}, 99.9 % {work[3]:.0f}" if work else "–"),
        ("core's scheduling", "SCHED_FIFO" if found.realtime else "SCHED_OTHER (FIFO refused)"),
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
    told = [(name, " / ".join(map(str, astuple(lost)))) for name, lost in rows]
    return [*told, ("records that this program missed", str(found.record_lost_count))]


def _stop_counts(found: Soaked) -> Counter[str]:
    stops = found.tally.stops
    return Counter(f"{stop.judged.value}: {stop.category} {stop.cause}" for stop in stops)


def _counted(counts: Counter[str]) -> list[tuple[str, str]]:
    return [(name, str(count)) for name, count in counts.most_common()] or [("none", "0")]


def _memory(found: Soaked) -> list[tuple[str, str]]:
    return [
        (
            f"gaitd {life.name}, for {life.duration_s:.0f} s, computing {life.cpu_ratio:.1%} of it",
            f"{life.start_mb:.1f}, {life.warm_mb:.1f}, {life.end_mb:.1f}; {_growth(life)}; "
            f"{life.ring_mb:.0f}",
        )
        for life in found.lives
    ]


def _growth(life: Life) -> str:
    growth = life.growth_mb_per_h
    return "too short a life" if growth is None else f"{growth:+.2f}"


# --- the page -------------------------------------------------------------------------------------

_HOW: Final = """\
Real processes on a simulated bus: `gaitd sim`, `gaitd core`, `gaitd gateway`, {in_time}. The leg
walks; every few seconds something goes wrong, drawn from a seed
(`gaitd_lab/soak/fault_generator.py`); an operator resets, enables and asks for gait again, over
Zenoh as `gaitd reset` does. Processes are killed in the first fifth only, so that memory is told of
processes that live on.

A stop is *expected* if the fault matrix ([fault_matrix.md](fault_matrix.md)) names its cause for
what went wrong. Every other stop is *unexpected*, whatever the computer did meanwhile, and fails
the soak."""
_SIMULATED: Final = "in simulated time as fast as it passes"
_BY_THE_WALL: Final = "by the computer's clock"


def page(found: Soaked, command: str, figure: str) -> str:
    """Return docs/soak.md."""
    today = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    machine = f"{platform.machine()}, {found.processors} processors, Python"
    blocks = [
        *_blocks(found),
        ("What went wrong", _counted(Counter(one.name for _, one in found.happenings))),
    ]
    return markdown.page(
        "# The soak",
        f"Written by `{command}` on {today}; {machine} {platform.python_version()}.",
        _HOW.format(in_time=_BY_THE_WALL if found.wall_clock else _SIMULATED),
        f"![memory and stops]({figure})",
        *(f"## {title}\n\n{markdown.table(('what', 'found'), rows)}" for title, rows in blocks),
    )


def plain(found: Soaked) -> dict[str, Any]:
    """Return the results as plain data for a program."""
    return {
        "seed": found.seed,
        "duration_s": found.duration_s,
        "cycle_count": found.tally.cycle_count,
        "wall_s": found.wall_s,
        "cpu_s": found.cpu_s,
        "lateness_us": dict(
            zip(map(str, QUANTILES), quantiles_us(found.tally.lateness_us), strict=False)
        ),
        "overrun": astuple(found.tally.overrun),
        "missed": {name: astuple(lost) for name, lost in found.tally.missed.items()},
        "troubles": [[time_s, str(one)] for time_s, one in found.happenings],
        "stops": [
            asdict(stop)
            | {"causes": [name_of(cause) for cause in stop.causes], "judged": stop.judged.value}
            for stop in found.tally.stops
        ],
        "memory": [life._asdict() for life in found.lives],
        "exit_codes": found.exit_codes,
        "endings": found.endings,
        "requests": dict(found.outcomes),
        "failures": failures(found),
    }
