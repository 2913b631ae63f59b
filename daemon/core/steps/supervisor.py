"""Supervisor: applies verdicts, requests and elapsed time to mode, stops and exercises.

`checks.py` finds verdicts, `table.py` has the mode transitions, `stop_sequence.py` brings one drive
to rest. This file applies them to the state of the core, once a cycle, in that order.

This file is the only writer of the mode and what belongs to it: the verdict, the stop of each axis,
the counters of enabling and reset, and whether there are drives.
"""

from collections.abc import Sequence
from typing import Final

from gaitd_names import (
    POWER_STATES,
    Cause,
    EventCode,
    Failure,
    Finding,
    Mode,
    ProgressCode,
    RequestKind,
    Trigger,
)

from daemon.core.exercises.exercise import LegSample
from daemon.core.modes import latched_stop, table
from daemon.core.modes.table import MODES
from daemon.core.period import cycles
from daemon.core.safety import stop_sequence
from daemon.core.safety.checks import worse
from daemon.core.safety.stop_sequence import Step
from daemon.core.state import Axis, Core
from daemon.core.steps import (
    controllers,
    exercises,
    monitors,
    passive,
    persistence,
    requests,
    sensing,
    single_axis,
)
from daemon.core.steps.wanted import is_driving, is_mode_changing
from daemon.ipc.record import Request, Verdict
from daemon.ipc.report import Progress
from daemon.wire.causes import DOUBTFUL_FEEDBACK, LOST_DRIVE
from drives.cia402.drive import DriveGroup
from drives.signals import PowerState

LOAD_SETTLE_CYCLES: Final = cycles(0.5)
"""Duration of the hold before the load at rest is compared with g(q)."""
RESET_CYCLES: Final = cycles(1.0)
"""Longest duration of a requested fault reset."""
RESET_SETTLE_CYCLES: Final = cycles(0.2)
"""Cycles for which a drive must show no fault before a reset is done."""
STOPPING_MAX_CYCLES: Final = cycles(3.0)
"""Longest duration of mode STOPPING.

A leg that still moves afterwards moves without power: the mode is FAULT, the speed is published.
"""

_DISOBEYED: Final = {
    Step.HOLD: Finding.NOT_HELD,
    Step.QUICK_STOP: Finding.NOT_STOPPED,
    Step.DISABLE: Finding.NOT_DISABLED,
    Step.NMT_STOP: Finding.NOT_STOPPED_BY_NMT,
}
_BUS_CAUSES: Final = frozenset({Cause.BUS_DOWN, Cause.TRANSMIT_QUEUE_FULL})
"""Causes after which bring-up is repeated automatically when no drive is enabled.

Bus-off is not among them: the operator should check the bus first.
"""


def supervise(core: Core, verdicts: Sequence[Verdict], cycle: int, utc_ns: int) -> None:
    """Update mode, stops and exercises from this cycle's verdicts, requests and time."""
    _take_verdicts(core, verdicts, cycle)
    persistence.check_day(core, utc_ns)
    _take_request(core, cycle, utc_ns)
    samples = _advance(core, cycle, utc_ns)
    _advance_single_axis(core, cycle)
    requests.finish(core)
    persistence.update_latch(core, utc_ns)
    persistence.store_sign_doubts(core)
    exercises.update_references(core, samples)


def latch(core: Core, verdicts: Sequence[Verdict], cycle: int, utc_ns: int) -> None:
    """Stop for these verdicts and latch them for the next core: this one ends by an exception."""
    _take_verdicts(core, verdicts, cycle)
    persistence.update_latch(core, utc_ns)


def rest(core: Core, cycle: int, utc_ns: int) -> None:
    """Answer requests while there are no drives."""
    _take_request(core, cycle, utc_ns)
    requests.finish(core)
    persistence.update_latch(core, utc_ns)


def _change(core: Core, trigger: Trigger) -> None:
    """Apply a row of the mode table: the only assignment of the mode.

    Raises:
        IllegalTransitionError: there is no such row: a programming error.
    """
    core.mode = table.next_mode(core.mode, trigger)
    core.bring_up = None


def _enter(core: Core, trigger: Trigger) -> None:
    """Apply a row of the mode table, and publish the change."""
    before = core.mode
    _change(core, trigger)
    core.report(EventCode.MODE_CHANGED, "", before, core.mode, trigger)


# --- requests -------------------------------------------------------------------------------


def _take_request(core: Core, cycle: int, utc_ns: int) -> None:
    if core.inputs.stop:
        single_axis.cancel(core, Failure.STOP_REQUESTED)
    request = requests.receive(core, cycle)
    if request is not None:
        _execute(core, request, cycle, utc_ns)


def _execute(core: Core, request: Request, cycle: int, utc_ns: int) -> None:
    if requests.is_of_single_axis(request) and request.mode.witnessed:
        persistence.prove_sign(core, *single_axis.confirmed(core, request.mode, utc_ns))
    elif requests.is_of_single_axis(request):
        single_axis.begin(core, request.mode, cycle)
        _restart_bring_up(core)
    elif request.kind == RequestKind.ENABLE:
        _enter(core, Trigger.ENABLE)
        core.verdict = Verdict()
        core.load_checked, core.load_settle_cycles = False, 0
        monitors.clear_energy(core)
    elif request.kind == RequestKind.DISABLE:
        core.disabling = True
        _enter(core, Trigger.DISABLE)
        exercises.brake(core)
        # An axis that is enabled alone is disabled; else both axes hold first. A drive that is not
        # enabled yet is not enabled in order to hold.
        step = Step.HOLD if core.single_axis is None else Step.DISABLE
        for axis in core.axes:
            possible = stop_sequence.possible(step, axis.sensed.feedback)
            axis.stop = stop_sequence.begin(possible, axis.sensed.joint, cycle)
        single_axis.cancel(core, Failure.DISABLE_REQUESTED)
    elif request.kind == RequestKind.RESET:
        _enter(core, Trigger.RESET)
        persistence.clear_latch(core)
        core.drives = None
        single_axis.drop(core)
        core.verdict = Verdict()
        core.reset_cycles_left, core.reset_settle_cycles = RESET_CYCLES, 0
    else:
        exercises.begin(core, request.mode)
        if request.mode.mode == Mode.GAIT and request.mode.baseline:
            for leg in core.legs:
                leg.passive = passive.begun(leg, core.config.gait.ramp_strides)
                core.report(EventCode.BASELINE_BEGUN, leg.name)
        assists, core.assisted = controllers.begun(
            core.legs, core.assisted, request, core.inputs.lease
        )
        for leg, assist in zip(core.legs, assists, strict=True):
            leg.assist = assist
        _enter(core, MODES[request.mode.mode].trigger)


def _restart_bring_up(core: Core) -> None:
    """Drop the drives, so that the loop brings them up again with the limits needed next."""
    core.drives = None
    _enter(core, Trigger.BRING_UP_RESTARTED)
    persistence.clear_latch(core)  # called only in READY, where no verdict is latched


def _advance_single_axis(core: Core, cycle: int) -> None:
    change = single_axis.advance(core, cycle)
    if change is None:
        return
    if change.homing is not None:
        sensing.doubt(core, change.homing.name)
    if change.homed is not None:
        sensing.take_home(change.homed)
    if change.trigger is Trigger.BRING_UP_RESTARTED:
        _restart_bring_up(core)
        return
    ended = change.trigger is Trigger.EXERCISE_OVER
    if ended:
        core.disabling = True
    _enter(core, change.trigger)
    begun = single_axis.moving(core)
    if begun is not None:
        core.report(EventCode.SINGLE_AXIS_BEGUN, begun.axis, begun.mode)
    if ended:
        for axis in core.axes:
            axis.stop = stop_sequence.begin(Step.DISABLE, axis.sensed.joint, cycle)


# --- verdicts -------------------------------------------------------------------------------


def _take_verdicts(core: Core, verdicts: Sequence[Verdict], cycle: int) -> None:
    stopping_all = is_driving(core)
    for verdict in verdicts:
        # Power that the core did not request is a reason to stop in every mode.
        if stopping_all or verdict.cause == Cause.UNEXPECTED_ENABLE:
            stop(core, verdict, cycle)
    if verdicts and core.mode == Mode.READY:
        _take_resting_verdict(core, verdicts[0])


def _take_resting_verdict(core: Core, verdict: Verdict) -> None:
    """Apply a verdict in READY: a lost drive leads to a new bring-up, a fault waits for a reset."""
    if verdict.cause in LOST_DRIVE or verdict.cause in _BUS_CAUSES:
        core.verdict = verdict
        core.drives = None
        single_axis.drop(core)
        core.reset_cycles_left = 0
        _enter(core, Trigger.DRIVES_LOST)
    elif core.reset_cycles_left == 0:
        core.verdict = verdict
        _enter(core, Trigger.DRIVE_FAULTY)
    else:
        return
    _report_cause(core, EventCode.CAUSE_FOUND, verdict)


def stop(core: Core, verdict: Verdict, cycle: int) -> None:
    """Stop all drives for this verdict, or escalate a stop that is under way."""
    if verdict.cause in DOUBTFUL_FEEDBACK:
        sensing.doubt(core, verdict.drive)
        sensing.doubt_sign(core, verdict.drive)
    first = core.mode.active or core.mode == Mode.READY
    if first:
        _enter(core, Trigger.STOP)
        exercises.brake(core)
        core.reset_cycles_left = 0
        core.causes_reported = set()
    if first or _replaces(core.verdict, verdict):
        core.verdict = verdict
        core.disabling = False
        _report_cause(core, EventCode.STOPPED, verdict)
    elif (verdict.cause, verdict.drive) not in core.causes_reported:
        _report_cause(core, EventCode.FURTHER_CAUSE, verdict)
    core.causes_reported.add((verdict.cause, verdict.drive))
    for axis in core.axes:
        step = _first_step(core, verdict, axis)
        if axis.stop is None:  # the first verdict, or in FAULT where its drive had no power
            judged = verdict.cause == Cause.MOVED_AGAINST_DRIVE and verdict.drive == axis.name
            axis.stop = stop_sequence.begin(step, axis.sensed.joint, cycle, must_slow=judged)
        else:
            axis.stop = stop_sequence.harsher(axis.stop, step, axis.sensed.joint, cycle)
    _stop_together(core, cycle)


def refuse_command(core: Core, cycle: int) -> None:
    """Stop all drives: a number of their command is not finite."""
    stop(core, _verdict(core, Cause.COMMAND_NOT_FINITE), cycle)


def _verdict(core: Core, cause: Cause, drive: str = "", said: str = "") -> Verdict:
    """The verdict of a cause that this file finds."""
    return Verdict(core.config.categories.of(cause), cause, drive, said=said)


def _report_cause(core: Core, code: EventCode, verdict: Verdict, *values: float) -> None:
    core.report(code, verdict.drive, *verdict.values, *values, said=verdict.said)


def _replaces(latched: Verdict, verdict: Verdict) -> bool:
    """True if a new verdict is published and latched in place of the latched one."""
    if verdict.cause == Cause.SHUTDOWN and latched.cause != Cause.NONE:
        # A shutdown must not replace the cause why the machine stopped before.
        return False
    # The reason why an axis could not obey is more specific than STOP_NOT_OBEYED.
    explains = latched.cause == Cause.STOP_NOT_OBEYED and verdict.cause in DOUBTFUL_FEEDBACK
    harsher = verdict.category.severity > latched.category.severity
    return harsher or (explains and verdict.drive == latched.drive)


def _stop_together(core: Core, cycle: int) -> None:
    """Escalate all axes to quick stop as soon as one has left HOLD: all axes stop together."""
    stops = [(axis, axis.stop) for axis in core.axes if axis.stop is not None]
    if any(stop.step > Step.HOLD for _, stop in stops):
        for axis, stop in stops:
            axis.stop = stop_sequence.harsher(stop, Step.QUICK_STOP, axis.sensed.joint, cycle)


def _first_step(core: Core, verdict: Verdict, axis: Axis) -> Step:
    """First stop step of an axis by category; an axis enabled alone begins with quick stop."""
    step = stop_sequence.possible(
        stop_sequence.first_step(verdict, axis.name), axis.sensed.feedback
    )
    return step if core.single_axis is None else max(step, Step.QUICK_STOP)


def lose_bus(core: Core, what: str) -> None:
    """Handle a lost bus: enabled drives stop by their own detection; the verdict is published."""
    verdict = _verdict(core, Cause.BUS_DOWN, "", what)
    _report_cause(core, EventCode.CAUSE_FOUND, verdict)
    core.verdict = worse(core.verdict, verdict)
    core.drives = None
    core.disabling = False
    single_axis.drop(core)
    core.reset_cycles_left = 0
    sensing.forget(core)
    sensing.lose_positions(core)
    exercises.reset(core)
    for axis in core.axes:
        axis.stop = None
    if core.mode.active:
        _enter(core, Trigger.STOP)
    if core.mode == Mode.STOPPING:
        _enter(core, Trigger.AT_REST_STOPPED)
    elif core.mode == Mode.READY:
        _enter(core, Trigger.DRIVES_LOST)


# --- time -----------------------------------------------------------------------------------


def _advance(core: Core, cycle: int, utc_ns: int) -> list[LegSample]:
    """Advance exercises, stops and a fault reset by one cycle; returns what exercises have read."""
    if core.mode == Mode.HOLD and not core.load_checked:
        _settle(core, cycle)
    _check_lapse(core, cycle)
    samples = exercises.samples_of(core, mode_changing=is_mode_changing(core))
    exercises.advance(core, samples)
    if core.mode.active and exercises.is_over(core):
        _end_exercise(core, cycle, utc_ns)
    if core.mode in {Mode.STOPPING, Mode.FAULT}:
        _advance_stops(core, cycle)
    if core.mode == Mode.READY and core.reset_cycles_left > 0:
        _await_reset(core)
    return samples


def _check_lapse(core: Core, cycle: int) -> None:
    """If assist has lost its lease or its setpoints: brake from where the leg is, and hold."""
    lapsed = controllers.lapse(
        core.legs, core.assisted, core.inputs.lease, core.mode, core.config, cycle
    )
    if lapsed is not None:
        core.assisted = lapsed
        exercises.brake_and_hold(core)
        _enter(core, Trigger.LEASE_LAPSED)


def _settle(core: Core, cycle: int) -> None:
    """After enabling, hold the leg where it is, then compare the load at rest with g(q)."""
    if not all(axis.sensed.reached_enabled for axis in core.axes):
        core.load_settle_cycles = 0
        exercises.hold_here(core)
        return
    core.load_settle_cycles += 1
    if core.load_settle_cycles < LOAD_SETTLE_CYCLES:
        return
    for axis in core.axes:
        excess_si = abs(axis.sensed.joint.effort_si - axis.sensed.gravity_si)
        if excess_si > axis.limits.static_load_tolerance_si:
            cause = Cause.STATIC_LOAD_WRONG
            category = core.config.categories.of(cause)
            limit_si = axis.limits.static_load_tolerance_si
            stop(core, Verdict(category, cause, axis.name, excess_si, limit_si), cycle)
            return
    core.load_checked = True


def _end_exercise(core: Core, cycle: int, utc_ns: int) -> None:
    failed = persistence.finish_self_test(core, utc_ns) if core.mode == Mode.SELF_TEST else None
    if failed is not None:
        stop(core, failed, cycle)
        return
    exercises.end(core)
    _enter(core, Trigger.EXERCISE_OVER)


def _advance_stops(core: Core, cycle: int) -> None:
    for axis in core.axes:
        if axis.stop is None or axis.sensed.feedback is None:
            continue
        before = axis.stop
        rules = core.config.stop_rules._replace(reaction_cycles=axis.reaction_cycles)
        axis.stop = stop_sequence.advance(
            before, axis.sensed.feedback, axis.sensed.joint, axis.limits, rules, cycle
        )
        if axis.stop.step > before.step and axis.stop.disobeyed:
            _report_stop_not_obeyed(core, axis, before.step)
    _stop_together(core, cycle)
    if core.mode == Mode.STOPPING and _stopped(core, cycle):
        _come_to_rest(core)


def _report_stop_not_obeyed(core: Core, axis: Axis, step: Step) -> None:
    cause, speed_si = Cause.STOP_NOT_OBEYED, abs(axis.sensed.joint.velocity_si)
    category = core.config.categories.of(cause)
    verdict = Verdict(category, cause, axis.name, speed_si, finding=_DISOBEYED[step])
    core.verdict = worse(core.verdict, verdict)
    core.disabling = False
    _report_cause(core, EventCode.CAUSE_FOUND, verdict)


def _stopped(core: Core, cycle: int) -> bool:
    """True if every axis is at rest, without recent samples, or past the longest stop time."""
    rules = core.config.stop_rules
    age_max = core.config.thresholds.sample_age_max_cycles
    return all(
        stop_sequence.is_resting(axis.stop, rules)
        or axis.sensed.feedback.sample_age_cycles > age_max
        or cycle - axis.stop.since_cycle > STOPPING_MAX_CYCLES
        for axis in core.axes
        if axis.stop is not None and axis.sensed.feedback is not None
    )


def _come_to_rest(core: Core) -> None:
    if core.disabling:
        _enter(core, Trigger.AT_REST_WELL)
        exercises.clear(core)
        for axis in core.axes:
            axis.stop = None
    else:
        _enter(core, Trigger.AT_REST_STOPPED)


def _await_reset(core: Core) -> None:
    """End a requested fault reset when no drive is in fault any more, or its time is over.

    A drive whose cause persists may leave its fault and come back to it some cycles later.
    """
    known = all(axis.sensed.joint.known for axis in core.axes)
    faulty = any(
        axis.sensed.feedback is not None and axis.sensed.feedback.in_fault for axis in core.axes
    )
    left = max(core.reset_settle_cycles - 1, 0)
    core.reset_settle_cycles = RESET_SETTLE_CYCLES if faulty else left
    ended = known and core.reset_settle_cycles == 0
    core.reset_cycles_left = 0 if ended else core.reset_cycles_left - 1


def power_off(core: Core, cycle: int) -> None:
    """Disable voltage on all drives in every mode: the end of an orderly shutdown."""
    for axis in core.axes:
        if axis.stop is None or axis.stop.step < Step.DISABLE:
            axis.stop = stop_sequence.begin(Step.DISABLE, axis.sensed.joint, cycle)


# --- bring-up -------------------------------------------------------------------------------------


def begin_bring_up(core: Core) -> None:
    """The loop begins to bring up the drives."""
    _change(core, Trigger.BRING_UP_BEGUN)
    core.report(EventCode.BRING_UP_BEGUN)


def show_progress(core: Core, drive: str, done_count: int, total_count: int) -> None:
    """Show the step of the bring-up."""
    core.bring_up = Progress(ProgressCode.SETTING_UP, drive, (done_count, total_count))


def take_drives(core: Core, drives: DriveGroup) -> None:
    """All drives are up: READY, or FAULT where a stop is latched since an earlier start."""
    core.drives = drives
    for axis in core.axes:
        axis.stop = None
    core.verdict = Verdict()
    core.load_checked = False
    latched = _take_latch(core)
    _change(core, Trigger.STILL_LATCHED if latched else Trigger.BRING_UP_DONE)


def wait_for_reset(core: Core, drive: str, state: PowerState) -> None:
    """Enter FAULT because a drive still holds the leg; it holds until a reset is requested."""
    cause = Cause.DRIVE_POWERED
    category = core.config.categories.of(cause)
    core.verdict = Verdict(category, cause, drive, float(state), finding=Finding.POWER_STATE)
    _change(core, Trigger.DRIVE_FAULTY)
    sensing.lose_positions(core)
    single_axis.drop(core)
    core.reset_cycles_left = 0
    latched = core.persistent.latched
    if latched is not None and latched_stop.verdict_of(latched).cause != Cause.LAST_END_UNKNOWN:
        _take_latch(core)
    core.report(EventCode.DRIVE_HOLDS, drive, POWER_STATES[state])


def fail_bring_up(core: Core, cause: Cause, drive: str, said: str) -> None:
    """Return to OFF with a verdict; an event is published only if the verdict is a new one."""
    if core.mode == Mode.BRINGING_UP:
        _change(core, Trigger.DRIVES_LOST)
    verdict = _verdict(core, cause, drive, said)
    if verdict != core.verdict:
        core.report(EventCode.BRING_UP_FAILED, drive, cause, said=said)
    core.verdict = verdict
    single_axis.drop(core)
    core.reset_cycles_left = 0
    core.bring_up = None
    sensing.lose_positions(core)


def _take_latch(core: Core) -> bool:
    """Restore a latched verdict after a restart; returns True if there is one."""
    latched = core.persistent.latched
    if latched is None:
        return False
    core.verdict = verdict = latched_stop.verdict_of(latched)
    core.causes_reported = {(verdict.cause, verdict.drive)}
    _report_cause(core, EventCode.STILL_LATCHED, verdict, latched.utc_ns * 1e-9)
    return True
