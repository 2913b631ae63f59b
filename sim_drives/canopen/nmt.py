"""Network management of a slave (CiA 301 7.3.2): states, commands, and services of each state.

Rules:
1. Commands act from every running state; none is illegal.
2. Reset node restarts the device with the parameters saved by 1010h, or the EDS's. Reset
   communication restores only 1000h to 1FFFh and leaves the application running. Both end in one
   boot-up message (heartbeat of state 00h) and pre-operational.
3. A service that the present state does not have is silent: no answer, no error.
"""

from collections.abc import Mapping
from enum import IntEnum, StrEnum
from types import MappingProxyType
from typing import Final

NMT_ID: Final = 0x000
EVERY_NODE: Final = 0


class NmtState(IntEnum):
    """NMT states with their heartbeat values; INITIALISING is the value of the boot-up message."""

    INITIALISING = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


class NmtCommand(IntEnum):
    """First byte of an NMT frame."""

    START = 0x01
    STOP = 0x02
    ENTER_PRE_OPERATIONAL = 0x80
    RESET_NODE = 0x81
    RESET_COMMUNICATION = 0x82


class Service(StrEnum):
    """A service that an NMT state may allow; each frame asks, so it has the hash of its text."""

    SDO = "SDO"
    SYNC = "SYNC"
    EMERGENCY = "emergency"
    PDO = "PDO"


SERVICES: Final[Mapping[NmtState, frozenset[Service]]] = MappingProxyType(
    {
        NmtState.INITIALISING: frozenset(),
        NmtState.STOPPED: frozenset(),
        NmtState.PRE_OPERATIONAL: frozenset({Service.SDO, Service.SYNC, Service.EMERGENCY}),
        NmtState.OPERATIONAL: frozenset(Service),
    }
)
NEXT_STATE: Final[Mapping[NmtCommand, NmtState]] = MappingProxyType(
    {
        NmtCommand.START: NmtState.OPERATIONAL,
        NmtCommand.STOP: NmtState.STOPPED,
        NmtCommand.ENTER_PRE_OPERATIONAL: NmtState.PRE_OPERATIONAL,
        NmtCommand.RESET_NODE: NmtState.INITIALISING,
        NmtCommand.RESET_COMMUNICATION: NmtState.INITIALISING,
    }
)


def command_for(node_id: int, data: bytes) -> NmtCommand | None:
    """Return the command of an NMT frame, if the frame is valid and addresses this node."""
    if len(data) != 2 or data[1] not in (EVERY_NODE, node_id):
        return None
    return NmtCommand(data[0]) if data[0] in set(NmtCommand) else None
