"""The power state machine of a drive (CiA 402-2), as tables. Nothing here moves or keeps state.

Rules:
1. Every transition that a controlword can cause stands in TRANSITIONS, and only there: a command
   without a row for the present state changes nothing. Transitions 0, 1, 12 after a quick stop,
   13 and 14 are automatic; 15 is the fault reset, which is an edge and not a command.
2. A controlword is one command. Conflicting bits are decoded in this order: disable voltage
   (bit 1 low) overrides quick stop (bit 2 low), which overrides the rest. What removes power
   ignores bit 7; what gives power needs bit 7 low.
3. 0Fh in "ready to switch on" is transition 3. Most drives continue with 4 automatically; others
   wait for the next controlword, depending on the personality.
4. 0Fh in "quick stop active" is transition 16 only if option code 605Ah is 5 to 8.
5. A slow-down (605Ah to 605Eh) happens in the state that the transition leaves or enters: in
   "operation enabled" for 5 and 8, in "quick stop active" for 11, in "fault reaction active" for
   13. The state after standstill is STOPPING's column `then`.

    not ready -1-> switch on disabled -2-> ready -3-> switched on -4-> operation enabled
                        ^  ^------------ 7, 10, 9 ------------------------|   | 11
                        |  |----------------------------- 12 ----- quick stop active -16-> enabled
                        15-- fault <-14- fault reaction <-13- any
"""

from collections.abc import Mapping
from enum import Enum, IntEnum, StrEnum
from types import MappingProxyType
from typing import Final, NamedTuple


class PowerState(IntEnum):
    """CiA 402 states; the value is the statusword's bits 0 to 3, 5 and 6, and is or-ed into it."""

    NOT_READY_TO_SWITCH_ON = 0x00
    SWITCH_ON_DISABLED = 0x40
    READY_TO_SWITCH_ON = 0x21
    SWITCHED_ON = 0x23
    OPERATION_ENABLED = 0x27
    QUICK_STOP_ACTIVE = 0x07
    FAULT_REACTION_ACTIVE = 0x0F
    FAULT = 0x08


class Command(StrEnum):
    """Command of a controlword; a key of the table, which text finds faster than an Enum."""

    DISABLE_VOLTAGE = "disable voltage"
    QUICK_STOP = "quick stop"
    SHUTDOWN = "shutdown"
    SWITCH_ON = "switch on, or disable operation"
    ENABLE_OPERATION = "enable operation"


COMMANDS: Final = (
    # mask, value, command: the first match applies
    (0x0002, 0x0000, Command.DISABLE_VOLTAGE),
    (0x0006, 0x0002, Command.QUICK_STOP),
    (0x0007, 0x0006, Command.SHUTDOWN),
    (0x008F, 0x0007, Command.SWITCH_ON),
    (0x008F, 0x000F, Command.ENABLE_OPERATION),
)
FAULT_RESET_BIT: Final = 0x0080
HALT_BIT: Final = 0x0100
OPERATION_BIT_4: Final = 0x0010
"""Bit of the mode: starts homing."""


class Transition(NamedTuple):
    """One transition: CiA 402's number, and the state it ends in."""

    number: int
    target: PowerState


_S = PowerState
_C = Command
TRANSITIONS: Final[Mapping[tuple[PowerState, Command], Transition]] = MappingProxyType(
    {
        (_S.SWITCH_ON_DISABLED, _C.SHUTDOWN): Transition(2, _S.READY_TO_SWITCH_ON),
        (_S.READY_TO_SWITCH_ON, _C.SWITCH_ON): Transition(3, _S.SWITCHED_ON),
        (_S.READY_TO_SWITCH_ON, _C.ENABLE_OPERATION): Transition(3, _S.SWITCHED_ON),
        (_S.READY_TO_SWITCH_ON, _C.QUICK_STOP): Transition(7, _S.SWITCH_ON_DISABLED),
        (_S.READY_TO_SWITCH_ON, _C.DISABLE_VOLTAGE): Transition(7, _S.SWITCH_ON_DISABLED),
        (_S.SWITCHED_ON, _C.ENABLE_OPERATION): Transition(4, _S.OPERATION_ENABLED),
        (_S.SWITCHED_ON, _C.SHUTDOWN): Transition(6, _S.READY_TO_SWITCH_ON),
        (_S.SWITCHED_ON, _C.QUICK_STOP): Transition(10, _S.SWITCH_ON_DISABLED),
        (_S.SWITCHED_ON, _C.DISABLE_VOLTAGE): Transition(10, _S.SWITCH_ON_DISABLED),
        (_S.OPERATION_ENABLED, _C.SWITCH_ON): Transition(5, _S.SWITCHED_ON),
        (_S.OPERATION_ENABLED, _C.SHUTDOWN): Transition(8, _S.READY_TO_SWITCH_ON),
        (_S.OPERATION_ENABLED, _C.DISABLE_VOLTAGE): Transition(9, _S.SWITCH_ON_DISABLED),
        (_S.OPERATION_ENABLED, _C.QUICK_STOP): Transition(11, _S.QUICK_STOP_ACTIVE),
        (_S.QUICK_STOP_ACTIVE, _C.DISABLE_VOLTAGE): Transition(12, _S.SWITCH_ON_DISABLED),
        (_S.QUICK_STOP_ACTIVE, _C.ENABLE_OPERATION): Transition(16, _S.OPERATION_ENABLED),
    }
)
POWER_STAGE_ON: Final = frozenset(
    {_S.OPERATION_ENABLED, _S.QUICK_STOP_ACTIVE, _S.FAULT_REACTION_ACTIVE}
)
"""States in which the motor may carry current."""


MISPLACED: Final = frozenset(
    {
        (_S.SWITCH_ON_DISABLED, _C.SWITCH_ON),
        (_S.SWITCH_ON_DISABLED, _C.ENABLE_OPERATION),
        (_S.QUICK_STOP_ACTIVE, _C.SHUTDOWN),
        (_S.QUICK_STOP_ACTIVE, _C.SWITCH_ON),
    }
)
"""Commands that change no state and request nothing new. In fault states all are ignored."""


class Ramp(Enum):
    """Slow-down of an option code."""

    COAST = "power stage off at once"
    SLOW = "profile deceleration 6084h"
    QUICK = "quick stop deceleration 6085h"
    LIMIT = "as hard as current and voltage allow"


class Stopping(NamedTuple):
    """Meaning of an option code."""

    ramp: Ramp
    stays: bool = False
    """605Ah: the drive stays in "quick stop active" after standstill."""


HALT_OPTION: Final[Mapping[int, Stopping]] = MappingProxyType(
    {
        1: Stopping(Ramp.SLOW),
        2: Stopping(Ramp.QUICK),
        3: Stopping(Ramp.LIMIT),
        4: Stopping(Ramp.LIMIT),
    }
)
"""Values of 605Dh: the drive stays in "operation enabled"."""
FAULT_REACTION_OPTION: Final[Mapping[int, Stopping]] = MappingProxyType(
    {0: Stopping(Ramp.COAST), **HALT_OPTION}
)
"""Values of 605Eh."""
QUICK_STOP_OPTION: Final[Mapping[int, Stopping]] = MappingProxyType(
    {
        **FAULT_REACTION_OPTION,
        5: Stopping(Ramp.SLOW, stays=True),
        6: Stopping(Ramp.QUICK, stays=True),
        7: Stopping(Ramp.LIMIT, stays=True),
        8: Stopping(Ramp.LIMIT, stays=True),
    }
)
"""Values of 605Ah."""
DISABLE_OPTION: Final[Mapping[int, Stopping]] = MappingProxyType(
    {0: Stopping(Ramp.COAST), 1: Stopping(Ramp.SLOW)}
)
"""Values of 605Bh (transition 8) and 605Ch (transition 5)."""


class AbortConnection(IntEnum):
    """Values of 6007h: reaction of the drive to a lost connection."""

    NOTHING = 0
    FAULT = 1
    DISABLE_VOLTAGE = 2
    QUICK_STOP = 3


class StatusBit(IntEnum):
    """Bits of the statusword other than the state's."""

    VOLTAGE_ENABLED = 0x0010
    WARNING = 0x0080
    REMOTE = 0x0200
    TARGET_REACHED = 0x0400
    """At rest after halt or quick stop; homing attained together with bit 12."""
    INTERNAL_LIMIT = 0x0800
    FOLLOWS = 0x1000
    """Cyclic modes: the drive follows the target. Homing: attained."""
    FOLLOWING_ERROR = 0x2000
    """Cyclic position: following error. Homing: error."""
    REFERENCED = 0x8000


def command_of(controlword: int) -> Command | None:
    """Decode a controlword by rule 2; None when it is no command (87h, 8Fh)."""
    for mask, value, command in COMMANDS:
        if controlword & mask == value:
            return command
    return None


def fault_reset_edge(controlword_prev: int, controlword: int) -> bool:
    """Return whether bit 7 has risen."""
    return bool(controlword & ~controlword_prev & FAULT_RESET_BIT)
