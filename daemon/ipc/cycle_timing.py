"""Where the time of a cycle goes: a part of its record (`record.py`)."""

from enum import IntEnum

import msgspec


class CyclePart(IntEnum):
    """Where a cycle can lose its time."""

    WAKE_UP = 0
    """Before SYNC: the processor was not given, or what came between two windows took long."""
    WINDOW = 1
    """Listening for the drives' answers."""
    WORK = 2
    """From the samples to the commands on the bus."""
    PUBLISH = 3
    """The record into the ring, the notes, systemd."""


class CycleTiming(msgspec.Struct, frozen=True, array_like=True):
    """Where the time of one cycle went, measured by the loop (the previous cycle's where noted)."""

    lateness_ns: int
    """SYNC sent after its grid point."""
    collect_ns: int
    """From SYNC to the last TPDO, or the window."""
    work_ns: int
    """Python work of the previous cycle: decode to records."""
    overrun_count: int
    """Grid points missed since start; skipped, never caught up."""
    answer_ns: int = 0
    """From SYNC to the last TPDO's arrival at this machine, by the kernel's stamp, whenever we read
    it; 0 where nobody knows (no answer, a bus without stamps, the wall clock was set meanwhile)."""
    publish_ns: int = 0
    """Of the previous cycle: its record into the ring, notes, systemd."""
    overrun_by_part: tuple[int, ...] = (0,) * len(CyclePart)
    """Of `overrun_count`, by the part that took longest beyond what it may."""
