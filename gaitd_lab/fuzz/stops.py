"""That a stop happens, to every drive, and that one that is told no more is not enabled any more.

1. Stops apart: when one drive stops being told to enable, every other one does before the next
   SYNC. Of one axis alone (homing, sign test) nothing else is enabled.
2. Stop not done: after a stop was asked of a core that lives, its records are in no active mode
   any more within HEARD_CYCLES.
3. Enabled still: a drive that was told to enable no more leaves "operation enabled" within the time
   that escalation, and at last its own watch over a silent master, may take.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final

from daemon.ipc.record import CycleRecord
from gaitd_lab.fuzz.watched import WatchedDrive

HEARD_CYCLES: Final = 3
"""From the stop count to the record of the cycle that has read it."""
STEPS: Final = 3
"""Quick stop, disable voltage, NMT stop: each has its cycles to be obeyed."""
OBEY_CYCLES: Final = 6
"""For one step: limits.toml's three, and two for a late sample on either side."""


@dataclass
class StopWatch:
    """All three rules over one session."""

    enabled_still_s: float
    _apart: dict[int, str] = field(default_factory=dict[int, str])
    """Drives that are still told to enable while another one was stopped since the last SYNC."""
    _heard_count: int | None = None
    """Records since a stop was asked; None: none is outstanding."""

    def asked(self) -> None:
        """The stop count rises, and a core hears it."""
        if self._heard_count is None:
            self._heard_count = 0

    def told(self, drive: WatchedDrive, *, enable: bool) -> None:
        """A drive is told to enable, or no more."""
        if not enable:
            self._apart.pop(drive.rules.node_id, None)

    def begins(self, others: Iterable[WatchedDrive]) -> None:
        """One drive was stopped; these are others."""
        self._apart.update({d.rules.node_id: d.rules.name for d in others if d.told_to_enable})

    def sync(self) -> Iterator[tuple[str, str]]:
        """A SYNC comes: rule 1."""
        if self._apart:
            names = ", ".join(sorted(self._apart.values()))
            yield "stops apart", f"{names} still told to enable at the next SYNC"
            self._apart.clear()

    def hear(self, record: CycleRecord) -> Iterator[tuple[str, str]]:
        """A record: rule 2."""
        if self._heard_count is None:
            return
        if not record.mode.active:
            self._heard_count = None
            return
        self._heard_count += 1
        if self._heard_count > HEARD_CYCLES:
            yield "stop not done", f"{record.mode.name.lower()} after {self._heard_count} cycles"
            self._heard_count = None

    def see(self, drive: WatchedDrive, now_ns: int, *, enabled: bool) -> Iterator[tuple[str, str]]:
        """A drive as it is: rule 3."""
        told_s = (now_ns - drive.told_until_ns) * 1e-9
        late_s = self.enabled_still_s + (1.0 if now_ns < drive.delayed_ns else 0.0)
        if not enabled or drive.told_to_enable or drive.told_until_ns < 0:
            drive.enabled_still_told = False
        elif told_s > late_s and not drive.enabled_still_told:
            drive.enabled_still_told = True
            yield "enabled still", f"{drive.rules.name}, {told_s * 1e3:.0f} ms after its last word"

    def core_gone(self) -> None:
        """Nobody is there who could hear a stop."""
        self._heard_count = None
        self._apart.clear()
