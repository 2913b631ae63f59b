"""One axis's motor and the drive's own loops: from the order to the effort at the joint.

Three loops as in an industrial servo drive: position (P, with the set point's speed fed forward),
velocity (PI) and current (first-order lag). The first two run every `drive_loop_us`, the lag in
every physics step, so in cyclic synchronous position the current between two SYNCs changes, and the
value sampled at a SYNC is not its mean. Loops work in joint units; current is
effort / `effort_per_a`.

    COAST     no order: the current decays with the current loop's lag
    TORQUE    the target, bounded by the effort limit and by the speed limiter
    POSITION  set point on a line from the last one to the target; P, PI; the ordered velocity and
              effort are added
    RAMP      set speed from the present speed to zero, PI; then HOLD where it came to rest
    HOLD      set point = position when the order came; P, PI
    VELOCITY  set speed from the present speed to the target's, PI

Entering a loop initialises its integral so that the effort does not jump.

`effort` is the effort of the current that the drive measures. The effort at the joint may have
another sign (motor connected with inverted sign), and lacks the offset of the current sensor. The
loops see the position through an encoder that may count in the wrong direction.
"""

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from observer.jit import kernel
from sim_drives.plant.actuation import Actuation, AxisActuation, AxisFlag

Records = NDArray[np.void]

ORDER: Final = np.dtype(
    [
        ("actuation", "i8"),
        ("effort", "f8"),
        ("position", "f8"),
        ("velocity", "f8"),
        ("deceleration", "f8"),
        ("interpolation_s", "f8"),
        ("effort_limit", "f8"),
        ("velocity_limit", "f8"),
        ("following_error", "f8"),
        ("following_error_time_s", "f8"),
        ("position_min", "f8"),
        ("position_max", "f8"),
    ]
)
"""AxisActuation in the kernels' form, field by field in its order, joint SI."""

DRIVE: Final = np.dtype(
    [
        ("position_gain", "f8"),
        ("velocity_gain", "f8"),
        ("velocity_integral_s", "f8"),
        ("position_deadband", "f8"),
        ("standstill_speed", "f8"),
        ("current_time_constant_s", "f8"),
        ("effort_per_a", "f8"),
        ("heating_k_per_a2", "f8"),
        ("thermal_time_constant_s", "f8"),
    ]
)
"""Constants of one motor and its drive."""

LOOP: Final = np.dtype(
    [
        ("acting", "i8"),  # Actuation whose loops run
        ("line_end", "f8"),  # target of the running interpolation
        ("line_left_s", "f8"),
        ("set_point", "f8"),
        ("set_speed", "f8"),
        ("holding", "i8"),
        ("integral", "f8"),
        ("ordered_effort", "f8"),
        ("effort", "f8"),
        ("error_time_s", "f8"),
        ("brake_upper", "f8"),  # integral part of the speed limiter
        ("brake_lower", "f8"),
        ("warming_k", "f8"),
        ("flags", "i8"),
        ("motor_sense", "f8"),  # -1: connected with inverted sign
        ("encoder_sense", "f8"),
        ("encoder_shift", "f8"),  # the drive measures sense * position + shift
        ("sensed_too_much", "f8"),  # offset of the current sensor, as effort
    ]
)
"""State of one drive's loops."""

# The kernels combine plain integers.
STANDSTILL: Final = int(AxisFlag.STANDSTILL)
FOLLOWING_ERROR: Final = int(AxisFlag.FOLLOWING_ERROR)
TARGET_CLIPPED: Final = int(AxisFlag.TARGET_CLIPPED)
SPEED_LIMITED: Final = int(AxisFlag.SPEED_LIMITED)
STOP_NEGATIVE: Final = int(AxisFlag.END_STOP_NEGATIVE)
STOP_POSITIVE: Final = int(AxisFlag.END_STOP_POSITIVE)


LIMITER_STIFFNESS: Final = 4.0
"""Proportional gain of the speed limiter in torque mode, in units of the velocity loop's gain."""
LIMITER_INTEGRAL_S: Final = 0.02

NOT_BEGUN: Final = -1
"""Value of `acting`: the ordered actuation begins at the loops' next tick."""


def take_order(
    orders: Sequence[NDArray[Any]],
    axis: int,
    loop: np.void,
    order: AxisActuation,
    before: AxisActuation,
) -> None:
    """Write an axis's order in the kernels' form, only what differs from the one before.

    The flags of the previous actuation are cleared at once, so that the standstill of an older
    ramp is never taken for that of a new one.

    Args:
        orders: the fields of the ORDER records, in their order.
        axis: number of the axis.
        loop: its LOOP record.
        order: the order.
        before: the order that the records hold.
    """
    if before.actuation != order.actuation:
        loop["acting"] = NOT_BEGUN
        loop["flags"] &= STOP_NEGATIVE | STOP_POSITIVE
    for field, value, was in zip(orders, order, before, strict=True):
        if value != was:
            field[axis] = value


def fresh_loops() -> Records:
    """Return two axes without power, connected with the right signs."""
    loops = np.zeros(2, LOOP)
    loops["motor_sense"] = 1.0
    loops["encoder_sense"] = 1.0
    return loops


@kernel
def bounded(value: float, limit: float) -> float:
    """Clip a value to [-limit, limit]."""
    return min(max(value, -limit), limit)


@kernel
def set_flag(loop: np.void, flag: int, raised: bool) -> None:
    """Raise or lower one flag."""
    loop["flags"] = loop["flags"] | flag if raised else loop["flags"] & ~flag


@kernel
def _enter(loop: np.void, drive: np.void, order: np.void, position: float, velocity: float) -> None:
    """Begin the ordered actuation from the present state, without a jump of effort."""
    loop["acting"] = order["actuation"]
    loop["set_point"] = position
    loop["line_end"] = position
    loop["line_left_s"] = 0.0
    loop["set_speed"] = 0.0
    loop["holding"] = 0
    loop["error_time_s"] = 0.0
    loop["brake_upper"] = 0.0
    loop["brake_lower"] = 0.0
    if order["actuation"] == Actuation.RAMP or order["actuation"] == Actuation.VELOCITY:
        loop["set_speed"] = velocity
    if order["actuation"] == Actuation.HOLD:
        loop["holding"] = 1
    speed_error = loop["set_speed"] - velocity
    added = order["effort"] if order["actuation"] != Actuation.TORQUE else 0.0
    loop["integral"] = loop["effort"] - drive["velocity_gain"] * speed_error - added


@kernel
def _follow_line(loop: np.void, order: np.void, loop_s: float) -> None:
    """Move the set point one tick along the line to the target."""
    target = min(max(order["position"], order["position_min"]), order["position_max"])
    set_flag(loop, TARGET_CLIPPED, target != order["position"])
    if target != loop["line_end"]:
        loop["line_end"] = target
        loop["line_left_s"] = order["interpolation_s"]
    before = loop["set_point"]
    if loop["line_left_s"] > loop_s:
        loop["set_point"] += (target - before) * loop_s / loop["line_left_s"]
        loop["line_left_s"] -= loop_s
    else:
        loop["set_point"] = target
        loop["line_left_s"] = 0.0
    loop["set_speed"] = (loop["set_point"] - before) / loop_s


@kernel
def _follow_ramp(loop: np.void, order: np.void, position: float, loop_s: float) -> None:
    """Lower the set speed by one tick of the ramp; at zero, hold where the axis is."""
    if loop["holding"] == 1:
        return
    fall = order["deceleration"] * loop_s
    loop["set_speed"] -= bounded(loop["set_speed"], fall)
    if loop["set_speed"] == 0.0:
        loop["holding"] = 1
        loop["set_point"] = position


@kernel
def _follow_speed(loop: np.void, order: np.void, loop_s: float) -> None:
    """Move the set speed one tick towards the ordered one."""
    wanted = bounded(order["velocity"], order["velocity_limit"])
    loop["set_speed"] += bounded(wanted - loop["set_speed"], order["deceleration"] * loop_s)


@kernel
def _wanted_speed(loop: np.void, drive: np.void, order: np.void, position: float) -> float:
    """Set value of the velocity loop: position loop plus the set point's own speed."""
    ramping = loop["acting"] == Actuation.RAMP and loop["holding"] == 0
    if ramping or loop["acting"] == Actuation.VELOCITY:
        return loop["set_speed"]
    error = loop["set_point"] - position
    if abs(error) <= drive["position_deadband"]:
        error = 0.0
    wanted = drive["position_gain"] * error + loop["set_speed"]
    if loop["acting"] == Actuation.POSITION:
        wanted += order["velocity"]
    speed = bounded(wanted, order["velocity_limit"])
    set_flag(loop, SPEED_LIMITED, speed != wanted)
    return speed


@kernel
def _velocity_loop(
    loop: np.void, drive: np.void, order: np.void, wanted: float, velocity: float, loop_s: float
) -> float:
    """PI with the integral held while the effort is at its limit (no wind-up)."""
    error = wanted - velocity
    gain = drive["velocity_gain"]
    effort = gain * error + loop["integral"] + order["effort"]
    limited = bounded(effort, order["effort_limit"])
    if limited == effort or error * effort < 0.0:
        loop["integral"] += gain * error * loop_s / drive["velocity_integral_s"]
    return limited


@kernel
def _watch_following(loop: np.void, order: np.void, position: float, loop_s: float) -> None:
    """Set FOLLOWING_ERROR once the error was outside its window long enough (6065h, 6066h)."""
    outside = abs(loop["set_point"] - position) > order["following_error"]
    loop["error_time_s"] = loop["error_time_s"] + loop_s if outside else 0.0
    late = outside and loop["error_time_s"] >= order["following_error_time_s"]
    set_flag(loop, FOLLOWING_ERROR, late)


@kernel
def _limiter(brake: float, gain: float, room: float, effort: float, step_s: float) -> float:
    """Return the integral part of one side of the speed limiter, after a step.

    It grows against the speed while its side limits, and is reset while it does not.
    """
    rate = step_s / LIMITER_INTEGRAL_S
    if gain * room + brake < effort:
        return brake + gain * room * rate
    return brake * (1.0 - rate)


@kernel
def torque_order(
    loop: np.void, drive: np.void, order: np.void, velocity: float, step_s: float
) -> float:
    """Return the torque target bounded by the effort limit and the speed limiter.

    The speed limiter is a PI controller on each side that may only reduce torque. Its proportional
    part is stiff, so that a load causes little excess speed; its integral part removes that excess.
    """
    effort = bounded(order["effort"], order["effort_limit"])
    gain = LIMITER_STIFFNESS * drive["velocity_gain"]
    ahead = order["velocity_limit"] - velocity
    behind = order["velocity_limit"] + velocity
    if math.isinf(ahead):
        return effort
    loop["brake_upper"] = _limiter(loop["brake_upper"], gain, ahead, effort, step_s)
    loop["brake_lower"] = _limiter(loop["brake_lower"], gain, behind, -effort, step_s)
    upper = gain * ahead + loop["brake_upper"]
    lower = -gain * behind - loop["brake_lower"]
    limited = bounded(min(max(effort, lower), upper), order["effort_limit"])
    set_flag(loop, SPEED_LIMITED, limited != effort)
    return limited


@kernel
def run_loops(
    loop: np.void,
    drive: np.void,
    order: np.void,
    position: float,
    velocity: float,
    loop_s: float,
    step_s: float,
) -> None:
    """Run one tick of the drive's loops: updates the ordered effort and the flags.

    Args:
        loop: LOOP record of this axis, written.
        drive: its DRIVE record.
        order: its ORDER record.
        position: joint, rad or m.
        velocity: joint, rad/s or m/s.
        loop_s: time between ticks of the position and velocity loops.
        step_s: time between steps of the physics, in which a torque order acts at once.
    """
    if loop["acting"] != order["actuation"]:
        _enter(loop, drive, order, position, velocity)
    acting = loop["acting"]
    if acting == Actuation.COAST:
        loop["ordered_effort"] = 0.0
        return
    if acting == Actuation.TORQUE:
        loop["ordered_effort"] = torque_order(loop, drive, order, velocity, step_s)
        return
    if acting == Actuation.POSITION:
        _follow_line(loop, order, loop_s)
        _watch_following(loop, order, position, loop_s)
    if acting == Actuation.RAMP:
        _follow_ramp(loop, order, position, loop_s)
    if acting == Actuation.VELOCITY:
        _follow_speed(loop, order, loop_s)
    wanted = _wanted_speed(loop, drive, order, position)
    loop["ordered_effort"] = _velocity_loop(loop, drive, order, wanted, velocity, loop_s)
    at_rest = loop["holding"] == 1 and abs(velocity) < drive["standstill_speed"]
    set_flag(loop, STANDSTILL, at_rest)


@kernel
def lag_current(loop: np.void, drive: np.void, step_s: float) -> float:
    """Let the current follow its order for one step; returns the joint's mean effort in it.

    First-order lag, solved exactly for a constant order.
    """
    ordered = loop["ordered_effort"]
    ratio = step_s / drive["current_time_constant_s"]
    decay = math.exp(-ratio)
    gap = loop["effort"] - ordered
    loop["effort"] = ordered + gap * decay
    return joint_effort(loop, ordered + gap * (1.0 - decay) / ratio)


@kernel
def joint_effort(loop: np.void, believed: float) -> float:
    """Return the true joint effort for the effort that the drive measures."""
    if loop["acting"] != Actuation.COAST:
        believed -= loop["sensed_too_much"]
    return loop["motor_sense"] * believed


@kernel
def warm(loop: np.void, drive: np.void, step_s: float) -> None:
    """Advance the winding's temperature above ambient: first order, heated by current squared."""
    current_a = loop["effort"] / drive["effort_per_a"]
    final_k = drive["heating_k_per_a2"] * current_a * current_a
    loop["warming_k"] += (final_k - loop["warming_k"]) * step_s / drive["thermal_time_constant_s"]
