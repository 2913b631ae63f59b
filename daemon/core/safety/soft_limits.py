"""Soft margins of positions and mechanism, which slow a leg before a hard limit stops it.

A margin begins with depth 0 and ends, at the hard limit, with depth 1. Inside it the effort of
guidance is changed in two ways, in every mode:
1. The part that pushes further out, beyond the load, is reduced in proportion to the depth.
2. Motion outwards is damped, in proportion to the depth.
Motion inwards is not damped, and effort inwards is not reduced. Both effects start from zero at the
edge, so effort does not step there, and neither can put energy into the leg.

The margin of the mechanism lies between `singularity.soft_ratio` and `stop_ratio`. Its "out" is a
direction in both coordinates, down the gradient of |sin(psi)|, and so is its damping.
"""

from typing import NamedTuple

from daemon.core.safety.limits import AxisLimits, Thresholds
from daemon.core.safety.stopping_path import gradient
from observer.mechanism.parameters import LegParameters

Pair = tuple[float, float]
"""Hip and slide: rad and m, rad/s and m/s, N·m and N."""


class SoftZone(NamedTuple):
    """Depth of a leg in its soft margins, from 0 outside of a margin to 1 at the hard limit."""

    depth: Pair = (0.0, 0.0)
    """Depth of hip and slide; negative at the lower end."""
    mechanism_depth_ratio: float = 0.0

    @property
    def entered(self) -> bool:
        """True if the leg is inside any of the margins."""
        return self.depth != (0.0, 0.0) or self.mechanism_depth_ratio > 0.0


def zone_at(
    limits: tuple[AxisLimits, AxisLimits],
    thresholds: Thresholds,
    position: Pair,
    singularity_ratio: float,
) -> SoftZone:
    """The depth of a pose in its soft margins."""
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
    """The efforts of guidance, reduced and damped inside the soft margins.

    Args:
        zone: depth of this pose in its margins.
        leg: mechanism.
        limits: limits of hip and slide.
        position: from the raw encoders.
        velocity: from the raw encoders.
        load: g(q), which is always carried.
        wanted: total efforts of guidance.

    Returns: total efforts; unchanged outside of all margins. Not bounded in size.
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
    """As `_pushed`, but along the gradient of the mechanism, weighted by both dampings."""
    yield_hip = inwards[0] / max(limits[0].soft_damping_si, LEAST_DAMPING_SI)
    yield_slide = inwards[1] / max(limits[1].soft_damping_si, LEAST_DAMPING_SI)
    stiff = 1.0 / (inwards[0] * yield_hip + inwards[1] * yield_slide)
    led_out = -stiff * (yield_hip * push[0] + yield_slide * push[1])
    moved_out = -stiff * (inwards[0] * velocity[0] + inwards[1] * velocity[1])
    back = depth * (max(led_out, 0.0) + max(moved_out, 0.0))
    return push[0] + back * inwards[0], push[1] + back * inwards[1]


LEAST_DAMPING_SI = 1e-3
"""Replaces a configured damping of 0: pushes still fade, and there is no division by zero."""
