"""Supervisor: applies verdicts, requests and elapsed time to mode, stops and exercises.

`checks.py` finds verdicts, `table.py` has the mode transitions, `stop_sequence.py` brings one drive
to rest. This file applies them to the state of the core, once a cycle, in that order.
"""

from collections.abc import Sequence

from daemon.core.inputs import CommandInputs
from daemon.core.modes.table import Event, rules_of
from daemon.core.safety import stop_sequence
from daemon.core.safety.checks import worse
from daemon.core.safety.stop_sequence import Step
from daemon.core.state import Axis, Core
from daemon.core.steps import (
    controllers,
    daily_test,
    exercises,
    latching,
    requests,
    single_axis,
)
from daemon.core.steps.joints import Joint
from daemon.core.steps.transition import describe, enter
from daemon.ipc.record import Cause, Mode, Stage, Verdict
from daemon.wire.causes import DOUBTFUL_FEEDBACK, LOST_DRIVE
from drives.signals import OperationMode

LOAD_SETTLE_CYCLES = 50
"""Duration of the hold before the load at rest is compared with g(q)."""
RESET_SETTLE_CYCLES = 20
"""Cycles for which a drive must show no fault before a reset is done."""
STOPPING_MAX_CYCLES = 300
"""Longest duration of mode STOPPING.

A leg that still moves afterwards moves without power: the mode is FAULT, the speed is published.
"""

_BUS_CAUSES = frozenset({Cause.BUS_DOWN, Cause.TRANSMIT_QUEUE_FULL})
"""Causes after which bring-up is repeated automatically when no drive is enabled.

Bus-off is not among them: the operator should check the bus first.
"""


def change_mode(
    core: Core, found: Sequence[Verdict], orders: CommandInputs, cycle: int, utc_ns: int
) -> None:
    """Update mode, stops and plans from this cycle's verdicts, requests and time."""
    _take_verdicts(core, found, cycle)
    daily_test.follow(core, utc_ns)
    requests.answer(core, orders, cycle, utc_ns)
    _move_on(core, cycle, utc_ns)
    single_axis.advance(core, cycle)
    requests.finish_request(core)
    latching.follow(core, utc_ns)
    exercises.update_references(core)


# --- questions ------------------------------------------------------------------------------


def driving(core: Core) -> bool:
    """True if a drive is, or may still be, powered by the core's request."""
    if core.mode.active or core.mode == Mode.STOPPING:
        return True
    held = {Step.HOLD, Step.QUICK_STOP}
    return core.mode == Mode.FAULT and any(a.stop and a.stop.step in held for a in core.axes)


def enable_wanted(core: Core, axis: Axis) -> bool:
    """True if this drive should be enabled and produce torque."""
    if axis.stop is not None:
        return axis.stop.step == Step.HOLD
    run = core.single_axis
    return core.mode.active and (run is None or run.axis == axis.name)


def mode_wanted(core: Core, axis: Axis) -> OperationMode:
    """The mode of operation that this drive should be in; a stop does not change the mode."""
    if axis.stop is not None:
        return axis.mode_sent
    if single_axis.is_homing(core, axis):
        return OperationMode.HOMING
    by_torque = rules_of(core.mode).by_torque or core.single_axis is not None
    if by_torque or not core.config.by_position:
        return OperationMode.CYCLIC_SYNC_TORQUE
    return OperationMode.CYCLIC_SYNC_POSITION


def silenced(core: Core) -> bool:
    """True in the last step of escalation: SYNC and heartbeat are no longer sent."""
    return any(axis.stop is not None and axis.stop.step == Step.SILENCE for axis in core.axes)


def nmt_stopped(core: Core) -> tuple[int, ...]:
    """Node ids of the drives to which NMT stop is sent."""
    return tuple(a.node_id for a in core.axes if a.stop and a.stop.step >= Step.NMT_STOP)


def stage(core: Core) -> Stage | None:
    """The stage of the exercise; None without an exercise, and in STOPPING and FAULT."""
    if core.mode in {Mode.STOPPING, Mode.FAULT}:
        return None
    if core.mode == Mode.BRINGING_UP:
        return Stage.PREPARING
    if core.single_axis is not None:
        return core.single_axis.stage
    if core.mode == Mode.HOLD:
        return None if core.load_checked else Stage.PREPARING
    return exercises.stage(core)


def progress(core: Core) -> str:
    """One line of text for the operator about the present activity."""
    if core.mode in {Mode.OFF, Mode.FAULT} and core.verdict.cause != Cause.NONE:
        return describe(core.verdict)
    text = exercises.text(core) if core.mode.active else ""
    if text:
        return f"{core.mode.name.lower()}: {text}"
    if core.single_axis is not None:
        return f"{core.single_axis.axis}: {core.single_axis.step.value}"
    if core.mode == Mode.HOLD and not core.load_checked:
        return "enabling: the load at rest is being compared"
    return core.progress or core.mode.name.lower().replace("_", " ")


# --- verdicts -------------------------------------------------------------------------------


def _take_verdicts(core: Core, found: Sequence[Verdict], cycle: int) -> None:
    stopping_all = driving(core)
    for verdict in found:
        # Power that the core did not request is a reason to stop in every mode.
        if stopping_all or verdict.cause == Cause.UNEXPECTED_ENABLE:
            stop(core, verdict, cycle)
    if found and core.mode == Mode.READY:
        _take_resting_verdict(core, found[0])


def _take_resting_verdict(core: Core, found: Verdict) -> None:
    """Apply a verdict in READY: a lost drive leads to a new bring-up, a fault waits for a reset."""
    if found.cause in LOST_DRIVE or found.cause in _BUS_CAUSES:
        core.verdict = found
        core.drives = None
        core.single_axis = None
        core.reset_cycles_left = 0
        enter(core, Event.DRIVES_LOST)
    elif core.reset_cycles_left == 0:
        core.verdict = found
        enter(core, Event.DRIVE_FAULTY)
    else:
        return
    core.events.append(describe(found))


def stop(core: Core, verdict: Verdict, cycle: int) -> None:
    """Stop all drives for this verdict, or escalate a stop that is under way."""
    if core.mode.active or core.mode == Mode.READY:
        core.verdict = verdict
        core.disabling = False
        core.reset_cycles_left = 0
        core.causes_told = {(verdict.cause, verdict.drive)}
        _begin_stop(
            core, cycle, {axis.name: _first_step(core, verdict, axis) for axis in core.axes}
        )
        _hold_together(core, cycle)
        core.events.append(f"stop {verdict.category.name}: {describe(verdict)}")
        return
    if _takes_its_place(core.verdict, verdict):
        core.verdict = verdict
        core.disabling = False
        core.events.append(f"stop {verdict.category.name}: {describe(verdict)}")
    elif (verdict.cause, verdict.drive) not in core.causes_told:
        core.events.append(f"also: {describe(verdict)}")
    core.causes_told.add((verdict.cause, verdict.drive))
    for axis in core.axes:
        step = _first_step(core, verdict, axis)
        if axis.stop is None:  # in FAULT without one: its drive had no power
            axis.stop = stop_sequence.begin(step, axis.joint, cycle)
        else:
            axis.stop = stop_sequence.harsher(axis.stop, step, axis.joint, cycle)
    _hold_together(core, cycle)


def _takes_its_place(latched: Verdict, verdict: Verdict) -> bool:
    """True if a new verdict is published and latched in place of the latched one."""
    if verdict.cause == Cause.SHUTDOWN and latched.cause != Cause.NONE:
        # A shutdown must not replace the cause why the machine stopped before.
        return False
    # The reason why an axis could not obey is more specific than STOP_NOT_OBEYED.
    explains = latched.cause == Cause.STOP_NOT_OBEYED and verdict.cause in DOUBTFUL_FEEDBACK
    return worse(latched, verdict) is verdict or (explains and verdict.drive == latched.drive)


def _hold_together(core: Core, cycle: int) -> None:
    """Escalate all axes to quick stop as soon as one has left HOLD: all axes stop together."""
    stops = [axis.stop for axis in core.axes if axis.stop is not None]
    if not any(stop.step > Step.HOLD for stop in stops):
        return
    for axis in core.axes:
        if axis.stop is not None:
            axis.stop = stop_sequence.harsher(axis.stop, Step.QUICK_STOP, axis.joint, cycle)


def _first_step(core: Core, verdict: Verdict, axis: Axis) -> Step:
    """First stop step of an axis by category; an axis enabled alone begins with quick stop."""
    step = stop_sequence.possible(stop_sequence.first_step(verdict, axis.name), axis.feedback)
    return step if core.single_axis is None else max(step, Step.QUICK_STOP)


def _begin_stop(core: Core, cycle: int, steps: dict[str, Step]) -> None:
    enter(core, Event.STOP)
    exercises.brake(core)
    for axis in core.axes:
        axis.stop = stop_sequence.begin(steps[axis.name], axis.joint, cycle)


def lose_bus(core: Core, what: str) -> None:
    """Handle a lost bus: enabled drives stop by their own detection; the verdict is published."""
    verdict = Verdict(core.config.categories.of(Cause.BUS_DOWN), Cause.BUS_DOWN, detail=what)
    core.events.append(describe(verdict))
    core.verdict = worse(core.verdict, verdict)
    core.drives = None
    core.disabling = False
    core.single_axis = None
    core.reset_cycles_left = 0
    for axis in core.axes:
        axis.feedback, axis.stop, axis.joint = None, None, Joint()
        axis.homed = False
    if core.mode.active:
        enter(core, Event.STOP)
    if core.mode == Mode.STOPPING:
        enter(core, Event.AT_REST_STOPPED)
    elif core.mode == Mode.READY:
        enter(core, Event.DRIVES_LOST)


# --- time -----------------------------------------------------------------------------------


def _move_on(core: Core, cycle: int, utc_ns: int) -> None:
    """Advance exercises, stops and a fault reset by one cycle."""
    if core.mode == Mode.HOLD and not core.load_checked:
        _settle(core, cycle)
    _let_lapse(core, cycle)
    exercises.advance(core, mode_changing=_changes_mode(core))
    if core.mode.active and exercises.is_over(core):
        _end_exercise(core, cycle, utc_ns)
    if core.mode in {Mode.STOPPING, Mode.FAULT}:
        _advance_stops(core, cycle)
    if core.mode == Mode.READY and core.reset_cycles_left > 0:
        _await_reset(core)


def _let_lapse(core: Core, cycle: int) -> None:
    """If assist has lost its lease or its setpoints: brake from where the leg is, and hold."""
    reason = controllers.lapse(core, cycle)
    if not reason:
        return
    exercises.brake_and_hold(core)
    core.lapse_count += 1
    core.lapse_reason = reason
    enter(core, Event.LEASE_LAPSED)


def _settle(core: Core, cycle: int) -> None:
    """After enabling, hold the leg where it is, then compare the load at rest with g(q)."""
    if not all(axis.reached_enabled for axis in core.axes):
        core.load_settle_cycles = 0
        exercises.hold_here(core)
        return
    core.load_settle_cycles += 1
    if core.load_settle_cycles < LOAD_SETTLE_CYCLES:
        return
    for axis in core.axes:
        excess_si = abs(axis.joint.effort_si - axis.gravity_si)
        if excess_si > axis.limits.static_load_tolerance_si:
            cause = Cause.STATIC_LOAD_WRONG
            category = core.config.categories.of(cause)
            limit_si = axis.limits.static_load_tolerance_si
            stop(core, Verdict(category, cause, axis.name, excess_si, limit_si), cycle)
            return
    core.load_checked = True


def _changes_mode(core: Core) -> bool:
    """True if a drive has not yet been sent the mode wanted; all legs begin together."""
    return any(axis.mode_sent != mode_wanted(core, axis) for axis in core.axes)


def _end_exercise(core: Core, cycle: int, utc_ns: int) -> None:
    failed = daily_test.conclude(core, utc_ns) if core.mode == Mode.SELF_TEST else None
    if failed is not None:
        stop(core, failed, cycle)
        return
    exercises.end(core)
    enter(core, Event.EXERCISE_OVER)


def _advance_stops(core: Core, cycle: int) -> None:
    for axis in core.axes:
        if axis.stop is None or axis.feedback is None:
            continue
        before = axis.stop
        rules = core.config.stop_rules._replace(reaction_cycles=axis.reaction_cycles)
        axis.stop = stop_sequence.advance(
            before, axis.feedback, axis.joint, axis.limits, rules, cycle
        )
        if axis.stop.step > before.step and axis.stop.disobeyed:
            _report_disobedience(core, axis, before.step)
    _hold_together(core, cycle)
    if core.mode == Mode.STOPPING and _stopped(core, cycle):
        _come_to_rest(core)


def _report_disobedience(core: Core, axis: Axis, step: Step) -> None:
    cause = Cause.STOP_NOT_OBEYED
    speed_si = abs(axis.joint.velocity_si)
    detail = f"after {step.name.lower()}, at {speed_si:.3g} per s"
    verdict = Verdict(core.config.categories.of(cause), cause, axis.name, detail=detail)
    core.verdict = worse(core.verdict, verdict)
    core.disabling = False
    core.events.append(describe(verdict))


def _stopped(core: Core, cycle: int) -> bool:
    """True if every axis is at rest, without recent samples, or past the longest stop time."""
    rules = core.config.stop_rules
    age_max = core.config.thresholds.sample_age_max_cycles
    for axis in core.axes:
        stopped = axis.stop
        if stopped is None or axis.feedback is None:
            continue
        unseen = axis.feedback.sample_age_cycles > age_max
        over = cycle - stopped.since_cycle > STOPPING_MAX_CYCLES
        if not (stop_sequence.is_at_rest(stopped, rules) or unseen or over):
            return False
    return True


def _come_to_rest(core: Core) -> None:
    if core.disabling:
        enter(core, Event.AT_REST_WELL)
        exercises.clear(core)
        for axis in core.axes:
            axis.stop = None
    else:
        enter(core, Event.AT_REST_STOPPED)


def _await_reset(core: Core) -> None:
    """End a requested fault reset when no drive is in fault any more, or its time is over.

    A drive whose cause persists may leave its fault and come back to it some cycles later.
    """
    known = all(axis.joint.known for axis in core.axes)
    faulty = any(axis.feedback is not None and axis.feedback.in_fault for axis in core.axes)
    left = max(core.reset_settle_cycles - 1, 0)
    core.reset_settle_cycles = RESET_SETTLE_CYCLES if faulty else left
    ended = known and core.reset_settle_cycles == 0
    core.reset_cycles_left = 0 if ended else core.reset_cycles_left - 1


def power_off(core: Core, cycle: int) -> None:
    """Disable voltage on all drives in every mode: the end of an orderly shutdown."""
    for axis in core.axes:
        if axis.stop is None or axis.stop.step < Step.DISABLE:
            axis.stop = stop_sequence.begin(Step.DISABLE, axis.joint, cycle)
