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
from daemon.core.state import Core
from daemon.core.steps import (
    checking,
    controllers,
    estimation,
    exercises,
    impedance,
    monitors,
    passive,
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
    raw = checking.check_raw(core, tick)
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
    verdicts = checking.check_raw(core, tick)
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


def _estimate(core: Core, tick: Tick) -> tuple[Verdict, ...]:
    """Update the estimate and what is seen of the patient in it; returns the reasons to stop."""
    for leg in core.legs:
        before = leg.estimated
        inputs_now = estimation.inputs_of(leg, tick)
        leg.estimated = estimation.estimate(leg.observers, before, inputs_now)
        if not core.config.patient_configured:
            core.publish(estimation.news(leg, before, leg.estimated))
    for leg in core.legs:
        known_before = leg.passive
        leg.passive = passive.advance(leg, known_before, core.mode, tick.cycle)
        if leg.passive is not known_before:
            core.publish(passive.news(leg, known_before, leg.passive))
    guided_motion = rules_of(core.mode).is_guided_motion
    for leg in core.legs:
        found = leg.estimated.estimate
        if found is not None:
            leg.softened = monitors.soften(
                leg, leg.softened, found, core.config, guided_motion=guided_motion
            )
            core.publish(monitors.news(leg))
    return checking.check_estimate(core)


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
