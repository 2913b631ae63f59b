"""The whole plant.toml, and its tables of virtual drives and faults.

The numbers of `[drives.LEG.AXIS]` describe the hardware: encoder, transmission, motor. The service
has its own copy of them in `configs/drives/`; the two may differ on purpose. What the master
writes by SDO is not here.
"""

from enum import Enum
from typing import Annotated, Literal

from msgspec import Meta

from sim_drives.plant.settings import PlantTables, Table


class PersonalityName(Enum):
    """The make that a drive imitates; defined in `personality.py`."""

    EPOS4 = "epos4"
    ELMO_GOLD = "elmo_gold"
    GENERIC = "generic"


class EncoderKind(Enum):
    """What the drive knows about its position after power-on."""

    ABSOLUTE = "absolute"
    INCREMENTAL = "incremental"
    """Counts from zero at the power-on position; referenced only after homing."""


class HomeSwitch(Table, frozen=True):
    """A switch that is on between two positions of the joint, in rad or m."""

    from_si: Annotated[float, Meta(ge=-10, le=10)]
    to_si: Annotated[float, Meta(ge=-10, le=10)]


class PositionLimit(Enum):
    """Reaction of the drive to a position outside 607Dh."""

    CLIP = "clip"
    """A target in cyclic position mode is clipped, and statusword bit 11 is set."""
    FAULT = "fault"
    """A target or an actual position outside is fault 8A82h."""


class LimitSwitch(Enum):
    """Reaction of the drive to the switches at the joint's end stops (60FDh bits 0 and 1)."""

    REPORT = "report"
    FAULT = "fault"
    """Fault 8A80h (negative) or 8A81h (positive)."""


class FaultKind(Enum):
    """Kinds of fault; `rules.py` has the rule of each."""

    LOST_TPDO = "lost_tpdo"
    LATE_TPDO = "late_tpdo"
    TPDO_ALL_ONES = "tpdo_all_ones"
    SILENT = "silent"
    UNPLUGGED = "unplugged"
    BUS_OFF = "bus_off"
    BUS_PASSIVE = "bus_passive"
    EMCY = "emcy"
    EMCY_WARNING = "emcy_warning"
    FROZEN_ENCODER = "frozen_encoder"
    ENCODER_GLITCH = "encoder_glitch"
    REBOOT = "reboot"
    BLOCKED_ROTOR = "blocked_rotor"
    HAND_SWITCH_OPEN = "hand_switch_open"
    LIMIT_SWITCH_ON = "limit_switch_on"
    STO_OPEN = "sto_open"
    WRONG_SIGN = "wrong_sign"
    ENCODER_REVERSED = "encoder_reversed"
    TORQUE_OFFSET = "torque_offset"
    HOME_SWITCH_STUCK = "home_switch_stuck"
    BRAKE_STUCK = "brake_stuck"
    IGNORES_QUICK_STOP = "ignores_quick_stop"
    DEAF = "deaf"
    SLOW_STATE = "slow_state"
    REFUSES_OBJECT = "refuses_object"
    WRONG_IDENTITY = "wrong_identity"


class DriveSettings(Table, frozen=True):
    """One drive: rotary with `offset_rad`, or on a rail with `lead_m` and `offset_m`.

    `build.py` refuses a drive that is neither, and a maximum below its minimum.
    """

    personality: PersonalityName
    node_id: Annotated[int, Meta(ge=1, le=127)]
    eds: Annotated[str, Meta(min_length=1)]
    """Path relative to plant.toml."""
    serial_number: Annotated[int, Meta(ge=0, le=0xFFFFFFFF)]
    boot_ms: Annotated[float, Meta(ge=1, le=10_000)]
    """Time from power-on, or NMT reset node, to the boot-up message."""
    encoder: EncoderKind
    counts_per_rev: Annotated[int, Meta(ge=4, le=10_000_000)]
    """Encoder counts per turn of the motor."""
    gear_ratio: Annotated[float, Meta(ge=0.01, le=10_000)]
    sign: Literal[1, -1]
    """+1 when positive counts and positive current move the joint in its positive direction."""
    torque_constant_nm_per_a: Annotated[float, Meta(ge=1e-3, le=100)]
    """True torque constant of the motor; 3001h:05 is the value configured in the drive."""
    nominal_current_a: Annotated[float, Meta(ge=0.01, le=200)]
    current_limit_a: Annotated[float, Meta(ge=0.01, le=500)]
    position_limit: PositionLimit
    limit_switch: LimitSwitch
    tpdo_delay_min_ms: Annotated[float, Meta(ge=0, le=10)]
    tpdo_delay_max_ms: Annotated[float, Meta(ge=0, le=10)]
    """A synchronous TPDO is sent this long after its SYNC, drawn from the seed."""
    tpdo_shuffled: bool
    """TPDOs of one SYNC are sent in any order instead of by number."""
    homes: bool = False
    """An absolute encoder can be homed, too, which moves its zero until power is lost."""
    homing_time_s: Annotated[float, Meta(ge=0.1, le=3600)] = 60.0
    """A homing that has not ended after this time has failed."""
    home_switch: HomeSwitch | None = None
    lead_m: Annotated[float, Meta(ge=5e-4, le=2)] | None = None
    """Travel per turn after the gear; makes the axis a linear one."""
    offset_rad: Annotated[float, Meta(ge=-10, le=10)] | None = None
    offset_m: Annotated[float, Meta(ge=-10, le=10)] | None = None
    """Joint position at count 0 of an absolute encoder."""


class LegDrives(Table, frozen=True):
    """The two drives of one leg."""

    hip: DriveSettings
    slide: DriveSettings


class FaultSettings(Table, frozen=True):
    """One `[[fault]]`: kind, drive, time and duration."""

    at_s: Annotated[float, Meta(ge=0, le=1e6)]
    """Time since the virtual drives' start."""
    drive: Annotated[str, Meta(pattern=r"^(\*|(right|left)/(hip|slide))\Z")]
    """LEG/AXIS, or * for every drive."""
    kind: FaultKind
    duration_s: Annotated[float, Meta(ge=0.001, le=1e6)] | None = None
    """Until cleared by command, if absent. A reboot and a glitch without one are over at once."""
    value: Annotated[float, Meta(ge=-0x80000000, le=0xFFFFFFFF)] = 0.0
    """Value of the fault, depending on its kind: error code, TPDO number, delay in ms, counts."""


class PlantFile(PlantTables, frozen=True, kw_only=True):
    """plant.toml."""

    drives: Annotated[dict[Literal["right", "left"], LegDrives], Meta(min_length=1)]
    fault: tuple[FaultSettings, ...] = ()
