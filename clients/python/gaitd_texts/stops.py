"""What texts and pages must know of each cause of a stop; its sentences are in the catalogues.

A new cause gets a row here, its category in `daemon/wire/causes.py`, and its sentences: `stop`,
`happened` and, if there is one, `advise` of the patient; `stopped` and, if there is one,
`stop_step` of the operator.
"""

from collections.abc import Mapping
from enum import StrEnum, auto
from typing import Final, NamedTuple

from gaitd_names import Cause


class Situation(StrEnum):
    """State of the leg after a stop: `first` of the operator, `last` of the patient."""

    HELD = auto()
    """The drives hold the leg."""
    LOOSE = auto()
    """The leg may not be held."""
    DANGER = auto()
    """A drive cannot be commanded any more, or cannot be trusted."""
    AT_REST = auto()
    """The machine was not moving, and does not start."""


class GoOn(StrEnum):
    """How to continue after the step of the cause: `go_on` of the operator."""

    ON = auto()
    SLOWER = auto()
    OUT = auto()
    """The leg is led out, and the session ends."""
    ONLY = auto()
    """The step of the cause says all."""


class Again(StrEnum):
    """What to do if the stop comes back: `again` of the operator."""

    TECHNICIAN = auto()
    SUPPORT = auto()
    OPERATOR = auto()
    PHYSICIAN = auto()
    WHO_STOPS = auto()
    HAND_SWITCH = auto()
    EMERGENCY_STOP = auto()
    CURRENT = auto()
    REFERENCE = auto()


class Stop(NamedTuple):
    """One cause."""

    situation: Situation
    go_on: GoOn = GoOn.ON
    again: Again = Again.TECHNICIAN
    step_of: Cause | None = None
    """Another cause that needs the same before the machine is used again; None: its own step."""


STOPS: Final[Mapping[str, Stop]] = {
    Cause.STOP_REQUESTED: Stop(Situation.HELD, GoOn.ON, Again.WHO_STOPS),
    Cause.SHUTDOWN: Stop(Situation.LOOSE, GoOn.ONLY, Again.OPERATOR),
    Cause.GATEWAY_SILENT: Stop(Situation.HELD, GoOn.ON, Again.SUPPORT),
    Cause.CYCLE_OVERRUN: Stop(Situation.HELD, GoOn.ON, Again.SUPPORT),
    Cause.COMMAND_NOT_FINITE: Stop(Situation.HELD, GoOn.OUT, Again.SUPPORT),
    Cause.LAST_END_UNKNOWN: Stop(Situation.LOOSE, GoOn.ON, Again.SUPPORT),
    Cause.HAND_SWITCH_OPEN: Stop(Situation.HELD, GoOn.ON, Again.HAND_SWITCH),
    Cause.STO_ACTIVE: Stop(Situation.LOOSE, GoOn.ON, Again.EMERGENCY_STOP),
    Cause.INPUTS_IMPOSSIBLE: Stop(Situation.HELD),
    Cause.BUS_DOWN: Stop(Situation.DANGER),
    Cause.DRIVE_SILENT: Stop(Situation.DANGER),
    Cause.HEARTBEAT_LOST: Stop(Situation.DANGER, step_of=Cause.DRIVE_SILENT),
    Cause.DRIVE_REBOOTED: Stop(Situation.DANGER),
    Cause.DRIVE_NOT_OPERATIONAL: Stop(Situation.DANGER),
    Cause.DRIVE_FAULT: Stop(Situation.LOOSE),
    Cause.EMERGENCY: Stop(Situation.LOOSE, step_of=Cause.DRIVE_FAULT),
    Cause.DRIVE_LEFT_ENABLED: Stop(Situation.LOOSE),
    Cause.MODE_NOT_SHOWN: Stop(Situation.HELD),
    Cause.NOT_FOLLOWING: Stop(Situation.HELD),
    Cause.BRING_UP_FAILED: Stop(Situation.AT_REST, GoOn.ONLY, Again.OPERATOR),
    Cause.BUS_OFF: Stop(Situation.DANGER),
    Cause.TRANSMIT_QUEUE_FULL: Stop(Situation.DANGER),
    Cause.DRIVE_POWERED: Stop(Situation.HELD, GoOn.ONLY, Again.SUPPORT),
    Cause.UNEXPECTED_ENABLE: Stop(Situation.DANGER, step_of=Cause.DRIVE_NOT_OPERATIONAL),
    Cause.ENCODER_FROZEN: Stop(Situation.LOOSE),
    Cause.ENCODER_JUMP: Stop(Situation.LOOSE, GoOn.ONLY),
    Cause.UNREFERENCED: Stop(Situation.LOOSE, GoOn.ONLY, Again.OPERATOR),
    Cause.SIGN_WRONG: Stop(Situation.DANGER, GoOn.ONLY),
    Cause.EFFORT_DEVIATION: Stop(Situation.HELD, GoOn.ON, Again.CURRENT),
    Cause.MOVED_AGAINST_DRIVE: Stop(Situation.HELD, GoOn.SLOWER, Again.OPERATOR),
    Cause.POSITION_LIMIT: Stop(Situation.HELD, GoOn.ON, Again.REFERENCE),
    Cause.VELOCITY_LIMIT: Stop(Situation.HELD, GoOn.SLOWER, Again.OPERATOR),
    Cause.EFFORT_LIMIT: Stop(Situation.HELD),
    Cause.POWER_LIMIT: Stop(Situation.HELD, GoOn.SLOWER, Again.OPERATOR),
    Cause.TRACKING_LIMIT: Stop(Situation.HELD, GoOn.ON, Again.OPERATOR, step_of=Cause.EFFORT_LIMIT),
    Cause.TEMPERATURE_LIMIT: Stop(Situation.HELD, GoOn.ONLY),
    Cause.SINGULARITY: Stop(Situation.HELD, GoOn.ON, Again.OPERATOR),
    Cause.LIMIT_SWITCH: Stop(Situation.HELD, GoOn.ONLY),
    Cause.ENERGY_LIMIT: Stop(Situation.HELD, GoOn.ON, Again.OPERATOR, step_of=Cause.EFFORT_LIMIT),
    Cause.STOPPING_PATH: Stop(Situation.HELD, GoOn.SLOWER, Again.OPERATOR),
    Cause.OBSERVER_INVALID: Stop(Situation.HELD, GoOn.ON, Again.SUPPORT),
    Cause.STATIC_LOAD_WRONG: Stop(Situation.HELD, GoOn.ONLY, Again.OPERATOR),
    Cause.SPASM: Stop(Situation.HELD, GoOn.ON, Again.PHYSICIAN, step_of=Cause.VELOCITY_LIMIT),
    Cause.SELF_TEST_FAILED: Stop(Situation.HELD, GoOn.ONLY),
    Cause.CLONUS: Stop(Situation.HELD, GoOn.ON, Again.PHYSICIAN),
    Cause.STOP_NOT_OBEYED: Stop(Situation.DANGER, GoOn.ONLY),
}
"""What follows from each cause of a stop: every cause but NONE."""

HOLDING: Final = frozenset({"operation_enabled", "quick_stop_active"})
"""CiA 402 power states in which a drive can hold a leg."""
UNKNOWN: Final = "unknown"
"""Key of the texts of a cause of a later version."""
UNKNOWN_STOP: Final = Stop(Situation.DANGER, GoOn.ONLY, step_of=Cause.OBSERVER_INVALID)
"""A cause of a later version, taken for the gravest."""


def stop_of(cause: str) -> Stop:
    """Return what is known of a cause, also of one that this version does not know."""
    return STOPS.get(cause, UNKNOWN_STOP)


def situation_of(cause: str, *, are_holding: bool) -> Situation:
    """Return the state of the leg after a stop: it is held only where every drive can hold it."""
    situation = stop_of(cause).situation
    is_loose = situation is Situation.HELD and not are_holding
    return Situation.LOOSE if is_loose else situation


def key_of(cause: str) -> str:
    """Return the member of the cause's texts in the catalogues."""
    return str(cause) if cause in STOPS else UNKNOWN
