"""Reaction of a drive to a failed connection to the master: 1029h, 6007h, and when it ends.

| code | cause | 1029h | EPOS4-like: fault | Elmo-like, plain CiA 402: error |
|---|---|---|---|---|
| 8120h | controller error-passive | | until NMT reset communication | while it lasts |
| 8130h | heartbeat of a watched node lost | yes | until NMT reset communication | while it lasts |
| 8140h | bus-off; on EPOS4 81FDh | yes | while it lasts | while it lasts |
| 8150h | identifier used by another node | | one of a TPDO; over at once | any; until a reset |
| 8250h | no RPDO in time: 1400h:05 | | while it lasts | while it lasts |
| 8250h | no target in time: 60C2h | | over at once | |

A fault whose cause is gone still needs a fault reset. The reaction by 6007h to a lost connection is
rule 5 of `drive.py`; only an EPOS4 treats a collision as one. 1029h moves the NMT state: 0 from
operational to pre-operational, 1 not at all, 2 to stopped. The EMCY of a bus-off is sent when the
bus is back.

Sources: CiA 301 7.2.7.1 and 7.5.2.28, CiA 402-2 6007h, reactions of EPOS4 as its public firmware
documents list them. CiA 301 does not specify when a collision ends.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

from sim_drives.canopen.dictionary import ObjectDictionary
from sim_drives.canopen.emergency import Errors
from sim_drives.canopen.nmt import NmtState
from sim_drives.canopen.objects import Object
from sim_drives.cia402.drive import Drive
from sim_drives.cia402.personality import Personality

PASSIVE_CODE: Final = 0x8120
HEARTBEAT_LOST_CODE: Final = 0x8130
BUS_OFF_CODE: Final = 0x8140
EPOS4_BUS_OFF_CODE: Final = 0x81FD
COLLISION_CODE: Final = 0x8150
PDO_TIMEOUT_CODE: Final = 0x8250
PRE_OPERATIONAL_ON_ERROR: Final = 0
STOPPED_ON_ERROR: Final = 2
"""1029h:1; the value 1 changes nothing."""


class Failure(NamedTuple):
    """One row of the failure table."""

    moves_nmt_state: bool = False
    until_reset: bool = False
    """Drives on which this failure is a fault."""


FAILURES: Final[Mapping[int, Failure]] = MappingProxyType(
    {
        PASSIVE_CODE: Failure(until_reset=True),
        HEARTBEAT_LOST_CODE: Failure(moves_nmt_state=True, until_reset=True),
        BUS_OFF_CODE: Failure(moves_nmt_state=True),
        EPOS4_BUS_OFF_CODE: Failure(moves_nmt_state=True),
        COLLISION_CODE: Failure(),
        PDO_TIMEOUT_CODE: Failure(),
    }
)


class Connection:
    """The connection failures of one node."""

    def __init__(
        self,
        personality: Personality,
        dictionary: ObjectDictionary,
        drive: Drive,
        errors: Errors,
        state: Callable[[], NmtState],
        enter: Callable[[NmtState], None],
    ) -> None:
        self._is_fault = personality.connection_loss_is_fault
        self._dictionary = dictionary
        self._drive = drive
        self._errors = errors
        self._state = state
        self._enter = enter

    def lost(self, code: int) -> None:
        """Begin a failure; `code` is one of FAILURES."""
        self._drive.connection_lost(code)
        if not FAILURES[code].moves_nmt_state:
            return
        behaviour = self._dictionary.value(Object.ERROR_BEHAVIOUR, 1)
        if behaviour == STOPPED_ON_ERROR:
            self._enter(NmtState.STOPPED)
        elif behaviour == PRE_OPERATIONAL_ON_ERROR and self._state() is NmtState.OPERATIONAL:
            self._enter(NmtState.PRE_OPERATIONAL)

    def back(self, code: int) -> None:
        """End the cause of a failure; on some drives the failure itself does not end with it."""
        if not (self._is_fault and FAILURES[code].until_reset):
            self._errors.cause_gone(code)

    def set_failure(self, code: int, present: bool) -> None:
        """Begin a failure, or end its cause."""
        if present:
            self.lost(code)
        else:
            self.back(code)

    def reset(self) -> None:
        """End every failure: NMT reset communication."""
        for code in FAILURES:
            self._errors.cause_gone(code)

    @property
    def _bus_off_code(self) -> int:
        return EPOS4_BUS_OFF_CODE if self._is_fault else BUS_OFF_CODE

    def bus_off(self) -> None:
        """Begin a bus-off: the CAN controller has left the bus."""
        self.lost(self._bus_off_code)

    def bus_back(self) -> None:
        """End a bus-off: the CAN controller is back and the EMCY can be sent."""
        self._errors.repeat(self._bus_off_code)
        self.back(self._bus_off_code)

    def collision(self, *, of_pdo: bool) -> None:
        """Report that another node has sent a frame with an identifier of this node."""
        if not self._is_fault:
            self._errors.begin(COLLISION_CODE, latched=False)
        elif of_pdo:
            self.lost(COLLISION_CODE)
            self.back(COLLISION_CODE)

    def target_missed(self) -> None:
        """Report that no PDO came in time for the interpolation; the fault is over at once."""
        self.lost(PDO_TIMEOUT_CODE)
        self.back(PDO_TIMEOUT_CODE)
