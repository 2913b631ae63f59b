"""History of EMCY messages: a bounded number for each drive, published with the drive's state."""

from collections import deque
from typing import Final

from gaitd_client import wire

from daemon.ipc.record import CycleRecord, EmergencyRecord

RING_COUNT: Final = 32


class EmergencyHistory:
    """The newest EMCY messages of every drive since the core's start."""

    def __init__(self) -> None:
        self._rings: dict[str, deque[wire.Emergency]] = {}

    def core_started(self) -> None:
        """Clear the history of the previous core."""
        self._rings.clear()

    def add(self, record: CycleRecord) -> None:
        """Add the EMCY messages of one record."""
        for drive in record.drives:
            for emergency in drive.emergencies:
                ring = self._rings.setdefault(drive.name, deque(maxlen=RING_COUNT))
                ring.append(_message(emergency, record.sync_utc_ns))

    def messages(self, drive: str) -> tuple[wire.Emergency, ...]:
        """The EMCY messages of one drive, oldest first."""
        return tuple(self._rings.get(drive, ()))


def _message(emergency: EmergencyRecord, time_ns: int) -> wire.Emergency:
    return wire.Emergency(
        time_ns=time_ns,
        code=f"0x{emergency.code:04X}",
        text=emergency.text,
        reaction=emergency.reaction,
        alarm=emergency.alarm,
        loses_reference=emergency.loses_reference,
        error_register=f"0x{emergency.error_register:02X}",
        vendor_bytes=emergency.vendor_bytes,
    )
