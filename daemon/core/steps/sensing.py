"""Drive samples become joints: position, speed, effort, references, and the readiness of drives.

This file makes `Sensed` and `Placed`, and writes scaling and serial number of an axis.
"""

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from gaitd_names import Doubt, EventCode
from msgspec import Struct
from msgspec.structs import replace

from daemon.core.exercises.exercise import Reference
from daemon.core.modes.persistent_state import disagreement
from daemon.core.motion.gait_shape import Pair
from daemon.core.safety import joints
from daemon.core.safety.joints import Joint, jump_reach_si
from daemon.core.safety.limits import AxisLimits, Thresholds
from daemon.core.slices import Placed, Sensed
from daemon.core.state import Axis, Core, Leg
from daemon.core.steps import single_axis, wanted
from daemon.ipc.report import Event
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


class SensingInputs(Struct, frozen=True):
    """What the sensing of one axis reads beside its samples: what is wanted of its drive."""

    origin_moved: bool
    """See `Sensed`."""
    enable_wanted: bool
    is_stopping: bool
    mode_sent: OperationMode


def inputs_of(core: Core, axis: Axis, feedback: DriveFeedback) -> SensingInputs:
    """Collect what the sensing of an axis reads beside its sample."""
    return SensingInputs(
        origin_moved=single_axis.moves_origin(core, axis, feedback),
        enable_wanted=wanted.enable_wanted(core, axis),
        is_stopping=axis.stop is not None,
        mode_sent=axis.sent.mode,
    )


def sense(
    axis: Axis,
    before: Sensed,
    feedback: DriveFeedback,
    now: SensingInputs,
    thresholds: Thresholds,
    sync_ns: int,
) -> Sensed:
    """Measure the joint of an axis, and check its reference and the state of its drive.

    Args:
        axis: limits and scaling are read.
        before: what was sensed in the cycle before.
        feedback: the newest sample of its drive.
        now: what is wanted of the drive.
        thresholds: of the safety checks.
        sync_ns: monotonic time of this cycle's SYNC.
    """
    # Homing moves the origin of the position: that step must not count as motion.
    last = Joint() if now.origin_moved else before.joint
    joint = joints.measure(last, feedback, axis.scaling, axis.limits, sync_ns)
    why = _reference_lost(joint, axis.limits, feedback, thresholds)
    lost = why is not Doubt.NONE
    referenced = before.referenced and not lost
    # A silent drive may have lost its power, and with it its position.
    silent = feedback.sample_age_cycles > thresholds.sample_age_max_cycles
    watched = before.watched and not silent and not feedback.rebooted
    readiness = _readiness(before, feedback, now)
    return replace(
        before,
        feedback=feedback,
        joint=joint,
        origin_moved=now.origin_moved,
        referenced=referenced,
        followed=before.followed and referenced and not silent,
        doubt=why if lost and before.referenced else before.doubt,
        watched=watched,
        sign_trusted=before.sign_trusted and watched and not lost,
        shown_unpowered=readiness.shown_unpowered,
        reached_enabled=readiness.reached_enabled,
        unready_cycles=readiness.unready_cycles,
        unexpected_enable_cycles=readiness.unexpected_enable_cycles,
        bring_up_error=(
            (0, "") if feedback.fresh and not feedback.in_fault else before.bring_up_error
        ),
    )


def news(axis: Axis, before: Sensed, after: Sensed) -> Iterator[Event]:
    """A temperature that is overdue or back, a lost reference, an error code without an EMCY."""
    overdue = after.feedback is not None and after.feedback.temperature_overdue
    was_overdue = before.feedback is not None and before.feedback.temperature_overdue
    if overdue != was_overdue:
        yield Event(
            EventCode.TEMPERATURE_OVERDUE if overdue else EventCode.TEMPERATURE_BACK, axis.name
        )
    shown = None if before.feedback is None else before.feedback.fault_code
    if after.feedback is not None and after.feedback.fault_code not in (0, shown):
        code, said = after.feedback.fault_code, after.feedback.error_text
        yield Event(EventCode.ERROR_CODE_SHOWN, axis.name, (float(code),), said)
    if before.referenced and not after.referenced:
        yield Event(EventCode.REFERENCE_LOST, axis.name, (after.doubt,))


def _reference_lost(
    joint: Joint, limits: AxisLimits, feedback: DriveFeedback, thresholds: Thresholds
) -> Doubt:
    """The reason why the position of an axis is no longer valid; NONE while it is valid."""
    if feedback.rebooted:
        return Doubt.REBOOTED
    if feedback.reference_lost:
        return Doubt.ENCODER_ERROR
    reach_si = jump_reach_si(joint, limits, thresholds)
    return Doubt.ENCODER_JUMPED if abs(joint.step_si) > reach_si else Doubt.NONE


class Readiness(NamedTuple):
    """How far a drive shows the power that is wanted; see `Sensed`."""

    shown_unpowered: bool
    reached_enabled: bool
    unready_cycles: int
    unexpected_enable_cycles: int


def _readiness(before: Sensed, feedback: DriveFeedback, now: SensingInputs) -> Readiness:
    state = feedback.power_state
    if not now.enable_wanted:
        unpowered = before.shown_unpowered or state in _OFF
        unexpected_cycles = before.unexpected_enable_cycles
        if (now.is_stopping and not unpowered) or state in CANNOT_EXERT_TORQUE:
            unexpected_cycles = 0
        elif feedback.fresh or state != PowerState.UNKNOWN:
            # A drive that has shown nothing since bring-up is silent, not enabled by another one.
            unexpected_cycles += 1
        return Readiness(unpowered, False, 0, unexpected_cycles)
    ready = (
        state == PowerState.OPERATION_ENABLED
        and feedback.mode_display == now.mode_sent
        and (feedback.following or now.mode_sent == OperationMode.HOMING)
    )
    reached = before.reached_enabled or ready
    return Readiness(False, reached, 0 if ready else before.unready_cycles + 1, 0)


def place(leg: Leg, before: Placed, *, may_hold: bool) -> tuple[Placed, tuple[Sensed, Sensed]]:
    """Compute where a leg is: singularity ratio, holding load and tracking error.

    Args:
        leg: what its axes show and its reference are read.
        before: of the last cycle.
        may_hold: mode HOLD with all drives enabled. Until then the pose to hold follows the leg.

    Returns:
        The place of the leg, and what hip and slide show with load and tracking error.
    """
    hip, slide = (axis.sensed for axis in leg.axes)
    guided = leg.reference if leg.reference is not None and leg.reference.guided else None
    held = may_hold and guided is not None and guided.velocity == (0.0, 0.0)
    held_cycles = before.held_cycles + 1 if held else 0
    if not leg.is_located:
        return Placed(held_cycles=held_cycles), (hip, slide)
    ratio, hip_nm, slide_n = ratio_and_load(
        leg.mechanism, hip.joint.position_si, slide.joint.position_si
    )
    loads = (hip_nm, slide_n) if ratio > 0 else (hip.gravity_si, slide.gravity_si)
    after = _tracked(hip, 0, loads, guided), _tracked(slide, 1, loads, guided)
    return Placed(ratio, held_cycles), after


def _tracked(sensed: Sensed, index: int, loads: Pair, guided: Reference | None) -> Sensed:
    tracking_si = wanted_velocity_si = 0.0
    if guided is not None:
        tracking_si = sensed.joint.position_si - guided.position[index]
        wanted_velocity_si = guided.velocity[index]
    return replace(
        sensed,
        gravity_si=loads[index],
        tracking_si=tracking_si,
        wanted_velocity_si=wanted_velocity_si,
    )


# --- between two windows, and without drives ------------------------------------------------------


def peek(core: Core, feedbacks: Sequence[DriveFeedback]) -> None:
    """Take the drive states of frames that came between two windows; the joints stay."""
    for axis, feedback in zip(core.axes, feedbacks, strict=True):
        axis.sensed = replace(axis.sensed, feedback=feedback)


def alarms_checked(core: Core) -> None:
    """All EMCY alarms up to now have been checked."""
    for axis in core.axes:
        feedback = axis.sensed.feedback
        if feedback is not None and feedback.alarm_count != axis.sensed.emergencies_checked:
            axis.sensed = replace(axis.sensed, emergencies_checked=feedback.alarm_count)


# --- references, bring-up and loss ----------------------------------------------------------------


def take_home(axis: Axis) -> None:
    """The axis has been homed: its position is valid."""
    axis.sensed = replace(axis.sensed, followed=True, referenced=True, doubt=Doubt.NONE)


def doubt(core: Core, name: str) -> None:
    """The position of this axis is doubtful: the next bring-up compares its encoder again.

    After doubtful feedback; and from the begin of a homing, which may move the origin and not end.
    """
    for axis in core.axes:
        if axis.name == name:
            axis.sensed = replace(axis.sensed, followed=False)


def trust_sign(axis: Axis, *, trusted: bool) -> None:
    """After a bring-up or a test of the sign: whether motion against the drive may be a person."""
    axis.sensed = replace(axis.sensed, sign_trusted=trusted)


def doubt_sign(core: Core, name: str) -> None:
    """After doubtful feedback the sign of this axis explains nothing until it is tested again."""
    for axis in core.axes:
        if axis.name == name:
            axis.sensed = replace(axis.sensed, sign_trusted=False)


def lose_positions(core: Core) -> None:
    """The state of the drives is unknown: each may have lost its power, or be another one."""
    for axis in core.axes:
        axis.sensed = replace(axis.sensed, followed=False, watched=False)


def forget(core: Core) -> None:
    """There are no drives: no state of a drive or a joint is known any more."""
    for axis in core.axes:
        axis.sensed = replace(axis.sensed, feedback=None, joint=Joint())


def begin(core: Core, plans: Sequence[DrivePlan], reports: Sequence[DriveReport]) -> None:
    """Begin with the drives that have just been brought up."""
    forget(core)
    for axis, plan, report in zip(core.axes, plans, reports, strict=True):
        axis.scaling = axis_scaling(plan.description, report.base)
        axis.serial_number = report.serial_number
        doubted = _doubt(core, axis, plan, report)
        known = doubted is Doubt.NONE
        axis.sensed = replace(
            axis.sensed,
            referenced=known,
            followed=known,
            doubt=doubted,
            watched=True,
            shown_unpowered=True,  # bring-up goes on with no drive that has power
            reached_enabled=False,
            unready_cycles=0,
            unexpected_enable_cycles=0,
            emergencies_checked=0,
            bring_up_error=(report.error_code, report.error_text),
        )


def _doubt(core: Core, axis: Axis, plan: DrivePlan, report: DriveReport) -> Doubt:
    """The reason why an axis is not referenced; NONE if it is.

    An axis is referenced if it was homed, or if its absolute encoder agrees with the stored pose.
    It stays referenced while it is followed, though the leg has moved since the pose was stored:
    no pose is stored while drives hold the leg after a stop, until a reset brings them up again.
    """
    if report.reference_lost:
        return Doubt.ENCODER_ERROR
    reports_homed = plan.description.profile.referenced_bit is not None
    if axis.sensed.followed and (report.absolute or report.homed or not reports_homed):
        return Doubt.NONE
    if not report.absolute:
        return Doubt.NONE if report.homed else Doubt.NOT_HOMED
    here_si = position_si(report.position_counts, axis.scaling)
    return disagreement(core.persistent, axis.name, here_si, axis.poses)
