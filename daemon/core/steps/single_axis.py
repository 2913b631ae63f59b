"""Homing and sign tests of one axis: request, start, progress and end in the core's state.

    READY -> OFF, the drives brought up with the torque limit of the preparation -> READY
          -> REFERENCE or COMMISSION, one axis enabled -> STOPPING -> READY
          -> OFF, the drives brought up with their usual limits -> READY

`exercises/homing.py` and `sign_test.py` have the sequence of one axis. A stop by a verdict ends in
FAULT as in other modes; the reset after it brings the drives up with their usual limits.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

from gaitd_names import EventCode, Failure, Mode, RefusalCode, Trigger

from daemon.core.exercises.single_axis import AxisSample, AxisStart, AxisStep, SingleAxis
from daemon.core.modes.persistent_state import SignProof, prove
from daemon.core.modes.table import MODES
from daemon.core.period import cycles
from daemon.core.safety.joints import is_at_rest
from daemon.core.safety.limits import AxisLimits
from daemon.core.state import Axis, Core
from daemon.ipc.record import ModeRequest
from daemon.ipc.report import Refusal
from drives.bringup.bringup import DriveReport
from drives.cia402.power_state import homing_state
from drives.signals import DriveFeedback, HomingState, OperationMode

BEGIN_CYCLES: Final = cycles(5.0)
"""Longest delay from request to motion: a later motion would surprise the operator."""
SINGLE_AXIS_MODES = frozenset(mode for mode, rules in MODES.items() if rules.single_axis)


def moving(core: Core) -> SingleAxis | None:
    """The homing or sign test under way in mode REFERENCE or COMMISSION; None if there is none."""
    run = core.single_axis
    return run if run is not None and core.mode in SINGLE_AXIS_MODES else None


def is_homing(core: Core, axis: Axis) -> bool:
    """True if this axis is moved by its drive's own homing."""
    run = core.single_axis
    return run is not None and run.axis == axis.name and run.by_drive


def seeks_home(core: Core, axis: Axis) -> bool:
    """True from the begin of this axis's homing until its home is found: its origin is in doubt.

    After a homing that was stopped or failed, until the drives are brought up again: the drive may
    have moved the origin.
    """
    run = core.single_axis
    return is_homing(core, axis) and run is not None and run.step is not AxisStep.DONE


def moves_origin(core: Core, axis: Axis, feedback: DriveFeedback) -> bool:
    """True if this sample is the first after a change of the position's origin by a homing."""
    run = moving(core)
    return run is not None and run.axis == axis.name and run.moves_origin(feedback)


def active_limits(core: Core, axis: Axis) -> AxisLimits:
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


def refusal(core: Core, wanted: ModeRequest, cycle: int) -> Refusal | None:
    """The reason to refuse a homing, a sign test or its confirmation; None if it is allowed."""
    axis = axis_named(core, wanted.axis)
    exercise = MODES[wanted.mode].single_axis
    if axis is None or exercise is None:
        known = ", ".join(axis.name for axis in core.axes)
        return Refusal(RefusalCode.NO_SUCH_AXIS, said=known)
    if wanted.witnessed:
        tested = axis.name in core.evidence
        return None if tested else Refusal(RefusalCode.NOT_TESTED, axis.name)
    return exercise.may_begin(_start(core, axis, cycle))


def begin(core: Core, wanted: ModeRequest, cycle: int) -> None:
    """Start an accepted homing or sign test; the drives must be brought up anew."""
    axis = axis_named(core, wanted.axis)
    exercise = MODES[wanted.mode].single_axis
    if axis is None or exercise is None:
        raise RuntimeError(f"there is no axis {wanted.axis!r}: the request was not refused")
    core.evidence.pop(axis.name, None)
    core.single_axis = exercise.begin(_start(core, axis, cycle))


def confirmed(core: Core, wanted: ModeRequest, utc_ns: int) -> tuple[Axis, SignProof]:
    """The axis of an accepted confirmation, and the proof of its sign that has been witnessed."""
    axis = axis_named(core, wanted.axis)
    test = None if axis is None else core.evidence.pop(axis.name, None)
    if axis is None or test is None or test.moved_si is None:
        raise RuntimeError(f"{wanted.axis!r} has no sign test: the request was not refused")
    core.report(EventCode.SIGN_PROVEN, axis.name, *test.evidence)
    return axis, prove(axis.wiring, axis.serial_number, test.moved_si, utc_ns)


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


def cancel(core: Core, why: Failure) -> None:
    """Cancel the homing or sign test under way; the usual limits are restored afterwards."""
    run = core.single_axis
    if run is not None and not run.is_over:
        core.single_axis = run.failed(why)
        core.report(EventCode.SINGLE_AXIS_FAILED, run.axis, why)


def drop(core: Core) -> None:
    """No homing or sign test any more: the drives were lost or reset."""
    core.single_axis = None


def drop_tests_of_other_drives(core: Core, reports: Sequence[DriveReport]) -> None:
    """Drop the sign tests of axes that have another drive since; before `sensing.begin`."""
    for axis, report in zip(core.axes, reports, strict=True):
        if axis.is_other_drive(report.serial_number):
            core.evidence.pop(axis.name, None)


# --- time -----------------------------------------------------------------------------------------


class Change(NamedTuple):
    """A change of the mode that the supervisor makes for a homing or sign test."""

    trigger: Trigger
    homing: Axis | None = None
    """The axis whose position is doubtful until its homing has ended."""
    homed: Axis | None = None
    """The axis whose position is valid from now on."""


def advance(core: Core, cycle: int) -> Change | None:
    """Run one cycle of a homing or sign test: begin it when the drives are up, end it when over."""
    run = core.single_axis
    axis = None if run is None else axis_named(core, run.axis)
    if run is None or axis is None:
        return None
    if core.mode == Mode.READY:
        return _begin_or_leave(core, axis, run, cycle)
    if core.mode not in SINGLE_AXIS_MODES:
        return None
    core.single_axis = run = run.advance(_sample(axis))
    return _end(core, axis, run) if run.is_over else None


def _begin_or_leave(core: Core, axis: Axis, run: SingleAxis, cycle: int) -> Change | None:
    if run.is_over:
        core.single_axis = None
        return Change(Trigger.BRING_UP_RESTARTED)
    if cycle - run.requested_cycle > BEGIN_CYCLES:
        cancel(core, Failure.NOT_READY)
    elif all(_rests(one) for one in core.axes):
        core.single_axis = run.enabling()
        homing = axis if run.by_drive else None
        return Change(MODES[run.mode].trigger, homing)
    return None


def _sample(axis: Axis) -> AxisSample:
    feedback, homing = axis.sensed.feedback, HomingState.NOT_STARTED
    if feedback is not None and feedback.mode_display == OperationMode.HOMING:
        homing = homing_state(feedback.statusword)
    return AxisSample(
        ready=axis.sensed.reached_enabled and axis.sensed.unready_cycles == 0,
        homing=homing,
        position_si=axis.sensed.joint.position_si,
        at_rest=_rests(axis),
    )


def _rests(axis: Axis) -> bool:
    return axis.sensed.joint.fresh and is_at_rest(axis.sensed.joint, axis.limits)


def _end(core: Core, axis: Axis, run: SingleAxis) -> Change:
    if run.why is not Failure.NONE:
        core.report(EventCode.SINGLE_AXIS_FAILED, axis.name, run.why)
        return Change(Trigger.EXERCISE_OVER)
    result = run.result()
    if result.moved_si is not None:
        core.evidence[axis.name] = result
    core.report(result.code, axis.name, *result.evidence)
    return Change(Trigger.EXERCISE_OVER, homed=axis if result.homed else None)


def target_effort_si(core: Core, axis: Axis) -> float:
    """The effort for an axis during a homing or sign test: 0 for every other axis."""
    run = moving(core)
    return run.effort_si if run is not None and run.axis == axis.name else 0.0
