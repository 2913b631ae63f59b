"""Meaning of each drive's settings at its joint, and the objects behind each number.

For `gaitd check`. The EDS is read here and nowhere else in the service: bring-up reads the drive.
"""

import math
from collections.abc import Iterator
from pathlib import Path

import msgspec
from gaitd_toml import ConfigError, Errors

from daemon.config.bundle import Settings
from daemon.config.drive_plan import cycle_settings, drive_limits, effort_per_motor_nm
from daemon.config.settings import Cycle
from drives.bringup.plan import homing_plan, plan
from drives.cia402.option_codes import in_words, without_torque
from drives.cia402.profile import DriveDescription, Keeps
from drives.cia402.torque import TorqueObject, TorqueSampling, base_in_words, count_nm
from drives.cia402.units import DriveLimits, axis_scaling, expected_base, raw_limits
from drives.errors import DescriptionError
from drives.service import eds

_UNLIMITED = {
    "position_limits": "the drive has no 607Dh: only gaitd keeps its position limits",
    "speed_limit": "6080h is not written: only gaitd keeps its speed limit",
    "following_error": "the drive has no 6065h: it does not monitor its following error",
    "interpolation_time": "the drive has no 60C2h: its interpolation in CSP is unspecified",
}
"""Consequence of a missing optional object, by its key in the profile."""


class TorqueMeaning(msgspec.Struct, frozen=True):
    """Meaning of one count of a torque object."""

    object: str
    bits: int
    signed: bool
    unit: str
    factor: float
    base: str
    """Reference value of the unit, with the objects that hold it."""
    effort_per_count_si: float
    """Effort at the joint, without the sign of the axis."""


class BaseMeaning(msgspec.Struct, frozen=True):
    """A number that the drive must hold, within 1 %."""

    object: str
    what: str
    expected_raw: int


class AxisMeaning(msgspec.Struct, frozen=True):
    """One drive, in the joint's units."""

    name: str
    node_id: int
    drive: str
    verified_on_hardware: bool
    sources: tuple[str, ...]
    """Documents and files, each with the facts of the profile that it states."""
    open_facts: tuple[str, ...]
    """Facts of the profile that no public document states: the drive must show them."""
    rotary: bool
    """True: rad and N m; false: m and N. `_si` is in these units."""
    position_per_count: float
    effort_per_permille: float
    """Effort per permille of 6071h, or per step of the drive's own unit."""
    effort_per_ma: float
    """Effort per mA of motor current."""
    effort_limit_si: float
    """The limit of limits.toml, written into the drive."""
    effort_nominal_si: float
    """At the motor's nominal current: the effort that it can give continuously."""
    effort_drive_limit_si: float
    """At the drive's current limit."""
    torque_source: TorqueMeaning
    torque_sign: int
    torque_sampling: str
    torque_limit: TorqueMeaning
    torque_limit_raw: int
    """The limit as it is written, in the drive's unit."""
    target_torque: TorqueMeaning
    torque_bases: tuple[BaseMeaning, ...]
    gear_ratio: float
    lead_m: float | None
    axis_sign: int
    option_codes: tuple[str, ...]
    """Reactions of the drive that it makes by itself, in words."""
    speed_limit_si_per_s: float
    speed_limit_raw: int | None
    """None where it is not written."""
    position_limits_si: tuple[float, float]
    position_limits_counts: tuple[int, int]
    quick_stop_s: float
    """Time on the ramp from the speed limit to rest."""
    brake: bool
    silence_detection_ms: int
    """Silence after which the drive stops by itself: the shorter of the two below."""
    heartbeat_detection_ms: int | None
    """1016h:01; None where the drive monitors no heartbeat."""
    rpdo_timeout_ms: int | None
    """1400h:05; None where the drive has none."""
    temperature: str | None
    """The object of the temperature; None where the limit is not monitored."""
    warnings: tuple[str, ...]
    objections: tuple[str, ...]
    """Objects that bring-up needs and the drive lacks according to its EDS."""


def axis_meanings(settings: Settings) -> tuple[AxisMeaning, ...]:
    """The meaning of all drives' settings, each leg's hip before its slide.

    Raises:
        ConfigError: an EDS cannot be read.
    """
    return tuple(
        _meaning(settings, drive, file, limits, brake)
        for drive, file, limits, brake in _drives(settings)
    )


def axis_errors(settings: Settings, axes: tuple[AxisMeaning, ...]) -> Errors:
    """Drives whose EDS lacks an object that bring-up needs: the first, and how many there are."""
    for axis, (drive, file, _, _) in zip(axes, _drives(settings), strict=True):
        if axis.objections:
            more = len(axis.objections) - 1
            others = f" (and {more} more objections)" if more else ""
            allowed = (
                f"a drive with all objects that its profile needs: {axis.objections[0]}{others}"
            )
            yield ConfigError(file, "eds", drive.axis.eds, allowed)


def _drives(settings: Settings) -> Iterator[tuple[DriveDescription, Path, DriveLimits, bool]]:
    hip, slide = drive_limits(settings.limits)
    for leg in settings.legs:
        yield leg.hip, leg.hip_file, hip, settings.limits.hip.brake
        yield leg.slide, leg.slide_file, slide, settings.limits.slide.brake


def _meaning(
    settings: Settings, drive: DriveDescription, file: Path, limits: DriveLimits, brake: bool
) -> AxisMeaning:
    profile, axis, cycle = drive.profile, drive.axis, settings.trainer.cycle
    scaling, raw = axis_scaling(drive, expected_base(drive)), raw_limits(limits, drive)
    motor, transmission = axis.motor, axis.transmission
    effort_per_a = motor.torque_constant_nm_per_a * effort_per_motor_nm(drive)
    heartbeat_ms = cycle.drive_detection_ms if profile.heartbeat.consumer_entries else None
    rpdo_ms = cycle.rpdo_timeout_ms if profile.pdo.rpdo_timeout else None
    objections, unused, doubtful = _eds_objections(drive, file, limits, cycle)
    return AxisMeaning(
        name=drive.name,
        node_id=drive.node_id,
        drive=f"{profile.vendor} {profile.family}",
        verified_on_hardware=profile.verified_on_hardware,
        sources=tuple(f"{one.what} states {', '.join(one.states)}" for one in profile.sources),
        open_facts=profile.open_facts,
        rotary=transmission.kind == "rotary",
        position_per_count=1.0 / scaling.counts_per_si,
        effort_per_permille=1.0 / scaling.permille_per_effort_si,
        effort_per_ma=math.copysign(1e-3 * effort_per_a, scaling.counts_per_si),
        effort_limit_si=limits.effort_max_si,
        effort_nominal_si=motor.nominal_current_a * effort_per_a,
        effort_drive_limit_si=motor.current_limit_a * effort_per_a,
        torque_source=_torque(drive, profile.torque_source),
        torque_sign=profile.torque_source.sign,
        torque_sampling=profile.torque_source.sampling.value,
        torque_limit=_torque(drive, profile.torque_limit),
        torque_limit_raw=raw.torque_raw,
        target_torque=_torque(drive, profile.target_torque),
        torque_bases=tuple(
            BaseMeaning(base.ref.place, base.what, base.expected_raw) for base in drive.torque_bases
        ),
        gear_ratio=transmission.gear_ratio,
        lead_m=transmission.lead_m,
        axis_sign=transmission.sign,
        option_codes=tuple(words for entry in profile.written if (words := in_words(entry))),
        speed_limit_si_per_s=limits.velocity_max_si,
        speed_limit_raw=raw.speed_raw if profile.optional_objects.speed_limit else None,
        position_limits_si=(limits.position_min_si, limits.position_max_si),
        position_limits_counts=(raw.position_min_counts, raw.position_max_counts),
        quick_stop_s=limits.velocity_max_si / limits.quick_stop_deceleration_si_per_s2,
        brake=brake,
        silence_detection_ms=min(ms for ms in (heartbeat_ms, rpdo_ms) if ms is not None),
        heartbeat_detection_ms=heartbeat_ms,
        rpdo_timeout_ms=rpdo_ms,
        temperature=None if profile.temperature is None else profile.temperature.place,
        warnings=(*_warnings(drive, brake, unused), *(() if doubtful is None else (doubtful,))),
        objections=objections,
    )


def _torque(drive: DriveDescription, torque: TorqueObject) -> TorqueMeaning:
    nm = count_nm(torque, expected_base(drive))
    return TorqueMeaning(
        object=torque.place,
        bits=torque.bits,
        signed=torque.signed,
        unit=torque.unit.value,
        factor=torque.factor,
        base=base_in_words(torque, drive.profile.torque_base),
        effort_per_count_si=nm * effort_per_motor_nm(drive),
    )


def _eds_objections(
    drive: DriveDescription, file: Path, limits: DriveLimits, cycle: Cycle
) -> tuple[tuple[str, ...], list[str], str | None]:
    """Objections, optional objects of the EDS that the profile does not use, doubtful lines."""
    try:
        sheet = eds.load_eds(drive.eds, drive.node_id)
    except DescriptionError as error:
        raise ConfigError(file, error.key, error.value, error.allowed) from error
    settings = cycle_settings(cycle)
    plans = [plan(drive, limits, settings)]
    if drive.axis.homing is not None:
        plans.append(homing_plan(drive, limits, settings))
    found = [line for one in plans for line in eds.objections(one, sheet)]
    has = drive.profile.optional_objects
    return tuple(dict.fromkeys(found)), eds.unused(has, sheet), eds.doubtful(sheet, found)


_TORQUE_MODE = {
    "speed_limit": (
        "6080h",
        "max_runaway relies on it",
        "max_runaway is computed without it",
    ),
    "position_limits": (
        "607Dh",
        "in that mode possibly only gaitd keeps the position limits",
        "in that mode only gaitd keeps the position limits",
    ),
}
"""Objects and warnings, by the keys of [torque_mode] and [optional_objects]: first if it is unknown
whether the object acts in torque mode, then if it does not."""


def _torque_mode(drive: DriveDescription) -> Iterator[str]:
    profile = drive.profile
    for name, (place, doubt, lack) in _TORQUE_MODE.items():
        keeps: Keeps = getattr(profile.torque_mode, name)
        if not getattr(profile.optional_objects, name) or keeps is Keeps.KEPT:
            continue
        if keeps is Keeps.UNKNOWN:
            yield f"no document states that {place} limits it in cyclic torque: {doubt}"
        else:
            yield f"{place} does not limit it in cyclic torque: {lack}"


def _warnings(drive: DriveDescription, brake: bool, unused: list[str]) -> Iterator[str]:
    profile = drive.profile
    if not profile.verified_on_hardware:
        kind = f"{profile.vendor} {profile.family}"
        yield f"the profile of {kind} has not been verified on hardware"
    if profile.torque_source.sampling is TorqueSampling.UNKNOWN:
        yield "no document states when its torque is sampled or how it is filtered"
    if profile.temperature is None:
        yield "its temperature cannot be read: temperature_max_degc is not monitored"
    for name, warning in _UNLIMITED.items():
        if not getattr(profile.optional_objects, name):
            seen = ", though its EDS has the object" if name in unused else ""
            yield f"{warning}{seen}"
    yield from _torque_mode(drive)
    if not brake:
        for entry, _ in without_torque(profile.written):
            yield f"{in_words(entry)}, and it has no brake"
