"""The CiA 402 power state machine, seen from the master: statusword in, one controlword out.

Rules of this file, all in the two tables below:

1.  One transition at a time. A word is chosen from the state that the drive last *displayed*, never
    from what was sent before; until the drive changes its state, the same word is sent again.
2.  Bit 3 (enable operation) is raised by ENABLE and HOME alone, and only from switched on onwards;
    HALT keeps it where it is already. 0Fh is never sent from switch on disabled or ready to switch
    on, so a drive without the automatic transition 4 works the same as one with it.
3.  QUICK_STOP never energises: from ready to switch on and switched on it is transition 7 or 10
    (to switch on disabled), and only from operation enabled is it transition 11 (the ramp).
4.  Nothing but FAULT_RESET raises bit 7, and one request raises it once: low for at least one
    cycle, high for one, low again until the request ends. It ends in switch on disabled; enabling
    is another request. A persistent fault remains, and there is no second try.
5.  Disable voltage (bit 1 low) beats quick stop (bit 2 low) beats the rest, in the drive.
6.  HOME raises bit 4 in operation enabled only, so a homing starts with an edge that the drive sees
    while it is enabled, and goes on for as long as it is requested. Its progress is bits 10, 12
    and 13 of the statusword (HOMING_STATES), and means something in mode 6 only.
7.  HALT raises bit 8 on top of 0Fh, in operation enabled alone: the drive brakes as 605Dh says and
    holds, and goes on once the request changes. It is a level, sent again every cycle, and causes
    no transition in any other state. It is defined for homing and profile modes: in the cyclic ones
    a vendor may leave the bit unused (Beckhoff EL7411: bits 8 to 15 are reserved in CST, CSV and
    CSP), so no stop depends on it.
8.  An unknown state (no statusword yet, or a bit pattern that the standard does not know) is
    answered with quick stop: it brakes a drive that should be on and energises none that is off.
9.  One ENABLE or HOME leads to operation enabled once. Once that state was displayed, a drive that
    displays any other one gets quick stop for as long as the request goes on: it left by itself,
    and only a new request may enable it again. Where it displays nothing, the word stays 0Fh: no
    other word keeps a drive enabled, and one lost TPDO1 is no reason to stop.

                 +----------------------+  0,1 automatic
                 | not ready (NRTSO)    |-------------+
                 +----------------------+             v
     15 fault reset edge                   +----------------------+
   +-------------------------------------->| switch on disabled   |<--------------------+
   |                                       +----------------------+<---------+          |
   |                                     2 |    ^ 7                          |          |
   |                                       v    |                            | 10       |
   |                                   +----------------------+              |          |
   |                             +---->| ready to switch on   |<--+          |          |
   |                             |     +----------------------+   |          |          |
   |                             |          3 |    ^ 6           |          |          |
   |                             | 8          v    |             |          |     9,12 |
   |                             |     +----------------------+  |          |          |
   |                             |     | switched on          |--+----------+          |
   |                             |     +----------------------+                        |
   |                             |          4 |    ^ 5                                |
   |                             |            v    |                                  |
   |                             |     +----------------------+                        |
   |                             +-----| operation enabled    |------------------------+
   |                                   +----------------------+                        |
   |                                       11 |    ^ 16 (605Ah = 5..8 only)            |
   |                                          v    |                                   |
   |                                   +----------------------+                        |
   |                                   | quick stop active    |------------------------+
   |                                   +----------------------+
   |    +-------+  14 automatic  +-----------------------+  13 from any state
   +----| fault |<---------------| fault reaction active |<---------------
        +-------+                +-----------------------+

Source: CiA 402-2 (state machine, controlword, statusword), as reproduced by the manuals of Toshiba
VF-S15, Kollmorgen AKD and MovingCap; the numbers are the standard's.
"""

from enum import Enum
from typing import Final, NamedTuple

from drives.signals import HomingState, PowerRequest, PowerState

SHUTDOWN: Final = 0x0006
"""Leads to *ready to switch on*: no torque."""
SWITCH_ON: Final = 0x0007
"""Leads to *switched on*: no torque yet."""
ENABLE_OPERATION: Final = 0x000F
"""Leads to *operation enabled*: torque."""
START_HOMING: Final = 0x001F
"""Enable operation with bit 4: in homing mode its rising edge starts, its falling edge
interrupts."""
DISABLE_VOLTAGE: Final = 0x0000
"""Leads to *switch on disabled*: the axis coasts. Bit 1 is low."""
QUICK_STOP: Final = 0x0002
"""An enabled drive brakes on its ramp; another one goes to *switch on disabled*. Bit 2 is low."""
HALT: Final = 0x010F
"""Enable operation with bit 8: brake as 605Dh says, and hold."""
FAULT_RESET: Final = 0x0080
"""Bit 7: its rising edge resets a fault."""

STATUS_WARNING: Final = 0x0080
"""Bit 7: the drive warns, and goes on."""
STATUS_FOLLOWS: Final = 0x1000
"""Bit 12 in the cyclic modes: the drive follows the target; if low, it ignores the target."""

STATUS_TARGET_REACHED: Final = 0x0400
"""Bit 10, read in homing mode alone: the target is reached, or the axis rests."""
STATUS_HOMING_ATTAINED: Final = 0x1000
"""Bit 12 in homing mode: the home is found."""
STATUS_HOMING_ERROR: Final = 0x2000
"""Bit 13 in homing mode: the homing has failed."""

_OFF = PowerState.SWITCH_ON_DISABLED
_READY = PowerState.READY_TO_SWITCH_ON
_ON = PowerState.SWITCHED_ON
_ENABLED = PowerState.OPERATION_ENABLED
_STOPPING = PowerState.QUICK_STOP_ACTIVE
_REACTING = PowerState.FAULT_REACTION_ACTIVE
_FAULT = PowerState.FAULT


CANNOT_EXERT_TORQUE: Final = frozenset(
    {
        PowerState.NOT_READY_TO_SWITCH_ON,
        _OFF,
        _READY,
        _ON,  # the power stage may be live, the drive function is not enabled
        _FAULT,
    }
)
"""States that prove that a drive cannot exert torque. Operation enabled and quick stop active do
exert some; fault reaction active brakes, for as long as the profile says; unknown proves nothing.
"""


POWER_STAGE_OFF: Final = CANNOT_EXERT_TORQUE - {_ON}
"""States that prove that the power stage is off as well."""


class Transition(NamedTuple):
    """One arrow of the figure; `controlword` is None where the drive moves by itself."""

    number: int
    source: PowerState
    target: PowerState
    controlword: int | None
    meaning: str


TRANSITIONS: Final = (
    Transition(1, PowerState.NOT_READY_TO_SWITCH_ON, _OFF, None, "initialised"),
    Transition(2, _OFF, _READY, SHUTDOWN, "shutdown"),
    Transition(3, _READY, _ON, SWITCH_ON, "switch on"),
    Transition(4, _ON, _ENABLED, ENABLE_OPERATION, "enable operation"),
    Transition(5, _ENABLED, _ON, SWITCH_ON, "disable operation"),
    Transition(6, _ON, _READY, SHUTDOWN, "shutdown"),
    Transition(7, _READY, _OFF, QUICK_STOP, "quick stop or disable voltage, no torque"),
    Transition(8, _ENABLED, _READY, SHUTDOWN, "shutdown, by 605Bh"),
    Transition(9, _ENABLED, _OFF, DISABLE_VOLTAGE, "disable voltage, coasts"),
    Transition(10, _ON, _OFF, QUICK_STOP, "quick stop or disable voltage, no torque"),
    Transition(11, _ENABLED, _STOPPING, QUICK_STOP, "quick stop, by 605Ah"),
    Transition(12, _STOPPING, _OFF, DISABLE_VOLTAGE, "disable voltage, or by itself (605Ah 0..4)"),
    Transition(13, _ENABLED, _REACTING, None, "fault, from any state, by 605Eh"),
    Transition(14, _REACTING, _FAULT, None, "reaction over"),
    Transition(15, _FAULT, _OFF, FAULT_RESET, "fault reset, rising edge, once the cause is gone"),
    Transition(16, _STOPPING, _ENABLED, ENABLE_OPERATION, "enable operation, only 605Ah 5..8"),
)
"""Transitions of the standard (0, power on, is not observable)."""

_TO_ENABLED: Final = {
    PowerState.UNKNOWN: QUICK_STOP,
    PowerState.NOT_READY_TO_SWITCH_ON: DISABLE_VOLTAGE,
    _OFF: SHUTDOWN,
    _READY: SWITCH_ON,
    _ON: ENABLE_OPERATION,
    _ENABLED: ENABLE_OPERATION,
    _STOPPING: DISABLE_VOLTAGE,
    _REACTING: DISABLE_VOLTAGE,
    _FAULT: DISABLE_VOLTAGE,
}
_WORDS: Final[dict[PowerRequest, dict[PowerState, int]]] = {
    # Power down, with or without a ramp: from every state by bit 1.
    PowerRequest.DISABLE_VOLTAGE: dict.fromkeys(PowerState, DISABLE_VOLTAGE),
    # Transitions 7, 10, 11; in quick stop active it keeps the drive there.
    PowerRequest.QUICK_STOP: dict.fromkeys(PowerState, QUICK_STOP),
    # Prepared, without torque: 2, 6, 8; from quick stop active only transition 12 leads there.
    PowerRequest.READY: {
        PowerState.UNKNOWN: QUICK_STOP,
        PowerState.NOT_READY_TO_SWITCH_ON: DISABLE_VOLTAGE,
        _OFF: SHUTDOWN,
        _READY: SHUTDOWN,
        _ON: SHUTDOWN,
        _ENABLED: SHUTDOWN,
        _STOPPING: DISABLE_VOLTAGE,
        _REACTING: DISABLE_VOLTAGE,
        _FAULT: DISABLE_VOLTAGE,
    },
    # 2, 3, 4, then held. Quick stop active: see next_word().
    PowerRequest.ENABLE: _TO_ENABLED,
    # As ENABLE; in operation enabled bit 4 is high besides, which starts the homing.
    PowerRequest.HOME: _TO_ENABLED | {_ENABLED: START_HOMING},
    # Bit 8 where the drive is enabled; elsewhere the word that keeps it where it is.
    PowerRequest.HALT: {
        PowerState.UNKNOWN: QUICK_STOP,
        PowerState.NOT_READY_TO_SWITCH_ON: DISABLE_VOLTAGE,
        _OFF: DISABLE_VOLTAGE,
        _READY: SHUTDOWN,
        _ON: SWITCH_ON,
        _ENABLED: HALT,
        _STOPPING: QUICK_STOP,
        _REACTING: DISABLE_VOLTAGE,
        _FAULT: DISABLE_VOLTAGE,
    },
    # Sent besides the one edge: a drive that carries a load keeps braking or holding it.
    PowerRequest.FAULT_RESET: {
        PowerState.UNKNOWN: QUICK_STOP,
        PowerState.NOT_READY_TO_SWITCH_ON: DISABLE_VOLTAGE,
        _OFF: DISABLE_VOLTAGE,
        _READY: DISABLE_VOLTAGE,
        _ON: DISABLE_VOLTAGE,
        _ENABLED: QUICK_STOP,
        _STOPPING: QUICK_STOP,
        _REACTING: DISABLE_VOLTAGE,
        _FAULT: DISABLE_VOLTAGE,
    },
}


_ENABLING: Final = frozenset({PowerRequest.ENABLE, PowerRequest.HOME})


class ResetEdge(Enum):
    """Progress of the one rising edge of the present FAULT_RESET request."""

    IDLE = "idle"
    """No reset is requested."""
    LOWERED = "lowered"
    """Bit 7 has been low for a cycle since the request began."""
    SPENT = "spent"
    """The edge was sent; whatever the drive did, this request raises no other."""


class Sent(NamedTuple):
    """The word to send, and the state that the next call needs."""

    controlword: int = DISABLE_VOLTAGE
    edge: ResetEdge = ResetEdge.IDLE
    was_enabled: bool = False
    """Operation enabled has been displayed during the present ENABLE or HOME."""


def _decode(low_bits: int) -> PowerState:
    if low_bits & 0x4F in _BY_4F:
        return _BY_4F[low_bits & 0x4F]
    return _BY_6F.get(low_bits & 0x6F, PowerState.UNKNOWN)


_BY_4F: Final = {
    0x00: PowerState.NOT_READY_TO_SWITCH_ON,
    0x40: _OFF,
    0x0F: _REACTING,
    0x08: _FAULT,
}
_BY_6F: Final = {0x21: _READY, 0x23: _ON, 0x27: _ENABLED, 0x07: _STOPPING}
_STATE: Final = tuple(_decode(low_bits) for low_bits in range(0x80))


def decode_statusword(statusword: int) -> PowerState:
    """Decode the power state; UNKNOWN for a pattern that the standard does not define.

    Source: CiA 402-2, statusword 6041h: masks 4Fh and 6Fh.
    """
    return _STATE[statusword & 0x7F]


HOMING_STATES: Final[dict[tuple[bool, bool, bool], HomingState]] = {
    # target reached (10), homing attained (12), homing error (13)
    (False, False, False): HomingState.IN_PROGRESS,
    (True, False, False): HomingState.NOT_STARTED,
    (False, True, False): HomingState.ATTAINED,
    (True, True, False): HomingState.DONE,
    (False, False, True): HomingState.FAILED_MOVING,
    (True, False, True): HomingState.FAILED,
    (False, True, True): HomingState.FAILED_MOVING,
    (True, True, True): HomingState.FAILED,
}
"""CiA 402-2, homing mode, statusword; attained with error is reserved: treated as an error."""


def homing_state(statusword: int) -> HomingState:
    """Decode the progress of a homing from a statusword sent in homing mode."""
    bits = (STATUS_TARGET_REACHED, STATUS_HOMING_ATTAINED, STATUS_HOMING_ERROR)
    reached, attained, error = (statusword & bit != 0 for bit in bits)
    return HOMING_STATES[reached, attained, error]


def next_word(state: PowerState, request: PowerRequest, sent: Sent, *, resume: bool) -> Sent:
    """The next controlword on the way from `state` to what is requested.

    Args:
        state: as in the newest statusword.
        request: what the core requests, as a level.
        sent: result of this function in the previous cycle.
        resume: whether an ENABLE that finds a drive in quick stop active leaves it by transition
            16 with continuous torque, which the drive must support (605Ah 5..8); otherwise it goes
            through transition 12.
    """
    if request is PowerRequest.FAULT_RESET:
        return _reset(state, sent)
    if request not in _ENABLING:
        return Sent(_WORDS[request][state])
    if sent.was_enabled and state is not _ENABLED:
        return Sent(_WORDS[PowerRequest.QUICK_STOP][state], was_enabled=True)
    if resume and state is _STOPPING:
        return Sent(ENABLE_OPERATION)
    return Sent(_WORDS[request][state], was_enabled=state is _ENABLED)


def _reset(state: PowerState, sent: Sent) -> Sent:
    word = _WORDS[PowerRequest.FAULT_RESET][state]
    if sent.edge is ResetEdge.IDLE:
        return Sent(word, ResetEdge.LOWERED)
    if sent.edge is ResetEdge.LOWERED and state is _FAULT:
        return Sent(FAULT_RESET, ResetEdge.SPENT)
    return Sent(word, sent.edge)
