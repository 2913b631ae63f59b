"""Stopping path: where a leg comes to rest if both drives brake now.

The workspace is not a box: shank and shoe must keep an angle to each other, so the slide's range
depends on the hip angle. With D the distance from knee to slide joint, u the shank, w the shoe,

    cos(psi) = (u^2 + w^2 - D^2) / (2 u w)        |sin(psi)| is the singularity ratio

and D^2 is a parabola over the rail: everything here is a few operations on two angles, computed
in every cycle from raw encoder values. A path continues at constant speed for a reaction time, then
each axis follows its own quick-stop ramp: a stop is sent in the cycle whose samples caused it, and
the drives act on it at the next SYNC. That is REACTION_S. A controller's assist does not consider
the ends of the range and may accelerate the leg from one cycle to the next: ASSISTED_REACTION_S
therefore adds the cycle before detection, and one cycle for the speed gained meanwhile. A gait is
slow where it turns and needs neither.
"""

import math
from typing import Final

from observer.jit import inline, kernel
from observer.mechanism.parameters import LegParameters

Pair = tuple[float, float]
"""Hip and slide: rad and m, rad/s and m/s, rad/s^2 and m/s^2."""

REACTION_S: Final = 0.01
"""One cycle. `gaitd check` uses three for the gait: a fault of a drive is detected later."""
ASSISTED_REACTION_S: Final = 0.03
"""Three cycles, while assist is in force."""
POINTS: Final = 6
"""Number of intervals of the path at which the angle of shank and shoe is computed."""


def reaction_s(*, assisted: bool) -> float:
    """Time for which a leg continues before its drives brake it."""
    return ASSISTED_REACTION_S if assisted else REACTION_S


@inline
def on_ramp(
    position: float, speed: float, deceleration: float, time_s: float, reaction_s: float
) -> float:
    """Position of one axis: constant speed for the reaction time, then the braking ramp."""
    braking_s = min(max(time_s - reaction_s, 0.0), abs(speed) / deceleration)
    slope = math.copysign(deceleration, speed)
    along = speed * (min(time_s, reaction_s) + braking_s)
    return position + along - 0.5 * slope * braking_s * braking_s


def end_of(position: float, speed: float, deceleration: float, reaction_s: float) -> float:
    """Position at which one axis comes to rest."""
    return position + speed * (reaction_s + 0.5 * abs(speed) / deceleration)


@inline
def cosine(leg: LegParameters, position: Pair) -> float:
    """cos(psi) of shank and shoe; beyond -1 or 1 where no pose exists."""
    dx, dy = _from_knee(leg, position)
    u, w = leg.shank_length_m, leg.shoe_length_m
    return (u * u + w * w - dx * dx - dy * dy) / (2.0 * u * w)


@inline
def ratio_of(cosine_ratio: float) -> float:
    """|sin(psi)|; 0 where no pose exists."""
    return math.sqrt(max(1.0 - cosine_ratio * cosine_ratio, 0.0))


@kernel
def least_ratio(
    leg: tuple[float, ...],
    position: Pair,
    velocity: Pair,
    decelerations: Pair,
    reaction_s: float,
) -> float:
    """The smallest |sin(psi)| on the way to rest of both axes, each on its own ramp."""
    parameters = LegParameters(*leg)
    braking_s = max(abs(velocity[0]) / decelerations[0], abs(velocity[1]) / decelerations[1])
    worst = 0.0
    for index in range(POINTS + 1):
        time_s = (reaction_s + braking_s) * index / POINTS
        hip = on_ramp(position[0], velocity[0], decelerations[0], time_s, reaction_s)
        slide = on_ramp(position[1], velocity[1], decelerations[1], time_s, reaction_s)
        worst = max(worst, abs(cosine(parameters, (hip, slide))))
    return ratio_of(worst)


@kernel
def gradient(leg: LegParameters, position: Pair) -> Pair:
    """Gradient of |sin(psi)| over hip angle and slide position, per rad and per m.

    At the singularity it does not exist; the value returned there points away from it.
    """
    dx, dy = _from_knee(leg, position)
    angle = leg.thigh_angle_rad + position[0]
    knee_x = leg.thigh_length_m * math.cos(angle)
    knee_y = leg.thigh_length_m * math.sin(angle)
    over = 1.0 / (leg.shank_length_m * leg.shoe_length_m)
    # d(D^2)/2: the knee turns about the hip, the slide joint runs along the rail.
    by_hip = (dx * knee_y - dy * knee_x) * over
    by_slide = (dx * leg.rail_cos + dy * leg.rail_sin) * over
    at = cosine(leg, position)
    factor = at / max(ratio_of(at), SMALLEST_RATIO)
    return by_hip * factor, by_slide * factor


SMALLEST_RATIO: Final = 0.01
"""Smallest ratio for the gradient: nearer to the singularity its length has no meaning."""


@inline
def _from_knee(leg: LegParameters, position: Pair) -> Pair:
    """Vector from knee to slide joint, m."""
    angle = leg.thigh_angle_rad + position[0]
    return (
        leg.rail_x_m + position[1] * leg.rail_cos - leg.thigh_length_m * math.cos(angle),
        leg.rail_y_m + position[1] * leg.rail_sin - leg.thigh_length_m * math.sin(angle),
    )
