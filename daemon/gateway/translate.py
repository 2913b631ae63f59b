"""Messages made from records: the rules of validity are applied here, and only here.

Fields of a record and of its messages have the same names, so that a message is made by them; what
is written out below has another meaning in the message.

Rules of validity, per axis of a leg:

    ok                   everything is given
    split_unobservable   position, velocity and net value are given; patient and friction are null
    bad                  everything of the axis is null

Unreferenced, out of workspace, inconsistent and uncalibrated make both axes bad, whatever validity
the record holds. A number that is not finite is null in any case. Raw measurements and the
innovation are not estimates: they are always given, to show why an axis is bad.
"""

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, Final, NamedTuple

import msgspec
from gaitd_client import wire
from gaitd_names import NMT_STATES, POWER_STATES, StatusBit, Validity
from gaitd_names.joints import JOINTS

from daemon.gateway.tremor import Tremor
from daemon.ipc.record import (
    STATE_COUNT,
    AxisRecord,
    CycleRecord,
    DriveRecord,
    LegRecord,
)
from daemon.report_messages import judgement, progress_message

NEVER_PUBLISHED: Final = (
    StatusBit.UNREFERENCED,
    StatusBit.OUT_OF_WORKSPACE,
    StatusBit.INCONSISTENT,
    StatusBit.UNCALIBRATED,
)
"""Status bits that make both axes bad."""

_BITS: Final = {bit: 1 << number for number, bit in enumerate(StatusBit)}
_NEVER_PUBLISHED_BITS: Final = sum(_BITS[bit] for bit in NEVER_PUBLISHED)

_VALIDITY: Final = tuple(Validity)
"""By the number in a record."""

COVARIANCE_COUNT: Final = STATE_COUNT * (STATE_COUNT + 1) // 2

_SPLIT: Final = ("friction", "patient")
"""Estimates that are valid only if the two can be separated."""
_ESTIMATES: Final = ("position", "velocity", "net", *_SPLIT)
"""Fields of an axis that are estimated, each with its standard deviation."""
_HIDDEN: Final = {
    Validity.OK: (),
    Validity.SPLIT_UNOBSERVABLE: _SPLIT,
    Validity.BAD: _ESTIMATES,
}
_BAD: Final = Validity.BAD

# Places of an axis' velocity and patient in the covariance.
_VELOCITY: Final = {"hip": 2, "slide": 3}
_PATIENT: Final = {"hip": 6, "slide": 7}

NO_TREMOR: Final[Mapping[str, Tremor | None]] = dict.fromkeys(JOINTS)

_FROM_STATUSWORD: Final = frozenset(
    {"statusword", "mode_display", "heartbeat_age_ms", "hand_switch_closed", "sto_released"}
)
"""Fields of a drive that are not known before its first statusword."""

Number = float | None


class Stamp(NamedTuple):
    """Origin of a message: the fields that all messages begin with, without `seq`."""

    core_boot_id: str | None = None
    cycle: int | None = None
    sample_time_ns: int | None = None


class View(NamedTuple):
    """One leg of one record after the rules of validity; its three messages are made from it."""

    leg: LegRecord
    common: dict[str, Any]
    """Fields of the messages by name, without `seq`; `hip` and `slide` have those of the axes."""
    covariance: tuple[float, ...] | None
    """Covariance of all eight states, as the observer gave it."""


def stamp_of(core_boot_id: str, record: CycleRecord) -> Stamp:
    """The stamp of all messages made from this record."""
    return Stamp(core_boot_id, record.cycle, record.sync_utc_ns)


def head(stamp: Stamp, seq: int) -> dict[str, Any]:
    """The fields of `wire.Stated`."""
    return {"seq": seq, **stamp._asdict()}


def finite(value: float | None) -> Number:
    """The number, or None if it is not finite."""
    return value if value is not None and math.isfinite(value) else None


def view_of(
    leg: LegRecord,
    record: CycleRecord,
    stamp: Stamp,
    tremors: Mapping[str, Tremor | None] = NO_TREMOR,
) -> View:
    """Apply the rules of validity to one leg's estimate.

    Args:
        leg: of the record.
        record: one cycle.
        stamp: of the record.
        tremors: of the axes, as the cycles before have shown.
    """
    is_bad = bool(leg.status & _NEVER_PUBLISHED_BITS)
    hip, slide = (
        _axis(one, Validity.BAD if is_bad else _VALIDITY[one.validity], tremors[name])
        for name, one in zip(JOINTS, leg.axes, strict=True)
    )
    covariance = leg.covariance if _is_covariance(leg.covariance) else None
    common = {
        **stamp._asdict(),
        "leg": leg.name,
        "mode": record.mode,
        "status": status_names(leg.status),
        "status_bits": f"0x{leg.status:04X}",
        "hip": hip,
        "slide": slide,
        "covariance": None if _BAD in (hip["validity"], slide["validity"]) else covariance,
        "nis": finite(leg.nis),
        "mean_nis": finite(leg.mean_nis),
        "observable_rank": _observable_rank(leg.status),
        "gait_phase_ratio": finite(leg.gait_phase) if leg.gait_phase >= 0 else None,
        "dt_s": finite(record.dt_s),
        "stiffness_ratio": finite(leg.stiffness_ratio),
        "setpoint_seq": leg.setpoint_seq if leg.setpoint_seq >= 0 else None,
    }
    return View(leg, common, covariance)


def estimate(view: View, seq: int) -> wire.Estimate:
    """The message LEG/estimate."""
    return msgspec.convert({**view.common, "seq": seq}, wire.Estimate)


def activity(view: View, seq: int) -> wire.Activity:
    """The message LEG/activity."""
    axes = {}
    for name in JOINTS:
        power_w, std_w = _power(view, (name,))
        axes[name] = view.common[name] | {"patient_power_w": power_w, "patient_power_w_std": std_w}
    power_w, std_w = _power(view, tuple(JOINTS))
    both = {"patient_power_w": power_w, "patient_power_w_std": std_w}
    return msgspec.convert({**view.common, "seq": seq, **axes, **both}, wire.Activity)


def friction(view: View, seq: int) -> wire.Friction:
    """The message LEG/friction."""
    return msgspec.convert({**view.common, "seq": seq}, wire.Friction)


def drive_state(
    drive: DriveRecord, stamp: Stamp, seq: int, emergencies: tuple[wire.Emergency, ...] = ()
) -> wire.DriveState:
    """The message drives/NAME; inputs and statusword are null before the first statusword."""
    values = finite_values(drive) | head(stamp, seq)
    values |= {
        "nmt_state": NMT_STATES.get(drive.nmt_state, "unknown"),
        "power_state": power_state_name(drive.power_state),
        "statusword": f"0x{drive.statusword:04X}",
        "emergency_code": f"0x{drive.emergency_code:04X}" if drive.emergency_code else None,
        "emergencies": emergencies,
    }
    if values["power_state"] == "unknown":
        values |= dict.fromkeys(_FROM_STATUSWORD)
    return msgspec.convert(values, wire.DriveState)


def power_state_name(power_state: int) -> str:
    """Name of a CiA 402 state by its number in the record."""
    return POWER_STATES[power_state] if 0 <= power_state < len(POWER_STATES) else POWER_STATES[0]


def safety(
    record: CycleRecord | None,
    limits: dict[str, object] | None,
    stamp: Stamp,
    seq: int,
    lease_holder: str | None = None,
) -> wire.Safety:
    """The message `safety`; without a record all fields are null and `valid` is false."""
    if record is None:
        unknown: dict[str, Any] = dict.fromkeys(wire.Safety.__struct_fields__)
        unknown.update(head(stamp, seq), valid=False)
        return wire.Safety(**unknown)
    return wire.Safety(
        **head(stamp, seq),
        valid=True,
        mode=record.mode,
        active=record.mode.active,
        verdict=judgement(record.verdict),
        stage=record.stage,
        progress=progress_message(record.progress),
        lease_holder=lease_holder,
        gateway_age_cycles=record.gateway_age_cycles,
        stop_count=record.stop_count,
        limits=limits,
    )


def _is_covariance(values: Sequence[float]) -> bool:
    # A value that is not finite makes the sum not finite; huge finite values could overflow, too.
    return len(values) == COVARIANCE_COUNT and (
        math.isfinite(sum(values)) or all(map(math.isfinite, values))
    )


def finite_values(record: msgspec.Struct) -> dict[str, Any]:
    """The fields of a record by name; a number that is not finite is None."""
    return {
        name: finite(value) if isinstance(value, float) else value
        for name, value in msgspec.structs.asdict(record).items()
    }


def tremor_fields(tremor: Tremor | None) -> dict[str, Any]:
    """The fields of a tremor, or of none."""
    frequency_hz, amplitude = (None, None) if tremor is None else tremor
    return {"tremor_frequency_hz": frequency_hz, "tremor_amplitude": amplitude}


def _axis(axis: AxisRecord, validity: Validity, tremor: Tremor | None) -> dict[str, Any]:
    """The fields of one axis by name, those that may not be published None."""
    values = finite_values(axis)
    values["validity"] = validity
    values |= tremor_fields(tremor if validity is Validity.OK else None)
    hidden = _HIDDEN[validity]
    for name in _ESTIMATES:
        if name in hidden or values[name] is None:
            values[name] = values[f"{name}_std"] = None
    return values


@lru_cache(maxsize=256)
def status_names(status: int) -> tuple[str, ...]:
    """Names of the status bits that are set. Cached: few combinations occur, and tests are slow."""
    return tuple(bit for bit, mask in _BITS.items() if mask & status)


@lru_cache(maxsize=256)
def _observable_rank(status: int) -> int:
    """Rank of the observability matrix; tests/observer/test_observability.py compares the two."""
    resting = {StatusBit.STANDSTILL_HIP, StatusBit.STANDSTILL_SLIDE} & {*status_names(status)}
    return STATE_COUNT - len(resting)


def _power(view: View, axes: tuple[str, ...]) -> tuple[Number, Number]:
    """Patient's power over these axes in W, and its standard deviation to first order.

    None stands for a value that is unknown or not finite; a product of finite factors may overflow.
    P = sum of effort times velocity, so its gradient is the velocity with respect to the effort and
    the effort with respect to the velocity; the variance is the gradient's quadratic form of
    covariance.
    """
    gradient: list[tuple[int, float]] = []
    for axis in axes:
        speed, effort = view.common[axis]["velocity"], view.common[axis]["patient"]
        if speed is None or effort is None:
            return None, None
        gradient += [(_PATIENT[axis], speed), (_VELOCITY[axis], effort)]
    power = sum(gradient[2 * k][1] * gradient[2 * k + 1][1] for k in range(len(axes)))
    if view.covariance is None:
        return finite(power), None
    variance = sum(g * h * view.covariance[_packed(i, j)] for i, g in gradient for j, h in gradient)
    return finite(power), finite(math.sqrt(max(variance, 0.0)))


def _packed(row: int, column: int) -> int:
    """Index of an element in the lower triangle, row by row."""
    low, high = sorted((row, column))
    return high * (high + 1) // 2 + low
