"""Inputs and outputs of this package in the cycle: raw drive numbers with names.

Fields that hold a drive's own numbers end in `_counts`, `_raw` or `_permille`; only `pdo.py`
packs them and only `units.py` converts them. Nothing here knows about legs.
"""

from dataclasses import dataclass
from enum import Enum, IntEnum, IntFlag
from typing import NamedTuple

from drives.canopen.emcy_codes import Reaction


class NmtState(IntEnum):
    """CiA 301 NMT states as the heartbeat carries them; UNKNOWN until the first heartbeat."""

    UNKNOWN = 0xFF
    BOOT_UP = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


class PowerState(IntEnum):
    """CiA 402 power states; UNKNOWN until the first statusword."""

    UNKNOWN = 0
    """No statusword yet, or a pattern that the standard does not define."""
    NOT_READY_TO_SWITCH_ON = 1
    """The drive starts, or tests itself."""
    SWITCH_ON_DISABLED = 2
    """No torque; power may not be switched on yet."""
    READY_TO_SWITCH_ON = 3
    """No torque; power may be switched on."""
    SWITCHED_ON = 4
    """The power stage may be live; no torque yet."""
    OPERATION_ENABLED = 5
    """The drive exerts torque, and follows its target."""
    QUICK_STOP_ACTIVE = 6
    """The drive brakes on its ramp, then holds the axis with torque."""
    FAULT_REACTION_ACTIVE = 7
    """A fault: the drive brakes by itself, for up to `fault_reaction_max_ms`."""
    FAULT = 8
    """A fault: no torque until a reset."""


class OperationMode(IntEnum):
    """Modes of operation, objects 6060h and 6061h."""

    NONE = 0
    HOMING = 6
    CYCLIC_SYNC_POSITION = 8
    CYCLIC_SYNC_TORQUE = 10


class HomingState(Enum):
    """Progress of a drive's own homing (CiA 402-2, statusword in homing mode)."""

    IN_PROGRESS = "in progress"
    NOT_STARTED = "interrupted or not started"
    ATTAINED = "attained, the target not reached yet"
    DONE = "done"
    FAILED_MOVING = "failed, still moving"
    FAILED = "failed, at rest"


class PowerRequest(Enum):
    """Power state that the core requests; `power_state.py` turns it into controlwords."""

    DISABLE_VOLTAGE = "disable_voltage"
    READY = "ready"
    """Powered down but prepared: ready to switch on, no torque."""
    ENABLE = "enable"
    HOME = "home"
    """Enabled and homing: only in mode HOMING, once the drive displays that mode."""
    QUICK_STOP = "quick_stop"
    HALT = "halt"
    """Brake as 605Dh says and hold in operation enabled, for as long as it is requested."""
    FAULT_RESET = "fault_reset"
    """One rising edge of bit 7 for each request, which ends in switch on disabled."""


class Input(IntFlag):
    """The digital inputs in use, after the profile has applied bit numbers and polarity."""

    NONE = 0
    HAND_SWITCH_CLOSED = 1
    STO_RELEASED = 2
    NEGATIVE_LIMIT = 4
    POSITIVE_LIMIT = 8
    IMPOSSIBLE = 16
    """Bits of 60FDh that no wiring can produce: none of the others is known then."""


@dataclass(frozen=True, slots=True)
class Emergency:
    """One EMCY message (CiA 301 7.2.7), decoded."""

    node_id: int
    code: int
    error_register: int
    vendor_bytes: bytes
    text: str
    time_ns: int
    reaction: Reaction = Reaction.UNKNOWN
    """What the drive does by itself."""
    loses_reference: bool = False
    """The encoder position is no longer reliable."""


class DriveFeedback(NamedTuple):
    """State of one drive at the end of this cycle's window."""

    node_id: int
    nmt_state: NmtState
    power_state: PowerState
    statusword: int
    following: bool
    """Statusword bit 12 in a cyclic mode: the drive follows the target."""
    warning: bool
    mode_display: int
    """6061h as received; compare with OperationMode."""
    position_counts: int
    torque_raw: int
    """The profile's torque source: current in mA, torque in per mille, as the profile says."""
    inputs: Input
    temperature_degc: float | None
    fresh: bool
    """Every cyclic TPDO of this cycle arrived inside the window, at its mapped length."""
    sample_age_cycles: int
    """Cycles since the last complete sample; 0 when fresh."""
    late_count: int
    """TPDOs received after their window closed, since bring-up."""
    heartbeat_age_ns: int
    rebooted: bool
    """A boot-up message was received since bring-up: the drive lost its configuration."""
    emergency: Emergency | None
    """The newest EMCY with a code that has not been cleared by code 0000h."""
    emergency_count: int
    protocol_error_count: int
    """Frames of a wrong length or content, which were not used."""
    alarm_count: int = 0
    """The part of `emergency_count` that requires a stop: all but warnings."""
    alarm: Emergency | None = None
    """The newest alarm, also where code 0000h has cleared it since."""
    temperature_overdue: bool = False
    """The drive has a temperature object, and it is not measured any more."""
    error_code: int = 0
    """603Fh of the newest TPDO3; 0 where it cannot be mapped, or an EMCY has told this code."""
    error_text: str = ""
    """Its meaning, by the profile and the standard."""
    reference_lost: bool = False
    """An EMCY since bring-up meant that the encoder position is no longer reliable."""
    news: tuple[tuple[Emergency, bool], ...] = ()
    """The newest EMCYs since the last window, each with True if it repeats an open code."""

    @property
    def fault_code(self) -> int:
        """603Fh of a drive in fault, where no EMCY has told it; else 0."""
        return self.error_code if self.in_fault else 0

    @property
    def in_fault(self) -> bool:
        """True in fault or fault reaction active."""
        return self.power_state in {PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE}


class DriveCommand(NamedTuple):
    """Command to one drive at the end of a cycle; it takes effect at the next SYNC."""

    power: PowerRequest
    mode: OperationMode
    target_position_counts: int
    target_torque_permille: int
