"""The drive profile (`configs/drives/profiles/*.toml`), and both files of a drive joined.

A profile holds a manufacturer's facts: which object holds the torque, in which unit, which one
limits it, which objects there are, which option codes are written. An axis file (`axis_file.py`)
holds one drive's: node, identity, gear, motor, and what its inputs are wired to. `describe` joins
the two into a `DriveDescription` and refuses contradictions. Numbers are CiA 301/402 indices.

What CiA leaves to the manufacturer must be stated, with `true` or `false`: otherwise a forgotten
object would silently not be written.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Final, NamedTuple

from msgspec import Meta

from drives.canopen.emcy_codes import Codes
from drives.canopen.objects import Object
from drives.cia402.axis_file import AxisFile, check_inputs, check_transmission
from drives.cia402.emergencies import MakerCode, check_emergencies, codes_of
from drives.cia402.homing import HomingObjects, check_homing, check_homing_objects
from drives.cia402.option_codes import WrittenObject, check_written, holds_after_quick_stop
from drives.cia402.sources import Source, check_sources, open_facts
from drives.cia402.torque import (
    ObjectRef,
    RatedTorqueUnit,
    Table,
    TorqueBase,
    TorqueObject,
    TorqueSource,
    Word,
    check_bases,
)
from drives.errors import DescriptionError

BASE_TOLERANCE_RATIO: Final = 0.01
"""How far the torque base of a drive may deviate from its file (canopen.md 4.3)."""

Unsigned32 = Annotated[int, Meta(ge=0, le=0xFFFFFFFF)]


class SpeedUnit(Enum):
    """The unit of 6080h."""

    RPM = "rpm"
    COUNTS_PER_S = "counts_per_s"
    TENTH_COUNTS_PER_S = "tenth_counts_per_s"


class DecelerationUnit(Enum):
    """The unit of 6085h."""

    RPM_PER_S = "rpm_per_s"
    COUNTS_PER_S2 = "counts_per_s2"
    TEN_COUNTS_PER_S2 = "ten_counts_per_s2"


class Temperature(ObjectRef, frozen=True, kw_only=True):
    """The drive's temperature."""

    mapped: bool
    """True: TPDO3 carries it. False: the drive cannot map it, and it is read by SDO."""
    degc_per_count: Annotated[float, Meta(ge=1e-4, le=10)]
    """Degrees of one count."""


class CheckedObject(ObjectRef, frozen=True, kw_only=True):
    """An object that must already hold a value, or the drive's numbers are wrong; never written."""

    value: Word
    """Value that the object must have at bring-up; another one is refused."""
    mask: Unsigned32
    """Bits that are compared."""
    why: Annotated[str, Meta(min_length=5)]
    """Reason, for the message of a refusal."""


class OptionalObjects(Table, frozen=True, kw_only=True):
    """Optional objects that this drive has; all of them are used.

    `gaitd check` lists what the drive therefore does not limit or monitor.
    """

    interpolation_time: bool
    """60C2h: set to our cycle."""
    position_limits: bool
    """607Dh."""
    speed_limit: bool
    """6080h."""
    following_error: bool
    """6065h."""
    halt_option: bool
    """605Dh; then it must be among `written`."""
    polarity: bool
    """607Eh: must read 0 in bits 5 to 7. Signs have one place, `transmission.sign`; a drive that
    inverts position, speed or torque by itself is refused, not corrected."""
    sync_counter: bool
    """1019h: SYNC with a counter."""
    sync_window: bool
    """1007h: synchronous window length."""


class Keeps(Enum):
    """Statement whether a drive itself enforces a limit in a mode."""

    KEPT = "kept"
    NOT_KEPT = "not_kept"
    UNKNOWN = "unknown"
    """Not publicly documented."""


class TorqueMode(Table, frozen=True, kw_only=True):
    """Limits that the drive enforces in cyclic synchronous torque, where CiA 402 names only 6072h.

    Manufacturers differ: Beckhoff's EP7412 limits its speed in cyclic position and velocity only,
    Lenze's i700 and Nanotec's PD4-E in cyclic torque, too.
    """

    speed_limit: Keeps
    """6080h."""
    position_limits: Keeps
    """607Dh."""


class Pdo(Table, frozen=True, kw_only=True):
    """PDO communication parameters that this drive has."""

    count: Annotated[int, Meta(ge=3, le=8)]
    """Number of RPDOs, and of TPDOs; those that the mapping does not use are switched off."""
    rpdo_timeout: bool
    """1400h:05: the drive stops by itself when RPDO1 is missing."""
    error_code: bool
    """603Fh can be mapped into TPDO3; otherwise only EMCY carries the code."""


class Heartbeat(Table, frozen=True, kw_only=True):
    """Heartbeats that this drive monitors."""

    consumer_entries: Annotated[int, Meta(ge=0, le=127)]
    """Entries of 1016h; the first monitors the master, the others are cleared."""


class DriveProfile(Table, frozen=True, kw_only=True):
    """One type of drive."""

    vendor: str
    """Name of the maker, for messages."""
    family: str
    """Drives that this profile is for."""
    verified_on_hardware: bool
    """True only when a recorded bus and the acceptance record of such a drive have shown every
    fact of the profile."""
    sources: tuple[Source, ...]
    """Public documents and files, each with the facts that it states."""
    must_show: tuple[str, ...] = ()
    """Facts that no public document states: `gaitd check` names them."""
    torque_source: TorqueSource
    torque_base: TorqueBase
    torque_limit: TorqueObject
    target_torque: TorqueObject
    """6071h."""
    velocity_unit: SpeedUnit
    """Unit of velocities in the drive, from its manual."""
    deceleration_unit: DecelerationUnit
    """Unit of 6085h, from its manual."""
    temperature: Temperature | None = None
    """Absent: no temperature can be read, and its limit is not monitored."""
    optional_objects: OptionalObjects
    torque_mode: TorqueMode
    pdo: Pdo
    heartbeat: Heartbeat
    fault_reaction_max_ms: Annotated[int, Meta(ge=10, le=5000)]
    """Longest time from a fault until the drive gives no torque; a stop that waits for the fault
    reaction waits no longer."""
    emergencies: tuple[MakerCode, ...] = ()
    """EMCY codes of the maker; those of the standard are known."""
    resume_from_quick_stop: bool
    """Enabling leaves quick stop active by transition 16, so a held load stays held."""
    written: tuple[WrittenObject, ...]
    checked: tuple[CheckedObject, ...] = ()
    inputs_always_zero: Unsigned32
    """Bits of 60FDh that no input of the drive can set: a drive that shows one shows no inputs."""
    referenced_bit: Annotated[int, Meta(ge=8, le=15)] | None = None
    """Statusword bit that means: position referenced to home."""
    homing: HomingObjects | None = None
    """Absent: homing is not supported, or not documented."""

    @property
    def open_facts(self) -> tuple[str, ...]:
        """The facts that no public document states."""
        return open_facts(self, self.sources, self.must_show)

    @property
    def emergency_codes(self) -> Codes:
        """The meaning of each EMCY code of the maker."""
        return codes_of(self.emergencies)

    @property
    def uploaded_temperature(self) -> Temperature | None:
        """The temperature, where no PDO carries it."""
        temperature = self.temperature
        return None if temperature is None or temperature.mapped else temperature

    @property
    def uploaded_in_cycle(self) -> tuple[int, int] | None:
        """Index and sub-index of the object that the service reads by SDO in its cycle."""
        temperature = self.uploaded_temperature
        return None if temperature is None else (temperature.index, temperature.sub)


class BaseObject(NamedTuple):
    """An object that torque numbers refer to, and the value it must hold for this motor."""

    ref: ObjectRef
    what: str
    expected_raw: int


@dataclass(frozen=True, slots=True)
class DriveDescription:
    """All settings of one drive from its files."""

    name: str
    """`LEG/AXIS`, for example `right/hip`."""
    profile: DriveProfile
    axis: AxisFile
    eds: str
    """Path of the EDS, resolved by the loader."""

    @property
    def node_id(self) -> int:
        """CANopen node id."""
        return self.axis.node_id

    @property
    def torque_bases(self) -> tuple[BaseObject, ...]:
        """Objects that bring-up reads and compares before torque values are used."""
        base, motor = self.profile.torque_base, self.axis.motor
        unit = "" if base.rated_torque_unit is None else base.rated_torque_unit.value
        named = (
            (base.rated_torque, f"rated torque in {unit}", motor.rated_torque_raw),
            (base.rated_current, "rated current in milliampere", motor.rated_current_raw),
            (
                base.torque_constant,
                "torque constant in micro_newton_metre per ampere",
                motor.torque_constant_raw,
            ),
        )
        return tuple(
            BaseObject(ref, what, raw)
            for ref, what, raw in named
            if ref is not None and raw is not None
        )


def describe(name: str, profile: DriveProfile, axis: AxisFile, eds: str) -> DriveDescription:
    """Join a profile and an axis file.

    Raises:
        DescriptionError: an impossible value in one of the two, or a contradiction between them.
    """
    for error in contradictions(profile, axis):
        raise error
    return DriveDescription(name, profile, axis, eds)


def contradictions(profile: DriveProfile, axis: AxisFile) -> list[DescriptionError]:
    """Impossible values in a profile or an axis file, and contradictions between them.

    The list has the first error of each kind, and is empty for two files that fit.
    """
    errors: list[DescriptionError] = []
    for check in _CHECKS:
        try:
            check(profile, axis)
        except DescriptionError as error:
            errors.append(error)
    return errors


def _check_torque_objects(profile: DriveProfile) -> None:
    target = profile.target_torque
    is_target = target.index == Object.TARGET_TORQUE and target.sub == 0 and target.signed
    if not is_target or target.bits < 16:
        allowed = "6071h:00, signed, of 16 or 32 bits: CiA 402 defines no other target"
        raise DescriptionError("profile", "target_torque", target.place, allowed)
    objects = {
        "torque_source": profile.torque_source,
        "torque_limit": profile.torque_limit,
        "target_torque": target,
    }
    for key, why in (
        ("torque_source", "it shows what was commanded, not what the motor gives"),
        ("torque_limit", "a command limits nothing"),
    ):
        if objects[key].index == Object.TARGET_TORQUE:
            allowed = f"another object than the target torque: {why}"
            raise DescriptionError("profile", key, objects[key].place, allowed)
    check_bases(objects, profile.torque_base)


def _check_silence_detection(profile: DriveProfile) -> None:
    if profile.heartbeat.consumer_entries == 0 and not profile.pdo.rpdo_timeout:
        allowed = "at least 1, or pdo.rpdo_timeout: a drive must detect the loss of its master"
        raise DescriptionError("profile", "heartbeat.consumer_entries", 0, allowed)


def _check_resume(profile: DriveProfile) -> None:
    if profile.resume_from_quick_stop and not holds_after_quick_stop(profile.written):
        allowed = "false where 605Ah is below 5: transition 16 needs a drive that holds"
        raise DescriptionError("profile", "resume_from_quick_stop", True, allowed)


def _check_slow_pdo(profile: DriveProfile) -> None:
    mapped = profile.temperature is not None and profile.temperature.mapped
    if not mapped and not profile.pdo.error_code:
        allowed = "true where no temperature is mapped: TPDO3 would be empty"
        raise DescriptionError("profile", "pdo.error_code", False, allowed)


def _check_checked_objects(profile: DriveProfile) -> None:
    for entry in profile.checked:
        if entry.value not in entry.values:
            key = f"checked[{entry.index:04X}h].value"
            raise DescriptionError("profile", key, entry.value, entry.values_in_words)


def _check_linear_motor(profile: DriveProfile, axis: AxisFile) -> None:
    transmission = axis.transmission
    if profile.torque_base.rated_torque_unit is not RatedTorqueUnit.MILLI_NEWTON:
        return
    if transmission.kind != "linear" or transmission.gear_ratio != 1.0:
        allowed = "linear, with gear_ratio = 1: the profile's 6076h is a force"
        raise DescriptionError("axis", "transmission.kind", transmission.kind, allowed)


def _check_motor(profile: DriveProfile, axis: AxisFile) -> None:
    motor = axis.motor
    if motor.current_limit_a < motor.nominal_current_a:
        allowed = f"at least nominal_current_a = {motor.nominal_current_a}"
        raise DescriptionError("axis", "motor.current_limit_a", motor.current_limit_a, allowed)
    if motor.peak_current_a is not None and motor.current_limit_a > motor.peak_current_a:
        allowed = f"at most peak_current_a = {motor.peak_current_a:g}, the motor's own"
        raise DescriptionError("axis", "motor.current_limit_a", motor.current_limit_a, allowed)
    base, expected = profile.torque_base, _expected_raw(profile, axis)
    for name, value, has in (
        ("rated_torque", motor.rated_torque_raw, base.rated_torque is not None),
        ("rated_current", motor.rated_current_raw, base.rated_current is not None),
        ("torque_constant", motor.torque_constant_raw, base.torque_constant is not None),
    ):
        key, should = f"motor.{name}_raw", expected[name]
        if (value is not None) != has:
            allowed = f"the profile has {'a' if has else 'no'} {name} object"
            raise DescriptionError("axis", key, value, allowed)
        if value is not None and abs(value - should) > BASE_TOLERANCE_RATIO * should:
            allowed = f"about {should:.6g}, from torque constant and nominal current"
            raise DescriptionError("axis", key, value, allowed)


def _check_stop_current(_: DriveProfile, axis: AxisFile) -> None:
    limit_a, homing = axis.motor.current_limit_a, axis.homing
    if homing is None or homing.stop_current_a is None or homing.stop_current_a < limit_a:
        return
    allowed = f"below motor.current_limit_a = {limit_a:g}: the motor never gets it, and pushes on"
    raise DescriptionError("axis", "homing.stop_current_a", homing.stop_current_a, allowed)


def _expected_raw(profile: DriveProfile, axis: AxisFile) -> dict[str, float]:
    """Values of the base objects for this motor, as floats in the objects' own units."""
    motor, unit = axis.motor, profile.torque_base.rated_torque_unit
    rated_si = motor.torque_constant_nm_per_a * motor.nominal_current_a
    if unit is RatedTorqueUnit.MILLI_NEWTON:
        rated_si /= axis.transmission.nm_per_n
    return {
        "rated_torque": rated_si / (unit or RatedTorqueUnit.MILLI_NEWTON_METRE).si,
        "rated_current": motor.nominal_current_a * 1e3,
        "torque_constant": motor.torque_constant_nm_per_a * 1e6,
    }


_CHECKS: Final[tuple[Callable[[DriveProfile, AxisFile], None], ...]] = (
    lambda profile, _: check_written(profile.written, halt=profile.optional_objects.halt_option),
    lambda profile, _: _check_torque_objects(profile),
    lambda profile, _: _check_silence_detection(profile),
    lambda profile, _: _check_resume(profile),
    lambda profile, _: _check_slow_pdo(profile),
    lambda profile, _: _check_checked_objects(profile),
    lambda profile, _: check_emergencies(profile.emergencies),
    lambda profile, axis: check_inputs(axis.inputs, profile.inputs_always_zero),
    lambda _, axis: check_transmission(axis.transmission),
    _check_linear_motor,
    _check_motor,
    lambda profile, _: check_homing_objects(profile.homing),
    lambda profile, axis: check_homing(profile.homing, axis.homing),
    _check_stop_current,
    lambda profile, _: check_sources(profile, profile.sources, profile.must_show),
)
