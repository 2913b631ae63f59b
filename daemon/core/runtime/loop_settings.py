"""What the loop is given, and how it ends: grid and bus, the seam, whoever watches it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

from daemon.core.runtime.build import Plans
from daemon.core.runtime.state_file import NoteKeeper
from daemon.ipc.record import CycleRecord, Level
from drives.bringup.plan import CycleSettings
from drives.canopen.bus import Bus


class ExitCode(IntEnum):
    """How the process ends."""

    ENDED = 0
    CONFIGURATION = 2
    REFUSED = 3
    BUG = 4


class Seam(Protocol):
    """What the loop needs of the seam: `daemon.ipc.transport.CoreSeam`, or a list in a test."""

    def publish(self, record: CycleRecord) -> object:
        """Hand a record over."""
        ...

    def levels(self) -> list[Level]:
        """All levels that wait."""
        ...

    def take_notices(self) -> list[str]:
        """What people should know of the seam and have not been told yet."""
        ...


class Supervisor(Protocol):
    """What the loop needs of systemd: `daemon.system.sd_notify.Notifier`."""

    def send(self, *lines: str) -> bool:
        """Tell it; false if it could not be told now."""
        ...


class Log(Protocol):
    """What the loop needs of the journal: `daemon.system.journal.Journal`."""

    def tell(self, text: str, priority: int, fields: Mapping[str, str]) -> None:
        """Put in a line; never waits."""
        ...


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """What the loop needs beside the core."""

    plans: Plans
    cycle: CycleSettings
    period_ns: int
    window_ns: int
    heartbeat_cycles: int
    """Our heartbeat goes out with every so many SYNCs."""
    master_node_id: int
    bus_load_ratio: float
    """The worst that can be, as computed."""
    bitrate_bit_per_s: int
    open_bus: Callable[[], Bus]
    notebook: NoteKeeper
