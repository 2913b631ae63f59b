"""What a core's records say of the computer that it runs on: whether it was held up.

On the loopback bus the virtual drives are ordinary processes. Where the computer stands still, SYNC
leaves late, grid points are missed, or the samples of all drives are missing at once; then the
service stops, rightly, and for nothing that anybody did.
"""

from collections.abc import Sequence
from typing import Final

from daemon.core.safety import OBSERVER_BAD_MAX_CYCLES
from daemon.record import CycleRecord, DriveRecord
from observer.status import NIS_WINDOW_SAMPLES

OPERATIONAL: Final = 0x05
"""NMT state in which TPDOs come."""
LATE_NS: Final = 4_000_000
"""A window of the shipped configuration: later, and a cycle's samples can be lost."""
LOOK_BACK_CYCLES: Final = 100
"""Of a stop by what happens now."""
OBSERVER_LOOK_BACK_CYCLES: Final = 100 + NIS_WINDOW_SAMPLES + OBSERVER_BAD_MAX_CYCLES
"""Of a stop by the observer: it remembers the innovations of its window, and is then of no use for
some more cycles before it stops."""


def held_up(records: Sequence[CycleRecord]) -> list[str]:
    """How the computer held these consecutive cycles up, in words; empty if it did not."""
    words: list[str] = []
    late_ns = max((record.timing.lateness_ns for record in records), default=0)
    if late_ns > LATE_NS:
        words.append(f"SYNC {late_ns / 1e6:.1f} ms late")
    overruns = records[-1].timing.overrun_count - records[0].timing.overrun_count if records else 0
    if overruns > 0:
        words.append(f"{overruns} grid points missed")
    all_missing = sum(map(_all_missing, records))
    if all_missing:
        words.append(f"samples of all drives missing at once in {all_missing} cycles")
    return words


def missing(drive: DriveRecord) -> bool:
    """Whether a drive that sends did not."""
    return drive.nmt_state == OPERATIONAL and not drive.fresh


def _all_missing(record: CycleRecord) -> bool:
    return bool(record.drives) and all(missing(drive) for drive in record.drives)
