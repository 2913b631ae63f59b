"""The timing and bus data that the loop passes to a cycle besides frames and gateway states."""

from typing import NamedTuple

from daemon.ipc.cycle_timing import CycleTiming
from daemon.ipc.record import BusRecord


class Tick(NamedTuple):
    """Data of one cycle that the loop measures and that no frame contains."""

    cycle: int
    sync_ns: int
    """Monotonic time at which SYNC was sent."""
    sync_utc_ns: int
    dt_s: float
    """Measured time since the previous SYNC."""
    timing: CycleTiming
    late: bool = False
    """Grid points were skipped directly before this cycle."""
    overruns_in_a_row: int = 0
    bus_error: str = ""
    tx_dropped_in_a_row: int = 0
    tx_dropped_count: int = 0
    bus_load_ratio: float = 0.0
    bus: BusRecord = BusRecord()
    shutdown: bool = False
    """SIGTERM has been received."""
    time_is_simulated: bool = False
