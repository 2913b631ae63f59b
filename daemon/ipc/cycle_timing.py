"""Durations of the parts of a cycle, and overruns: a part of its record (`record.py`)."""

import msgspec
from gaitd_names import CyclePart


class CycleTiming(msgspec.Struct, frozen=True, array_like=True):
    """Durations of one cycle, measured by the loop (of the previous cycle where noted)."""

    lateness_ns: int
    """Delay of SYNC after its grid point."""
    collect_ns: int
    """From SYNC to the last TPDO, or to the end of the window."""
    work_ns: int
    """Python work of the previous cycle: from decoding to records."""
    overrun_count: int
    """Grid points missed since start; skipped, never caught up."""
    answer_ns: int = 0
    """From SYNC to the last TPDO's arrival at this machine, by the kernel's timestamp; 0 if unknown
    (no answer, a bus without timestamps, the wall clock was set meanwhile)."""
    publish_ns: int = 0
    """Duration in the previous cycle: record into the ring, state file, systemd."""
    overrun_by_part: dict[CyclePart, int] = {}
    """`overrun_count` by the part that exceeded its time the most; parts without one are absent."""
