"""Which targets a drive gets in which mode, without a step in torque or position over a switch.

Every command carries both targets, since a drive may begin to go by either one at any SYNC:

    6061h shows     target torque 6071h                target position 607Ah
    ------------    -------------------------------    ----------------------------------------
    torque mode     what guidance wants, bounded       the present position
    ... while 8 is  the same; near rest the last one,  the present position; once 8 is asked
    wanted          so that friction brings it to rest for, that of the same SYNC, held
    position mode   the present torque                 what guidance wants, bounded
    ... while 10 is the present torque                 the last one, held: the drive still obeys
    asked for
    not enabled     0 (or what will hold the pose)     the present position

8 is asked for once the joint is at rest: a position loop that begins on a moving one kicks it.
A target that guidance takes over begins where it was and not where the plan is: the difference
fades away. So does the one between the target and the leg when a stop begins in position mode,
which brakes from where the leg is.
"""

import math
from typing import Final

from daemon.core import safety
from daemon.core.state import Axis
from drives.signals import DriveFeedback, OperationMode, PowerState

FADE_S: Final = 0.2
"""Time constant with which a difference at a hand-over fades."""
TORQUE: Final = OperationMode.CYCLIC_SYNC_TORQUE
POSITION: Final = OperationMode.CYCLIC_SYNC_POSITION


def effort(
    axis: Axis,
    wanted_si: float,
    mode: OperationMode,
    dt_s: float,
    *,
    pushing: bool,
    leaving: bool,
) -> float | None:
    """The effort to send, N·m or N; None if a number is not finite.

    Args:
        axis: its `effort_offset_si` is renewed.
        wanted_si: what guidance asks for.
        mode: the mode that is asked for with it.
        dt_s: nominal time between two commands.
        pushing: the drive is meant to be enabled.
        leaving: another mode is wanted than torque mode, as soon as the joint is at rest.
    """
    if not pushing:
        axis.effort_offset_si, axis.effort_mean_si = 0.0, axis.gravity_si
        return safety.bound(0.0, 0.0, axis.limits, dt_s)
    if _shown(axis) == TORQUE:
        axis.effort_offset_si *= _faded(dt_s)
        # Before a drive pushes, its target may go straight to what will hold the pose.
        last_si = axis.effort_sent_si if axis.reached_enabled else axis.gravity_si
        if leaving and _is_slow(axis):
            return safety.bound(axis.effort_mean_si, last_si, axis.limits, dt_s)
        sent_si = safety.bound(wanted_si + axis.effort_offset_si, last_si, axis.limits, dt_s)
        axis.effort_mean_si += (1 - _faded(dt_s)) * ((sent_si or 0.0) - axis.effort_mean_si)
        return sent_si
    present_si = safety.bound(axis.joint.effort_si, axis.joint.effort_si, axis.limits, dt_s)
    if present_si is not None and mode == TORQUE:
        axis.effort_offset_si = present_si - wanted_si
    return present_si


def position(
    axis: Axis, wanted_si: float, mode: OperationMode, dt_s: float, *, pushing: bool
) -> float | None:
    """The position to send, rad or m; None if a number is not finite.

    Args:
        axis: its `position_offset_si` is renewed.
        wanted_si: where guidance wants it.
        mode: the mode that is asked for with it.
        dt_s: nominal time between two commands.
        pushing: the drive is meant to be enabled.
    """
    feedback = axis.feedback
    obeying = _obeys_position(axis)
    if obeying and pushing and mode == POSITION and feedback is not None and feedback.following:
        axis.position_offset_si *= _faded(dt_s)
        aim_si = wanted_si + axis.position_offset_si
        return safety.bound_position(aim_si, axis.position_sent_si, axis.limits, dt_s)
    asked_before = mode == POSITION == axis.mode_sent
    held = obeying or (_is_enabled(feedback) and asked_before)
    sent_si = axis.position_sent_si if held else axis.joint.position_si
    axis.position_offset_si = sent_si - wanted_si if pushing else 0.0
    return sent_si if math.isfinite(wanted_si) else None


def brake_from_the_target(axis: Axis, wanted_si: float, velocity_si: float, dt_s: float) -> None:
    """A stop begins: from the target, which goes on as fast as the leg, back to where the leg is.

    Args:
        axis: its `position_offset_si` is renewed.
        wanted_si: where the plan that brakes begins: where the leg is.
        velocity_si: of that plan.
        dt_s: nominal time between two commands.
    """
    axis.position_offset_si = axis.position_sent_si + velocity_si * dt_s - wanted_si


def loop_distance(axis: Axis) -> float:
    """From where the drive's own loops hold the joint; infinite where they do not hold it."""
    if _obeys_position(axis):
        return abs(axis.position_sent_si - axis.joint.position_si)
    state = PowerState.UNKNOWN if axis.feedback is None else axis.feedback.power_state
    rested = axis.stop is not None and axis.stop.has_rested
    return 0.0 if rested and state == PowerState.QUICK_STOP_ACTIVE else math.inf


def note_motion(axis: Axis, position_si: float, dt_s: float) -> None:
    """Speed and acceleration of a target that the drive goes by, before it replaces the last."""
    if not _obeys_position(axis):
        axis.speed_sent_si = axis.acceleration_sent_si = 0.0
        return
    speed_si = (position_si - axis.position_sent_si) / dt_s
    axis.acceleration_sent_si = (speed_si - axis.speed_sent_si) / dt_s
    axis.speed_sent_si = speed_si


def _obeys_position(axis: Axis) -> bool:
    return _is_enabled(axis.feedback) and _shown(axis) == POSITION


def _is_slow(axis: Axis) -> bool:
    return abs(axis.joint.velocity_si) < axis.limits.standstill_si_per_s


def _faded(dt_s: float) -> float:
    return math.exp(-dt_s / FADE_S)


def _shown(axis: Axis) -> int:
    return axis.feedback.mode_display if axis.feedback is not None else OperationMode.NONE


def _is_enabled(feedback: DriveFeedback | None) -> bool:
    return feedback is not None and feedback.power_state == PowerState.OPERATION_ENABLED
