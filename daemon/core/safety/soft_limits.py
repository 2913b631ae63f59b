"""What slows a leg before a hard limit has to stop it: the soft margins of positions and mechanism.

A margin begins with depth 0 and ends, at the hard limit, with depth 1. Inside, two things happen to
the effort that guidance wants, whatever the mode:
1. What of it leads further out, beyond what carries the load, fades with the depth.
2. What moves out is damped, with a damping that grows with the depth.
Moving back is free: nothing here ever acts on a leg that moves in, or stands, and no push that
leads in is touched. Both grow from nothing at the edge, so no effort steps there; and neither can
put energy into the leg.

The margin of the mechanism lies between `singularity.soft_ratio` and `stop_ratio`. Its "out" is a
direction in both coordinates, down the gradient of |sin(psi)|, and so is its damping.
"""

from typing import NamedTuple

from daemon.core.safety.limits import AxisLimits, Thresholds
from daemon.core.safety.stopping_path import gradient
from observer.mechanism.mechanism import LegParameters

Pair = tuple[float, float]
"""Hip and slide: rad and m, rad/s and m/s, N·m and N."""


class SoftZone(NamedTuple):
    """How far a leg is inside its soft margins, each 0 outside of it to 1 at the hard limit."""

    depth: Pair = (0.0, 0.0)
    """Of hip and slide: their sign says at which end, negative at the lower one."""
    mechanism_depth_ratio: float = 0.0

    @property
    def entered(self) -> bool:
        """Whether the leg is inside any of them."""
        return self.depth != (0.0, 0.0) or self.mechanism_depth_ratio > 0.0


def zone_at(
    limits: tuple[AxisLimits, AxisLimits],
    thresholds: Thresholds,
    position: Pair,
    singularity_ratio: float,
) -> SoftZone:
    """Where a pose is in its soft margins."""
    soft_ratio, stop_ratio = thresholds.singularity_soft_ratio, thresholds.singularity_stop_ratio
    return SoftZone(
        (_depth(position[0], limits[0]), _depth(position[1], limits[1])),
        _share((soft_ratio - singularity_ratio) / (soft_ratio - stop_ratio)),
    )


def _depth(position_si: float, limits: AxisLimits) -> float:
    margin_si = limits.soft_margin_si
    below_si = limits.position_min_si + margin_si - position_si
    above_si = position_si - limits.position_max_si + margin_si
    return _share(above_si / margin_si) - _share(below_si / margin_si)


def _share(value: float) -> float:
    return min(max(value, 0.0), 1.0)


def slowed(
    zone: SoftZone,
    leg: LegParameters,
    limits: tuple[AxisLimits, AxisLimits],
    position: Pair,
    velocity: Pair,
    load: Pair,
    wanted: Pair,
) -> Pair:
    """The efforts that guidance wants, less what would lead further out.

    Args:
        zone: of this pose.
        leg: mechanism.
        limits: of hip and slide.
        position: raw.
        velocity: raw.
        load: g(q), which is always carried.
        wanted: total efforts.

    Returns: total efforts; outside of all margins just those wanted. Not bounded in size.
    """
    if not zone.entered:
        return wanted
    push = (
        _pushed(zone.depth[0], limits[0], velocity[0], wanted[0] - load[0]),
        _pushed(zone.depth[1], limits[1], velocity[1], wanted[1] - load[1]),
    )
    if zone.mechanism_depth_ratio > 0.0:
        inwards = gradient(leg, position)
        push = _pushed_together(zone.mechanism_depth_ratio, limits, inwards, velocity, push)
    return load[0] + push[0], load[1] + push[1]


def _pushed(depth: float, limits: AxisLimits, speed: float, push: float) -> float:
    if push * depth > 0.0:
        push *= 1.0 - abs(depth)
    if speed * depth > 0.0:
        push -= abs(depth) * limits.soft_damping_si * speed
    return push


def _pushed_together(
    depth: float,
    limits: tuple[AxisLimits, AxisLimits],
    inwards: Pair,
    velocity: Pair,
    push: Pair,
) -> Pair:
    """Along the gradient, in the measure of both dampings; with one axis alone as `_pushed`."""
    yield_hip = inwards[0] / max(limits[0].soft_damping_si, LEAST_DAMPING_SI)
    yield_slide = inwards[1] / max(limits[1].soft_damping_si, LEAST_DAMPING_SI)
    stiff = 1.0 / (inwards[0] * yield_hip + inwards[1] * yield_slide)
    led_out = -stiff * (yield_hip * push[0] + yield_slide * push[1])
    moved_out = -stiff * (inwards[0] * velocity[0] + inwards[1] * velocity[1])
    back = depth * (max(led_out, 0.0) + max(moved_out, 0.0))
    return push[0] + back * inwards[0], push[1] + back * inwards[1]


LEAST_DAMPING_SI = 1e-3
"""Where a file says no damping at all, pushes still fade and nothing is divided by zero."""
