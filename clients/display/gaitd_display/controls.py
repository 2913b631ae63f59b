"""What a therapist can request now, and for all else why not: a pure function, and its words.

The service decides by itself (`daemon/core/modes/table.py`), and knows more: samples, signs, the
daily test. So a button here may still be refused, and the page says that refusal; but no button is
offered for what the present mode or the inputs exclude. One rule is of this page alone: the drives
are switched off only where the leg is held, because it is then not held any more.
"""

from enum import StrEnum, auto
from typing import Final, NamedTuple

import msgspec
from gaitd_client import Mode, Stage


class Command(StrEnum):
    """Request of a button without arguments."""

    ENABLE = auto()
    HOLD = auto()
    HAND_GUIDING = auto()
    SELF_TEST = auto()
    DISABLE = auto()
    RESET = auto()


class Does(StrEnum):
    """What a request does now; the page says it on the button."""

    HOLDS_THE_LEG = auto()
    ENDS_WALKING = auto()
    CANCELS_WALKING = auto()
    """The walking is announced, and nothing moves yet."""
    ENDS_ASSIST = auto()
    """Another program adds torque."""
    ENDS_MOTION = auto()
    CARRIES_THE_WEIGHT = auto()
    MOVES_A_LITTLE = auto()
    LETS_GO = auto()
    ENDS_ONE_AXIS = auto()
    """One axis moves alone; the others have no power."""
    LETS_GO_UNTIL_ENABLED = auto()
    CLEARS_THE_STOP = auto()
    """No drive has power: RESET takes nothing from the leg."""


class WhyNot(StrEnum):
    """Why a request is not possible now."""

    UNKNOWN = auto()
    """The trainer is silent, or in a mode of a later version."""
    GETTING_READY = auto()
    DOES_NOT_START = auto()
    """A drive or the bus is missing: the stop says which."""
    STOPPING = auto()
    STOP_FIRST = auto()
    IS_ON = auto()
    IS_OFF = auto()
    IS_HELD = auto()
    NOT_HELD = auto()
    ONE_AXIS = auto()
    NO_STOP = auto()
    HAND_SWITCH = auto()
    EMERGENCY_STOP = auto()
    POSITION = auto()


class Control(msgspec.Struct, frozen=True):
    """One request: either what it does, or why it is not possible."""

    command: Command
    does: Does | None
    why_not: WhyNot | None


class Requestable(NamedTuple):
    """What decides; None: not known."""

    mode: str | None
    stage: str | None = None
    lease_holder: str | None = None
    hand_switch_closed: bool | None = None
    sto_released: bool | None = None
    is_latched: bool = False
    """A stop has a cause that was not reset."""
    has_power: bool = True
    """A drive has power, or may have."""
    knows_position: bool = True
    """Every axis is referenced, as far as is known."""


WALKING: Final = frozenset({Mode.GAIT, Mode.TORQUE})
"""Modes in which the holder of the lease adds torque."""
MOVING: Final = WALKING | {Mode.EXCITE, Mode.HAND_GUIDING, Mode.SELF_TEST}
ONE_AXIS: Final = frozenset({Mode.REFERENCE, Mode.COMMISSION})
NOT_YET: Final = frozenset({Stage.PREPARING, Stage.ANNOUNCING})
EVERYTHING: Final = {
    Mode.OFF: WhyNot.GETTING_READY,
    Mode.BRINGING_UP: WhyNot.GETTING_READY,
    Mode.STOPPING: WhyNot.STOPPING,
}
"""Modes in which nothing can be requested but STOP."""


def controls(now: Requestable) -> tuple[Control, ...]:
    """Return all requests, those that are possible first, else in the order of `Command`."""
    made = [_control(command, _decide(command, now)) for command in Command]
    return tuple(sorted(made, key=lambda control: control.does is None))


def _control(command: Command, decided: Does | WhyNot) -> Control:
    if isinstance(decided, Does):
        return Control(command, decided, None)
    return Control(command, None, decided)


def _decide(command: Command, now: Requestable) -> Does | WhyNot:
    mode = now.mode
    if now.is_latched and mode in {Mode.OFF, Mode.BRINGING_UP}:
        return WhyNot.DOES_NOT_START
    if mode in EVERYTHING:
        return EVERYTHING[Mode(mode)]
    if mode == Mode.FAULT:
        return _reset(now) if command is Command.RESET else WhyNot.STOP_FIRST
    if mode == Mode.READY:
        return _at_rest(command, now)
    if mode == Mode.HOLD and now.stage == Stage.PREPARING and command in WHEN_HELD:
        return WhyNot.GETTING_READY
    if mode == Mode.HOLD:
        return HELD[command]
    if mode in ONE_AXIS:
        return ALONE.get(command, WhyNot.ONE_AXIS)
    if mode in MOVING:
        return _hold(now) if command is Command.HOLD else IN_MOTION[command]
    return WhyNot.UNKNOWN


HELD: Final[dict[Command, Does | WhyNot]] = {
    Command.ENABLE: WhyNot.IS_ON,
    Command.HOLD: WhyNot.IS_HELD,
    Command.HAND_GUIDING: Does.CARRIES_THE_WEIGHT,
    Command.SELF_TEST: Does.MOVES_A_LITTLE,
    Command.DISABLE: Does.LETS_GO,
    Command.RESET: WhyNot.NO_STOP,
}
WHEN_HELD: Final = frozenset({Command.HAND_GUIDING, Command.SELF_TEST})
"""Refused until the drives hold the leg and their load was compared."""
IN_MOTION: Final[dict[Command, WhyNot]] = {
    Command.ENABLE: WhyNot.IS_ON,
    Command.HAND_GUIDING: WhyNot.NOT_HELD,
    Command.SELF_TEST: WhyNot.NOT_HELD,
    Command.DISABLE: WhyNot.NOT_HELD,
    Command.RESET: WhyNot.NO_STOP,
}
ALONE: Final[dict[Command, Does | WhyNot]] = {
    Command.DISABLE: Does.ENDS_ONE_AXIS,
    Command.RESET: WhyNot.NO_STOP,
}


def _at_rest(command: Command, now: Requestable) -> Does | WhyNot:
    if command is Command.RESET:
        return _reset(now) if now.is_latched else WhyNot.NO_STOP
    if command is not Command.ENABLE:
        return WhyNot.IS_OFF
    if not now.knows_position:
        return WhyNot.POSITION
    return _inputs(now) or Does.HOLDS_THE_LEG


def _reset(now: Requestable) -> Does | WhyNot:
    return _inputs(now) or (Does.LETS_GO_UNTIL_ENABLED if now.has_power else Does.CLEARS_THE_STOP)


def _inputs(now: Requestable) -> WhyNot | None:
    """Return which input prevents it; one that is not known is left to the service."""
    if now.sto_released is False:
        return WhyNot.EMERGENCY_STOP
    return WhyNot.HAND_SWITCH if now.hand_switch_closed is False else None


def _hold(now: Requestable) -> Does:
    if now.mode == Mode.GAIT and now.stage in NOT_YET:
        return Does.CANCELS_WALKING
    if now.mode == Mode.GAIT and now.lease_holder is not None:
        return Does.ENDS_ASSIST
    return Does.ENDS_WALKING if now.mode == Mode.GAIT else Does.ENDS_MOTION
