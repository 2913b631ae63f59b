"""Memory and processor time of a process, from /proc (proc(5))."""

import os
from pathlib import Path
from typing import Final, NamedTuple

KB_PER_MB: Final = 1024
_KINDS: Final = ("RssAnon", "RssFile", "RssShmem")
TICKS_PER_S: Final = os.sysconf("SC_CLK_TCK")
FIELDS_BEFORE_STATE: Final = 2
UTIME: Final = 14 - FIELDS_BEFORE_STATE - 1
"""Index of field 14 after the command's name, which may contain blanks."""


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
