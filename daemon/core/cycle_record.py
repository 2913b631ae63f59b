"""Build the record of one cycle from the core's state; nothing here affects control."""

from typing import Any, TypeVar

from msgspec.structs import replace

from daemon.core.motion.assist import wanted_si
from daemon.core.state import Axis, Core, Leg
from daemon.core.steps import status
from daemon.core.tick import Tick
from daemon.ipc.record import (
    NAN,
    AssistRecord,
    AxisRecord,
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
from observer.filter.status import Status
from observer.smoother import LAG

Reported = TypeVar("Reported", Event, Refusal)
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
        progress=status.progress(core),
        gateway_age_cycles=tick.cycle - core.inputs.gateway_state_cycle,
        stop_count=core.inputs.stop_count or 0,
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
    assisted = core.assisted
    return AssistRecord(
        accepted_count=assisted.accepted_count,
        refused_count=dict(assisted.refused_count),
        lapse_count=assisted.lapse_count,
        lapse_reason=assisted.lapse_reason,
    )


def _phase(leg: Leg) -> float:
    return -1.0 if leg.exercise is None else leg.exercise.gait_phase


def _drive(axis: Axis, age_max_cycles: int) -> DriveRecord:
    """The record of one drive; values of a sample that is too old are left out."""
    feedback, joint = axis.sensed.feedback, axis.sensed.joint
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
        position=joint.position_si if known else None,
        velocity=joint.velocity_si if known else None,
        effort=joint.effort_si if known else None,
        target_effort=axis.sent.effort_si,
        referenced=axis.sensed.referenced,
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
        position=None,
        velocity=None,
        effort=None,
        target_effort=0.0,
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
    estimate = leg.estimated.estimate
    hip, slide = _axis(leg, 0), _axis(leg, 1)
    if estimate is None:
        return LegRecord(
            name=leg.name,
            hip=hip,
            slide=slide,
            status=Status.UNREFERENCED if not _referenced(leg) else Status.WARM_UP,
            gait_phase=_phase(leg),
            stiffness_ratio=leg.guidance_ratio,
            setpoint_seq=leg.assist.seq,
        )
    return LegRecord(
        name=leg.name,
        hip=hip,
        slide=slide,
        status=estimate.status,
        covariance=estimate.covariance,
        nis=estimate.nis,
        mean_nis=estimate.mean_nis,
        gait_phase=_phase(leg),
        stiffness_ratio=leg.guidance_ratio,
        setpoint_seq=leg.assist.seq,
        stride=_stride(leg, tick.sync_ns, core.config.period_ns),
    )


def _axis(leg: Leg, index: int) -> AxisRecord:
    """The record of one axis, 0 the hip and 1 the slide: places in the observer's pairs."""
    estimated, newest = leg.estimated, leg.assist.accepted
    reference = leg.reference.position if leg.reference else estimated.measured
    measured, effort = estimated.measured[index], estimated.effort_used[index]
    assist, estimate = leg.assist.added_si[index], estimated.estimate
    wanted = 0.0 if newest is None else wanted_si(newest)[index]
    needed = leg.softened.needed_si
    if estimate is None:
        return AxisRecord(measured, effort, reference[index], assist, wanted)
    state, std, drift = estimate.state, estimate.std, estimated.drifts[index]
    of_friction, of_patient = estimate.passive[index], estimate.passive[2 + index]
    return AxisRecord(
        measured_position=measured,
        effort=effort,
        reference_position=reference[index],
        assist=assist,
        assist_wanted=wanted,
        validity=estimate.validity[index],
        position=state[index],
        position_std=std[index],
        velocity=state[2 + index],
        velocity_std=std[2 + index],
        friction=state[4 + index] - of_friction,
        friction_std=std[4 + index],
        patient=state[6 + index] - of_patient,
        patient_std=std[6 + index],
        net=estimate.net[index] - (of_patient - of_friction),
        net_std=estimate.net_std[index],
        innovation=estimate.innovation[index],
        artificial=estimated.artificial[index],
        drift_correlation=correlation(drift),
        friction_error=friction_error(drift),
        # A passive patient in this machine needs this much more than its file says.
        needed=NAN if needed is None else needed[index] + of_friction - of_patient,
    )


def _referenced(leg: Leg) -> bool:
    return all(axis.sensed.referenced for axis in leg.axes)


def _stride(leg: Leg, sync_ns: int, period_ns: int) -> StrideRecord | None:
    """The record of the stride completed in this cycle; None if there is none."""
    stride = leg.estimated.stride
    if stride is None:
        return None
    figures: dict[str, Any] = stride._asdict()
    figures["hip"] = AxisStrideRecord(**stride.hip._asdict())
    figures["slide"] = AxisStrideRecord(**stride.slide._asdict())
    end_ns = sync_ns - (LAG + 1) * period_ns
    return StrideRecord(number=leg.estimated.stride_count, end_mono_ns=end_ns, **figures)
