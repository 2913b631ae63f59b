"""What the loop hands to a cycle besides frames and levels."""

from typing import NamedTuple

from daemon.ipc.cycle_timing import CycleTiming
from daemon.ipc.record import BusRecord


class Tick(NamedTuple):
    """What the loop knows about this cycle and no frame says."""

    cycle: int
    sync_ns: int
    """Monotonic time at which SYNC left."""
    sync_utc_ns: int
    dt_s: float
    """True time since the SYNC before."""
    timing: CycleTiming
    late: bool = False
    """Grid points were skipped before this one."""
    overruns_in_a_row: int = 0
    bus_error: str = ""
    tx_dropped_in_a_row: int = 0
    tx_dropped_count: int = 0
    bus_load_ratio: float = 0.0
    bus: BusRecord = BusRecord()
    shutdown: bool = False
    """SIGTERM has come."""
