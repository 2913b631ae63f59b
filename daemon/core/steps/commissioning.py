"""Homing and sign tests of one axis: request, start, progress and end in the core's state.

    READY -> OFF, the drives brought up with the torque limit of the preparation -> READY
          -> REFERENCE or COMMISSION, one axis enabled -> STOPPING -> READY
          -> OFF, the drives brought up with their usual limits -> READY

`single_axis.py` has the sequence of one axis. A stop by a verdict ends in FAULT as in other modes;
the reset after it brings the drives up with their usual limits.
"""

from dataclasses import replace

from daemon.core.modes.persistent_state import prove, with_proof
from daemon.core.modes.table import Event
from daemon.core.motion import single_axis
from daemon.core.motion.single_axis import (
    HOME_FOUND,
    OVER,
    Homing,
    Preparation,
    PreparationStep,
    Seen,
    SignTest,
)
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
MODES = frozenset({Mode.REFERENCE, Mode.COMMISSION})


def in_work(core: Core) -> Preparation | None:
    """The homing or sign test under way in mode REFERENCE or COMMISSION; None if there is none."""
    return core.preparation if core.mode in MODES else None


def is_homing(core: Core, axis: Axis) -> bool:
    """True if this axis is moved by its drive's own homing."""
    run = core.preparation
    return isinstance(run, Homing) and run.axis == axis.name


def finds_home(core: Core, axis: Axis, feedback: DriveFeedback) -> bool:
    """True if this sample is the first that shows home as attained or reached."""
    run = in_work(core)
    if not isinstance(run, Homing) or run.axis != axis.name or not run.begun:
        return False
    if feedback.mode_display != OperationMode.HOMING:
        return False
    shown = homing_state(feedback.statusword)
    return shown in HOME_FOUND and shown is not run.found


def limits_in_force(core: Core, axis: Axis) -> AxisLimits:
    """The limits of an axis in force now; homing, sign test and hand guiding have their own."""
    run = core.preparation
    if core.mode == Mode.HAND_GUIDING:
        return axis.limits._replace(velocity_max_si=axis.limits.hand_guiding_speed_max_si)
    if run is None or run.axis != axis.name:
        return axis.limits
    limits = axis.limits._replace(effort_max_si=run.rules.effort_max_si)
    if isinstance(run, Homing) and in_work(core) is not None:
        return limits._replace(velocity_max_si=run.rules.speed_max_si_per_s)
    return limits


def axis_named(core: Core, name: str) -> Axis | None:
    """The axis with this name; None if there is none."""
    return next((axis for axis in core.axes if axis.name == name), None)


# --- request --------------------------------------------------------------------------------------


def refusal(core: Core, wanted: ModeRequest) -> str:
    """The reason to refuse a homing, a sign test or its confirmation; empty if it is allowed."""
    axis = axis_named(core, wanted.axis)
    if axis is None:
        known = ", ".join(axis.name for axis in core.axes)
        return f"axis = {wanted.axis!r}, known are: {known}"
    if wanted.witnessed:
        nothing = f"{axis.name} has not been tested since the service's start"
        return "" if axis.name in core.evidence else nothing
    if wanted.mode == Mode.REFERENCE and axis.homing is None:
        return f"{axis.name} has no [homing] in its axis file"
    if wanted.mode == Mode.REFERENCE and core.config.signs_must_be_proven and not axis.sign_proven:
        return f"the sign of {axis.name} is not proven: commission it first"
    return ""


def ask(core: Core, wanted: ModeRequest, cycle: int, utc_ns: int) -> None:
    """Start an accepted request: a new bring-up for it, or the confirmation of a sign test."""
    axis = axis_named(core, wanted.axis)
    if axis is None:
        raise RuntimeError(f"there is no axis {wanted.axis!r}: the request was not refused")
    if wanted.witnessed:
        _believe(core, axis, utc_ns)
        return
    core.evidence.pop(axis.name, None)
    core.preparation = _of(core, axis, wanted.mode, cycle)
    bring_up_anew(core)


def _of(core: Core, axis: Axis, mode: Mode, cycle: int) -> Preparation:
    if mode == Mode.COMMISSION:
        return SignTest(axis.name, cycle, axis.push, core.config.period_s)
    if axis.homing is None:
        raise RuntimeError(f"{axis.name} cannot be homed: the request was not refused")
    return Homing(axis.name, cycle, axis.homing)


def _believe(core: Core, axis: Axis, utc_ns: int) -> None:
    test = core.evidence.pop(axis.name)
    moved_si = (test.moved_forth_si, test.moved_back_si)
    proof = prove(axis.wiring, axis.serial_number, moved_si, utc_ns)
    core.notes = with_proof(core.notes, axis.name, proof)
    axis.sign_proven = True
    core.events.append(f"{axis.name}: its sign is proven, {single_axis.evidence(test)}")


def cancel(core: Core, why: str) -> None:
    """Cancel the homing or sign test under way; the usual limits are restored afterwards."""
    run = core.preparation
    if run is not None and run.step not in OVER:
        core.preparation = replace(run, step=PreparationStep.FAILED, why=why)
        core.events.append(f"{run.axis}: failed: {why}")


def bring_up_anew(core: Core) -> None:
    """Drop the drives, so that the loop brings them up again with the limits needed next."""
    core.drives = None
    enter(core, Event.BRING_UP_ANEW)
    latching.clear(core)  # called only in READY, where no verdict is latched


# --- time -----------------------------------------------------------------------------------------


def move_on(core: Core, cycle: int) -> None:
    """Run one cycle of a homing or sign test: begin it when the drives are up, end it when over."""
    run = core.preparation
    if run is None:
        return
    axis = axis_named(core, run.axis)
    if axis is None:
        return
    if core.mode == Mode.READY:
        _begin_or_leave(core, axis, run, cycle)
    elif core.mode in MODES:
        core.preparation = run = single_axis.advance(run, _seen(axis))
        if run.step in OVER:
            _end(core, axis, run, cycle)


def _begin_or_leave(core: Core, axis: Axis, run: Preparation, cycle: int) -> None:
    if run.step in OVER:
        core.preparation = None
        bring_up_anew(core)
    elif cycle - run.asked_cycle > BEGIN_CYCLES:
        cancel(core, "the drives and the leg were not ready in time: ask again")
    elif all(_rests(one) for one in core.axes):
        core.preparation = single_axis.begin(run)
        homing = isinstance(run, Homing)
        enter(core, Event.TO_REFERENCE if homing else Event.TO_COMMISSION)
        core.events.append(f"{axis.name}: {'homing' if homing else 'sign test'} begun")


def _seen(axis: Axis) -> Seen:
    feedback, homing = axis.feedback, HomingState.NOT_STARTED
    if feedback is not None and feedback.mode_display == OperationMode.HOMING:
        homing = homing_state(feedback.statusword)
    return Seen(
        ready=axis.reached_enabled and axis.unready_cycles == 0,
        homing=homing,
        position_si=axis.joint.position_si,
        at_rest=_rests(axis),
    )


def _rests(axis: Axis) -> bool:
    joint = axis.joint
    return joint.fresh and abs(joint.velocity_si) < axis.limits.standstill_si_per_s


def _end(core: Core, axis: Axis, run: Preparation, cycle: int) -> None:
    _tell_end(core, axis, run)
    core.disabling = True
    enter(core, Event.EXERCISE_OVER)
    for one in core.axes:
        one.stop = stop_sequence.begin(Step.DISABLE, one.joint, cycle)


def _tell_end(core: Core, axis: Axis, run: Preparation) -> None:
    if run.step is PreparationStep.FAILED:
        core.events.append(f"{axis.name}: failed: {run.why}")
    elif isinstance(run, SignTest):
        core.evidence[axis.name] = run
        core.events.append(f"{axis.name}: moves with its torque: {single_axis.evidence(run)}")
    else:
        axis.homed = axis.referenced = True
        axis.unreferenced_why = ""
        core.events.append(f"{axis.name}: homed")


def target_effort_si(core: Core, axis: Axis) -> float:
    """The effort for an axis during a homing or sign test: 0 for every other axis."""
    run = in_work(core)
    return run.effort_si if run is not None and run.axis == axis.name else 0.0
