"""One cycle of 10 ms, in the order of time: CAN frames in, CAN frames and a record out.

frames -> drives: decode, state -> units: SI at the joint -> safety: raw verdict
       -> observer: estimate, which may add a verdict -> modes: next mode
       -> safety: bound the command -> units -> drives: encode -> frames
                                               ... and all of it in one CycleRecord
"""

from collections.abc import Sequence
from typing import Final

from gaitd_names import Mode

from daemon.core import cycle_record, inputs
from daemon.core.modes.table import rules_of
from daemon.core.period import cycles
from daemon.core.safety import checks
from daemon.core.safety.inputs import (
    AxisEstimateInputs,
    AxisInputs,
    LegEstimateInputs,
    LegInputs,
    SafetyInputs,
    ServiceInputs,
)
from daemon.core.state import Axis, Core, Leg
from daemon.core.steps import (
    controllers,
    estimation,
    exercises,
    impedance,
    monitors,
    persistence,
    sensing,
    single_axis,
    supervisor,
    targets,
)
from daemon.core.steps.wanted import enable_wanted, enable_wanted_of, is_driving
from daemon.core.tick import Tick
from daemon.ipc.record import CycleRecord, GatewayState, Verdict
from drives.canopen.bus import Frame
from drives.signals import DriveCommand, DriveFeedback

POSE_CYCLES: Final = cycles(1.0)
"""Cycles between two updates of the stored pose, while no drive has power."""


def step(
    core: Core, frames: Sequence[Frame], gateway_states: Sequence[GatewayState], tick: Tick
) -> tuple[list[Frame], CycleRecord]:
    """Run one cycle with drives: from the TPDOs of a SYNC to the RPDOs that follow them.

    The raw checks come before the estimate, which they cannot see. An exception in the estimate
    ends the process, and the next one still finds what the raw checks have found.
    """
    drives = core.drives
    if drives is None:
        raise RuntimeError("a cycle needs drives that have been brought up")
    drives.feed(frames, tick.sync_ns)
    _sense(core, drives.end_of_window(tick.cycle, tick.sync_ns), tick)
    _monitor(core)
    _receive(core, gateway_states, tick.cycle)
    raw = _check_raw(core, tick)
    try:
        estimated = _estimate(core, tick)
    except Exception:
        supervisor.latch(core, raw, tick.cycle, tick.sync_utc_ns)
        raise
    verdicts = checks.harshest_of_each([*raw, *estimated]) if estimated else raw
    supervisor.supervise(core, verdicts, tick.cycle, tick.sync_utc_ns)
    if tick.cycle % POSE_CYCLES == 0 and not is_driving(core):
        persistence.store_poses(core, tick.sync_utc_ns)
    for leg in core.legs:
        enabled = enable_wanted_of(core, leg)
        leg.assist = controllers.advance(leg, core.mode, core.config, tick.cycle, enabled=enabled)
    commanded = commands(core, tick.cycle)
    for leg in core.legs:
        leg.monitored = monitors.with_sent(leg, [enable_wanted(core, axis) for axis in leg.axes])
    return [*drives.frames(commanded), *drives.uploads()], cycle_record.record(core, tick)


def rest(core: Core, gateway_states: Sequence[GatewayState], tick: Tick) -> CycleRecord:
    """Run one cycle without drives: gateway states are read and a record is written.

    What the lost drives have shown last is not repeated: a record has no value that is not of now.
    """
    sensing.forget(core)
    for leg in core.legs:
        leg.estimated = estimation.cleared(leg.estimated)
    _receive(core, gateway_states, tick.cycle)
    supervisor.rest(core, tick.cycle, tick.sync_utc_ns)
    return cycle_record.record(core, tick)


def react(core: Core, frames: Sequence[Frame], tick: Tick, next_cycle: int) -> list[Frame]:
    """Process frames between two windows and stop all drives at once if one sent an alarm.

    Frames are sent only if the stop of an axis became harsher. Otherwise a drive that answers each
    frame with another EMCY (8220h after its own reset) would cause an endless exchange. The stop
    counts from `next_cycle`: after a delay of the core the drives have had no time to obey yet.
    """
    drives = core.drives
    if drives is None or not drives.feed_between(frames, tick.sync_ns):
        return []
    if not is_driving(core):
        return []
    core.inputs = inputs.receive(core.inputs, (), core.boot_id, core.result.id, tick.cycle)
    sensing.peek(core, drives.peek(tick.sync_ns))
    verdicts = _check_raw(core, tick)
    if not verdicts:
        return []
    before = [axis.stop and axis.stop.step for axis in core.axes]
    for verdict in verdicts:
        supervisor.stop(core, verdict, next_cycle)
    if before == [axis.stop and axis.stop.step for axis in core.axes]:
        return []
    return drives.frames(commands(core, next_cycle))


def _sense(core: Core, feedbacks: Sequence[DriveFeedback], tick: Tick) -> None:
    for axis, feedback in zip(core.axes, feedbacks, strict=True):
        before, now = axis.sensed, sensing.inputs_of(core, axis, feedback)
        thresholds = core.config.thresholds
        axis.sensed = sensing.sense(axis, before, feedback, now, thresholds, tick.sync_ns)
        core.publish(sensing.news(axis, before, axis.sensed))
    may_hold = core.mode == Mode.HOLD and all(axis.sensed.reached_enabled for axis in core.axes)
    for leg in core.legs:
        leg.placed, shown = sensing.place(leg, leg.placed, may_hold=may_hold)
        for axis, sensed in zip(leg.axes, shown, strict=True):
            axis.sensed = sensed


def _monitor(core: Core) -> None:
    for leg in core.legs:
        hip, slide = leg.axes
        limits = single_axis.active_limits(core, hip), single_axis.active_limits(core, slide)
        homing = single_axis.is_homing(core, hip) or single_axis.is_homing(core, slide)
        leg.monitored = monitors.update(leg, leg.monitored, limits, core.config, homing=homing)


def _receive(core: Core, gateway_states: Sequence[GatewayState], cycle: int) -> None:
    before, newest_id = core.inputs, core.result.id
    core.inputs = inputs.receive(before, gateway_states, core.boot_id, newest_id, cycle)
    core.publish(inputs.news(before, core.inputs))
    assists, core.assisted = controllers.receive(
        core.legs, core.assisted, core.inputs, core.mode, core.config, cycle
    )
    for leg, assist in zip(core.legs, assists, strict=True):
        leg.assist = assist


def _check_raw(core: Core, tick: Tick) -> tuple[Verdict, ...]:
    verdicts = checks.check_raw(safety_inputs(core, tick))
    sensing.alarms_checked(core)
    return verdicts


def _estimate(core: Core, tick: Tick) -> tuple[Verdict, ...]:
    """Update the estimate and what is seen of the patient in it; returns the reasons to stop."""
    for leg in core.legs:
        before = leg.estimated
        inputs_now = estimation.inputs_of(leg, tick)
        leg.estimated = estimation.estimate(leg.observers, before, inputs_now)
        if not core.config.patient_configured:
            core.publish(estimation.news(leg, before, leg.estimated))
    guided_motion = rules_of(core.mode).is_guided_motion
    for leg in core.legs:
        found = leg.estimated.estimate
        if found is not None:
            leg.softened = monitors.soften(
                leg, leg.softened, found, core.config, guided_motion=guided_motion
            )
            core.publish(monitors.news(leg))
    if not is_driving(core):
        return ()
    legs = [_leg_estimate(core, leg) for leg in core.legs]
    return checks.check_estimate(legs, core.config.thresholds, core.config.categories)


def commands(core: Core, cycle: int) -> list[DriveCommand]:
    """The command to every drive; one that is refused becomes a stop in the same frames."""
    requests = impedance.requests(core)
    bounded = impedance.bounded(core, requests, cycle)
    if bounded is None:
        supervisor.refuse_command(core, cycle)
        pairs = zip(core.axes, requests, strict=True)
        bounded = [targets.without_effort(axis, request) for axis, request in pairs]
    for axis, sent in zip(core.axes, bounded, strict=True):
        axis.sent = sent
    exercises.has_taken_over(core)
    return impedance.command(core)


def safety_inputs(core: Core, tick: Tick) -> SafetyInputs:
    """Collect all that the raw checks read in this cycle."""
    drives = core.drives
    return SafetyInputs(
        service=ServiceInputs(
            stop_requested=core.inputs.stop,
            shutdown_requested=tick.shutdown,
            gateway_age_cycles=tick.cycle - core.inputs.gateway_state_cycle,
            overruns_in_a_row=tick.overruns_in_a_row,
            bus_off=drives is not None and drives.bus_state.has_been_off,
            bus_error=tick.bus_error,
            tx_dropped_in_a_row=tick.tx_dropped_in_a_row,
        ),
        axes=[_axis(core, leg, index) for leg in core.legs for index in (0, 1)],
        legs=[_leg(core, leg) for leg in core.legs],
        thresholds=core.config.thresholds,
        categories=core.config.categories,
        driving=is_driving(core),
    )


def _leg(core: Core, leg: Leg) -> LegInputs:
    return LegInputs(
        name=leg.name,
        singularity_ratio=leg.placed.singularity_ratio,
        stopping_ratio=leg.monitored.stopping_ratio,
        seeks_home=_seeks_home(core, leg),
    )


def _leg_estimate(core: Core, leg: Leg) -> LegEstimateInputs:
    return LegEstimateInputs(
        name=leg.name,
        axes=[_axis_estimate(axis) for axis in leg.axes],
        observer_bad_cycles=leg.estimated.bad_cycles,
        seeks_home=_seeks_home(core, leg),
    )


def _seeks_home(core: Core, leg: Leg) -> bool:
    if core.single_axis is None:
        return False
    return any(single_axis.seeks_home(core, axis) for axis in leg.axes)


def _axis_estimate(axis: Axis) -> AxisEstimateInputs:
    return AxisEstimateInputs(
        name=axis.name,
        limits=axis.limits,
        spasm_cycles=axis.spasm.cycles,
        spasm_rise_si=axis.spasm.rise_si,
        clonus_cycles=axis.clonus.cycles,
        clonus_swing_si=axis.clonus.swing_si,
    )


def _axis(core: Core, leg: Leg, index: int) -> AxisInputs:
    axis = leg.axes[index]
    feedback = axis.sensed.feedback
    if feedback is None:
        raise RuntimeError(f"{axis.name} is judged before it was sensed")
    return AxisInputs(
        name=axis.name,
        feedback=feedback,
        joint=axis.sensed.joint,
        limits=single_axis.active_limits(core, axis),
        referenced=axis.sensed.referenced,
        preparing=core.single_axis is not None,
        homing=single_axis.is_homing(core, axis),
        tracking_si=axis.sensed.tracking_si if core.mode != Mode.STOPPING else 0.0,
        held=leg.is_held,
        wanted_velocity_si=axis.sensed.wanted_velocity_si,
        counts_sign=1 if axis.scaling.counts_per_si > 0 else -1,
        loop_distance_si=targets.loop_distance(axis),
        enable_wanted=enable_wanted(core, axis),
        reached_enabled=axis.sensed.reached_enabled,
        unready_cycles=axis.sensed.unready_cycles,
        unexpected_enable_cycles=axis.sensed.unexpected_enable_cycles,
        shown_unpowered=axis.sensed.shown_unpowered,
        reaction_cycles=axis.reaction_cycles,
        mode_wanted=axis.sent.mode,
        new_emergency=feedback.alarm_count > axis.sensed.emergencies_checked,
        sign_trusted=axis.sensed.sign_trusted,
        watch=leg.monitored.watches[index],
        stride_energy_j=monitors.stride_energy(leg, axis),
        stride_drift_si=monitors.stride_drift(leg, axis),
        stopping_end_si=leg.monitored.stopping_end_si[index],
        bring_up_error=axis.sensed.bring_up_error,
    )
