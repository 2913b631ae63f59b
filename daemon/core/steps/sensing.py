"""Drive samples become joints: position, speed, effort, references, and the readiness of drives.

This file is the only writer of these fields of `Axis` and `Leg`.
"""

from collections.abc import Sequence
from typing import Final

from gaitd_names import Doubt, EventCode, Mode

from daemon.core.modes.persistent_state import disagreement
from daemon.core.safety import joints
from daemon.core.safety.joints import Joint, jump_reach_si
from daemon.core.state import Axis, Core, Leg
from daemon.core.steps import single_axis, wanted
from daemon.core.tick import Tick
from drives.bringup.bringup import DriveReport
from drives.bringup.plan import DrivePlan
from drives.cia402.power_state import CANNOT_EXERT_TORQUE
from drives.cia402.units import axis_scaling, position_si
from drives.signals import DriveFeedback, OperationMode, PowerState
from observer.mechanism.mechanism import ratio_and_load

_OFF: Final = frozenset(
    {PowerState.NOT_READY_TO_SWITCH_ON, PowerState.SWITCH_ON_DISABLED, PowerState.FAULT}
)
"""States from which no single controlword enables power, so a delayed controlword cannot either."""


def sense(core: Core, feedbacks: Sequence[DriveFeedback], tick: Tick) -> None:
    """Update the joints from the drive samples, and check their references and drive states."""
    for axis, feedback in zip(core.axes, feedbacks, strict=True):
        _report_overdue(core, axis, feedback)
        axis.feedback = feedback
        # Homing moves the origin of the position: that step must not count as motion.
        moved = single_axis.moves_origin(core, axis, feedback)
        before = Joint() if moved else axis.joint
        axis.joint = joints.measure(before, feedback, axis.scaling, axis.limits, tick.sync_ns)
        lost = _reference_lost(core, axis, feedback)
        if lost is not Doubt.NONE and axis.referenced:
            axis.referenced, axis.doubt = False, lost
            core.report(EventCode.REFERENCE_LOST, axis.name, lost)
        # A silent drive may have lost its power, and with it its position.
        silent = feedback.sample_age_cycles > core.config.thresholds.sample_age_max_cycles
        axis.followed = axis.followed and axis.referenced and not silent
        axis.watched = axis.watched and not silent and not feedback.rebooted
        axis.sign_trusted = axis.sign_trusted and axis.watched and lost is Doubt.NONE
        _count_readiness(core, axis, feedback)
        if feedback.fresh and not feedback.in_fault:
            axis.bring_up_error = 0, ""
    for leg in core.legs:
        _place(leg)
        leg.held_cycles = leg.held_cycles + 1 if _is_held(core, leg) else 0


def _report_overdue(core: Core, axis: Axis, feedback: DriveFeedback) -> None:
    before = axis.feedback is not None and axis.feedback.temperature_overdue
    if feedback.temperature_overdue and not before:
        core.report(EventCode.TEMPERATURE_OVERDUE, axis.name)
    elif before and not feedback.temperature_overdue:
        core.report(EventCode.TEMPERATURE_BACK, axis.name)


def _reference_lost(core: Core, axis: Axis, feedback: DriveFeedback) -> Doubt:
    """The reason why the position of an axis is no longer valid; NONE while it is valid."""
    if feedback.rebooted:
        return Doubt.REBOOTED
    if feedback.reference_lost:
        return Doubt.ENCODER_ERROR
    reach_si = jump_reach_si(axis.joint, axis.limits, core.config.thresholds)
    return Doubt.ENCODER_JUMPED if abs(axis.joint.step_si) > reach_si else Doubt.NONE


def _count_readiness(core: Core, axis: Axis, feedback: DriveFeedback) -> None:
    state = feedback.power_state
    if not wanted.enable_wanted(core, axis):
        axis.shown_unpowered = axis.shown_unpowered or state in _OFF
        held = axis.stop is not None and not axis.shown_unpowered
        if held or state in CANNOT_EXERT_TORQUE:
            axis.unexpected_enable_cycles = 0
        elif feedback.fresh or state != PowerState.UNKNOWN:
            # A drive that has shown nothing since bring-up is silent, not enabled by another one.
            axis.unexpected_enable_cycles += 1
        axis.reached_enabled, axis.unready_cycles = False, 0
        return
    axis.shown_unpowered, axis.unexpected_enable_cycles = False, 0
    ready = (
        state == PowerState.OPERATION_ENABLED
        and feedback.mode_display == axis.mode_sent
        and (feedback.following or axis.mode_sent == OperationMode.HOMING)
    )
    axis.reached_enabled = axis.reached_enabled or ready
    axis.unready_cycles = 0 if ready else axis.unready_cycles + 1


def _place(leg: Leg) -> None:
    """Compute holding load, singularity ratio and tracking error of a leg from raw encoders."""
    hip, slide = leg.axes
    if not leg.is_located:
        leg.singularity_ratio = 1.0
        return
    leg.singularity_ratio, hip_nm, slide_n = ratio_and_load(
        leg.mechanism, hip.joint.position_si, slide.joint.position_si
    )
    if leg.singularity_ratio > 0:
        hip.gravity_si, slide.gravity_si = hip_nm, slide_n
    reference = leg.reference
    for index, axis in enumerate(leg.axes):
        axis.tracking_si = axis.wanted_velocity_si = 0.0
        if reference is not None and reference.guided:
            axis.tracking_si = axis.joint.position_si - reference.position[index]
            axis.wanted_velocity_si = reference.velocity[index]


def _is_held(core: Core, leg: Leg) -> bool:
    """True if mode HOLD holds a pose: all drives are enabled, and the reference stands still.

    Until then the pose to hold follows the leg (`supervisor.py`).
    """
    reference = leg.reference
    still = reference is not None and reference.guided and reference.velocity == (0.0, 0.0)
    return core.mode == Mode.HOLD and still and all(axis.reached_enabled for axis in core.axes)


# --- between two windows, and without drives ------------------------------------------------------


def peek(core: Core, feedbacks: Sequence[DriveFeedback]) -> None:
    """Take the drive states of frames that came between two windows; the joints stay."""
    for axis, feedback in zip(core.axes, feedbacks, strict=True):
        axis.feedback = feedback


def alarms_checked(core: Core) -> None:
    """All EMCY alarms up to now have been checked."""
    for axis in core.axes:
        if axis.feedback is not None:
            axis.emergencies_checked = axis.feedback.alarm_count


# --- references, bring-up and loss ----------------------------------------------------------------


def take_home(axis: Axis) -> None:
    """The axis has been homed: its position is valid."""
    axis.followed = axis.referenced = True
    axis.doubt = Doubt.NONE


def doubt(core: Core, name: str) -> None:
    """The position of this axis is doubtful: the next bring-up compares its encoder again.

    After doubtful feedback; and from the begin of a homing, which may move the origin and not end.
    """
    for axis in core.axes:
        axis.followed = axis.followed and axis.name != name


def trust_sign(axis: Axis, *, trusted: bool) -> None:
    """After a bring-up or a test of the sign: whether motion against the drive may be a person."""
    axis.sign_trusted = trusted


def doubt_sign(core: Core, name: str) -> None:
    """After doubtful feedback the sign of this axis explains nothing until it is tested again."""
    for axis in core.axes:
        axis.sign_trusted = axis.sign_trusted and axis.name != name


def lose_positions(core: Core) -> None:
    """The state of the drives is unknown: each may have lost its power, or be another one."""
    for axis in core.axes:
        axis.followed = axis.watched = False


def forget(core: Core) -> None:
    """There are no drives: no state of a drive or a joint is known any more."""
    for axis in core.axes:
        axis.feedback, axis.joint = None, Joint()


def begin(core: Core, plans: Sequence[DrivePlan], reports: Sequence[DriveReport]) -> None:
    """Begin with the drives that have just been brought up."""
    forget(core)
    for axis, plan, report in zip(core.axes, plans, reports, strict=True):
        axis.scaling = axis_scaling(plan.description, report.base)
        axis.serial_number = report.serial_number
        axis.doubt = _doubt(core, axis, plan, report)
        axis.referenced = axis.followed = axis.doubt is Doubt.NONE
        axis.watched = True
        axis.reached_enabled, axis.unready_cycles, axis.unexpected_enable_cycles = False, 0, 0
        axis.shown_unpowered = True  # bring-up goes on with no drive that has power
        axis.emergencies_checked = 0
        axis.bring_up_error = report.error_code, report.error_text


def _doubt(core: Core, axis: Axis, plan: DrivePlan, report: DriveReport) -> Doubt:
    """The reason why an axis is not referenced; NONE if it is.

    An axis is referenced if it was homed, or if its absolute encoder agrees with the stored pose.
    It stays referenced while it is followed, though the leg has moved since the pose was stored:
    no pose is stored while drives hold the leg after a stop, until a reset brings them up again.
    """
    if report.reference_lost:
        return Doubt.ENCODER_ERROR
    reports_homed = plan.description.profile.referenced_bit is not None
    if axis.followed and (report.absolute or report.homed or not reports_homed):
        return Doubt.NONE
    if not report.absolute:
        return Doubt.NONE if report.homed else Doubt.NOT_HOMED
    here_si = position_si(report.position_counts, axis.scaling)
    return disagreement(core.persistent, axis.name, here_si, axis.poses)
