"""What a verification asks of a drive, and what the profile says that it must do.

The option codes decide what a stop must end in (CiA 402-2, 605Ah and 6007h): 5 to 8 of 605Ah hold
in quick stop active, the others end in switch on disabled; 1 of 6007h is a fault, 2 switches off, 3
is a quick stop. Some makers (EPOS4) report a fault after each of them: both ends are allowed, and
the evidence says which one it was.
"""

from enum import StrEnum, auto
from typing import Final

import msgspec

from drives.bringup.plan import DrivePlan
from drives.canopen.objects import Object
from drives.signals import PowerState


class FactCode(StrEnum):
    """What is examined."""

    BRING_UP = auto()
    """Identity, torque base, mapping, limits, option codes, offsets: written and read back."""
    SAMPLES = auto()
    """Share of the SYNCs that both cyclic TPDOs answer inside the window."""
    STATUSWORD_MAPPED = auto()
    """The TPDO's statusword and that of an SDO read, both in 16 bits: bits that differ."""
    POSITION_MAPPED = auto()
    """The TPDO's position less that of an SDO read, counts."""
    ENCODER = auto()
    """Counts of one turn of the motor by hand, over those of the file."""
    ENABLED = auto()
    """Time until operation enabled, s."""
    STANDSTILL = auto()
    """Motion without a commanded torque, motor revolutions."""
    SIGN = auto()
    """Partial correlation of the motion and the commanded torque."""
    EFFORT_SCALE = auto()
    """Measured torque over commanded torque."""
    INERTIA = auto()
    """Inertia that the motion shows over the one that is known."""
    FOLLOWING = auto()
    """Largest distance to the target position, over the following error window."""
    VELOCITY_UNIT = auto()
    """Velocity that the drive shows (606Ch) over that of its positions."""
    QUICK_STOP_STATE = auto()
    QUICK_STOP_WAY = auto()
    """Way to rest over the longest one that is allowed: cycles of the command, and the ramp."""
    SHUTDOWN_STATE = auto()
    DISABLE_VOLTAGE_STATE = auto()
    HEARTBEAT_LOSS_TIME = auto()
    """Time from the last heartbeat of the master until the drive left operation enabled, s."""
    HEARTBEAT_LOSS_STATE = auto()
    HEARTBEAT_LOSS_REST = auto()
    """Time from the last heartbeat to rest, s."""
    HEARTBEAT_LOSS_EMCY = auto()
    """Code of the EMCY."""
    COMMAND_LOSS_TIME = auto()
    """Time from the last command until the drive left operation enabled, s."""
    COMMAND_LOSS_STATE = auto()
    FAULT_RESET = auto()
    """Power state after a fault reset."""
    ERROR_CLEARED = auto()
    """Error register after it."""
    COMPLETED = auto()
    """Why it ended early."""


class Judgement(StrEnum):
    """Result of a fact."""

    PASSED = auto()
    FAILED = auto()
    NOT_MEASURED = auto()


class Fact(msgspec.Struct, frozen=True):
    """One fact: a number inside its bounds, or a name among those that are allowed."""

    code: FactCode
    judgement: Judgement
    found: float | str | None = None
    """None: not measured."""
    bounds: tuple[float, float] | None = None
    """Lowest and highest number; None where a name is allowed."""
    allowed: tuple[str, ...] = ()


def number(code: FactCode, found: float | None, low: float, high: float) -> Fact:
    """Judge a number; None is not measured."""
    judged = Judgement.NOT_MEASURED
    if found is not None:
        judged = Judgement.PASSED if low <= found <= high else Judgement.FAILED
    return Fact(code, judged, found, (low, high))


def named(code: FactCode, found: str | None, *allowed: str) -> Fact:
    """Judge a name; None is not measured."""
    judged = Judgement.NOT_MEASURED
    if found is not None:
        judged = Judgement.PASSED if found in allowed else Judgement.FAILED
    return Fact(code, judged, found, allowed=allowed)


_HOLDS: Final = range(5, 9)
_ON_THE_RAMP: Final = frozenset((2, 6))


def written(plan: DrivePlan, index: int) -> int | None:
    """The option code that bring-up writes; None: the profile writes none."""
    entries = plan.description.profile.written
    return next((entry.value for entry in entries if entry.index == index), None)


def after_quick_stop(plan: DrivePlan) -> PowerState:
    """The state in which a quick stop ends."""
    code = written(plan, Object.QUICK_STOP)
    holds = code in _HOLDS
    return PowerState.QUICK_STOP_ACTIVE if holds else PowerState.SWITCH_ON_DISABLED


def brakes_on_ramp(plan: DrivePlan) -> bool:
    """True if a quick stop slows down on the ramp of 6085h."""
    return written(plan, Object.QUICK_STOP) in _ON_THE_RAMP


def after_lost_master(plan: DrivePlan) -> tuple[str, ...]:
    """Names of the states in which the loss of heartbeat or commands may end."""
    code = written(plan, Object.ABORT_CONNECTION)
    if code == 1:
        return (PowerState.FAULT.name,)
    end = PowerState.SWITCH_ON_DISABLED if code == 2 else after_quick_stop(plan)
    return end.name, PowerState.FAULT.name
