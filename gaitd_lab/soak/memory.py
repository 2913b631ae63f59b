"""Memory and processor time of processes, from /proc (proc(5)), and the growth of memory."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from scipy.stats import theilslopes

KB_PER_MB: Final = 1024
_KINDS: Final = ("RssAnon", "RssFile", "RssShmem")
TICKS_PER_S: Final = os.sysconf("SC_CLK_TCK")
FIELDS_BEFORE_STATE: Final = 2
UTIME: Final = 14 - FIELDS_BEFORE_STATE - 1
"""Index of field 14 after the command's name, which may contain blanks."""
WARM_UP_RATIO: Final = 0.25
"""Warm-up of a process, in which caches and allocators fill."""
STARTED_S: Final = 5.0
"""Time by which a process has read its files and finished its imports."""
SAMPLES_MIN: Final = 8
LIFE_MIN_S: Final = 600.0
"""Least life of a process for which a growth per hour is calculated."""
S_PER_H: Final = 3600.0


class Sample(NamedTuple):
    """One process at one moment."""

    time_s: float
    pid: int
    rss_mb: float
    """Resident memory (RssAnon and RssFile), without the ring, which core and gateway share."""
    own_mb: float
    """The process' own pages (RssAnon)."""
    ring_mb: float
    """Pages of the ring that the process has accessed (RssShmem)."""
    cpu_s: float
    """User and system time since the process' start."""


def sample(pid: int, time_s: float) -> Sample | None:
    """Sample a process; None if it has ended."""
    place = Path("/proc") / str(pid)
    try:
        status = (place / "status").read_text()
        stat = (place / "stat").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return None
    rows = dict(line.split(":", 1) for line in status.splitlines() if ":" in line)
    if "VmRSS" not in rows:
        return None  # the process has ended, and its exit code was not read yet
    own_mb, file_mb, ring_mb = (int(rows[name].split()[0]) / KB_PER_MB for name in _KINDS)
    fields = stat.rpartition(")")[2].split()
    cpu_s = (int(fields[UTIME]) + int(fields[UTIME + 1])) / TICKS_PER_S
    return Sample(time_s, pid, own_mb + file_mb, own_mb, ring_mb, cpu_s)


class Life(NamedTuple):
    """One process from its first sample to its last."""

    name: str
    pid: int
    duration_s: float
    start_mb: float
    warm_mb: float
    end_mb: float
    most_mb: float
    ring_mb: float
    growth_mb_per_h: float | None
    """Growth of its own pages, after warm-up; None: it did not live long enough."""
    cpu_ratio: float
    """Share of one processor."""


def lives(name: str, samples: Sequence[Sample]) -> list[Life]:
    """Return each process with this name, oldest first."""
    pids = list(dict.fromkeys(one.pid for one in samples))
    return [_life(name, [one for one in samples if one.pid == pid]) for pid in pids]


def _life(name: str, samples: Sequence[Sample]) -> Life:
    first, last = samples[0], samples[-1]
    duration_s = last.time_s - first.time_s
    started_s = first.time_s + STARTED_S
    warm_s = first.time_s + WARM_UP_RATIO * duration_s
    warm = [one for one in samples if one.time_s >= warm_s]
    return Life(
        name=name,
        pid=first.pid,
        duration_s=duration_s,
        start_mb=next((one for one in samples if one.time_s > started_s), last).rss_mb,
        warm_mb=warm[0].rss_mb,
        end_mb=last.rss_mb,
        most_mb=max(one.rss_mb for one in samples),
        ring_mb=last.ring_mb,
        growth_mb_per_h=growth_mb_per_h(warm) if duration_s >= LIFE_MIN_S else None,
        cpu_ratio=(last.cpu_s - first.cpu_s) / duration_s if duration_s else 0.0,
    )


def growth_mb_per_h(samples: Sequence[Sample]) -> float | None:
    """Median of the slopes between any two samples of a process' own pages (Theil and Sen).

    A steady growth, even in many small steps, shows between most samples. A single step to a level
    that is then kept, as by the first backlog of a halted process, is no growth, although a least
    squares line would show one.
    """
    if len(samples) < SAMPLES_MIN:
        return None
    own_mb, time_s = [one.own_mb for one in samples], [one.time_s for one in samples]
    slope: Any = theilslopes(own_mb, time_s)[0]
    return float(slope) * S_PER_H
