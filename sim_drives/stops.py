"""Mechanical stops: springs with dampers that push and never pull.

Hip and slide have a stop at each end of their travel. A third one stands between shank and shoe:
the mechanism's only singularity is where those two are in line, and near it the angle between them
moves fast for little travel, so a torsion spring there is a wall that neither drives nor a fall
pass.
"""

import math
from typing import NamedTuple

from observer.jit import kernel
from observer.mechanism import LegParameters, pose, rates
from sim_drives.plant_settings import Stops


class Stop(NamedTuple):
    """One coordinate's travel and what lies at its ends; rad, N·m or m, N."""

    low_si: float
    high_si: float
    stiffness_si: float
    damping_si: float


def build_stops(stops: Stops) -> tuple[Stop, Stop, Stop]:
    """Stops of hip, slide and the angle between shank and shoe."""
    hip, slide, ankle = stops.hip, stops.slide, stops.ankle
    edge_rad = math.asin(ankle.edge_ratio)
    return (
        Stop(
            math.radians(hip.min_deg),
            math.radians(hip.max_deg),
            hip.stiffness_nm_per_rad,
            hip.damping_nm_s_per_rad,
        ),
        Stop(slide.min_m, slide.max_m, slide.stiffness_n_per_m, slide.damping_n_s_per_m),
        Stop(
            edge_rad,
            math.pi - edge_rad,
            ankle.stiffness_nm_per_rad,
            ankle.damping_nm_s_per_rad,
        ),
    )


@kernel
def stop_effort(stop: Stop, position: float, velocity: float) -> float:
    """What the stop exerts along the positive axis; 0 between its ends."""
    if position > stop.high_si:
        depth = position - stop.high_si
        return -max(stop.stiffness_si * depth + stop.damping_si * velocity, 0.0)
    if position < stop.low_si:
        depth = stop.low_si - position
        return max(stop.stiffness_si * depth - stop.damping_si * velocity, 0.0)
    return 0.0


@kernel
def ankle_stop_effort(
    p: LegParameters, stop: Stop, hip: float, slide: float, hip_rate: float, slide_rate: float
) -> tuple[float, float]:
    """Generalised torque N·m and force N of the stop between shank and shoe.

    The angle between them is pi with the leg stretched and 0 with it folded; its gradient is the
    difference of the two links' rates, so virtual work gives the generalised forces.
    """
    at = pose(p, hip, slide)
    along = at.shank_x * at.shoe_x + at.shank_y * at.shoe_y
    angle = math.atan2(-at.delta, along)
    if stop.low_si <= angle <= stop.high_si:
        return 0.0, 0.0
    w = rates(p, at)
    by_hip = w.shank_hip - w.shoe_hip
    by_slide = w.shank_slide - w.shoe_slide
    torque = stop_effort(stop, angle, by_hip * hip_rate + by_slide * slide_rate)
    return by_hip * torque, by_slide * torque
