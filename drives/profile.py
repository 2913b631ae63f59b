"""What the files in `configs/drives/` may say: one profile per kind of drive, one file per axis.

A profile (`profiles/*.toml`) holds the vendor's facts: which object tells the torque, in which
unit, which one limits it, what the input bits mean, which option codes we write. An axis file
(`hip_*.toml`, `slide_*.toml`) holds one drive's: node, identity, gear, motor. `describe` joins the
two into a `DriveDescription` and refuses what cannot be. Numbers are CiA 301/402 indices.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Final, Literal

import msgspec
from msgspec import Meta

from drives.errors import DescriptionError

BASE_TOLERANCE_RATIO: Final = 0.01
"""How far the torque base of a drive may be from what its file says (canopen.md 4.3)."""

Index = Annotated[int, Meta(ge=0x1000, le=0xFFFF)]
Sub = Annotated[int, Meta(ge=0, le=254)]
Bit = Annotated[int, Meta(ge=0, le=31)]
NodeId = Annotated[int, Meta(ge=1, le=127)]
Unsigned32 = Annotated[int, Meta(ge=0, le=0xFFFFFFFF)]


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One table of a file."""


# --- profiles/*.toml ------------------------------------------------------------------------------


class TorqueUnit(Enum):
    """What one count of a torque object means."""

    MILLIAMPERE = "milliampere"
    PERMILLE = "permille_of_rated_torque"


class RatedTorqueUnit(Enum):
    """What one count of 6076h means: CiA 402 says mN·m, EPOS4 means µN·m (a factor of 1000)."""

    MICRO_NEWTON_METRE = "micro_newton_metre"
    MILLI_NEWTON_METRE = "milli_newton_metre"

    @property
    def nm(self) -> float:
        """One count in N·m."""
        return 1e-6 if self is RatedTorqueUnit.MICRO_NEWTON_METRE else 1e-3


class TorqueSampling(Enum):
    """What a torque sample at a SYNC stands for."""

    INSTANT = "instant"
    """The value at the SYNC. In CST the target is constant, so it held for the cycle; in CSP the
    drive's loops change it each millisecond and it is not the cycle's mean."""
    FILTERED = "filtered"
    """Low-passed in the drive: late by the filter's lag."""


class VelocityUnit(Enum):
    """The unit of 6080h (speed) and, per second, of 6085h (deceleration)."""

    RPM = "rpm"
    COUNTS_PER_S = "counts_per_s"


class ObjectRef(Table, frozen=True, kw_only=True):
    """One object of the dictionary, and how wide it is."""

    index: Index
    sub: Sub
    bits: Literal[8, 16, 32]
    signed: bool


class TorqueObject(ObjectRef, frozen=True, kw_only=True):
    """An object that measures or limits torque."""

    unit: TorqueUnit


class TorqueSource(TorqueObject, frozen=True, kw_only=True):
    """The object that says how hard the motor pulls; mapped into TPDO2."""

    sampling: TorqueSampling


class TorqueBase(Table, frozen=True, kw_only=True):
    """The objects that the torque numbers refer to; read at bring-up, compared, never written."""

    rated_torque: ObjectRef
    """6076h: 1000 per mille of 6071h and 6077h."""
    rated_torque_unit: RatedTorqueUnit
    rated_current: ObjectRef
    """mA."""
    torque_constant: ObjectRef | None = None
    """µN·m/A; absent where the drive has none, then the axis file's number counts."""


class Temperature(ObjectRef, frozen=True, kw_only=True):
    """The drive's temperature, mapped into TPDO3."""

    degc_per_count: Annotated[float, Meta(gt=0, le=10)]


class InputBit(Table, frozen=True, kw_only=True):
    """Where an input is in 60FDh, and at which level it means what its name says."""

    bit: Bit
    level: Literal[0, 1]


class Inputs(Table, frozen=True, kw_only=True):
    """60FDh. Hand switch and STO are mandatory; good means: both named conditions hold."""

    hand_switch_closed: InputBit
    sto_released: InputBit
    negative_limit: InputBit | None = None
    positive_limit: InputBit | None = None


class WrittenObject(ObjectRef, frozen=True, kw_only=True):
    """A setting that bring-up writes and reads back, whatever was there."""

    value: int
    legal: Annotated[tuple[int, ...], Meta(min_length=1)]
    """What this drive accepts; `value` must be one of them."""
    why: Annotated[str, Meta(min_length=5)]


class Pdo(Table, frozen=True, kw_only=True):
    """Which PDO communication parameters this drive has."""

    count: Annotated[int, Meta(ge=3, le=8)]
    """RPDOs and TPDOs, of each; what the mapping does not use is switched off."""
    inhibit_time: bool
    """1800h:03."""
    event_timer: bool
    """1800h:05."""
    rpdo_timeout: bool
    """1400h:05: the drive stops by itself when RPDO1 stays away."""


class Heartbeat(Table, frozen=True, kw_only=True):
    """What this drive watches."""

    consumer_entries: Annotated[int, Meta(ge=0, le=127)]
    """Entries of 1016h; the first watches us, the others are cleared."""


class FaultReset(Table, frozen=True, kw_only=True):
    """What a fault reset needs besides the edge of bit 7."""

    communication_reset_first: tuple[Annotated[int, Meta(ge=0, le=0xFFFF)], ...]
    """EMCY codes after which the edge is ignored until NMT reset communication."""


class DriveProfile(Table, frozen=True, kw_only=True):
    """One kind of drive."""

    vendor: str
    family: str
    verified_on_hardware: bool
    provenance: Annotated[str, Meta(min_length=20)]
    """Where the facts of this file come from."""
    torque_source: TorqueSource
    torque_base: TorqueBase
    torque_limit: TorqueObject
    velocity_unit: VelocityUnit
    temperature: Temperature
    inputs: Inputs
    pdo: Pdo
    heartbeat: Heartbeat
    fault_reset: FaultReset
    emergency_table: Literal["standard", "epos4"]
    resume_from_quick_stop: bool
    """Enabling leaves quick stop active by transition 16, so a held load stays held."""
    written: tuple[WrittenObject, ...]
    referenced_bit: Annotated[int, Meta(ge=8, le=15)] | None = None
    """Statusword bit that says: position referenced to home."""


# --- hip_*.toml, slide_*.toml ---------------------------------------------------------------------


class Identity(Table, frozen=True, kw_only=True):
    """1018h."""

    vendor_id: Unsigned32
    product_code: Unsigned32
    revision: Unsigned32
    serial: Unsigned32 | None = None
    """Absent: any drive of this kind will do."""


class Transmission(Table, frozen=True, kw_only=True):
    """From the motor to the joint. Losses are friction's: there is no efficiency factor."""

    kind: Literal["rotary", "linear"]
    gear_ratio: Annotated[float, Meta(gt=0, le=1000)]
    """Motor revolutions per revolution of the joint, or of what drives the slide."""
    lead_m: Annotated[float, Meta(gt=0, le=2)] | None = None
    """Linear: travel per revolution after the gear."""
    sign: Literal[-1, 1]
    """+1: counts grow along the positive axis."""
    counts_per_rev: Annotated[int, Meta(ge=4, le=0x1000000)]
    """Of the motor, all edges counted."""
    offset_rad: Annotated[float, Meta(ge=-10, le=10)] | None = None
    offset_m: Annotated[float, Meta(ge=-10, le=10)] | None = None
    """Joint position at count 0."""


class Encoder(Table, frozen=True, kw_only=True):
    """What position is worth after power-on."""

    absolute: bool


class Motor(Table, frozen=True, kw_only=True):
    """The motor's sheet, and what the drive's base objects must therefore hold."""

    torque_constant_nm_per_a: Annotated[float, Meta(gt=0, le=10)]
    nominal_current_a: Annotated[float, Meta(gt=0, le=200)]
    current_limit_a: Annotated[float, Meta(gt=0, le=400)]
    rated_torque_raw: Annotated[int, Meta(gt=0, le=0xFFFFFFFF)]
    """6076h, in the drive's own unit."""
    rated_current_raw: Annotated[int, Meta(gt=0, le=0xFFFFFFFF)]
    """The profile's rated_current object: mA."""
    torque_constant_raw: Annotated[int, Meta(gt=0, le=0xFFFFFFFF)] | None = None
    """The profile's torque_constant object: µN·m/A; only where the drive has it."""


class AxisFile(Table, frozen=True, kw_only=True):
    """One drive of the machine. Paths are relative to this file."""

    profile: Annotated[str, Meta(min_length=1)]
    eds: Annotated[str, Meta(min_length=1)]
    node_id: NodeId
    identity: Identity
    transmission: Transmission
    encoder: Encoder
    motor: Motor


# --- both together --------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class DriveDescription:
    """Everything that the files say about one drive."""

    name: str
    """`LEG/AXIS`, for example `right/hip`."""
    profile: DriveProfile
    axis: AxisFile
    eds: str
    """Path of the EDS, resolved by the loader."""

    @property
    def node_id(self) -> int:
        """Its CANopen node."""
        return self.axis.node_id


QUICK_STOP_OPTION: Final = (0x605A, 0)
ABORT_CONNECTION_OPTION: Final = (0x6007, 0)
FAULT_REACTION_OPTION: Final = (0x605E, 0)
_NEVER: Final = {
    QUICK_STOP_OPTION: (0, "a quick stop that only switches off lets the leg fall"),
    ABORT_CONNECTION_OPTION: (0, "a drive that goes on without its master moves by itself"),
    FAULT_REACTION_OPTION: (0, "a fault that only switches off lets the leg fall"),
}
"""Option codes that every profile must write, the value none may choose, and why."""


def describe(name: str, profile: DriveProfile, axis: AxisFile, eds: str) -> DriveDescription:
    """Join a profile and an axis file.

    Raises:
        DescriptionError: one of the two says something that cannot be, or they disagree.
    """
    _check_option_codes(profile)
    _check_silence_detection(profile)
    _check_inputs(profile)
    _check_transmission(axis.transmission)
    _check_motor(profile, axis.motor)
    return DriveDescription(name, profile, axis, eds)


def check_nodes(descriptions: Sequence[DriveDescription], master_node_id: int) -> None:
    """Every node on the bus has a number of its own.

    Raises:
        DescriptionError: naming the second drive of a pair.
    """
    taken = {master_node_id: "the master"}
    for description in descriptions:
        owner = taken.setdefault(description.node_id, description.name)
        if owner != description.name:
            free = f"a node id of its own; this one belongs to {owner}"
            raise DescriptionError("axis", "node_id", description.node_id, free)


def _check_option_codes(profile: DriveProfile) -> None:
    written = {(entry.index, entry.sub): entry for entry in profile.written}
    for (index, sub), (forbidden, why) in _NEVER.items():
        entry = written.get((index, sub))
        if entry is None:
            missing = f"{index:04X}h:{sub:02X} must be among them, since {why}"
            raise DescriptionError("profile", "written", sorted(written), missing)
        if entry.value == forbidden:
            key = f"written[{index:04X}h].value"
            raise DescriptionError("profile", key, entry.value, f"not {forbidden}: {why}")
    for entry in profile.written:
        if entry.value not in entry.legal:
            key = f"written[{entry.index:04X}h].value"
            allowed = f"one of {', '.join(map(str, entry.legal))}"
            raise DescriptionError("profile", key, entry.value, allowed)


def _check_silence_detection(profile: DriveProfile) -> None:
    if profile.heartbeat.consumer_entries == 0 and not profile.pdo.rpdo_timeout:
        allowed = "at least 1, or pdo.rpdo_timeout: a drive must notice that its master is gone"
        raise DescriptionError("profile", "heartbeat.consumer_entries", 0, allowed)


def _check_inputs(profile: DriveProfile) -> None:
    inputs = profile.inputs
    bits = [
        entry.bit
        for entry in (
            inputs.hand_switch_closed,
            inputs.sto_released,
            inputs.negative_limit,
            inputs.positive_limit,
        )
        if entry is not None
    ]
    if len(set(bits)) != len(bits):
        raise DescriptionError("profile", "inputs", bits, "a bit of its own for each input")


def _check_transmission(transmission: Transmission) -> None:
    linear = transmission.kind == "linear"
    needs = {
        "lead_m": (transmission.lead_m, linear),
        "offset_m": (transmission.offset_m, linear),
        "offset_rad": (transmission.offset_rad, not linear),
    }
    for key, (value, needed) in needs.items():
        if (value is None) == needed:
            allowed = f"{'needed' if needed else 'must be absent'} for kind = {transmission.kind}"
            raise DescriptionError("axis", f"transmission.{key}", value, allowed)


def _check_motor(profile: DriveProfile, motor: Motor) -> None:
    base = profile.torque_base
    if (base.torque_constant is None) != (motor.torque_constant_raw is None):
        has = "no" if base.torque_constant is None else "a"
        allowed = f"the profile has {has} torque_constant object"
        raise DescriptionError(
            "axis", "motor.torque_constant_raw", motor.torque_constant_raw, allowed
        )
    if motor.current_limit_a < motor.nominal_current_a:
        allowed = f"at least nominal_current_a = {motor.nominal_current_a}"
        raise DescriptionError("axis", "motor.current_limit_a", motor.current_limit_a, allowed)
    torque_nm = motor.torque_constant_nm_per_a * motor.nominal_current_a
    expected = {
        "rated_torque_raw": (motor.rated_torque_raw, torque_nm / base.rated_torque_unit.nm),
        "rated_current_raw": (motor.rated_current_raw, motor.nominal_current_a * 1e3),
        "torque_constant_raw": (motor.torque_constant_raw, motor.torque_constant_nm_per_a * 1e6),
    }
    for key, (value, should) in expected.items():
        if value is not None and abs(value - should) > BASE_TOLERANCE_RATIO * should:
            allowed = f"about {should:.6g}, from torque constant and nominal current"
            raise DescriptionError("axis", f"motor.{key}", value, allowed)
