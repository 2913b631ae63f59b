"""What may be sent: the last word over every effort, every assist and every target position.

A bound takes away and never adds, and a number that is none is never replaced: then nothing may be
sent, and the machine stops. `checks.py` judges what was measured; here is what is asked for.
"""

import math

from daemon.core.safety.limits import AxisLimits


def bound(wanted_si: float, last_si: float, limits: AxisLimits, dt_s: float) -> float | None:
    """The effort that may be sent: inside the limit, and not faster than the rate from the last.

    Args:
        wanted_si: total effort that guidance asks for (g(q) and all).
        last_si: the effort sent in the cycle before, itself bounded.
        limits: of the axis.
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
    """The assist that may be in force: inside its limit and its power, at no more than its rate.

    Power bounds assist along the motion alone: against it assist takes energy out of the leg. It
    takes away and never adds, and where a rising speed leaves too much, it is taken at the rate:
    torque never jumps. The whole effort has no such bound but a stop (`POWER_LIMIT`), because
    cutting it would cut g(q) and let the leg fall.

    Args:
        wanted_si: what a controller asks for on top of g(q), N·m or N.
        last_si: what was in force in the cycle before.
        limits: of the axis.
        velocity_si: of the joint by its raw encoder, rad/s or m/s.
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
    """The target position that may be sent: no faster than the axis may be, never out of its range.

    Inside the soft margin before a limit a target may stay or go back, and go no further out. So a
    drive never sees a target beyond its own software limits (607Dh), which for some is a fault.
    Arguments and result as of `bound`, in rad or m.
    """
    if not (math.isfinite(wanted_si) and math.isfinite(last_si)):
        return None
    step_si = limits.velocity_max_si * dt_s
    slow_si = min(max(wanted_si, last_si - step_si), last_si + step_si)
    lowest_si = min(limits.position_min_si + limits.soft_margin_si, last_si)
    highest_si = max(limits.position_max_si - limits.soft_margin_si, last_si)
    return min(max(slow_si, lowest_si), highest_si)
