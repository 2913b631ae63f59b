"""Meaning of a drive's torque numbers: objects, units, and the bases that they refer to.

A profile defines one count of three objects: the torque source (mapped into TPDO2), the torque
limit (written and read back), and the target (6071h, in RPDO2). The units:

    milliampere                 k_t · count / 1000                 EPOS4 30D1h:02, 3001h:02
    ampere                      k_t · count                        a vendor's own count, by `factor`
    permille_of_rated_current   k_t · rated current · count / 1000 Elmo 6078h, 6072h
    permille_of_rated_torque    rated torque · count / 1000        CiA 402: 6071h, 6072h, 6077h

each times the object's `factor`: 1 where the object counts in just that unit, 2·I_peak/65520 where
one count is that part of an ampere, 1/√2 where k_t is given per A rms and the count is a peak
value.

The bases (rated torque, rated current, k_t) are objects of the drive where it has them: read at
bring-up, compared with the axis file, never written. Missing ones are taken from the axis file.
"""

from enum import Enum
from typing import Annotated, Final, Literal, NamedTuple

import msgspec
from msgspec import Meta

from drives.errors import DescriptionError

Index = Annotated[int, Meta(ge=0x1000, le=0xFFFF)]
Sub = Annotated[int, Meta(ge=0, le=254)]
Word = Annotated[int, Meta(ge=-0x80000000, le=0xFFFFFFFF)]
"""A value of an object of up to 32 bits, signed or not."""


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One table of a configuration file."""


class TorqueUnit(Enum):
    """Meaning of one count of a torque object, before the object's factor."""

    MILLIAMPERE = "milliampere"
    AMPERE = "ampere"
    PERMILLE_OF_RATED_CURRENT = "permille_of_rated_current"
    PERMILLE_OF_RATED_TORQUE = "permille_of_rated_torque"

    @property
    def is_current(self) -> bool:
        """True for current units, which the torque constant converts to torque."""
        return self is not TorqueUnit.PERMILLE_OF_RATED_TORQUE


class RatedTorqueUnit(Enum):
    """Unit of one count of 6076h: mN·m in CiA 402, µN·m in EPOS4 (a factor of 1000)."""

    MICRO_NEWTON_METRE = "micro_newton_metre"
    MILLI_NEWTON_METRE = "milli_newton_metre"
    MILLI_NEWTON = "milli_newton"
    """For a linear motor: its rated force."""

    @property
    def si(self) -> float:
        """One count in N·m, or in N."""
        return 1e-6 if self is RatedTorqueUnit.MICRO_NEWTON_METRE else 1e-3


class TorqueSampling(Enum):
    """Meaning of a torque sample at a SYNC."""

    INSTANT = "instant"
    """The value at the SYNC. In CST the target is constant, so it held for the cycle; in CSP the
    drive's loops change it each millisecond and it is not the cycle's mean."""
    FILTERED = "filtered"
    """Low-pass filtered in the drive: delayed by the filter's lag."""
    UNKNOWN = "unknown"
    """Not publicly documented; `gaitd check` warns."""


class ObjectRef(Table, frozen=True, kw_only=True):
    """One object of the dictionary and its width."""

    index: Index
    """Index of the object, from the EDS."""
    sub: Sub
    """Subindex."""
    bits: Literal[8, 16, 32]
    """Size of the object."""
    signed: bool
    """Whether the value has a sign."""

    @property
    def place(self) -> str:
        """`6077h:00`."""
        return f"{self.index:04X}h:{self.sub:02X}"

    @property
    def values(self) -> range:
        """All values that the object can hold."""
        half = 1 << (self.bits - 1)
        return range(-half, half) if self.signed else range(2 * half)

    @property
    def values_in_words(self) -> str:
        """`-128 to 127, which 60FFh:00 can hold`."""
        return f"{self.values[0]} to {self.values[-1]}, which {self.place} can hold"


class TorqueObject(ObjectRef, frozen=True, kw_only=True):
    """An object that measures, limits or commands torque."""

    unit: TorqueUnit
    """Unit of one count, from the manual. A wrong one scales every effort; the acceptance record
    measures it."""
    factor: Annotated[float, Meta(ge=1e-9, le=1000)]
    """Number of units per count."""


class TorqueSource(TorqueObject, frozen=True, kw_only=True):
    """The object that measures the motor's torque; mapped into TPDO2."""

    sign: Literal[-1, 1]
    """+1: positive where the motor drives towards higher counts of 6064h, as CiA 402 defines."""
    sampling: TorqueSampling
    """Whether the drive shows the value of the SYNC's instant, a filtered one, or says nothing
    about it."""


class TorqueBase(Table, frozen=True, kw_only=True):
    """Objects that the torque numbers refer to; read at bring-up, compared, never written.

    Objects that are absent here do not exist in the drive: the axis file's motor data replace them.
    """

    rated_torque: ObjectRef | None = None
    """6076h: the base of 1000 per mille in 6071h and 6077h."""
    rated_torque_unit: RatedTorqueUnit | None = None
    """Unit of the rated torque; none: the profile scales by currents."""
    rated_current: ObjectRef | None = None
    """In mA: 6075h, or a vendor-specific object."""
    torque_constant: ObjectRef | None = None
    """In µN·m/A."""


class DriveBase(NamedTuple):
    """The bases of one drive, in SI units at the motor."""

    rated_torque_nm: float
    rated_current_a: float
    torque_constant_nm_per_a: float


_NEEDED: Final = {
    TorqueUnit.MILLIAMPERE: (),
    TorqueUnit.AMPERE: (),
    TorqueUnit.PERMILLE_OF_RATED_CURRENT: ("rated_current",),
    TorqueUnit.PERMILLE_OF_RATED_TORQUE: ("rated_torque",),
}
"""Base objects that a unit requires. k_t alone may come from the motor's data sheet."""


def count_nm(torque: TorqueObject, base: DriveBase) -> float:
    """Torque at the motor per count, N·m."""
    constant_nm_per_a = base.torque_constant_nm_per_a
    unit_nm = {
        TorqueUnit.MILLIAMPERE: 1e-3 * constant_nm_per_a,
        TorqueUnit.AMPERE: constant_nm_per_a,
        TorqueUnit.PERMILLE_OF_RATED_CURRENT: 1e-3 * base.rated_current_a * constant_nm_per_a,
        TorqueUnit.PERMILLE_OF_RATED_TORQUE: 1e-3 * base.rated_torque_nm,
    }
    return torque.factor * unit_nm[torque.unit]


def base_in_words(torque: TorqueObject, base: TorqueBase) -> str:
    """Describe what a count of this object refers to, with the objects that hold it."""
    rated_torque, rated_current = base.rated_torque, base.rated_current
    if not torque.unit.is_current:
        unit = base.rated_torque_unit
        where = "the axis file" if rated_torque is None else rated_torque.place
        return f"rated torque of {where}" + (f" in {unit.value}" if unit else "")
    constant = base.torque_constant
    k_t = "k_t of the axis file" if constant is None else f"k_t of {constant.place}"
    if torque.unit is not TorqueUnit.PERMILLE_OF_RATED_CURRENT:
        return k_t
    where = "the axis file" if rated_current is None else rated_current.place
    return f"rated current of {where} in milliampere, {k_t}"


def check_bases(objects: dict[str, TorqueObject], base: TorqueBase) -> None:
    """Check that every unit has the base object that it refers to.

    Raises:
        DescriptionError: names the missing base, and the object that needs it.
    """
    for key, torque in objects.items():
        for name in _NEEDED[torque.unit]:
            if getattr(base, name) is None:
                allowed = f"the object that {key}.unit = {torque.unit.value} refers to"
                raise DescriptionError("profile", f"torque_base.{name}", None, allowed)
    if (base.rated_torque is None) != (base.rated_torque_unit is None):
        allowed = "given if, and only if, torque_base.rated_torque is"
        raise DescriptionError(
            "profile", "torque_base.rated_torque_unit", base.rated_torque_unit, allowed
        )
