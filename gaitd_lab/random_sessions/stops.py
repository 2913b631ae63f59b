"""Checks that a stop happens, on every drive, and that a drive commanded off does not stay enabled.

1. Stops apart: when the enable command of one drive ends, that of every other one ends before the
   next SYNC. With one axis alone (homing, sign test) nothing else is enabled.
2. Stop not done: after a stop request to a living core, its records are in no active mode any more
   within HEARD_CYCLES.
3. Enabled still: a drive without an enable command leaves "operation enabled" within the time that
   escalation, and at last its own watchdog over the master, may take.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final

from daemon.ipc.record import CycleRecord
from gaitd_lab.random_sessions.watched_drive import WatchedDrive

RECEIVED_CYCLES: Final = 3
"""Cycles from the stop count to the record of the cycle that has read it."""
STEPS: Final = 3
"""Quick stop, disable voltage, NMT stop: each is given some cycles to take effect."""
OBEY_CYCLES: Final = 6
"""Cycles for one step: limits.toml's three, and two for a late sample on either side."""


@dataclass
class StopWatch:
    """All three rules over one session."""

    enabled_still_s: float
    _apart: dict[int, str] = field(default_factory=dict[int, str])
    """Drives still commanded to enable while another one was stopped since the last SYNC."""
    _received_count: int | None = None
    """Records since the stop request; None: none is pending."""

    def stop_requested(self) -> None:
        """Note that the stop count rises, and a core receives it."""
        if self._received_count is None:
            self._received_count = 0

    def enable_commanded(self, drive: WatchedDrive, *, enable: bool) -> None:
        """Note that a drive's enable command begins or ends."""
        if not enable:
            self._apart.pop(drive.rules.node_id, None)

    def begins(self, others: Iterable[WatchedDrive]) -> None:
        """Note that one drive was stopped; the given drives are the others."""
        self._apart.update({d.rules.node_id: d.rules.name for d in others if d.commanded_enable})

    def sync(self) -> Iterator[tuple[str, str]]:
        """Check rule 1 at a SYNC."""
        if self._apart:
            names = ", ".join(sorted(self._apart.values()))
            yield "stops apart", f"{names} still told to enable at the next SYNC"
            self._apart.clear()

    def receive(self, record: CycleRecord) -> Iterator[tuple[str, str]]:
        """Check rule 2 on a record."""
        if self._received_count is None:
            return
        if not record.mode.active:
            self._received_count = None
            return
        self._received_count += 1
        if self._received_count > RECEIVED_CYCLES:
            yield "stop not done", f"{record.mode} after {self._received_count} cycles"
            self._received_count = None

    def check_truth(
        self, drive: WatchedDrive, now_ns: int, *, enabled: bool
    ) -> Iterator[tuple[str, str]]:
        """Check rule 3 on a drive's true state."""
        told_s = (now_ns - drive.commanded_until_ns) * 1e-9
        late_s = self.enabled_still_s + (1.0 if now_ns < drive.delayed_ns else 0.0)
        if not enabled or drive.commanded_enable or drive.commanded_until_ns < 0:
            drive.late_disable_reported = False
        elif told_s > late_s and not drive.late_disable_reported:
            drive.late_disable_reported = True
            yield "enabled still", f"{drive.rules.name}, {told_s * 1e3:.0f} ms after its last word"

    def core_ended(self) -> None:
        """Clear a pending stop: the core that should execute it has ended."""
        self._received_count = None
        self._apart.clear()
