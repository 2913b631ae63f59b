"""Evaluation of a soak's records: lateness, lost frames, and each stop with its verdict.

A stop is expected if the row of the active fault names its cause. Without a fault, or with one that
requires no stop, a stop is unexpected; for a stop by the observer its last values are stored.
"""

from array import array
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

from daemon.core.safety.checks import OBSERVER_BAD_MAX_CYCLES
from daemon.ipc.record import Cause, CycleRecord, DriveRecord, Mode, StopCategory
from daemon.wire.names import name_of
from gaitd_lab.soak.fault_generator import ActiveFault
from observer.filter.status import NIS_WINDOW_SAMPLES, Status

HISTORY_CYCLES: Final = NIS_WINDOW_SAMPLES + OBSERVER_BAD_MAX_CYCLES
"""Cycles of observer values kept for a stop by the observer: it keeps the innovations of its
window, and is then unusable for some more cycles before it stops.
"""
OPERATIONAL: Final = 0x05
"""NMT state in which TPDOs come."""
SILENCE_S: Final = 0.35
"""Time without records after which a core is dead or halted."""
WITHOUT_SYNC: Final = frozenset({Mode.OFF, Mode.BRINGING_UP})
NS_PER_US: Final = 1000


class Classification(Enum):
    """Classification of a stop."""

    EXPECTED = "expected"
    UNEXPECTED = "unexpected"
    MISSED = "should have stopped, and did not"


@dataclass(slots=True)
class Stop:
    """One stop, from its first cause to the reset."""

    time_s: float
    mode: str
    category: str
    causes: list[Cause]
    """The first cause and those that followed."""
    drive: str
    detail: str
    happening: str
    judged: Classification
    evidence: str = ""

    @property
    def cause(self) -> str:
        """The first cause."""
        return name_of(self.causes[0])


@dataclass(slots=True)
class Lost:
    """Missing frames, without a fault and during a fault."""

    calm_count: int = 0
    trouble_count: int = 0

    def add(self, count: int, *, trouble: bool) -> None:
        """Count a frame."""
        if trouble:
            self.trouble_count += count
        else:
            self.calm_count += count


@dataclass(slots=True)
class Tally:
    """All counts."""

    cycle_count: int = 0
    mode_cycles: Counter[str] = field(default_factory=Counter[str])
    lateness_us: "array[float]" = field(default_factory=lambda: array("f"))
    work_us: "array[float]" = field(default_factory=lambda: array("f"))
    overrun: Lost = field(default_factory=Lost)
    """Missed grid points."""
    missed: dict[str, Lost] = field(default_factory=dict[str, Lost])
    """Samples missing from their window, by drive."""
    tx_dropped: Lost = field(default_factory=Lost)
    protocol_error: Lost = field(default_factory=Lost)
    stops: list[Stop] = field(default_factory=list[Stop])


class RecordMonitor:
    """Processes every record, in order."""

    def __init__(self) -> None:
        """Start without a record."""
        self.tally = Tally()
        self._recent: deque[CycleRecord] = deque(maxlen=HISTORY_CYCLES)
        self._before: CycleRecord | None = None
        self._received_s = 0.0
        self._silent = True

    @property
    def newest(self) -> CycleRecord | None:
        """Newest record of the running core; None if there is none, or if it sends none."""
        return None if self._silent else self._before

    @property
    def stopped(self) -> bool:
        """True if a verdict is latched."""
        return self._before is not None and self._before.verdict.category > StopCategory.NONE

    @property
    def walks(self) -> bool:
        """True if a gait is running."""
        record = self.newest
        return record is not None and record.mode == Mode.GAIT and record.gait_phase >= 0

    def process(
        self, records: Sequence[CycleRecord], time_s: float, fault: ActiveFault | None
    ) -> None:
        """Process records that were written during `fault`.

        Args:
            records: records since the last call.
            time_s: the present time.
            fault: the active fault.
        """
        self._received_s = time_s if records else self._received_s
        self._silent = time_s - self._received_s > SILENCE_S
        for record in records:
            if record.seq == 1:
                self._before = None
                self._recent.clear()
            self._count(record, trouble=fault is not None)
            self._recent.append(record)
            self._classify(record, time_s, fault)
            self._before = record

    def never_stopped(self, time_s: float, fault: ActiveFault) -> None:
        """Note that a required stop did not happen."""
        self.tally.stops.append(
            Stop(time_s, "gait", "none", [Cause.NONE], "", "", str(fault), Classification.MISSED)
        )

    # --- counting -------------------------------------------------------------------------------

    def _count(self, record: CycleRecord, *, trouble: bool) -> None:
        tally, before = self.tally, self._before
        tally.mode_cycles[record.mode.name.lower()] += 1
        rise = record.timing.overrun_count - (before.timing.overrun_count if before else 0)
        tally.overrun.add(rise, trouble=trouble)
        dropped = record.tx_dropped_count - (before.tx_dropped_count if before else 0)
        tally.tx_dropped.add(max(dropped, 0), trouble=trouble)
        if record.mode in WITHOUT_SYNC:
            return
        tally.cycle_count += 1
        tally.lateness_us.append(record.timing.lateness_ns / NS_PER_US)
        tally.work_us.append(record.timing.work_ns / NS_PER_US)
        for number, drive in enumerate(record.drives):
            lost = tally.missed.setdefault(drive.name, Lost())
            lost.add(missing(drive), trouble=trouble)
            old = before.drives[number] if before and len(before.drives) > number else None
            errors = drive.protocol_error_count - (old.protocol_error_count if old else 0)
            tally.protocol_error.add(max(errors, 0), trouble=trouble)

    # --- stops ----------------------------------------------------------------------------------

    def _classify(self, record: CycleRecord, time_s: float, fault: ActiveFault | None) -> None:
        verdict = record.verdict
        if verdict.category == StopCategory.NONE:
            return
        if not self.stopped:
            mode = self._before.mode if self._before else record.mode
            stop = Stop(
                time_s,
                mode.name.lower(),
                verdict.category.name,
                [verdict.cause],
                verdict.drive,
                verdict.detail,
                str(fault) if fault else "",
                Classification.EXPECTED,
            )
            self._update_classification(stop, fault)
            self.tally.stops.append(stop)
        elif self.tally.stops and verdict.cause != self.tally.stops[-1].causes[-1]:
            stop = self.tally.stops[-1]
            stop.causes.append(verdict.cause)
            self._update_classification(stop, fault)

    def _update_classification(self, stop: Stop, fault: ActiveFault | None) -> None:
        """Classify a stop by its newest cause; an unexpected stop stays unexpected."""
        if fault is not None:
            law = fault.law
            if stop.causes[-1] in law.causes | law.later | law.latches:
                return
        if stop.judged is Classification.EXPECTED:
            stop.judged = Classification.UNEXPECTED
            if stop.causes[-1] == Cause.OBSERVER_INVALID:
                stop.evidence = ", ".join(_observed(self._recent))


def missing(drive: DriveRecord) -> bool:
    """Return whether a sample of a sending drive is missing."""
    return drive.nmt_state == OPERATIONAL and not drive.fresh


def _observed(recent: Sequence[CycleRecord]) -> list[str]:
    """Return the observer's values of each leg before its stop."""
    words: list[str] = []
    for name in [leg.name for leg in recent[-1].legs]:
        legs = [leg for record in recent for leg in record.legs if leg.name == name]
        bits = "|".join(bit.name or "" for bit in Status(legs[-1].status))
        gated = sum(bool(leg.status & Status.GATED) for leg in legs)
        words.append(
            f"{name} said {bits}, mean NIS {legs[-1].mean_nis:.1f}, and had rejected the samples "
            f"of {gated} of {len(legs)} cycles"
        )
    return words
