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

This file makes `Sent`.
"""

import math
from typing import Final, NamedTuple

from msgspec.structs import replace

from daemon.core.safety import bounds
from daemon.core.safety.joints import is_at_rest
from daemon.core.slices import Sensed, Sent
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


class Effort(NamedTuple):
    """The effort to send, N·m or N, with the state of its fade; see `Sent`."""

    sent_si: float
    offset_si: float
    mean_si: float


class Position(NamedTuple):
    """The position to send, rad or m, with the state of its fade; see `Sent`."""

    sent_si: float
    offset_si: float


def effort(axis: Axis, wanted_si: float, request: DriveRequest) -> Effort | None:
    """The effort to send; None if a number is not finite.

    Args:
        axis: what it shows, and what was sent to it last.
        wanted_si: effort of guidance.
        request: mode and state for this command.
    """
    sensed = axis.sensed
    if not request.pushing:
        return Effort(0.0, 0.0, sensed.gravity_si)
    if _displayed_mode(sensed) == TORQUE:
        return _guided_effort(axis, wanted_si, request)
    present_si = sensed.joint.effort_si
    offset_si = present_si - wanted_si if request.mode == TORQUE else 0.0
    sent_si = bounds.bound(present_si, present_si, axis.limits, request.dt_s)
    return None if sent_si is None else Effort(sent_si, offset_si, axis.sent.effort_mean_si)


def _guided_effort(axis: Axis, wanted_si: float, request: DriveRequest) -> Effort | None:
    sensed, before, limits = axis.sensed, axis.sent, axis.limits
    # Before a drive is enabled, its target may step to the effort that will hold the pose.
    last_si = before.effort_si if sensed.reached_enabled else sensed.gravity_si
    if request.takes_over:
        offset_si = last_si - wanted_si
    else:
        offset_si = _faded(before.effort_offset_si, request.dt_s)
    mean_si = before.effort_mean_si
    if request.leaving and is_at_rest(sensed.joint, limits):
        sent_si = bounds.bound(mean_si, last_si, limits, request.dt_s)
        return None if sent_si is None else Effort(sent_si, offset_si, mean_si)
    sent_si = bounds.bound(wanted_si + offset_si, last_si, limits, request.dt_s)
    if sent_si is None:
        return None
    return Effort(sent_si, offset_si, sent_si + _faded(mean_si - sent_si, request.dt_s))


def position(
    axis: Axis, wanted_si: float, offset_si: float, request: DriveRequest
) -> Position | None:
    """The position to send; None if a number is not finite.

    Args:
        axis: what it shows, and what was sent to it last.
        wanted_si: position of guidance.
        offset_si: difference between target and plan at the last command.
        request: mode and state for this command.
    """
    sensed, before = axis.sensed, axis.sent
    obeys, requested = _obeys_position(sensed), request.mode == POSITION
    if obeys and requested and request.pushing and _follows(sensed):
        offset_si = _faded(offset_si, request.dt_s)
        aim_si, last_si = wanted_si + offset_si, before.position_si
        sent_si = bounds.bound_position(aim_si, last_si, axis.limits, request.dt_s)
        return None if sent_si is None else Position(sent_si, offset_si)
    seeded = requested and before.mode == POSITION and _is_enabled(sensed)
    sent_si = before.position_si if obeys or seeded else sensed.joint.position_si
    return Position(sent_si, sent_si - wanted_si if request.pushing else 0.0)


def braking_offset_si(before: Sent, wanted_si: float, velocity_si: float, dt_s: float) -> float:
    """Offset from the braking plan to the present target, at the begin of a stop in position mode.

    The target first continues at the speed of the leg; the offset then fades, so the target
    returns to the leg's own position.

    Args:
        before: the last command.
        wanted_si: start of the braking plan, which is the leg's position.
        velocity_si: start velocity of that plan.
        dt_s: nominal time between two commands.
    """
    return before.position_si + velocity_si * dt_s - wanted_si


def sent(axis: Axis, effort: Effort, position: Position, request: DriveRequest) -> Sent:
    """The command of this cycle, with speed and acceleration of a followed target."""
    before, speed_si, acceleration_si = axis.sent, 0.0, 0.0
    if _obeys_position(axis.sensed):
        speed_si = (position.sent_si - before.position_si) / request.dt_s
        acceleration_si = (speed_si - before.speed_si) / request.dt_s
    return Sent(
        mode=request.mode,
        effort_si=effort.sent_si,
        position_si=position.sent_si,
        speed_si=speed_si,
        acceleration_si=acceleration_si,
        effort_mean_si=effort.mean_si,
        effort_offset_si=effort.offset_si,
        position_offset_si=position.offset_si,
    )


def without_effort(axis: Axis, request: DriveRequest) -> Sent:
    """The command in place of a refused one: no effort, and the position sent last."""
    before = axis.sent
    effort = Effort(0.0, before.effort_offset_si, before.effort_mean_si)
    return sent(axis, effort, Position(before.position_si, before.position_offset_si), request)


def loop_distance(axis: Axis) -> float:
    """Distance of the joint from where the drive's own loops hold it; infinite if they do not."""
    if _obeys_position(axis.sensed):
        return abs(axis.sent.position_si - axis.sensed.joint.position_si)
    state = PowerState.UNKNOWN if axis.sensed.feedback is None else axis.sensed.feedback.power_state
    rested = axis.stop is not None and axis.stop.has_rested
    return 0.0 if rested and state == PowerState.QUICK_STOP_ACTIVE else math.inf


def reset(core: Core) -> None:
    """No effort has been sent to the drives that have just been brought up."""
    for axis in core.axes:
        axis.sent = replace(axis.sent, effort_si=0.0)


def _faded(difference_si: float, dt_s: float) -> float:
    """The difference after one cycle of fading; exactly 0 once it is negligible, NaN stays NaN."""
    faded_si = difference_si * math.exp(-dt_s / FADE_S)
    return 0.0 if abs(faded_si) <= NEGLIGIBLE_SI else faded_si


def _obeys_position(sensed: Sensed) -> bool:
    return _is_enabled(sensed) and _displayed_mode(sensed) == POSITION


def _displayed_mode(sensed: Sensed) -> int:
    return OperationMode.NONE if sensed.feedback is None else sensed.feedback.mode_display


def _is_enabled(sensed: Sensed) -> bool:
    feedback = sensed.feedback
    return feedback is not None and feedback.power_state == PowerState.OPERATION_ENABLED


def _follows(sensed: Sensed) -> bool:
    return sensed.feedback is not None and sensed.feedback.following
