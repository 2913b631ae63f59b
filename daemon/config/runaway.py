"""How far a leg runs when the core dies at the worst moment: pure functions of the settings.

The drives do not know that nobody is there until 1016h (or 1400h:05) has run out. Until then each
goes on with the last torque that it was told, at most its own torque limit; then both make the
quick stop of 6007h. Rules of the computation:

1. Each drive pushes with all that its torque limit leaves, either way, for its own detection time
   and RESPONSE_S; a drive that watches its speed (6080h) pushes no faster than that.
2. Then it brakes along its ramp (6085h) as well as its torque limit lets it: the effort that the
   ramp asks of row (6) of the mechanism, with the other axis in motion, is cut off at the limit.
3. The other axis does the same, both ways. Each axis starts from rest or at its highest allowed
   speed the way that it pushes, at each of the gait's poses: sixteen runs for each pose.
4. A run ends where both are at rest, or where the mechanism does: at the leg stretched so far that
   the service would have stopped. What lies beyond is the machine's own end stops, not the drives'.

How far is measured from where the core died, to the farthest place, in the joint's own coordinate.
What a position limit in the drives (607Dh) takes away from it is not counted: not every make keeps
one in torque mode (docs/backstop.md).
"""

import math
from collections.abc import Iterable
from itertools import product
from typing import Final, NamedTuple

import numpy as np

from daemon.config.workspace import Frictions, Motion, Pair
from observer.friction import friction_after
from observer.mechanism import Dynamics, LegParameters, dynamics, singularity_ratio

RESPONSE_S: Final = 0.02
"""From the end of the silence to braking torque: the drive's own scan, and a velocity loop that has
first to undo the torque that it found."""
STEP_S: Final = 0.004
RUN_S: Final = 2.0
"""A ramp that has not ended by then was never one: the torque limit is below the load."""
_FULL: Final = 1.0
"""With Coriolis."""


class AxisRunaway(NamedTuple):
    """What one drive does by itself, at the joint."""

    effort_max_si: float
    """The torque limit that is in the drive."""
    velocity_max_si: float
    """The highest speed that is allowed, where a run may start."""
    drive_velocity_max_si: float
    """The speed that the drive itself keeps to; infinity where it keeps to none."""
    deceleration_si_per_s2: float
    detection_s: float
    """The longest silence that it lets pass."""


class Runaway(NamedTuple):
    """The worst of one axis; rad or m."""

    start_si: float
    """Where it began."""
    until_noticed_si: float
    """How far it had come when the drive began to brake."""
    distance_si: float
    """How far it had come at the farthest."""
    speed_max_si: float
    ends_stretched: bool
    """Not the ramp but the stretched leg ended it."""


class Run(NamedTuple):
    """How far both axes came in one run."""

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
    """The farthest of each axis over poses, directions and starts.

    Args:
        leg: the mechanism, with the patient's leg.
        frictions: of hip and slide.
        poses: where the core may die: rad, m.
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
    drives = tuple(_Drive(axis, sign) for axis, sign in zip(axes, signs, strict=True))
    position, velocity, friction = start.position, start.velocity, (0.0, 0.0)
    noticed, far, fast = (0.0, 0.0), (0.0, 0.0), _pair(map(abs, velocity))
    for index in range(round(RUN_S / STEP_S)):
        ratio = float(singularity_ratio(leg, np.array(position)))
        if ratio < stop_ratio:
            return Run(noticed, far, fast, ends_stretched=True)
        d = dynamics(leg, *position, *velocity, _FULL)
        wanted = _pair(
            drive.wanted(index * STEP_S, v) for drive, v in zip(drives, velocity, strict=True)
        )
        acceleration = _accelerations(d, friction, drives, wanted)
        velocity = velocity[0] + STEP_S * acceleration[0], velocity[1] + STEP_S * acceleration[1]
        position = position[0] + STEP_S * velocity[0], position[1] + STEP_S * velocity[1]
        friction = (
            friction_after(frictions[0], friction[0], velocity[0], STEP_S),
            friction_after(frictions[1], friction[1], velocity[1], STEP_S),
        )
        moved = abs(position[0] - start.position[0]), abs(position[1] - start.position[1])
        far = max(far[0], moved[0]), max(far[1], moved[1])
        fast = max(fast[0], abs(velocity[0])), max(fast[1], abs(velocity[1]))
        noticed = _pair(
            before if drive.brakes else now
            for drive, before, now in zip(drives, noticed, moved, strict=True)
        )
        if all(drive.at_rest(v) for drive, v in zip(drives, velocity, strict=True)):
            break
    return Run(noticed, far, fast, ends_stretched=False)


class _Drive:
    """What one drive does in one run."""

    def __init__(self, axis: AxisRunaway, sign: float) -> None:
        self.axis = axis
        self.effort_si = sign * axis.effort_max_si
        self.brakes = False
        self._ramp_si_per_s = 0.0

    def wanted(self, time_s: float, velocity_si: float) -> float:
        """The acceleration that it would like to have; NaN where it only pushes."""
        axis = self.axis
        if time_s < axis.detection_s + RESPONSE_S:
            faster = self.effort_si * velocity_si > 0
            limited = faster and abs(velocity_si) >= axis.drive_velocity_max_si
            return 0.0 if limited else math.nan
        if not self.brakes:
            self.brakes, self._ramp_si_per_s = True, velocity_si
        fall_si = min(abs(self._ramp_si_per_s), axis.deceleration_si_per_s2 * STEP_S)
        self._ramp_si_per_s -= math.copysign(fall_si, self._ramp_si_per_s)
        return (self._ramp_si_per_s - velocity_si) / STEP_S

    def at_rest(self, velocity_si: float) -> bool:
        """Its ramp has ended, and it holds."""
        ended = self.brakes and self._ramp_si_per_s == 0.0
        return ended and abs(velocity_si) < self.axis.deceleration_si_per_s2 * STEP_S


def _accelerations(d: Dynamics, friction: Pair, drives: tuple[_Drive, ...], wanted: Pair) -> Pair:
    """Both accelerations, with what the drives want cut off at their torque limits."""
    hip, slide = drives
    bias = d.bias_hip + friction[0], d.bias_slide + friction[1]
    pushed = _solve(d, bias, (hip.effort_si, slide.effort_si))
    aims = _aims(d, bias, (hip.effort_si, slide.effort_si), wanted, pushed)
    efforts = (
        _bounded(d.m11 * aims[0] + d.m12 * aims[1] + bias[0], hip.axis.effort_max_si),
        _bounded(d.m12 * aims[0] + d.m22 * aims[1] + bias[1], slide.axis.effort_max_si),
    )
    return _solve(d, bias, efforts)


def _aims(d: Dynamics, bias: Pair, push: Pair, wanted: Pair, pushed: Pair) -> Pair:
    """Accelerations as wanted; of an axis that only pushes, what follows from the other's."""
    hip, slide = wanted
    if math.isnan(hip) and math.isnan(slide):
        return pushed
    if math.isnan(hip):
        return (push[0] - bias[0] - d.m12 * slide) / d.m11, slide
    if math.isnan(slide):
        return hip, (push[1] - bias[1] - d.m12 * hip) / d.m22
    return wanted


def _solve(d: Dynamics, bias: Pair, efforts: Pair) -> Pair:
    hip, slide = efforts[0] - bias[0], efforts[1] - bias[1]
    determinant = d.m11 * d.m22 - d.m12 * d.m12
    return (
        (d.m22 * hip - d.m12 * slide) / determinant,
        (d.m11 * slide - d.m12 * hip) / determinant,
    )


def _bounded(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))


def _pair(values: Iterable[float]) -> Pair:
    first, second = values
    return first, second
