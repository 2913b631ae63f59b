"""Bounds of every effort, every assist and every target position before it is sent.

A bound only reduces. A value that is not finite is never replaced: it is not sent, and the machine
stops. `checks.py` checks measured values; this file bounds commands.
"""

import math

from daemon.core.safety.limits import AxisLimits


def bound(wanted_si: float, last_si: float, limits: AxisLimits, dt_s: float) -> float | None:
    """The effort that may be sent: inside the limit, and within the rate limit from the last.

    Args:
        wanted_si: total effort of guidance, including g(q).
        last_si: the bounded effort sent in the previous cycle.
        limits: limits of the axis.
        dt_s: nominal time between two commands.

    Returns:
        The bounded effort, or None if a number is not finite: then the machine stops.
    """
    if not (math.isfinite(wanted_si) and math.isfinite(last_si)):
        return None
    step_si = limits.effort_rate_max_si_per_s * dt_s
    slow_si = min(max(wanted_si, last_si - step_si), last_si + step_si)
    return min(max(slow_si, -limits.effort_max_si), limits.effort_max_si)


def bound_assist(
    wanted_si: float, last_si: float, limits: AxisLimits, velocity_si: float, dt_s: float
) -> float | None:
    """The assist that may be in force: inside its limit, its power and its rate.

    Power bounds only assist along the motion: against it assist takes energy out of the leg. Where
    a rising speed makes assist exceed its power, it is reduced at the rate limit, so that torque
    never jumps. The power of the whole effort is not bounded but causes a stop (`POWER_LIMIT`),
    because a cut would also cut g(q) and let the leg fall.

    Args:
        wanted_si: assist from a controller on top of g(q), N·m or N.
        last_si: assist in force in the previous cycle.
        limits: limits of the axis.
        velocity_si: joint speed from its raw encoder, rad/s or m/s.
        dt_s: nominal time between two commands.

    Returns:
        The bounded assist, or None if a number is not finite: then the machine stops.
    """
    if not all(map(math.isfinite, (wanted_si, last_si, velocity_si))):
        return None
    aim_si = min(max(wanted_si, -limits.assist_max_si), limits.assist_max_si)
    if velocity_si > 0:
        aim_si = min(aim_si, limits.assist_power_max_w / velocity_si)
    elif velocity_si < 0:
        aim_si = max(aim_si, limits.assist_power_max_w / velocity_si)
    step_si = limits.assist_rate_max_si_per_s * dt_s
    return min(max(aim_si, last_si - step_si), last_si + step_si)


def bound_position(
    wanted_si: float, last_si: float, limits: AxisLimits, dt_s: float
) -> float | None:
    """The target position that may be sent: within the axis's speed limit and range.

    Inside the soft margin before a limit a target may stay or go back, but not go further out. So
    a drive never gets a target beyond its own software limits (607Dh), which is a fault for some.
    Arguments and result are those of `bound`, in rad or m.
    """
    if not (math.isfinite(wanted_si) and math.isfinite(last_si)):
        return None
    step_si = limits.velocity_max_si * dt_s
    slow_si = min(max(wanted_si, last_si - step_si), last_si + step_si)
    lowest_si = min(limits.position_min_si + limits.soft_margin_si, last_si)
    highest_si = max(limits.position_max_si - limits.soft_margin_si, last_si)
    return min(max(slow_si, lowest_si), highest_si)
