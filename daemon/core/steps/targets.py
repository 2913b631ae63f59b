"""Targets of a drive in each mode, without a step in torque or position at a mode change.

Every command carries both targets, since a drive may begin to follow either one at any SYNC:

    6061h shows     target torque 6071h                target position 607Ah
    ------------    -------------------------------    ----------------------------------------
    torque mode     bounded target of guidance         the present position
    ... while 8 is  the same; near rest its mean, so   the present position; once 8 has been
    wanted          that friction brings it to rest    sent, that of the same SYNC, held
    position mode   the present torque                 bounded target of guidance
    ... while 10    the present torque                 the last one, held: the drive still
    is requested                                       follows it
    not enabled     0 (or what will hold the pose)     the present position

Mode 8 is requested once the joint is at rest: a position loop that starts on a moving joint jerks
it. When guidance takes a target over, the target starts at its last value, and the difference to
the plan fades to zero. This applies after a change between the two modes, and when another plan
begins, so that no change of mode under power causes a jump of torque. The difference between
target and leg fades in the same way when a stop begins in position mode, which brakes from where
the leg is. A stop in torque mode does not wait for a fade: its torque goes to the braking value as
fast as the rate limit allows.

This file is the only writer of the commands in the state.
"""

import math
from typing import Final, NamedTuple

from daemon.core.safety import bounds
from daemon.core.safety.joints import is_at_rest
from daemon.core.state import Axis, Core
from drives.signals import OperationMode, PowerState

FADE_S: Final = 0.2
"""Time constant with which a difference at a hand-over fades."""
NEGLIGIBLE_SI: Final = 1e-7
"""rad, m, N·m or N: far below a count."""
TORQUE: Final = OperationMode.CYCLIC_SYNC_TORQUE
POSITION: Final = OperationMode.CYCLIC_SYNC_POSITION


class DriveRequest(NamedTuple):
    """The mode and state requested from one drive together with its targets."""

    mode: OperationMode
    """Mode of operation in this command."""
    pushing: bool
    """The drive is to be enabled."""
    leaving: bool
    """Another mode than torque mode is to follow as soon as the joint is at rest."""
    dt_s: float
    """Nominal time between two commands."""
    takes_over: bool = False
    """A new plan gives the effort from now on: it begins with the last effort sent."""


def effort(axis: Axis, wanted_si: float, request: DriveRequest) -> float | None:
    """The effort to send, N·m or N; None if a number is not finite.

    Args:
        axis: its `effort_offset_si` and `effort_mean_si` are updated.
        wanted_si: effort of guidance.
        request: mode and state for this command.
    """
    if not request.pushing:
        axis.effort_offset_si, axis.effort_mean_si = 0.0, axis.gravity_si
        return 0.0
    if _displayed_mode(axis) == TORQUE:
        return _guided_effort(axis, wanted_si, request)
    present_si = axis.joint.effort_si
    axis.effort_offset_si = present_si - wanted_si if request.mode == TORQUE else 0.0
    return bounds.bound(present_si, present_si, axis.limits, request.dt_s)


def _guided_effort(axis: Axis, wanted_si: float, request: DriveRequest) -> float | None:
    # Before a drive is enabled, its target may step to the effort that will hold the pose.
    last_si = axis.effort_sent_si if axis.reached_enabled else axis.gravity_si
    before_si = last_si - wanted_si if request.takes_over else axis.effort_offset_si
    axis.effort_offset_si = before_si if request.takes_over else _faded(before_si, request.dt_s)
    if request.leaving and is_at_rest(axis.joint, axis.limits):
        return bounds.bound(axis.effort_mean_si, last_si, axis.limits, request.dt_s)
    sent_si = bounds.bound(wanted_si + axis.effort_offset_si, last_si, axis.limits, request.dt_s)
    if sent_si is not None:
        axis.effort_mean_si = sent_si + _faded(axis.effort_mean_si - sent_si, request.dt_s)
    return sent_si


def position(axis: Axis, wanted_si: float, request: DriveRequest) -> float | None:
    """The position to send, rad or m; None if a number is not finite.

    Args:
        axis: its `position_offset_si` is updated.
        wanted_si: position of guidance.
        request: mode and state for this command.
    """
    obeys, requested = _obeys_position(axis), request.mode == POSITION
    if obeys and requested and request.pushing and _follows(axis):
        axis.position_offset_si = _faded(axis.position_offset_si, request.dt_s)
        aim_si = wanted_si + axis.position_offset_si
        return bounds.bound_position(aim_si, axis.position_sent_si, axis.limits, request.dt_s)
    seeded = requested and axis.mode_sent == POSITION and _is_enabled(axis)
    sent_si = axis.position_sent_si if obeys or seeded else axis.joint.position_si
    axis.position_offset_si = sent_si - wanted_si if request.pushing else 0.0
    return sent_si


def brake_from_the_target(axis: Axis, wanted_si: float, velocity_si: float, dt_s: float) -> None:
    """Begin a stop in position mode: set the offset from the braking plan to the present target.

    The target first continues at the speed of the leg; the offset then fades, so the target
    returns to the leg's own position.

    Args:
        axis: its `position_offset_si` is updated.
        wanted_si: start of the braking plan, which is the leg's position.
        velocity_si: start velocity of that plan.
        dt_s: nominal time between two commands.
    """
    axis.position_offset_si = axis.position_sent_si + velocity_si * dt_s - wanted_si


def loop_distance(axis: Axis) -> float:
    """Distance of the joint from where the drive's own loops hold it; infinite if they do not."""
    if _obeys_position(axis):
        return abs(axis.position_sent_si - axis.joint.position_si)
    state = PowerState.UNKNOWN if axis.feedback is None else axis.feedback.power_state
    rested = axis.stop is not None and axis.stop.has_rested
    return 0.0 if rested and state == PowerState.QUICK_STOP_ACTIVE else math.inf


def record_sent(
    axis: Axis, mode: OperationMode, effort_si: float, position_si: float, dt_s: float
) -> None:
    """Store the command of this cycle, with speed and acceleration of a followed target."""
    if not _obeys_position(axis):
        axis.speed_sent_si = axis.acceleration_sent_si = 0.0
    else:
        speed_si = (position_si - axis.position_sent_si) / dt_s
        axis.acceleration_sent_si = (speed_si - axis.speed_sent_si) / dt_s
        axis.speed_sent_si = speed_si
    axis.mode_sent = mode
    axis.effort_sent_si, axis.position_sent_si = effort_si, position_si


def reset(core: Core) -> None:
    """No effort has been sent to the drives that have just been brought up."""
    for axis in core.axes:
        axis.effort_sent_si = 0.0


def _faded(difference_si: float, dt_s: float) -> float:
    """The difference after one cycle of fading; exactly 0 once it is negligible."""
    faded_si = difference_si * math.exp(-dt_s / FADE_S)
    return faded_si if abs(faded_si) > NEGLIGIBLE_SI else 0.0


def _obeys_position(axis: Axis) -> bool:
    return _is_enabled(axis) and _displayed_mode(axis) == POSITION


def _displayed_mode(axis: Axis) -> int:
    return axis.feedback.mode_display if axis.feedback is not None else OperationMode.NONE


def _is_enabled(axis: Axis) -> bool:
    return axis.feedback is not None and axis.feedback.power_state == PowerState.OPERATION_ENABLED


def _follows(axis: Axis) -> bool:
    return axis.feedback is not None and axis.feedback.following
