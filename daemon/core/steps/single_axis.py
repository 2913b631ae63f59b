"""Homing and sign tests of one axis: request, start, progress and end in the core's state.

    READY -> OFF, the drives brought up with the torque limit of the preparation -> READY
          -> REFERENCE or COMMISSION, one axis enabled -> STOPPING -> READY
          -> OFF, the drives brought up with their usual limits -> READY

`exercises/homing.py` and `sign_test.py` have the sequence of one axis. A stop by a verdict ends in
FAULT as in other modes; the reset after it brings the drives up with their usual limits.
"""

from daemon.core.exercises.single_axis import AxisSample, AxisStart, SingleAxis
from daemon.core.modes.persistent_state import prove, with_proof
from daemon.core.modes.table import MODES, Event
from daemon.core.safety import stop_sequence
from daemon.core.safety.limits import AxisLimits
from daemon.core.safety.stop_sequence import Step
from daemon.core.state import Axis, Core
from daemon.core.steps import latching
from daemon.core.steps.transition import enter
from daemon.ipc.record import Mode, ModeRequest
from drives.cia402.power_state import homing_state
from drives.signals import DriveFeedback, HomingState, OperationMode

BEGIN_CYCLES = 500
"""Longest delay from request to motion: a later motion would surprise the operator."""
SINGLE_AXIS_MODES = frozenset(mode for mode, rules in MODES.items() if rules.single_axis)


def moving(core: Core) -> SingleAxis | None:
    """The homing or sign test under way in mode REFERENCE or COMMISSION; None if there is none."""
    return core.single_axis if core.mode in SINGLE_AXIS_MODES else None


def is_homing(core: Core, axis: Axis) -> bool:
    """True if this axis is moved by its drive's own homing."""
    run = core.single_axis
    return run is not None and run.axis == axis.name and run.by_drive


def moves_origin(core: Core, axis: Axis, feedback: DriveFeedback) -> bool:
    """True if this sample is the first after a change of the position's origin by a homing."""
    run = moving(core)
    return run is not None and run.axis == axis.name and run.moves_origin(feedback)


def limits_in_force(core: Core, axis: Axis) -> AxisLimits:
    """The limits of an axis in force now; homing, sign test and hand guiding have their own."""
    run = core.single_axis
    if core.mode == Mode.HAND_GUIDING:
        return axis.limits._replace(velocity_max_si=axis.limits.hand_guiding_speed_max_si)
    if run is None or run.axis != axis.name:
        return axis.limits
    return run.limits(axis.limits, moving=moving(core) is not None)


def axis_named(core: Core, name: str) -> Axis | None:
    """The axis with this name; None if there is none."""
    return next((axis for axis in core.axes if axis.name == name), None)


# --- request --------------------------------------------------------------------------------------


def refusal(core: Core, wanted: ModeRequest, cycle: int) -> str:
    """The reason to refuse a homing, a sign test or its confirmation; empty if it is allowed."""
    axis = axis_named(core, wanted.axis)
    exercise = MODES[wanted.mode].single_axis
    if axis is None or exercise is None:
        known = ", ".join(axis.name for axis in core.axes)
        return f"axis = {wanted.axis!r}, known are: {known}"
    if wanted.witnessed:
        nothing = f"{axis.name} has not been tested since the service's start"
        return "" if axis.name in core.evidence else nothing
    return exercise.may_begin(_start(core, axis, cycle))


def begin(core: Core, wanted: ModeRequest, cycle: int, utc_ns: int) -> None:
    """Start an accepted request: a new bring-up for it, or the confirmation of a sign test."""
    axis = axis_named(core, wanted.axis)
    exercise = MODES[wanted.mode].single_axis
    if axis is None or exercise is None:
        raise RuntimeError(f"there is no axis {wanted.axis!r}: the request was not refused")
    if wanted.witnessed:
        _confirm(core, axis, utc_ns)
        return
    core.evidence.pop(axis.name, None)
    core.single_axis = exercise.begin(_start(core, axis, cycle))
    bring_up_anew(core)


def _start(core: Core, axis: Axis, cycle: int) -> AxisStart:
    config = core.config
    return AxisStart(
        name=axis.name,
        push=axis.push,
        homing=axis.homing,
        sign_proven=axis.sign_proven,
        signs_must_be_proven=config.signs_must_be_proven,
        cycle=cycle,
        period_s=config.period_s,
    )


def _confirm(core: Core, axis: Axis, utc_ns: int) -> None:
    test = core.evidence.pop(axis.name)
    if test.moved_si is None:
        raise RuntimeError(f"{axis.name}: a homing is no evidence of a sign")
    proof = prove(axis.wiring, axis.serial_number, test.moved_si, utc_ns)
    core.notes = with_proof(core.notes, axis.name, proof)
    axis.sign_proven = True
    core.events.append(f"{axis.name}: its sign is proven, {test.evidence}")


def cancel(core: Core, why: str) -> None:
    """Cancel the homing or sign test under way; the usual limits are restored afterwards."""
    run = core.single_axis
    if run is not None and not run.is_over:
        core.single_axis = run.failed(why)
        core.events.append(f"{run.axis}: failed: {why}")


def bring_up_anew(core: Core) -> None:
    """Drop the drives, so that the loop brings them up again with the limits needed next."""
    core.drives = None
    enter(core, Event.BRING_UP_ANEW)
    latching.clear(core)  # called only in READY, where no verdict is latched


# --- time -----------------------------------------------------------------------------------------


def advance(core: Core, cycle: int) -> None:
    """Run one cycle of a homing or sign test: begin it when the drives are up, end it when over."""
    run = core.single_axis
    axis = None if run is None else axis_named(core, run.axis)
    if run is None or axis is None:
        return
    if core.mode == Mode.READY:
        _begin_or_leave(core, axis, run, cycle)
    elif core.mode in SINGLE_AXIS_MODES:
        core.single_axis = run = run.advance(_sample(axis))
        if run.is_over:
            _end(core, axis, run, cycle)


def _begin_or_leave(core: Core, axis: Axis, run: SingleAxis, cycle: int) -> None:
    if run.is_over:
        core.single_axis = None
        bring_up_anew(core)
    elif cycle - run.requested_cycle > BEGIN_CYCLES:
        cancel(core, "the drives and the leg were not ready in time: ask again")
    elif all(_rests(one) for one in core.axes):
        core.single_axis = run.enabling()
        enter(core, MODES[run.mode].event)
        core.events.append(f"{axis.name}: {run.title} begun")


def _sample(axis: Axis) -> AxisSample:
    feedback, homing = axis.feedback, HomingState.NOT_STARTED
    if feedback is not None and feedback.mode_display == OperationMode.HOMING:
        homing = homing_state(feedback.statusword)
    return AxisSample(
        ready=axis.reached_enabled and axis.unready_cycles == 0,
        homing=homing,
        position_si=axis.joint.position_si,
        at_rest=_rests(axis),
    )


def _rests(axis: Axis) -> bool:
    joint = axis.joint
    return joint.fresh and abs(joint.velocity_si) < axis.limits.standstill_si_per_s


def _end(core: Core, axis: Axis, run: SingleAxis, cycle: int) -> None:
    if run.why:
        core.events.append(f"{axis.name}: failed: {run.why}")
    else:
        _take_result(core, axis, run)
    core.disabling = True
    enter(core, Event.EXERCISE_OVER)
    for one in core.axes:
        one.stop = stop_sequence.begin(Step.DISABLE, one.joint, cycle)


def _take_result(core: Core, axis: Axis, run: SingleAxis) -> None:
    result = run.result()
    if result.moved_si is not None:
        core.evidence[axis.name] = result
    if result.homed:
        axis.homed = axis.referenced = True
        axis.unreferenced_why = ""
    core.events.append(f"{axis.name}: {result.text}")


def target_effort_si(core: Core, axis: Axis) -> float:
    """The effort for an axis during a homing or sign test: 0 for every other axis."""
    run = moving(core)
    return run.effort_si if run is not None and run.axis == axis.name else 0.0
