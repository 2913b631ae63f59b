"""Paths of the leg when it is stopped or left without power: pure functions of the settings.

The workspace is not a box: whether a hip angle is reachable depends on the slide's position. So a
stop is computed along its path in both coordinates. Three kinds are swept over the stride of the
gait at the highest cadence: both axes on their quick-stop ramps, and each axis coasting (its drive
without voltage) while the other ramps down. `drift` leaves both axes without power, from rest.

A coasting axis obeys its row of (6) with the other axis's motion given; friction is eq. (11). Paths
begin REACTION_S late, because a fault frame takes up to two cycles and a window to act.

The paths are kernels: the core sweeps them too, at each of its starts.
"""

import math
from collections.abc import Iterable
from enum import Enum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from daemon.config.robot import Frictions
from daemon.config.settings import Gait
from daemon.core.motion.gait_shape import gait_angles, gait_shape, joints_of_angles
from observer.jit import inline, kernel
from observer.mechanism.friction import FrictionParameters, friction_after, static_friction
from observer.mechanism.linkage import dynamics
from observer.mechanism.mechanism import singularity_ratio
from observer.mechanism.parameters import LegParameters

Pair = tuple[float, float]
"""Hip and slide."""
Vector = NDArray[np.float64]

REACTION_S: Final = 0.03
"""From the fault frame to the begin of the ramp in both drives: 20 ms and a window."""
RAMP_STEP_S: Final = 0.005
COAST_STEP_S: Final = 0.005
"""Half a cycle: with eq. (11) solved exponentially this is the filter's own, stable step."""
COAST_S: Final = 1.5
COAST_STEPS: Final = round(COAST_S / COAST_STEP_S)
DRIFT_S: Final = 3.0
DRIFT_STEPS: Final = round(DRIFT_S / COAST_STEP_S)
PHASES: Final = 60
_PHASE_STEP: Final = 1e-4
_FULL: Final = 1.0
"""Full Coriolis terms."""


class Motion(NamedTuple):
    """Position and velocity of a leg at one instant: rad, m, rad/s, m/s."""

    position: Pair
    velocity: Pair


class Box(NamedTuple):
    """Hard position limits: rad, m."""

    low: Pair
    high: Pair

    def holds(self, position: Pair) -> bool:
        """True if a pose is inside."""
        return all(
            low <= at <= high for low, at, high in zip(self.low, position, self.high, strict=True)
        )


class Extent(NamedTuple):
    """Extent of a set of poses."""

    low: Pair
    high: Pair
    least_singularity_ratio: float
    """|sin| of the angle between shank and shoe; 0 where a pose does not exist."""

    def inside(self, box: Box) -> bool:
        """True if the whole extent lies inside the box."""
        return box.holds(self.low) and box.holds(self.high)


class StopKind(Enum):
    """Kind of stop: which axes brake."""

    BOTH_RAMP = "both axes on their ramps"
    HIP_COASTS = "hip coasting, slide on its ramp"
    SLIDE_COASTS = "slide coasting, hip on its ramp"


class Sweep(NamedTuple):
    """The worst of one kind of stop over a stride."""

    kind: StopKind
    extent: Extent
    end_speed: Pair
    """Fastest arrival at a position limit, rad/s and m/s; 0 where none is reached."""


class Drift(NamedTuple):
    """Motion without power, from rest at one pose."""

    start: Pair
    end: Pair
    speed_max: Pair
    reached_limit: bool
    """A position limit, or the end of the mechanism's reach, stopped it."""


def gait_motions(
    leg: LegParameters, gait: Gait, cadence_hz: float, phases: int = PHASES
) -> tuple[Motion, ...]:
    """The stride at full amplitude, at equal steps of phase.

    Raises:
        observer.mechanism.mechanism.WorkspaceError: the mechanism cannot do this gait.
    """
    shape = gait_shape(gait)

    def joints(phase: float) -> Pair:
        return joints_of_angles(leg, gait_angles(shape, phase, 1.0))

    motions: list[Motion] = []
    for index in range(phases):
        at, soon = joints(index / phases), joints(index / phases + _PHASE_STEP)
        rate = cadence_hz / _PHASE_STEP
        velocity = (soon[0] - at[0]) * rate, (soon[1] - at[1]) * rate
        motions.append(Motion(at, velocity))
    return tuple(motions)


def extent_of(leg: LegParameters, positions: Iterable[Pair]) -> Extent:
    """Bounding box and smallest singularity ratio of poses."""
    return _extent(leg, np.array(list(positions)))


@kernel
def ramp_path(motion: Motion, decelerations: Pair) -> Vector:
    """Poses while both axes ramp down to rest, each on its own ramp, shape (n, 2)."""
    (hip, slide), (hip_speed, slide_speed) = motion
    hip_ramp, slide_ramp = decelerations
    stop_s = REACTION_S + max(abs(hip_speed) / hip_ramp, abs(slide_speed) / slide_ramp)
    path = np.empty((math.ceil(stop_s / RAMP_STEP_S) + 1, 2))
    for index in range(len(path)):
        time_s = index * RAMP_STEP_S
        path[index, 0], _ = _on_ramp(hip, hip_speed, hip_ramp, time_s)
        path[index, 1], _ = _on_ramp(slide, slide_speed, slide_ramp, time_s)
    return path


def sweep_ramps(leg: LegParameters, motions: Iterable[Motion], decelerations: Pair) -> Sweep:
    """Sweep of both axes on their ramps, from each of the motions."""
    poses = np.concatenate([ramp_path(motion, decelerations) for motion in motions])
    return Sweep(StopKind.BOTH_RAMP, _extent(leg, poses), (0.0, 0.0))


def sweep_coasting(
    leg: LegParameters,
    frictions: Frictions,
    motions: Iterable[Motion],
    decelerations: Pair,
    box: Box,
    axis: int,
) -> Sweep:
    """Sweep of one axis (0 hip, 1 slide) coasting while the other ramps down, from each motion."""
    poses: list[Vector] = []
    end_speed = 0.0
    for motion in motions:
        path = coasting_path(leg, frictions[axis], *motion, decelerations, axis)
        outside = np.flatnonzero((path[:, axis] < box.low[axis]) | (path[:, axis] > box.high[axis]))
        if outside.size:
            end_speed = max(end_speed, abs(float(path[outside[0], 2 + axis])))
            path = path[: outside[0]]
        poses.append(path[:, :2])
    kind = StopKind.SLIDE_COASTS if axis else StopKind.HIP_COASTS
    speeds = (0.0, end_speed) if axis else (end_speed, 0.0)
    return Sweep(kind, _extent(leg, np.concatenate(poses)), speeds)


def drift(leg: LegParameters, frictions: Frictions, start: Pair, box: Box) -> Drift:
    """Motion of both axes without power, from rest: eq. (23) without drives and patient."""
    end, fastest, reached_limit = _drift(leg, *frictions, start, box)
    return Drift(start, end, fastest, reached_limit)


@inline
def _on_ramp(start: float, speed: float, deceleration: float, time_s: float) -> Pair:
    """Position and velocity of one axis: constant speed for the reaction time, then the ramp."""
    if time_s <= REACTION_S:
        return start + speed * time_s, speed
    braking_s = min(time_s - REACTION_S, abs(speed) / deceleration)
    slope = math.copysign(deceleration, speed)
    position = start + speed * (REACTION_S + braking_s) - 0.5 * slope * braking_s**2
    return position, speed - slope * braking_s


@inline
def _ramp_acceleration(speed: float, deceleration: float, time_s: float) -> float:
    braking = REACTION_S < time_s < REACTION_S + abs(speed) / deceleration
    return -math.copysign(deceleration, speed) if braking else 0.0


@kernel
def coasting_path(
    leg: LegParameters,
    friction: FrictionParameters,
    start: Pair,
    speed: Pair,
    decelerations: Pair,
    axis: int,
) -> Vector:
    """Rows of hip, slide and their velocities, until COAST_S or where no pose exists."""
    other = 1 - axis
    path = np.empty((COAST_STEPS, 4))
    position, velocity = start[axis], speed[axis]
    force = static_friction(friction, velocity)
    for index in range(COAST_STEPS):
        time_s = index * COAST_STEP_S
        driven, driven_velocity = _on_ramp(start[other], speed[other], decelerations[other], time_s)
        row = path[index]
        row[axis], row[other] = position, driven
        row[2 + axis], row[2 + other] = velocity, driven_velocity
        d = dynamics(leg, row[0], row[1], row[2], row[3], _FULL)
        if not d.closes:
            return path[: index + 1]
        inertia, bias = (d.m22, d.bias_slide) if axis else (d.m11, d.bias_hip)
        pull = d.m12 * _ramp_acceleration(speed[other], decelerations[other], time_s)
        velocity -= COAST_STEP_S * (pull + bias + force) / inertia
        position += COAST_STEP_S * velocity
        force = friction_after(friction, force, velocity, COAST_STEP_S)
    return path


@kernel
def _drift(
    leg: LegParameters,
    hip_friction: FrictionParameters,
    slide_friction: FrictionParameters,
    start: Pair,
    box: Box,
) -> tuple[Pair, Pair, bool]:
    """Final position, highest speeds, and whether a limit stopped the motion."""
    hip, slide = start
    v_hip = v_slide = f_hip = f_slide = fast_hip = fast_slide = 0.0
    for _ in range(DRIFT_STEPS):
        d = dynamics(leg, hip, slide, v_hip, v_slide, _FULL)
        net_hip, net_slide = -d.bias_hip - f_hip, -d.bias_slide - f_slide
        determinant = d.m11 * d.m22 - d.m12 * d.m12
        v_hip += COAST_STEP_S * (d.m22 * net_hip - d.m12 * net_slide) / determinant
        v_slide += COAST_STEP_S * (d.m11 * net_slide - d.m12 * net_hip) / determinant
        next_hip, next_slide = hip + COAST_STEP_S * v_hip, slide + COAST_STEP_S * v_slide
        held = box.low[0] <= next_hip <= box.high[0] and box.low[1] <= next_slide <= box.high[1]
        if not d.closes or not held:
            return (hip, slide), (fast_hip, fast_slide), True
        hip, slide = next_hip, next_slide
        fast_hip, fast_slide = max(fast_hip, abs(v_hip)), max(fast_slide, abs(v_slide))
        f_hip = friction_after(hip_friction, f_hip, v_hip, COAST_STEP_S)
        f_slide = friction_after(slide_friction, f_slide, v_slide, COAST_STEP_S)
    return (hip, slide), (fast_hip, fast_slide), False


def _extent(leg: LegParameters, poses: Vector) -> Extent:
    """Extent of rows of hip and slide."""
    (hip_low, slide_low), (hip_high, slide_high) = poses.min(0).tolist(), poses.max(0).tolist()
    return Extent((hip_low, slide_low), (hip_high, slide_high), _least_ratio(leg, poses))


@kernel
def _least_ratio(leg: LegParameters, poses: Vector) -> float:
    least = math.inf
    for pose in poses:
        least = min(least, singularity_ratio(leg, pose))
    return least
