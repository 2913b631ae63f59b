"""The bring-up of one drive as a list of steps, which can be printed before anything runs.

`plan` is pure: files and limits in, steps out. `bringup.py` executes them. The order, and why:

    reset    NMT reset communication: removes the settings of an earlier master
    boot     the boot-up message: the drive is there, in PRE-OPERATIONAL
    power    without power, or switched off where that was requested: no setting changes under load
    check    device type, identity, modes: it must be the drive of the files
    alone    no second node answers under its number
    compare  torque base, which its torque numbers refer to; read, never written, then used
    check    polarity and other references of its numbers; read, never written
    off      every PDO switched off, so that nothing of an earlier mapping can act
    write    SYNC's counter and window where the drive has them; type, timers, objects of the PDOs
             we use, each switched on last; then limits, option codes, interpolation time,
             heartbeats: defence in depth, all read back
    clear    what would act beside our commands, where the drive has it: inhibit and event timers,
             offsets of the targets. No drive has power, so that no joint steps
    range    software position limits: two objects that must not cross on the way
    seed     target at the joint's position (torque 0 and the mode are ordinary writes)
    hear     its heartbeat, in PRE-OPERATIONAL
    report   error register and error code as found

Never: a controlword other than disable voltage, a fault reset, an enable, a store to the drive's
memory.
"""

import math
from collections.abc import Iterator
from typing import Final, NamedTuple

from drives.bringup.steps import ALL_BITS, NO_RTR, SERIAL_NUMBER, Step, StepKind
from drives.canopen.objects import Object
from drives.cia402.homing import Homing, HomingObjects
from drives.cia402.pdo import PdoLayout, layouts
from drives.cia402.profile import DriveDescription
from drives.cia402.torque import ObjectRef
from drives.cia402.units import DriveLimits, RawLimits, raw_homing, raw_limits
from drives.errors import BootFailure
from drives.signals import OperationMode

_POLARITY_BITS: Final = 0b111 << 5
"""Bits of 607Eh: torque, velocity, position."""
_CYCLIC_MODES: Final = 1 << 7 | 1 << 9
"""Bits of 6502h: cyclic synchronous position, cyclic synchronous torque."""
_HOMING_MODE: Final = 1 << 5
_OFFSETS: Final = (
    (Object.POSITION_OFFSET, 32, "position"),
    (Object.VELOCITY_OFFSET, 32, "velocity"),
    (Object.TORQUE_OFFSET, 16, "torque"),
)
"""Objects of CiA 402-2 that a drive adds to the targets, with their bits."""
_MILLISECONDS: Final = -3
"""60C2h:02 is a power of ten of a second."""


class CycleSettings(NamedTuple):
    """The part of the cycle's configuration that bring-up needs."""

    period_ms: int
    master_node_id: int
    drive_heartbeat_ms: int
    """1017h of each drive."""
    drive_detection_ms: int
    """1016h:01 of each drive: the drive stops after this long without the master's heartbeat."""
    rpdo_timeout_ms: int
    """1400h:05 where the drive has it."""
    sync_counter: int = 0
    """1019h: SYNC carries a counter from 1 to this value; 0: no counter."""
    sync_window_us: int = 0
    """1007h where the drive has it: a TPDO later than this after SYNC is dropped; 0: no window."""


class DrivePlan(NamedTuple):
    """One drive and its steps."""

    description: DriveDescription
    steps: tuple[Step, ...]

    def __str__(self) -> str:
        head = f"{self.description.name}, node {self.description.node_id}"
        return "\n".join((head, *(f"{n:4}  {step}" for n, step in enumerate(self.steps, 1))))


def plan(description: DriveDescription, limits: DriveLimits, cycle: CycleSettings) -> DrivePlan:
    """List all steps of one drive, in order."""
    steps = (
        Step(StepKind.RESET, "NMT reset communication: removes the settings of an earlier master"),
        Step(StepKind.BOOT, "boot-up message: the drive is in PRE-OPERATIONAL"),
        *_identity(description),
        _word(StepKind.POWER, "its power stage is off", Object.STATUSWORD, 16),
        *_torque_base(description),
        *_units(description),
        *_all_pdos_off(description),
        *_sync(description, cycle),
        *_mapping(description, cycle),
        *_limits(description, raw_limits(limits, description)),
        *_settings(description, cycle),
        *_seeds(description, raw_limits(limits, description)),
        *_watches(description, cycle),
        *_temperature(description),
        _word(StepKind.REPORT, "error register as found", Object.ERROR_REGISTER, 8),
        _word(StepKind.REPORT, "error code as found", Object.ERROR_CODE, 16),
    )
    return DrivePlan(description, steps)


def homing_plan(
    description: DriveDescription, limits: DriveLimits, cycle: CycleSettings
) -> DrivePlan:
    """As `plan`, with what homing needs and with the axis file's torque limit for homing."""
    objects, homing = description.profile.homing, description.axis.homing
    if objects is None or homing is None:
        raise ValueError(f"{description.name} has no homing")
    usual = single_axis_plan(description, limits, cycle, homing.effort_max_si)
    seeds = next(n for n, step in enumerate(usual.steps) if step.kind is StepKind.SEED_POSITION)
    steps = (*usual.steps[:seeds], *_homing(description, objects, homing), *usual.steps[seeds:])
    return DrivePlan(description, steps)


def single_axis_plan(
    description: DriveDescription, limits: DriveLimits, cycle: CycleSettings, effort_max_si: float
) -> DrivePlan:
    """As `plan`, for an axis that is moved alone, with at most this effort in N·m or N.

    The axis may not be referenced, so the drive enforces no position limits.
    """
    single_axis = limits._replace(
        position_min_si=-math.inf, position_max_si=math.inf, effort_max_si=effort_max_si
    )
    return plan(description, single_axis, cycle)


def _identity(description: DriveDescription) -> Iterator[Step]:
    check = StepKind.CHECK
    failure = BootFailure.WRONG_DEVICE_TYPE
    kind = Object.DEVICE_TYPE
    yield Step(check, "it is a CiA 402 drive", kind, value=402, mask=0xFFFF, failure=failure)
    identity = description.axis.identity
    named = (
        ("vendor", identity.vendor_id, BootFailure.WRONG_VENDOR),
        ("product", identity.product_code, BootFailure.WRONG_PRODUCT),
        ("revision", identity.revision, BootFailure.WRONG_REVISION),
        ("serial number", identity.serial, BootFailure.WRONG_SERIAL_NUMBER),
    )
    for sub, (what, value, failure) in enumerate(named, 1):
        if value is not None:
            why = f"{what} of this axis"
            yield Step(check, why, Object.IDENTITY, sub, value=value, is_hex=True, failure=failure)
    if identity.serial is None:
        yield Step(StepKind.ASK, "its serial number", *SERIAL_NUMBER, is_hex=True)
    yield Step(StepKind.ALONE, "no second node has its node id")
    modes, missing = _CYCLIC_MODES, BootFailure.MISSING_MODE
    why = "it supports cyclic synchronous position and torque"
    yield _word(check, why, Object.SUPPORTED_MODES, 32, modes, modes, failure=missing)


def _torque_base(description: DriveDescription) -> Iterator[Step]:
    failure = BootFailure.WRONG_MOTOR_DATA
    for base in description.torque_bases:
        yield _step(StepKind.COMPARE, base.ref, base.expected_raw, base.what, failure=failure)


def _units(description: DriveDescription) -> Iterator[Step]:
    check = StepKind.CHECK
    if description.profile.optional_objects.polarity:
        why = "it inverts no sign: signs are in the axis file"
        yield _word(check, why, Object.POLARITY, 8, 0, _POLARITY_BITS)
    for entry in description.profile.checked:
        yield _step(check, entry, entry.value, entry.why, mask=entry.mask)


def _step(
    kind: StepKind,
    ref: ObjectRef,
    value: int,
    why: str,
    *,
    mask: int = ALL_BITS,
    failure: BootFailure = BootFailure.CONFIGURATION,
) -> Step:
    place = (ref.index, ref.sub, ref.bits, ref.signed)
    return Step(kind, why, *place, value, mask, failure=failure)


def _word(
    kind: StepKind,
    why: str,
    index: Object,
    bits: int,
    value: int = 0,
    mask: int = ALL_BITS,
    failure: BootFailure = BootFailure.CONFIGURATION,
) -> Step:
    """A step about an unsigned object without sub-indices, whose value is shown in hex."""
    return Step(kind, why, index, 0, bits, False, value, mask, is_hex=True, failure=failure)


def _write(why: str, index: int, sub: int, bits: int, value: int, *, is_hex: bool = False) -> Step:
    signed = value < 0
    return Step(StepKind.WRITE, why, index, sub, bits, signed, value, is_hex=is_hex)


def _clear(why: str, index: int, sub: int, bits: int, *, signed: bool = False) -> Step:
    return Step(StepKind.CLEAR, why, index, sub, bits, signed)


def _all_pdos_off(description: DriveDescription) -> Iterator[Step]:
    for number in range(description.profile.pdo.count):
        for index, name in ((Object.RPDO, "RPDO"), (Object.TPDO, "TPDO")):
            why = f"{name}{number + 1} off, under the identifier that it has"
            yield Step(StepKind.SWITCH_OFF, why, index + number, 1, is_hex=True)


def _sync(description: DriveDescription, cycle: CycleSettings) -> Iterator[Step]:
    has = description.profile.optional_objects
    if has.sync_counter:
        why = "SYNC counts so far, or not at all"
        yield _write(why, Object.SYNC_COUNTER, 0, 8, cycle.sync_counter)
    if has.sync_window:
        why = "synchronous window in microseconds: later PDOs are dropped"
        yield _write(why, Object.SYNC_WINDOW, 0, 32, cycle.sync_window_us)


def _mapping(description: DriveDescription, cycle: CycleSettings) -> Iterator[Step]:
    pdos = layouts(description.profile, description.node_id)
    for layout in pdos:
        yield from _mapping_of(layout)
        if layout is pdos.control and description.profile.pdo.rpdo_timeout:
            why = "RPDO1 timeout in ms, after which the drive stops by itself"
            yield _write(why, layout.communication_index, 5, 16, cycle.rpdo_timeout_ms)
        yield _switch_on(layout)


def _mapping_of(layout: PdoLayout) -> Iterator[Step]:
    parameters = layout.communication_index
    yield _write(f"{layout} with every n-th SYNC", parameters, 2, 8, layout.transmission_type)
    if layout.transmit:
        yield _clear(f"{layout} has no inhibit time", parameters, 3, 16)
        yield _clear(f"{layout} has no event timer", parameters, 5, 16)
    objects = layout.mapping_index
    yield _write(f"{layout} emptied", objects, 0, 8, 0)
    for sub, item in enumerate(layout.objects, 1):
        why = f"{layout} carries {item.index:04X}h:{item.sub:02X}"
        yield _write(why, objects, sub, 32, item.entry, is_hex=True)
    yield _write(f"{layout} complete", objects, 0, 8, len(layout.objects))


def _switch_on(layout: PdoLayout) -> Step:
    # Bit 30 is requested but not required: some drives do not support it.
    value = layout.can_id | (NO_RTR if layout.transmit else 0)
    return Step(
        kind=StepKind.WRITE,
        why=f"{layout} on",
        index=layout.communication_index,
        sub=1,
        value=value,
        mask=ALL_BITS ^ NO_RTR,
        is_hex=True,
    )


def _limits(description: DriveDescription, raw: RawLimits) -> Iterator[Step]:
    profile, has = description.profile, description.profile.optional_objects
    if has.position_limits:
        yield Step(
            kind=StepKind.RANGE,
            why="software position limits in counts",
            index=Object.POSITION_LIMITS,
            sub=1,
            signed=True,
            value=raw.position_min_counts,
            second=raw.position_max_counts,
        )
    limit, speed = profile.torque_limit, profile.velocity_unit.value
    why = f"{'current' if limit.unit.is_current else 'torque'} limit in {limit.unit.value}"
    yield _write(why, limit.index, limit.sub, limit.bits, raw.torque_raw)
    if has.speed_limit:
        yield _write(f"speed limit in {speed}", Object.SPEED_LIMIT, 0, 32, raw.speed_raw)
    if has.following_error:
        why = "following error window in counts"
        yield _write(why, Object.FOLLOWING_WINDOW, 0, 32, raw.following_error_counts)
    why = f"quick-stop ramp in {profile.deceleration_unit.value}"
    yield _write(why, Object.QUICK_STOP_DECELERATION, 0, 32, raw.deceleration_raw)


def _settings(description: DriveDescription, cycle: CycleSettings) -> Iterator[Step]:
    for entry in description.profile.written:
        yield _step(StepKind.WRITE, entry, entry.value, entry.why)
    for index, bits, what in _OFFSETS:
        why = f"no {what} offset: the target is the whole command"
        yield _clear(why, index, 0, bits, signed=True)
    if description.profile.optional_objects.interpolation_time:
        index = Object.INTERPOLATION_TIME
        yield _write("interpolation time: the core's cycle", index, 1, 8, cycle.period_ms)
        yield _write("... in ms", index, 2, 8, _MILLISECONDS)


def _homing(
    description: DriveDescription, objects: HomingObjects, homing: Homing
) -> Iterator[Step]:
    raw = raw_homing(homing, objects.home_sign, description)
    modes, bit = Object.SUPPORTED_MODES, _HOMING_MODE
    missing = BootFailure.MISSING_MODE
    yield _word(StepKind.CHECK, "it supports homing", modes, 32, bit, bit, failure=missing)
    speed, speeds = description.profile.velocity_unit.value, Object.HOMING_SPEEDS
    yield _write("homing method", Object.HOMING_METHOD, 0, 8, homing.method)
    yield _write(f"homing: search speed in {speed}", speeds, 1, 32, raw.search_speed_raw)
    yield _write(f"homing: speed of the final search in {speed}", speeds, 2, 32, raw.zero_speed_raw)
    why = f"homing: acceleration in {speed} per s"
    yield _write(why, Object.HOMING_ACCELERATION, 0, 32, raw.acceleration_raw)
    home, threshold = objects.home, objects.current_threshold
    yield _write("position at home in counts", home.index, home.sub, home.bits, raw.home_raw)
    for zero in objects.zeros:
        yield _step(StepKind.CLEAR, zero, 0, "no further shift of the home")
    if threshold is not None and raw.stop_current_ma is not None:
        why = "current in mA that means the mechanical stop"
        yield _write(why, threshold.index, threshold.sub, threshold.bits, raw.stop_current_ma)


def _seeds(description: DriveDescription, raw: RawLimits) -> Iterator[Step]:
    bits = description.profile.target_torque.bits
    yield _write("target torque: none", Object.TARGET_TORQUE, 0, bits, 0)
    yield Step(
        kind=StepKind.SEED_POSITION,
        why="target position: where the joint is",
        index=Object.TARGET_POSITION,
        signed=True,
        value=raw.position_min_counts,
        second=raw.position_max_counts,
    )
    mode = OperationMode.CYCLIC_SYNC_TORQUE
    yield _write("mode: cyclic synchronous torque", Object.MODE, 0, 8, mode)


def _temperature(description: DriveDescription) -> Iterator[Step]:
    temperature = description.profile.uploaded_temperature
    if temperature is not None:
        yield _step(StepKind.REPORT, temperature, 0, "temperature, by SDO in the cycle, too")


def _watches(description: DriveDescription, cycle: CycleSettings) -> Iterator[Step]:
    entries, consumer = description.profile.heartbeat.consumer_entries, Object.HEARTBEAT_CONSUMER
    for sub in range(2, entries + 1):
        yield _write("it monitors no other heartbeat", consumer, sub, 32, 0)
    if entries:
        value = cycle.master_node_id << 16 | cycle.drive_detection_ms
        yield _write("it monitors the master's heartbeat", consumer, 1, 32, value, is_hex=True)
    why = "its own heartbeat in ms"
    yield _write(why, Object.HEARTBEAT_PRODUCER, 0, 16, cycle.drive_heartbeat_ms)
    yield Step(StepKind.HEAR, "its heartbeat, in PRE-OPERATIONAL")
