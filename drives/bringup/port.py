"""The interface that bring-up needs: SDO transfers, frames out, and waiting while receiving.

`configurator.py` implements it over any `Bus`: the real one, or one in memory that advances
simulated time during a wait. No call takes longer than one SDO transfer or the requested wait.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Protocol

from drives.canopen.bus import Frame
from drives.canopen.bus_state import BusMonitor
from drives.canopen.nmt import SyncProducer
from drives.signals import NmtState

EMERGENCIES_KEPT: Final = 8


@dataclass(slots=True)
class NodeTraffic:
    """Unrequested traffic of one node since the port was opened; only grows."""

    boot_up_count: int = 0
    heartbeat_count: int = 0
    nmt_state: NmtState = NmtState.UNKNOWN
    emergencies: deque[bytes] = field(default_factory=lambda: deque[bytes](maxlen=EMERGENCIES_KEPT))
    """Raw EMCY data, oldest first."""
    pdo_count: dict[int, int] = field(default_factory=dict[int, int])
    """Number of TPDOs by identifier."""
    pdo_data: dict[int, bytes] = field(default_factory=dict[int, bytes])
    """Data of the newest TPDO by identifier."""
    sdo_repeat_count: int = 0
    """Repeated SDO replies: two nodes answer under one number."""


class DrivePort(Protocol):
    """The master's side of a bus with drives."""

    sync: SyncProducer
    """The only source of SYNC, in bring-up and after it."""
    bus_state: BusMonitor
    foreign_sync_count: int
    """SYNCs from other nodes since the port was opened."""

    def now_ns(self) -> int:
        """Monotonic time in ns."""
        ...

    def send(self, frames: Sequence[Frame]) -> None:
        """Send at once (NMT, SYNC).

        Raises:
            BusError: the bus is down, or does not take the frames.
        """
        ...

    def wait(self, until_ns: int) -> None:
        """Receive until then, or until a frame arrives; traffic is up to date afterwards.

        Raises:
            BusError: the bus is down; BusOff: the controller has left it.
        """
        ...

    def traffic(self, node_id: int) -> NodeTraffic:
        """Return what a node has sent so far; call again after waiting."""
        ...

    def read(self, node_id: int, index: int, sub: int) -> bytes:
        """One SDO upload.

        Raises:
            SdoAborted, SdoTimeout, SdoGarbled: the transfer failed.
            BusError: the bus is down.
        """
        ...

    def write(self, node_id: int, index: int, sub: int, data: bytes) -> None:
        """One SDO download.

        Raises:
            SdoAborted, SdoTimeout, SdoGarbled: the transfer failed.
            BusError: the bus is down.
        """
        ...
