"""Settings and interfaces of the loop: grid and bus, IPC channel, systemd, journal."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from daemon.core.runtime.build import Plans
from daemon.core.runtime.state_file import StateStore
from drives.bringup.plan import CycleSettings
from drives.canopen.bus import Bus


class Supervisor(Protocol):
    """Interface to systemd: `daemon.system.sd_notify.Notifier`."""

    def send(self, *lines: str) -> bool:
        """Send lines; False if they could not be sent now."""
        ...


class Log(Protocol):
    """Interface to the journal: `daemon.system.journal.Journal`."""

    def write(self, text: str, priority: int, fields: Mapping[str, str]) -> None:
        """Write a line; never waits."""
        ...


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """Settings of the loop."""

    plans: Plans
    cycle: CycleSettings
    period_ns: int
    window_ns: int
    heartbeat_cycles: int
    """Number of SYNCs between two heartbeats of the master."""
    master_node_id: int
    bus_load_ratio: float
    """Computed worst-case bus load."""
    bitrate_bit_per_s: int
    open_bus: Callable[[], Bus]
    state_file: StateStore
