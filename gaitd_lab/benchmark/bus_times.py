"""Timing of a master on the bus, measured by a listener: SYNC, commands, and reaction to an EMCY.

Times are those at which a frame was sent, by the one clock of this computer: the same for every
master.
"""

from bisect import bisect_right
from collections.abc import Callable, Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np

SYNC: Final = 0x080
PERIOD_US: Final = 10_000
TARGETS: Final = (0x305, 0x306)
"""RPDO2 of hip and slide, the last that a master sends in a cycle."""
ANSWERS: Final = (0x185, 0x186, 0x285, 0x286)
"""TPDO1 and TPDO2 of both drives."""
CONTROLWORDS: Final = (0x205, 0x206)
EMERGENCIES: Final = (0x085, 0x086)
NO_ERROR: Final = b"\0\0"
QUICK_STOP_MASK, QUICK_STOP = 0x86, 0x02
"""Quick stop controlword, CiA 402-2: bit 2 low, bit 1 high, no fault reset."""
STATE_MASK, STOPPING, ENABLED = 0x6F, 0x07, 0x27
"""Statusword: quick stop active, operation enabled."""


class TimedFrame(NamedTuple):
    """A received frame."""

    time_us: float
    can_id: int
    data: bytes


class Syncs(NamedTuple):
    """Intervals between SYNCs, and the frames in each."""

    sync_count: int
    jitter_std_us: float
    """Standard deviation of the interval."""
    jitter_p99_us: float
    """The interval's deviation from 10 ms; 99 % are smaller."""
    jitter_worst_us: float
    answer_median_us: float
    """Time from the last TPDO of a SYNC to the last command."""
    answer_p99_us: float
    without_command_ratio: float
    """Share of cycles in which not every drive got a new target before the next SYNC."""


def syncs(frames: Sequence[TimedFrame]) -> Syncs:
    """Statistics of a period in which both drives were held.

    Raises:
        ValueError: there are no two SYNCs in it.
    """
    starts = [frame.time_us for frame in frames if frame.can_id == SYNC]
    if len(starts) < 3:
        raise ValueError(f"{len(starts)} SYNCs in {len(frames)} frames")
    off_us = np.abs(np.diff(starts) - PERIOD_US)
    answers = [_answer_us(cycle) for cycle in _cycles(frames, starts)]
    given = np.array([value for value in answers if value is not None] or [np.nan])
    return Syncs(
        len(starts),
        float(np.std(np.diff(starts))),
        float(np.quantile(off_us, 0.99)),
        float(off_us.max()),
        float(np.median(given)),
        float(np.quantile(given, 0.99)),
        sum(value is None for value in answers) / len(answers),
    )


def _cycles(frames: Sequence[TimedFrame], starts: Sequence[float]) -> list[list[TimedFrame]]:
    """Group the frames between each SYNC and the next."""
    cycles: list[list[TimedFrame]] = [[] for _ in starts]
    for frame in frames:
        number = bisect_right(starts, frame.time_us) - 1
        if number >= 0 and frame.can_id != SYNC:
            cycles[number].append(frame)
    return cycles[:-1]


def _answer_us(cycle: Iterable[TimedFrame]) -> float | None:
    last = {frame.can_id: frame.time_us for frame in cycle}
    answered = [last[can_id] for can_id in ANSWERS if can_id in last]
    commands = [last.get(can_id) for can_id in TARGETS]
    sent = [time_us for time_us in commands if time_us is not None]
    if len(sent) < len(TARGETS) or not answered:
        return None
    return max(sent) - max(answered)


class Reaction(NamedTuple):
    """Times from an EMCY of one drive to the command and the reaction of the other one."""

    commanded_us: float
    """The controlword commands a quick stop."""
    shown_us: float
    """The statusword shows quick stop active."""


def reaction(frames: Sequence[TimedFrame], failing: int) -> Reaction | None:
    """Return the reaction of the drive other than `failing`; None if it has not stopped.

    An EMCY without an error (0000h) is ignored.
    """
    other = 1 - failing
    begun = _first(frames, 0.0, EMERGENCIES[failing], lambda frame: frame.data[:2] != NO_ERROR)
    if begun is None:
        return None
    commanded = _first(frames, begun, CONTROLWORDS[other], lambda frame: requests_stop(frame.data))
    shown = _first(frames, begun, ANSWERS[other], lambda frame: state(frame) == STOPPING)
    if commanded is None or shown is None:
        return None
    return Reaction(commanded - begun, shown - begun)


def requests_stop(data: bytes) -> bool:
    """Return whether an RPDO1 commands a quick stop, or disable voltage."""
    word = int.from_bytes(data[:2], "little")
    return word & QUICK_STOP_MASK == QUICK_STOP or not word & QUICK_STOP_MASK


def state(frame: TimedFrame) -> int:
    """Return the state of the statusword in a TPDO1."""
    return int.from_bytes(frame.data[:2], "little") & STATE_MASK


def held(frames: Sequence[TimedFrame]) -> bool:
    """Return whether both drives' newest statuswords show operation enabled."""
    newest = {frame.can_id: frame for frame in frames if frame.can_id in ANSWERS[:2]}
    return len(newest) == 2 and all(state(frame) == ENABLED for frame in newest.values())


def _first(
    frames: Sequence[TimedFrame], since_us: float, can_id: int, fits: Callable[[TimedFrame], bool]
) -> float | None:
    """Return the time of the first such frame."""
    for frame in frames:
        if frame.can_id == can_id and frame.time_us >= since_us and fits(frame):
            return frame.time_us
    return None
