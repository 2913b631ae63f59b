"""Messages made from records: the rules of validity are applied here, and only here.

Rules of validity, per axis of a leg:

    ok                   everything is given
    split_unobservable   pose, speed and net value are given; patient and friction are null
    bad                  everything of the axis is null

Unreferenced, out of workspace, inconsistent and uncalibrated make both axes bad, whatever validity
the record holds. A number that is not finite is null in any case. Raw measurements and the
innovation are not estimates: they are always given, to show why an axis is bad.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Final, NamedTuple

from gaitd_client import wire
from gaitd_client.wire.fields import NMT_STATES, POWER_STATES

from daemon.ipc.record import (
    STATE_COUNT,
    CycleRecord,
    DriveRecord,
    LegRecord,
    StopCategory,
    Verdict,
)
from daemon.ipc.report import Refusal
from daemon.wire.cause_texts import CAUSE_TEXT
from daemon.wire.names import StatusBit, Validity, name_of
from daemon.wire.report_fields import ENUMS, REFUSAL_FIELDS
from daemon.wire.report_texts import detail_text

NEVER_PUBLISHED: Final = (
    StatusBit.UNREFERENCED
    | StatusBit.OUT_OF_WORKSPACE
    | StatusBit.INCONSISTENT
    | StatusBit.UNCALIBRATED
)
"""Status bits that make both axes bad."""

_NEVER_PUBLISHED_BITS: Final = int(NEVER_PUBLISHED)

_VALIDITY: Final = {validity.value: validity for validity in Validity}
"""Lookup of Validity by value: ten times as fast as the enum's own call."""

COVARIANCE_COUNT: Final = STATE_COUNT * (STATE_COUNT + 1) // 2

# Indices into the state: two axes, each with position, velocity, friction, patient.
_VELOCITY: Final = (2, 3)
_PATIENT: Final = (6, 7)
_FIRST_SPLIT_INDEX: Final = 4
"""From this index on a state is valid only if friction and patient can be separated."""

Number = float | None


class Stamp(NamedTuple):
    """Origin of a message: the fields that all messages begin with, without `seq`."""

    core_boot_id: str | None = None
    cycle: int | None = None
    sample_time_ns: int | None = None


class View(NamedTuple):
    """One leg of one record after the rules of validity; its three messages are made from it."""

    leg: LegRecord
    record: CycleRecord
    common: dict[str, Any]
    """The fields of `wire.Estimated`, without `seq`."""
    state: tuple[Number, ...]
    std: tuple[Number, ...]
    net: tuple[Number, ...]
    net_std: tuple[Number, ...]
    validity: tuple[Validity, Validity]
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


def view_of(leg: LegRecord, record: CycleRecord, stamp: Stamp) -> View:
    """Apply the rules of validity to one leg's estimate."""
    validity = _validity(leg)
    published = _may_be_published(validity)
    state = tuple(
        value if may and math.isfinite(value) else None
        for may, value in zip(published, leg.state, strict=True)
    )
    net = tuple(
        finite(value) if of_axis is not Validity.BAD else None
        for of_axis, value in zip(validity, leg.net, strict=True)
    )
    return View(
        leg=leg,
        record=record,
        common=_common(leg, record, stamp, validity),
        state=state,
        std=_where(state, leg.std),
        net=net,
        net_std=_where(net, leg.net_std),
        validity=validity,
        covariance=leg.covariance if _is_covariance(leg.covariance) else None,
    )


def estimate(view: View, seq: int) -> wire.Estimate:
    """The message LEG/estimate."""
    leg, record, state, std = view.leg, view.record, view.state, view.std
    return wire.Estimate(
        **view.common,
        seq=seq,
        hip_angle_rad=state[0],
        hip_angle_rad_std=std[0],
        slide_position_m=state[1],
        slide_position_m_std=std[1],
        hip_velocity_rad_per_s=state[2],
        hip_velocity_rad_per_s_std=std[2],
        slide_velocity_m_per_s=state[3],
        slide_velocity_m_per_s_std=std[3],
        **_friction(view),
        **_patient_and_net(view),
        covariance=None if Validity.BAD in view.validity else view.covariance,
        innovation_hip_rad=finite(leg.innovation[0]),
        innovation_slide_m=finite(leg.innovation[1]),
        nis=finite(leg.nis),
        mean_nis=finite(leg.mean_nis),
        observable_rank=_observable_rank(leg.status),
        measured_hip_angle_rad=finite(leg.measured[0]),
        measured_slide_position_m=finite(leg.measured[1]),
        hip_torque_nm=finite(leg.effort_used[0]),
        slide_force_n=finite(leg.effort_used[1]),
        artificial_hip_nm=finite(leg.artificial[0]),
        artificial_slide_n=finite(leg.artificial[1]),
        reference_hip_angle_rad=finite(leg.reference[0]),
        reference_slide_position_m=finite(leg.reference[1]),
        gait_phase_ratio=_phase(leg),
        dt_s=finite(record.dt_s),
        **_assist(leg, record),
    )


def activity(view: View, seq: int) -> wire.Activity:
    """The message LEG/activity."""
    hip, slide, both = _power(view, (0,)), _power(view, (1,)), _power(view, (0, 1))
    return wire.Activity(
        **view.common,
        seq=seq,
        **_patient_and_net(view),
        hip_patient_power_w=hip[0],
        hip_patient_power_w_std=hip[1],
        slide_patient_power_w=slide[0],
        slide_patient_power_w_std=slide[1],
        patient_power_w=both[0],
        patient_power_w_std=both[1],
        gait_phase_ratio=_phase(view.leg),
    )


def friction(view: View, seq: int) -> wire.Friction:
    """The message LEG/friction."""
    leg = view.leg
    return wire.Friction(
        **view.common,
        seq=seq,
        **_friction(view),
        hip_drift_correlation=finite(leg.drift_correlation[0]),
        slide_drift_correlation=finite(leg.drift_correlation[1]),
        hip_friction_error_nm=finite(leg.friction_error[0]),
        slide_friction_error_n=finite(leg.friction_error[1]),
    )


def drive_state(
    drive: DriveRecord, stamp: Stamp, seq: int, emergencies: tuple[wire.Emergency, ...] = ()
) -> wire.DriveState:
    """The message drives/NAME; inputs and statusword are null before the first statusword."""
    heard = power_state_name(drive.power_state) != "unknown"
    return wire.DriveState(
        **head(stamp, seq),
        name=drive.name,
        nmt_state=NMT_STATES.get(drive.nmt_state, "unknown"),
        power_state=power_state_name(drive.power_state),
        statusword=f"0x{drive.statusword:04X}" if heard else None,
        mode_display=drive.mode_display if heard else None,
        fresh=drive.fresh,
        sample_age_cycles=drive.sample_age_cycles,
        late_count=drive.late_count,
        heartbeat_age_ms=finite(drive.heartbeat_age_ms) if heard else None,
        position_si=finite(drive.position_si),
        velocity_si=finite(drive.velocity_si),
        effort_si=finite(drive.effort_si),
        target_effort_si=finite(drive.target_effort_si),
        referenced=drive.referenced,
        hand_switch_closed=drive.hand_switch_closed if heard else None,
        sto_released=drive.sto_released if heard else None,
        temperature_degc=finite(drive.temperature_degc),
        emergency_code=f"0x{drive.emergency_code:04X}" if drive.emergency_code else None,
        emergency_text=drive.emergency_text,
        emergency_count=drive.emergency_count,
        protocol_error_count=drive.protocol_error_count,
        sign_proven=drive.sign_proven,
        emergencies=emergencies,
    )


def power_state_name(power_state: int) -> str:
    """Name of a CiA 402 state by its number in the record."""
    return POWER_STATES[power_state] if 0 <= power_state < len(POWER_STATES) else POWER_STATES[0]


def verdict_message(verdict: Verdict) -> wire.Judgement:
    """The verdict with its text and remedy for the operator."""
    text = CAUSE_TEXT[verdict.cause]
    stops = verdict.category is not StopCategory.NONE
    return wire.Judgement(
        category=verdict.category.name if stops else "none",
        cause=name_of(verdict.cause),
        drive=verdict.drive or None,
        value=finite(verdict.value) if stops else None,
        limit=finite(verdict.limit) if stops else None,
        finding=name_of(verdict.finding),
        said=verdict.said,
        detail=detail_text(verdict),
        text=text.title,
        remedy=text.remedy,
    )


def refusal_message(refusal: Refusal) -> wire.Refusal:
    """A refusal of the core, its values by name."""
    return wire.Refusal(
        code=name_of(refusal.code),
        subject=refusal.subject or None,
        values=named_values(REFUSAL_FIELDS[refusal.code], refusal.values),
        said=refusal.said,
    )


def named_values(names: Sequence[str], values: Sequence[float]) -> dict[str, float | str | None]:
    """Values of an event or a refusal by name; members of enums by theirs, new ones as numbers."""
    return {
        name: next((name_of(one) for one in ENUMS.get(name, ()) if one == value), finite(value))
        for name, value in zip(names, values, strict=False)
    }


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
        mode=name_of(record.mode),
        active=record.mode.active,
        verdict=verdict_message(record.verdict),
        stage=None if record.stage is None else name_of(record.stage),
        progress=record.progress,
        lease_holder=lease_holder,
        gateway_age_cycles=record.gateway_age_cycles,
        stop_count=record.stop_count,
        limits=limits,
    )


@lru_cache(maxsize=len(Validity) ** 2)
def _may_be_published(validity: tuple[Validity, Validity]) -> tuple[bool, ...]:
    """The states that may be published, as a flag for each of the eight."""
    return tuple(
        validity[index % 2] is Validity.OK
        or (validity[index % 2] is Validity.SPLIT_UNOBSERVABLE and index < _FIRST_SPLIT_INDEX)
        for index in range(STATE_COUNT)
    )


def _where(values: Sequence[Number], others: Sequence[float]) -> tuple[Number, ...]:
    """`others` where `values` has a number, else None."""
    pairs = zip(values, others, strict=True)
    return tuple(
        other if value is not None and math.isfinite(other) else None for value, other in pairs
    )


def _is_covariance(values: Sequence[float]) -> bool:
    # A value that is not finite makes the sum not finite; huge finite values could overflow, too.
    return len(values) == COVARIANCE_COUNT and (
        math.isfinite(sum(values)) or all(map(math.isfinite, values))
    )


def _validity(leg: LegRecord) -> tuple[Validity, Validity]:
    """Validity of hip and slide; BAD for both if a status bit requires it."""
    if leg.status & _NEVER_PUBLISHED_BITS:
        return Validity.BAD, Validity.BAD
    return _VALIDITY[leg.validity[0]], _VALIDITY[leg.validity[1]]


def _common(
    leg: LegRecord, record: CycleRecord, stamp: Stamp, validity: tuple[Validity, Validity]
) -> dict[str, Any]:
    return {
        **stamp._asdict(),
        "leg": leg.name,
        "mode": name_of(record.mode),
        "status": status_names(leg.status),
        "status_bits": f"0x{leg.status:04X}",
        "hip_validity": name_of(validity[0]),
        "slide_validity": name_of(validity[1]),
    }


@lru_cache(maxsize=256)
def status_names(status: int) -> tuple[str, ...]:
    """Names of the status bits that are set. Cached: few combinations occur, and tests are slow."""
    return tuple(name_of(bit) for bit in StatusBit if bit & status)


@lru_cache(maxsize=256)
def _observable_rank(status: int) -> int:
    """Rank of the observability matrix; tests/observer/test_observability.py compares the two."""
    resting = bool(status & StatusBit.STANDSTILL_HIP) + bool(status & StatusBit.STANDSTILL_SLIDE)
    return STATE_COUNT - resting


def _friction(view: View) -> dict[str, Any]:
    return {
        "hip_friction_nm": view.state[4],
        "hip_friction_nm_std": view.std[4],
        "slide_friction_n": view.state[5],
        "slide_friction_n_std": view.std[5],
    }


def _assist(leg: LegRecord, record: CycleRecord) -> dict[str, Any]:
    told = zip(record.legs, record.assist.legs, strict=False)
    own = next((own for one, own in told if one.name == leg.name), None)
    return {
        "assist_hip_nm": finite(own.assist[0]) if own else None,
        "assist_slide_n": finite(own.assist[1]) if own else None,
        "stiffness_ratio": finite(own.stiffness_ratio) if own else None,
        "setpoint_seq": own.seq if own and own.seq >= 0 else None,
    }


def _patient_and_net(view: View) -> dict[str, Any]:
    return {
        "hip_patient_nm": view.state[6],
        "hip_patient_nm_std": view.std[6],
        "slide_patient_n": view.state[7],
        "slide_patient_n_std": view.std[7],
        "hip_net_nm": view.net[0],
        "hip_net_nm_std": view.net_std[0],
        "slide_net_n": view.net[1],
        "slide_net_n_std": view.net_std[1],
    }


def _phase(leg: LegRecord) -> Number:
    return finite(leg.gait_phase) if leg.gait_phase >= 0 else None


def _power(view: View, axes: tuple[int, ...]) -> tuple[Number, Number]:
    """Patient's power over these axes in W, and its standard deviation to first order.

    None stands for a value that is unknown or not finite; a product of finite factors may overflow.
    P = sum of effort times speed, so its gradient is the speed with respect to the effort and the
    effort with respect to the speed; the variance is the gradient's quadratic form of covariance.
    """
    gradient: list[tuple[int, float]] = []
    for axis in axes:
        speed, effort = view.state[_VELOCITY[axis]], view.state[_PATIENT[axis]]
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
