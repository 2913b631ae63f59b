"""The axis file: one drive of the machine (`configs/drives/hip_*.toml`, `slide_*`)."""

import math
from typing import Annotated, Literal

from msgspec import Meta

from drives.cia402.homing import Homing
from drives.cia402.torque import Table
from drives.errors import DescriptionError

NodeId = Annotated[int, Meta(ge=1, le=127)]
Unsigned32 = Annotated[int, Meta(ge=0, le=0xFFFFFFFF)]
Bit = Annotated[int, Meta(ge=0, le=31)]
MotorData = Annotated[int, Meta(ge=1, le=0xFFFFFFFF)]


class Identity(Table, frozen=True, kw_only=True):
    """Identity object 1018h."""

    vendor_id: Unsigned32
    """1018h:01 as `gaitd scan` prints it. Another drive is refused at bring-up."""
    product_code: Unsigned32
    """1018h:02."""
    revision: Unsigned32
    """1018h:03; another firmware may have other objects."""
    serial: Unsigned32 | None = None
    """Absent: any drive of this kind is accepted."""


class Transmission(Table, frozen=True, kw_only=True):
    """From the motor to the joint. Losses belong to friction: there is no efficiency factor."""

    kind: Literal["rotary", "linear"]
    """`rotary` for the hip, `linear` for the slide."""
    gear_ratio: Annotated[float, Meta(ge=0.01, le=1000)]
    """Motor revolutions per revolution of the joint, or of the shaft that drives the slide."""
    lead_m: Annotated[float, Meta(ge=5e-4, le=2)] | None = None
    """Linear: travel per revolution after the gear."""
    sign: Literal[-1, 1]
    """+1: counts grow along the positive axis."""
    counts_per_rev: Annotated[int, Meta(ge=4, le=0x1000000)]
    """Encoder counts per motor revolution, all edges counted."""
    offset_rad: Annotated[float, Meta(ge=-10, le=10)] | None = None
    """Position of the joint where the encoder shows 0; `none`: found by homing or a reference."""
    offset_m: Annotated[float, Meta(ge=-10, le=10)] | None = None
    """Joint position at count 0."""

    @property
    def revs_per_si(self) -> float:
        """Revolutions of the motor per rad or m of the joint."""
        return self.gear_ratio / (self.lead_m or math.tau)

    @property
    def nm_per_n(self) -> float:
        """Motor torque, N·m, per N along a linear joint."""
        return 1.0 / (math.tau * self.revs_per_si)


class Encoder(Table, frozen=True, kw_only=True):
    """Encoder: validity of its position after power-on."""

    absolute: bool
    """True: it keeps its position without power, so the axis can be referenced without homing."""


class Motor(Table, frozen=True, kw_only=True):
    """Data sheet of the motor, and the values that the drive's base objects must therefore hold.

    A linear motor counts as one whose revolution is `lead_m`, with `gear_ratio` 1: its torque
    constant is its force constant in N/A times `lead_m` / 2π.
    """

    torque_constant_nm_per_a: Annotated[float, Meta(ge=1e-3, le=10)]
    """From the motor's data sheet, at its operating temperature. 10 % wrong is 10 % of each
    effort."""
    nominal_current_a: Annotated[float, Meta(ge=0.01, le=200)]
    """Continuous current, from the data sheet, in the drive's own definition (peak or rms)."""
    current_limit_a: Annotated[float, Meta(ge=0.01, le=400)]
    """Largest current that the drive may give; written into it. The limit of effort must fit
    below it."""
    peak_current_a: Annotated[float, Meta(ge=0.01, le=2000)] | None = None
    """The largest current that the data sheet allows; absent: `gaitd check` warns of a limit that
    is far above the nominal current."""
    rated_torque_raw: MotorData | None = None
    """The profile's rated_torque object, in the drive's own unit; only where the drive has it."""
    rated_current_raw: MotorData | None = None
    """The profile's rated_current object: mA; only where the drive has it."""
    torque_constant_raw: MotorData | None = None
    """The profile's torque_constant object: µN·m/A; only where the drive has it."""


class InputBit(Table, frozen=True, kw_only=True):
    """Position of an input in 60FDh, and the level at which its name holds."""

    bit: Bit
    """Bit of 60FDh that shows it."""
    level: Literal[0, 1]
    """Value of the bit while this is true."""


class Inputs(Table, frozen=True, kw_only=True):
    """What the bits of 60FDh are wired to. Hand switch and STO are mandatory.

    Good means that both named conditions hold.
    """

    hand_switch_closed: InputBit
    sto_released: InputBit
    negative_limit: InputBit | None = None
    positive_limit: InputBit | None = None


class AxisFile(Table, frozen=True, kw_only=True):
    """One drive of the machine. Paths are relative to this file."""

    profile: Annotated[str, Meta(min_length=1)]
    """File of the maker's profile, relative to this file."""
    eds: Annotated[str, Meta(min_length=1)]
    """The maker's EDS or DCF file, relative to this file; virtual drives and `gaitd drive
    compare` read it."""
    node_id: NodeId
    """As set in the drive. `gaitd scan` shows those on the bus."""
    identity: Identity
    transmission: Transmission
    encoder: Encoder
    motor: Motor
    inputs: Inputs
    homing: Homing | None = None
    """Absent: this axis cannot be homed."""
    enable_max_ms: Annotated[int, Meta(ge=50, le=2000)] = 250
    """Time from a request to enable until the drive is enabled and follows; a brake that opens or a
    DC link that charges during transition 4 takes longer than the state changes themselves."""


def check_inputs(inputs: Inputs, always_zero: int) -> None:
    """Check that no two inputs have one bit, and that the drive can set each bit.

    Raises:
        DescriptionError: they have, or it cannot.
    """
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
        raise DescriptionError("axis", "inputs", bits, "a different bit for each input")
    if any(always_zero >> bit & 1 for bit in bits):
        allowed = f"bits outside the profile's inputs_always_zero = {always_zero:08X}h"
        raise DescriptionError("axis", "inputs", bits, allowed)


def check_transmission(transmission: Transmission) -> None:
    """Check the keys that a rotary and a linear joint need and must not have.

    Raises:
        DescriptionError: a missing or superfluous key.
    """
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
