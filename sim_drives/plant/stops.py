"""Mechanical stops at the ends of the joints' travel.

Hip and slide have springs with dampers at each end, which push and never pull.

The mechanism as a whole has a stop between shank and shoe, before its only singularity, where those
two are in line. Near it the angle between them changes fast for little travel, so no spring is
stiff enough at a fixed step; the stop is rigid and inelastic instead. It bounds the distance
between knee and slide joint, which is smooth there: a velocity that would take the distance past
its bound within one step is reduced by an impulse along the distance's gradient. Neither the drives
at full effort nor a fall pass it.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.jit import kernel
from observer.mechanism.linkage import pose
from observer.mechanism.parameters import LegParameters
from sim_drives.plant.settings import AnkleStop, HipStop, SlideStop

Records = NDArray[np.void]


class Stop(NamedTuple):
    """One coordinate's travel and its end stops; rad, N·m or m, N."""

    low_si: float
    high_si: float
    stiffness_si: float
    damping_si: float


class Reach(NamedTuple):
    """Bounds of the distance between knee and slide joint: leg folded, leg stretched."""

    nearest_m: float
    farthest_m: float


def joint_stops(hip: HipStop, slide: SlideStop) -> tuple[Stop, Stop]:
    """The end stops of hip and slide."""
    return (
        Stop(
            math.radians(hip.min_deg),
            math.radians(hip.max_deg),
            hip.stiffness_nm_per_rad,
            hip.damping_nm_s_per_rad,
        ),
        Stop(slide.min_m, slide.max_m, slide.stiffness_n_per_m, slide.damping_n_s_per_m),
    )


def leg_reach(stop: AnkleStop, leg: LegParameters) -> Reach:
    """The distances at which |sin| of the angle between shank and shoe is the stop's ratio."""
    shank_m, shoe_m = leg.shank_length_m, leg.shoe_length_m
    squares = shank_m * shank_m + shoe_m * shoe_m
    cosine = math.sqrt(1.0 - stop.edge_ratio * stop.edge_ratio)
    twice = 2.0 * shank_m * shoe_m * cosine  # law of cosines
    return Reach(math.sqrt(squares - twice), math.sqrt(squares + twice))


@kernel
def stop_effort(stop: Stop, position: float, velocity: float) -> float:
    """Effort of the stop along the positive axis; 0 between its ends."""
    if position > stop.high_si:
        depth = position - stop.high_si
        return -max(stop.stiffness_si * depth + stop.damping_si * velocity, 0.0)
    if position < stop.low_si:
        depth = stop.low_si - position
        return max(stop.stiffness_si * depth - stop.damping_si * velocity, 0.0)
    return 0.0


@kernel
def _response(
    joints: Records, mass: tuple[float, float, float], by_hip: float, by_slide: float
) -> tuple[float, float]:
    """Change of both velocities for a unit impulse along the gradient; held axes do not move."""
    m11, m12, m22 = mass
    if joints[0]["held"] == 1 and joints[1]["held"] == 1:
        return 0.0, 0.0
    if joints[0]["held"] == 1:
        return 0.0, by_slide / m22
    if joints[1]["held"] == 1:
        return by_hip / m11, 0.0
    determinant = m11 * m22 - m12 * m12
    return (
        (m22 * by_hip - m12 * by_slide) / determinant,
        (m11 * by_slide - m12 * by_hip) / determinant,
    )


@kernel
def keep_in_reach(
    p: LegParameters,
    reach: Reach,
    joints: Records,
    mass: tuple[float, float, float],
    step_s: float,
) -> bool:
    """Reduce `next_velocity` where it would move the leg past its reach; the force is contact.

    Args:
        p: the leg.
        reach: its bounds.
        joints: JOINT records after `slide_or_stick`, written.
        mass: M11, M12, M22 at this pose.
        step_s: the step.

    Returns: whether the leg hit its stop.
    """
    a, b = joints[0], joints[1]
    at = pose(p, a["position"], b["position"])
    # Vector from the knee to the slide joint, and how its length changes with hip and slide.
    dx = at.shank_x - at.shoe_x
    dy = at.shank_y - at.shoe_y
    distance = math.hypot(dx, dy)
    by_hip = (dx * at.knee_y - dy * at.knee_x) / distance
    by_slide = (dx * p.rail_cos + dy * p.rail_sin) / distance
    rate = by_hip * a["next_velocity"] + by_slide * b["next_velocity"]
    fastest = (reach.farthest_m - distance) / step_s
    slowest = (reach.nearest_m - distance) / step_s
    excess = rate - min(max(rate, slowest), fastest)
    hip_change, slide_change = _response(joints, mass, by_hip, by_slide)
    gain = by_hip * hip_change + by_slide * slide_change
    if excess == 0.0 or gain <= 0.0:
        return False
    impulse = excess / gain
    a["next_velocity"] -= hip_change * impulse
    b["next_velocity"] -= slide_change * impulse
    a["contact"] -= by_hip * impulse / step_s
    b["contact"] -= by_slide * impulse / step_s
    return True
