"""Build the record of one cycle from the core's state; nothing here affects control."""

from typing import TypeVar

from msgspec.structs import replace

from daemon.core.motion.assist import wanted_si
from daemon.core.state import Axis, Core, Leg
from daemon.core.steps import status
from daemon.core.tick import Tick
from daemon.ipc.assist_record import AssistRecord, LegAssistRecord
from daemon.ipc.record import (
    STATE_COUNT,
    AxisStrideRecord,
    CycleRecord,
    DriveRecord,
    EmergencyRecord,
    LegRecord,
    RequestResult,
    StrideRecord,
    clipped,
)
from daemon.ipc.report import EVENTS_MAX, SAID_BYTES_MAX, Event, Refusal
from drives.canopen.emcy import is_alarm
from drives.signals import Emergency, Input, NmtState, PowerState
from observer.drift import correlation, friction_error
from observer.filter.status import Status, Validity
from observer.smoother import LAG
from observer.strides import AxisStride, Stride

Reported = TypeVar("Reported", Event, Refusal)
NAN = float("nan")
NS_PER_MS = 1_000_000


def record(core: Core, tick: Tick) -> CycleRecord:
    """Build the record of this cycle; recorded events are removed from the core's list."""
    core.seq += 1
    events = tuple(_clipped(event) for event in core.events[:EVENTS_MAX])
    del core.events[:EVENTS_MAX]
    age_max = core.config.thresholds.sample_age_max_cycles
    return CycleRecord(
        seq=core.seq,
        cycle=tick.cycle,
        sync_mono_ns=tick.sync_ns,
        sync_utc_ns=tick.sync_utc_ns,
        dt_s=tick.dt_s,
        mode=core.mode,
        verdict=replace(core.verdict, said=clipped(core.verdict.said)),
        events=events,
        request=_result(core.result),
        progress=clipped(status.progress(core)),
        gateway_age_cycles=tick.cycle - core.gateway_state_cycle,
        stop_count=core.stop_count or 0,
        gait_phase=_phase(core.legs[0]),
        drives=tuple([_drive(axis, age_max) for axis in core.axes]),
        legs=tuple([_leg(core, tick, leg) for leg in core.legs]),
        timing=tick.timing,
        bus_load_ratio=tick.bus_load_ratio,
        tx_dropped_count=tick.tx_dropped_count,
        bus=tick.bus,
        assist=_assist(core),
        stage=status.stage(core),
        time_is_simulated=tick.time_is_simulated,
    )


def _result(result: RequestResult) -> RequestResult:
    if result.refusal is None:
        return result
    return replace(result, refusal=_clipped(result.refusal))


def _clipped(reported: Reported) -> Reported:
    """The event or refusal with a text that fits: a slot of the ring has a fixed size."""
    said = clipped(reported.said, SAID_BYTES_MAX)
    return reported if said == reported.said else replace(reported, said=said)


def _assist(core: Core) -> AssistRecord:
    return AssistRecord(
        legs=tuple(_leg_assist(leg) for leg in core.legs),
        accepted_count=core.setpoint_accepted_count,
        refused_count=tuple(core.setpoint_refused_count),
        lapse_count=core.lapse_count,
        lapse_reason=core.lapse_reason,
    )


def _leg_assist(leg: Leg) -> LegAssistRecord:
    newest = leg.assist.accepted
    return LegAssistRecord(
        seq=leg.assist.seq,
        wanted=(0.0, 0.0) if newest is None else wanted_si(newest),
        assist=leg.assist_si,
        stiffness_ratio=leg.guidance_ratio,
    )


def _phase(leg: Leg) -> float:
    return -1.0 if leg.exercise is None else leg.exercise.gait_phase


def _drive(axis: Axis, age_max_cycles: int) -> DriveRecord:
    """The record of one drive; values of a sample that is too old are left out."""
    feedback, joint = axis.feedback, axis.joint
    if feedback is None:
        return _unseen(axis.name)
    emergency = feedback.emergency
    known = joint.known and feedback.sample_age_cycles <= age_max_cycles
    return DriveRecord(
        name=axis.name,
        nmt_state=feedback.nmt_state,
        power_state=feedback.power_state,
        statusword=feedback.statusword,
        mode_display=feedback.mode_display,
        fresh=joint.fresh,
        sample_age_cycles=feedback.sample_age_cycles,
        late_count=feedback.late_count,
        heartbeat_age_ms=feedback.heartbeat_age_ns / NS_PER_MS,
        position_si=joint.position_si if known else None,
        velocity_si=joint.velocity_si if known else None,
        effort_si=joint.effort_si if known else None,
        target_effort_si=axis.effort_sent_si,
        referenced=axis.referenced,
        hand_switch_closed=Input.HAND_SWITCH_CLOSED in feedback.inputs,
        sto_released=Input.STO_RELEASED in feedback.inputs,
        temperature_degc=feedback.temperature_degc,
        emergency_code=emergency.code if emergency else 0,
        emergency_text=emergency.text if emergency else "",
        emergency_count=feedback.emergency_count,
        protocol_error_count=feedback.protocol_error_count,
        sign_proven=axis.sign_proven,
        emergencies=tuple(_emergency(one, repeated) for one, repeated in feedback.news),
    )


def _emergency(emergency: Emergency, repeated: bool) -> EmergencyRecord:
    return EmergencyRecord(
        code=emergency.code,
        error_register=emergency.error_register,
        vendor_bytes=emergency.vendor_bytes.hex(),
        text=emergency.text,
        reaction=emergency.reaction.value,
        alarm=is_alarm(emergency),
        loses_reference=emergency.loses_reference,
        repeated=repeated,
    )


def _unseen(name: str) -> DriveRecord:
    """The record of a drive without any sample since bring-up, or without a bring-up."""
    return DriveRecord(
        name=name,
        nmt_state=NmtState.UNKNOWN,
        power_state=PowerState.UNKNOWN,
        statusword=0,
        mode_display=0,
        fresh=False,
        sample_age_cycles=0,
        late_count=0,
        heartbeat_age_ms=0.0,
        position_si=None,
        velocity_si=None,
        effort_si=None,
        target_effort_si=0.0,
        referenced=False,
        hand_switch_closed=False,
        sto_released=False,
        temperature_degc=None,
        emergency_code=0,
        emergency_text="",
        emergency_count=0,
        protocol_error_count=0,
    )


def _leg(core: Core, tick: Tick, leg: Leg) -> LegRecord:
    estimate = leg.estimate
    reference = leg.reference.position if leg.reference else leg.measured
    if estimate is None:
        unknown = (NAN,) * STATE_COUNT
        return LegRecord(
            name=leg.name,
            state=unknown,
            std=unknown,
            covariance=(NAN,) * (STATE_COUNT * (STATE_COUNT + 1) // 2),
            innovation=(NAN, NAN),
            nis=NAN,
            net=(NAN, NAN),
            net_std=(NAN, NAN),
            validity=(Validity.BAD, Validity.BAD),
            status=Status.UNREFERENCED if not _referenced(leg) else Status.WARM_UP,
            measured=leg.measured,
            effort_used=leg.effort_used,
            reference=reference,
            gait_phase=_phase(leg),
        )
    hip, slide = leg.axes
    return LegRecord(
        name=leg.name,
        state=estimate.state,
        std=estimate.std,
        covariance=estimate.covariance,
        innovation=estimate.innovation,
        nis=estimate.nis,
        net=estimate.net,
        net_std=estimate.net_std,
        validity=estimate.validity,
        status=estimate.status,
        measured=leg.measured,
        effort_used=leg.effort_used,
        reference=reference,
        artificial=leg.artificial,
        mean_nis=estimate.mean_nis,
        drift_correlation=(correlation(hip.drift), correlation(slide.drift)),
        friction_error=(friction_error(hip.drift), friction_error(slide.drift)),
        stride=_stride(leg, tick.sync_ns, core.config.period_ns),
        gait_phase=_phase(leg),
    )


def _referenced(leg: Leg) -> bool:
    return all(axis.referenced for axis in leg.axes)


def _stride(leg: Leg, sync_ns: int, period_ns: int) -> StrideRecord | None:
    """The record of the stride completed in this cycle; None if there is none."""
    stride = leg.stride
    if stride is None:
        return None
    return StrideRecord(
        number=leg.stride_count,
        end_mono_ns=sync_ns - (LAG + 1) * period_ns,
        duration_s=stride.duration_s,
        sample_count=stride.sample_count,
        hip=_axis_stride(stride.hip),
        slide=_axis_stride(stride.slide),
        work_positive_j=(stride.work_positive_j, stride.work_positive_j_std),
        work_negative_j=(stride.work_negative_j, stride.work_negative_j_std),
        share_ratio=_share(stride),
        status=stride.status,
        baseline=stride.baseline,
    )


def _axis_stride(axis: AxisStride) -> AxisStrideRecord:
    return AxisStrideRecord(
        work_positive_j=(axis.work_positive_j, axis.work_positive_j_std),
        work_negative_j=(axis.work_negative_j, axis.work_negative_j_std),
        assist_mean_si=(axis.assist_mean_si, axis.assist_mean_si_std),
        assist_peak_si=(axis.assist_peak_si, axis.assist_peak_si_std),
        power_mean_w=(axis.power_mean_w, axis.power_mean_w_std),
        power_peak_w=(axis.power_peak_w, axis.power_peak_w_std),
        share_ratio=_share(axis),
        coverage_ratio=axis.coverage_ratio,
    )


def _share(of: AxisStride | Stride) -> tuple[float, float] | None:
    if of.share_ratio is None or of.share_ratio_std is None:
        return None
    return of.share_ratio, of.share_ratio_std
