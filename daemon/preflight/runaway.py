"""How far a leg runs when the core ends at the worst moment: pure functions of the settings.

The drives do not detect the core's silence before 1016h (or 1400h:05) has run out. Until then each
continues with its last torque command, at most its own torque limit; then both make the quick stop
of 6007h. Rules of the computation:

1. Each drive pushes with all that its torque limit leaves, either way, for its own detection time
   and RESPONSE_S; a drive that limits its speed (6080h) pushes no faster than that.
2. Then it brakes along its ramp (6085h) as well as its torque limit lets it: the effort that the
   ramp requires by row (6) of the mechanism, with the other axis in motion, is cut off at the
   limit.
3. The other axis does the same, both ways. Each axis starts from rest or at its highest allowed
   speed the way that it pushes, at each of the gait's poses: sixteen runs for each pose.
4. A run ends where both are at rest, or where the mechanism does: at the leg stretched so far that
   the service would have stopped. Beyond that the machine's own end stops act, not the drives.

The distance is measured from the pose at which the core ended to the farthest one, in the joint's
own coordinate. Position limits in the drives (607Dh), which would shorten it, are not counted: not
every make keeps one in torque mode (docs/backstop.md).
"""

import math
from collections.abc import Iterable
from itertools import product
from typing import Final, NamedTuple

import numpy as np

from daemon.config.robot import Frictions
from daemon.preflight.workspace import Motion, Pair
from observer.jit import inline, kernel
from observer.mechanism.friction import FrictionParameters, friction_after
from observer.mechanism.linkage import Dynamics, dynamics
from observer.mechanism.mechanism import singularity_ratio
from observer.mechanism.parameters import LegParameters

RESPONSE_S: Final = 0.02
"""Time from the end of the silence to braking torque: the drive's own scan, and a velocity loop
that first has to remove the torque in force."""
STEP_S: Final = 0.004
RUN_S: Final = 2.0
"""Duration of a run; a ramp that has not ended by then cannot: the torque limit is below the
load."""
RUN_STEPS: Final = round(RUN_S / STEP_S)
_FULL: Final = 1.0
"""Full Coriolis terms."""


class AxisRunaway(NamedTuple):
    """Behaviour of one drive without commands, at the joint."""

    effort_max_si: float
    """The torque limit that is in the drive."""
    velocity_max_si: float
    """The highest speed that is allowed, where a run may start."""
    drive_velocity_max_si: float
    """The drive's own speed limit; infinity if it has none."""
    deceleration_si_per_s2: float
    detection_s: float
    """The longest silence before the drive reacts."""


class Runaway(NamedTuple):
    """The worst run of one axis; rad or m."""

    start_si: float
    """Position at the start."""
    until_noticed_si: float
    """Distance until the drive began to brake."""
    distance_si: float
    """Distance to the farthest position."""
    speed_max_si: float
    ends_stretched: bool
    """The run ended at the stretched leg, before the ramp did."""


class Run(NamedTuple):
    """Distances and speeds of both axes in one run."""

    until_noticed: Pair
    distance: Pair
    speed_max: Pair
    ends_stretched: bool


def worst_runaways(
    leg: LegParameters,
    frictions: Frictions,
    poses: Iterable[Pair],
    axes: tuple[AxisRunaway, AxisRunaway],
    stop_ratio: float,
) -> tuple[Runaway, Runaway]:
    """The farthest run of each axis over poses, directions and starts.

    Args:
        leg: the mechanism, with the patient's leg.
        frictions: of hip and slide.
        poses: where the core may end: rad, m.
        axes: both drives.
        stop_ratio: |sin| of shank and shoe below which a run ends.
    """
    found: list[tuple[Pair, Run]] = []
    for pose in poses:
        for signs, moves in product(product((-1.0, 1.0), repeat=2), product((0.0, 1.0), repeat=2)):
            speeds = _pair(
                sign * move * axis.velocity_max_si
                for sign, move, axis in zip(signs, moves, axes, strict=True)
            )
            start = Motion(pose, speeds)
            run = run_away(leg, frictions, start, _pair(signs), axes, stop_ratio)
            found.append((pose, run))
    return _worst(found, 0), _worst(found, 1)


def _worst(found: list[tuple[Pair, Run]], axis: int) -> Runaway:
    pose, run = max(found, key=lambda entry: entry[1].distance[axis])
    return Runaway(
        pose[axis],
        run.until_noticed[axis],
        run.distance[axis],
        run.speed_max[axis],
        run.ends_stretched,
    )


def run_away(
    leg: LegParameters,
    frictions: Frictions,
    start: Motion,
    signs: Pair,
    axes: tuple[AxisRunaway, AxisRunaway],
    stop_ratio: float,
) -> Run:
    """One run, by semi-implicit steps: eq. (6) with both drives' efforts, friction by eq. (11)."""
    return _run(leg, *frictions, *start, signs, *axes, stop_ratio)


@kernel
def _run(
    leg: LegParameters,
    hip_friction: FrictionParameters,
    slide_friction: FrictionParameters,
    start: Pair,
    speed: Pair,
    signs: Pair,
    hip: AxisRunaway,
    slide: AxisRunaway,
    stop_ratio: float,
) -> Run:
    position, velocity, friction = start, speed, (0.0, 0.0)
    push = signs[0] * hip.effort_max_si, signs[1] * slide.effort_max_si
    noticed, far, fast = (0.0, 0.0), (0.0, 0.0), (abs(speed[0]), abs(speed[1]))
    # The speed on each ramp; NaN before it begins.
    ramp = math.nan, math.nan
    for index in range(RUN_STEPS):
        if singularity_ratio(leg, np.array(position)) < stop_ratio:
            return Run(noticed, far, fast, True)
        d = dynamics(leg, position[0], position[1], velocity[0], velocity[1], _FULL)
        time_s = index * STEP_S
        ramp = _ramp(hip, ramp[0], time_s, velocity[0]), _ramp(slide, ramp[1], time_s, velocity[1])
        wanted = (
            _wanted(hip, push[0], ramp[0], velocity[0]),
            _wanted(slide, push[1], ramp[1], velocity[1]),
        )
        bias = d.bias_hip + friction[0], d.bias_slide + friction[1]
        aims = _aims(d, bias, push, wanted)
        efforts = (
            _bounded(d.m11 * aims[0] + d.m12 * aims[1] + bias[0], hip.effort_max_si),
            _bounded(d.m12 * aims[0] + d.m22 * aims[1] + bias[1], slide.effort_max_si),
        )
        acceleration = _solve(d, bias, efforts)
        velocity = velocity[0] + STEP_S * acceleration[0], velocity[1] + STEP_S * acceleration[1]
        position = position[0] + STEP_S * velocity[0], position[1] + STEP_S * velocity[1]
        friction = (
            friction_after(hip_friction, friction[0], velocity[0], STEP_S),
            friction_after(slide_friction, friction[1], velocity[1], STEP_S),
        )
        moved = abs(position[0] - start[0]), abs(position[1] - start[1])
        far = max(far[0], moved[0]), max(far[1], moved[1])
        fast = max(fast[0], abs(velocity[0])), max(fast[1], abs(velocity[1]))
        noticed = (
            moved[0] if math.isnan(ramp[0]) else noticed[0],
            moved[1] if math.isnan(ramp[1]) else noticed[1],
        )
        if _at_rest(hip, ramp[0], velocity[0]) and _at_rest(slide, ramp[1], velocity[1]):
            break
    return Run(noticed, far, fast, False)


@inline
def _ramp(axis: AxisRunaway, before: float, time_s: float, velocity_si: float) -> float:
    """The speed on the ramp after this step; NaN while the drive has not noticed the silence."""
    if time_s < axis.detection_s + RESPONSE_S:
        return math.nan
    speed_si = velocity_si if math.isnan(before) else before
    fall_si = min(abs(speed_si), axis.deceleration_si_per_s2 * STEP_S)
    return speed_si - math.copysign(fall_si, speed_si)


@inline
def _wanted(axis: AxisRunaway, push_si: float, ramp: float, velocity_si: float) -> float:
    """The acceleration that a drive's control loop demands; NaN where it only pushes."""
    if not math.isnan(ramp):
        return (ramp - velocity_si) / STEP_S
    limited = push_si * velocity_si > 0 and abs(velocity_si) >= axis.drive_velocity_max_si
    return 0.0 if limited else math.nan


@inline
def _at_rest(axis: AxisRunaway, ramp: float, velocity_si: float) -> bool:
    """True if the ramp has ended and the axis holds."""
    return ramp == 0.0 and abs(velocity_si) < axis.deceleration_si_per_s2 * STEP_S


@inline
def _aims(d: Dynamics, bias: Pair, push: Pair, wanted: Pair) -> Pair:
    """Accelerations as demanded; that of an axis that only pushes follows from the other's."""
    hip, slide = wanted
    if math.isnan(hip) and math.isnan(slide):
        return _solve(d, bias, push)
    if math.isnan(hip):
        return (push[0] - bias[0] - d.m12 * slide) / d.m11, slide
    if math.isnan(slide):
        return hip, (push[1] - bias[1] - d.m12 * hip) / d.m22
    return wanted


@inline
def _solve(d: Dynamics, bias: Pair, efforts: Pair) -> Pair:
    hip, slide = efforts[0] - bias[0], efforts[1] - bias[1]
    determinant = d.m11 * d.m22 - d.m12 * d.m12
    return (
        (d.m22 * hip - d.m12 * slide) / determinant,
        (d.m11 * slide - d.m12 * hip) / determinant,
    )


@inline
def _bounded(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))


def _pair(values: Iterable[float]) -> Pair:
    first, second = values
    return first, second
