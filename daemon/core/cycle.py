"""One cycle of 10 ms, in the order of time: CAN frames in, CAN frames and a record out.

frames -> drives: decode, state -> units: SI at the joint -> observer: estimate
       -> safety: verdict -> modes: next mode -> safety: bound the command -> units
       -> drives: encode -> frames             ... and all of it in one CycleRecord
"""

import math
from collections.abc import Sequence
from dataclasses import replace

from daemon.core import (
    cycle_record,
    inputs,
)
from daemon.core.safety import (
    checks,
)
from daemon.core.safety.friction_monitor import watch
from daemon.core.safety.inputs import AxisInputs, LegInputs, ServiceInputs
from daemon.core.state import Axis, Core, Leg
from daemon.core.steps import (
    controllers,
    impedance,
    joints,
    latching,
    monitors,
    poses,
    requests,
    single_axis,
    supervisor,
    targets,
)
from daemon.core.steps.joints import jump_reach_si
from daemon.core.steps.sampling import effort_std
from daemon.core.steps.smoothing import look_back
from daemon.core.tick import Tick
from daemon.ipc.record import CycleRecord, GatewayState, Mode, Verdict
from drives.canopen.bus import Frame
from drives.cia402.power_state import TORQUE_FREE
from drives.signals import DriveFeedback, OperationMode, PowerState
from observer.filter.leg_observer import PoseError
from observer.filter.status import Validity
from observer.mechanism.mechanism import ratio_and_load


def step(
    core: Core, frames: Sequence[Frame], levels: Sequence[GatewayState], tick: Tick
) -> tuple[list[Frame], CycleRecord]:
    """Run one cycle with drives: from the TPDOs of a SYNC to the RPDOs that follow them."""
    drives = core.drives
    if drives is None:
        raise RuntimeError("a cycle needs drives that have been brought up")
    drives.feed(frames, tick.sync_ns)
    sense(core, drives.end_of_window(tick.cycle, tick.sync_ns), tick)
    observe(core, tick)
    orders = inputs.hear(core, levels, tick.cycle)
    controllers.hear(core, tick.cycle)
    found = judge(core, orders, tick)
    supervisor.change_mode(core, found, orders, tick.cycle, tick.sync_utc_ns)
    poses.follow(core, tick.cycle, tick.sync_utc_ns)
    impedance.assist(core, tick.cycle)
    commands = impedance.command(core, tick.cycle)
    monitors.note_commands(core)
    outgoing = drives.frames(commands)
    return outgoing, cycle_record.record(core, tick)


def rest(core: Core, levels: Sequence[GatewayState], tick: Tick) -> CycleRecord:
    """Run one cycle without drives: gateway states are read and a record is written."""
    for axis in core.axes:
        if axis.feedback is not None:
            # Each EMCY is recorded once, in its own cycle; no new sample replaces this one.
            axis.feedback = replace(axis.feedback, news=())
    orders = inputs.hear(core, levels, tick.cycle)
    controllers.hear(core, tick.cycle)
    requests.answer(core, orders, tick.cycle, tick.sync_utc_ns)
    requests.finish_request(core)
    latching.follow(core, tick.sync_utc_ns)
    return cycle_record.record(core, tick)


def react(core: Core, frames: Sequence[Frame], tick: Tick) -> list[Frame]:
    """Process frames between two windows and stop all drives at once if one sent an alarm.

    Frames are sent only if the stop of an axis became harsher. Otherwise a drive that answers each
    frame with another EMCY (8220h after its own reset) would cause an endless exchange.
    """
    drives = core.drives
    if drives is None or not drives.feed_between(frames, tick.sync_ns):
        return []
    if not supervisor.driving(core):
        return []
    for axis, feedback in zip(core.axes, drives.peek(tick.sync_ns), strict=True):
        axis.feedback = feedback
    found = judge(core, inputs.NO_ORDERS, tick)
    if not found:
        return []
    before = [axis.stop and axis.stop.step for axis in core.axes]
    for verdict in found:
        supervisor.stop(core, verdict, tick.cycle)
    if before == [axis.stop and axis.stop.step for axis in core.axes]:
        return []
    return drives.frames(impedance.command(core, tick.cycle))


def sense(core: Core, feedbacks: Sequence[DriveFeedback], tick: Tick) -> None:
    """Update the joints from the drive samples, and check their references and drive states."""
    for axis, feedback in zip(core.axes, feedbacks, strict=True):
        _tell_overdue(core, axis, feedback)
        axis.feedback = feedback
        axis.joint = _measured(core, axis, feedback, tick)
        lost = _reference_lost(core, axis, feedback)
        if lost and axis.referenced:
            axis.referenced, axis.unreferenced_why = False, lost
            core.events.append(f"{axis.name}: not referenced any more, {lost}")
        # A silent drive may have lost its power, and with it its home position.
        silent = feedback.sample_age_cycles > core.config.thresholds.sample_age_max_cycles
        axis.homed = axis.homed and axis.referenced and not silent
        _count_readiness(core, axis, feedback)
        if feedback.fresh and not feedback.in_fault:
            axis.error_found = ""
    for leg in core.legs:
        _place(leg)
        monitors.watch_raw(core, leg)


def _tell_overdue(core: Core, axis: Axis, feedback: DriveFeedback) -> None:
    before = axis.feedback is not None and axis.feedback.temperature_overdue
    if feedback.temperature_overdue and not before:
        core.events.append(f"{axis.name}: its temperature is not measured any more")
    elif before and not feedback.temperature_overdue:
        core.events.append(f"{axis.name}: its temperature is measured again")


def _measured(core: Core, axis: Axis, feedback: DriveFeedback, tick: Tick) -> joints.Joint:
    # Homing moves the origin of the position: that step must not count as motion.
    before = joints.Joint() if single_axis.moves_origin(core, axis, feedback) else axis.joint
    return joints.measure(before, feedback, axis.scaling, tick.sync_ns)


def _reference_lost(core: Core, axis: Axis, feedback: DriveFeedback) -> str:
    """The reason why the position of an axis is no longer valid; empty while it is valid."""
    if feedback.rebooted:
        return "its drive has rebooted"
    if feedback.reference_lost:
        return "its encoder is in error"
    reach_si = jump_reach_si(axis.joint, axis.limits, core.config.thresholds)
    jumped = axis.joint.elapsed_s > 0 and abs(axis.joint.step_si) > reach_si
    return "its encoder jumped" if jumped else ""


def _count_readiness(core: Core, axis: Axis, feedback: DriveFeedback) -> None:
    state = feedback.power_state
    if not supervisor.enable_wanted(core, axis):
        axis.seen_off = axis.seen_off or state in _OFF
        held = axis.stop is not None and not axis.seen_off
        powered = state not in TORQUE_FREE
        axis.unasked_cycles = axis.unasked_cycles + 1 if powered and not held else 0
        axis.reached_enabled, axis.unready_cycles = False, 0
        return
    axis.seen_off, axis.unasked_cycles = False, 0
    ready = (
        state == PowerState.OPERATION_ENABLED
        and feedback.mode_display == axis.mode_sent
        and (feedback.following or axis.mode_sent == OperationMode.HOMING)
    )
    axis.reached_enabled = axis.reached_enabled or ready
    axis.unready_cycles = 0 if ready else axis.unready_cycles + 1


_OFF = frozenset(
    {PowerState.NOT_READY_TO_SWITCH_ON, PowerState.SWITCH_ON_DISABLED, PowerState.FAULT}
)
"""States from which no single controlword enables power, so a delayed controlword cannot either."""


def _place(leg: Leg) -> None:
    """Compute holding load, singularity ratio and tracking error of a leg from raw encoders."""
    hip, slide = leg.axes
    if not all(axis.joint.known and axis.referenced for axis in leg.axes):
        leg.singularity_ratio = 1.0
        return
    leg.singularity_ratio, hip_nm, slide_n = ratio_and_load(
        leg.parameters, hip.joint.position_si, slide.joint.position_si
    )
    if leg.singularity_ratio > 0:
        hip.gravity_si, slide.gravity_si = hip_nm, slide_n
    reference = leg.reference
    for index, axis in enumerate(leg.axes):
        axis.tracking_si = axis.wanted_velocity_si = 0.0
        if reference is not None and reference.guided:
            axis.tracking_si = axis.joint.position_si - reference.position[index]
            axis.wanted_velocity_si = reference.velocity[index]


def observe(core: Core, tick: Tick) -> None:
    """Feed each leg's observer with this cycle's samples; a missing sample is NaN."""
    for leg in core.legs:
        hip, slide = leg.axes
        exercise = leg.exercise
        leg.artificial = (0.0, 0.0) if exercise is None else exercise.artificial_si
        leg.measured = (_sampled_si(hip), _sampled_si(slide))
        leg.effort_used = (
            hip.joint.effort_si - leg.artificial[0],
            slide.joint.effort_si - leg.artificial[1],
        )
        referenced = hip.referenced and slide.referenced
        if not leg.observer_started:
            if not (referenced and hip.joint.fresh and slide.joint.fresh):
                continue
            if not _start_observer(leg):
                continue
        leg.estimate = estimate = leg.observer.step(
            leg.measured,
            leg.effort_used,
            tick.dt_s,
            effort_std=effort_std(leg),
            late=tick.late,
            unreferenced=not referenced,
            artificial=exercise is not None and exercise.is_artificial,
            input_saturated=monitors.is_saturated(leg),
            near_limit=leg.zone.entered,
        )
        watch(core, leg, estimate, tick.dt_s)
        look_back(leg, estimate, tick.dt_s)
        monitors.watch_patient(core, leg, estimate)
        bad = Validity.BAD in estimate.validity
        leg.observer_bad_cycles = leg.observer_bad_cycles + 1 if bad else 0


def _start_observer(leg: Leg) -> bool:
    """Start the observer at the measured pose; False if that pose is impossible.

    Without an observer the drives cannot be enabled.
    """
    try:
        leg.observer.reset(leg.measured)
    except PoseError:
        return False
    leg.observer_started = True
    return True


def _sampled_si(axis: Axis) -> float:
    return axis.joint.position_si if axis.joint.fresh else math.nan


def judge(core: Core, orders: inputs.CommandInputs, tick: Tick) -> tuple[Verdict, ...]:
    """Collect the safety inputs and run the safety checks; the harshest verdict is first."""
    drives = core.drives
    service = ServiceInputs(
        stop_requested=orders.stop,
        shutdown_requested=tick.shutdown,
        gateway_age_cycles=tick.cycle - core.level_cycle,
        overruns_in_a_row=tick.overruns_in_a_row,
        bus_off=drives is not None and drives.bus_state.has_been_off,
        bus_error=tick.bus_error,
        tx_dropped_in_a_row=tick.tx_dropped_in_a_row,
    )
    axes = [_situation(core, leg, index) for leg in core.legs for index in range(len(leg.axes))]
    legs = [
        LegInputs(leg.name, leg.singularity_ratio, leg.stopping_ratio, leg.observer_bad_cycles)
        for leg in core.legs
    ]
    for axis in core.axes:
        if axis.feedback is not None:
            axis.emergencies_seen = axis.feedback.alarm_count
    config = core.config
    return checks.judge(
        service, axes, legs, config.thresholds, config.categories, driving=supervisor.driving(core)
    )


def _situation(core: Core, leg: Leg, index: int) -> AxisInputs:
    axis = leg.axes[index]
    feedback = axis.feedback
    if feedback is None:
        raise RuntimeError(f"{axis.name} is judged before it was sensed")
    return AxisInputs(
        name=axis.name,
        feedback=feedback,
        joint=axis.joint,
        limits=single_axis.limits_in_force(core, axis),
        referenced=axis.referenced,
        preparing=core.single_axis is not None,
        homing=single_axis.is_homing(core, axis),
        tracking_si=axis.tracking_si if core.mode != Mode.STOPPING else 0.0,
        wanted_velocity_si=axis.wanted_velocity_si,
        counts_sign=1 if axis.scaling.counts_per_si > 0 else -1,
        loop_distance_si=targets.loop_distance(axis),
        enable_wanted=supervisor.enable_wanted(core, axis),
        reached_enabled=axis.reached_enabled,
        unready_cycles=axis.unready_cycles,
        unasked_cycles=axis.unasked_cycles,
        seen_off=axis.seen_off,
        reaction_cycles=axis.reaction_cycles,
        mode_wanted=axis.mode_sent,
        new_emergency=feedback.alarm_count > axis.emergencies_seen,
        watch=axis.watch,
        stride_energy_j=monitors.stride_energy(leg, axis),
        stride_drift_si=monitors.stride_drift(leg, axis),
        stopping_end_si=axis.stopping_end_si,
        spasm_cycles=axis.spasm.cycles,
        spasm_rise_si=axis.spasm.rise_si,
        error_found=axis.error_found,
    )
