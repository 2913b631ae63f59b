"""Inverse dynamics: drive efforts computed from the encoders' motion, without a filter.

    M(q) q'' + c(q, q') + C~(q) q' + g(q) + F_s(q') = effort of the drives + of the patient      (6)

The left side needs positions only: three samples in a row give the mean acceleration about the
middle one. The right side is the mean of the efforts of the two cycles between them. The residual
is the patient's effort, or a fault: a drive that gives another torque than it reports, a motor or
an encoder the wrong way round, an encoder that stands still. `effort_monitor.py` checks it.

One sample of acceleration has a noise of 1 rad/s^2 or 0.5 m/s^2 (an encoder's step in 10 ms
squared), some 2 N·m and 10 N, so a single cycle is not conclusive.
"""

from typing import NamedTuple

from daemon.core.safety.joints import Joint
from observer.jit import inline, kernel
from observer.mechanism.friction import (
    FrictionParameters,
    OverPosition,
    at_position,
    static_friction,
)
from observer.mechanism.linkage import dynamics
from observer.mechanism.parameters import LegParameters

Pair = tuple[float, float]
"""Hip and slide: N·m and N, rad and m."""

Law = tuple[tuple[float, ...], tuple[float, ...]]
"""`FrictionParameters` of an axis and its `OverPosition`, as plain tuples."""

ROW = 3
"""Number of samples of both axes in a row that the inverse dynamics need."""


class InverseDynamics(NamedTuple):
    """The terms of (6) for one leg, about the sample before the newest one."""

    samples_in_a_row: int = 0
    position: Pair = (0.0, 0.0)
    """Position of the newest sample; `velocity` and `measured` are of this sample too."""
    velocity: Pair = (0.0, 0.0)
    measured: Pair = (0.0, 0.0)
    effort: Pair = (0.0, 0.0)
    """Effort of the drives, by their own measurement."""
    load: Pair = (0.0, 0.0)
    """Sum of g, Coriolis and dampers."""
    inertia: Pair = (0.0, 0.0)
    """M q'', including the coupling with the other axis."""
    coupled: Pair = (0.0, 0.0)
    """The part of `inertia` from the other axis's acceleration."""
    friction: Pair = (0.0, 0.0)
    """Friction of the static law (13); 0 between two samples at rest, where it is not known."""

    @property
    def known(self) -> bool:
        """True if the terms are of the newest cycle; else they are older."""
        return self.samples_in_a_row >= ROW

    def residual(self, axis: int) -> float:
        """Residual of one axis: effort beyond motion, load and friction, N·m or N."""
        explained = self.load[axis] + self.inertia[axis] + self.friction[axis]
        return self.effort[axis] - explained

    def held(self, axis: int) -> float:
        """Effort that friction and patient hold together at standstill of a joint, N·m or N.

        The joint's own acceleration is left out: at standstill its samples are only noise.
        """
        return self.effort[axis] - self.load[axis] - self.coupled[axis]


def evaluate(
    before: InverseDynamics,
    leg: tuple[float, ...],
    frictions: tuple[Law, Law],
    joints: tuple[Joint, Joint],
) -> InverseDynamics:
    """The inverse dynamics after this cycle's samples.

    Args:
        before: result of the previous cycle.
        leg: `LegParameters` of the mechanism, as a plain tuple.
        frictions: of hip and slide, eq. (13).
        joints: hip and slide at this cycle's samples; a missing sample restarts the count.
    """
    hip, slide = joints
    if not (hip.fresh and slide.fresh and hip.elapsed_s > 0 and slide.elapsed_s > 0):
        return before._replace(samples_in_a_row=0)
    count = before.samples_in_a_row + 1
    position = hip.position_si, slide.position_si
    velocity = hip.velocity_si, slide.velocity_si
    measured = hip.effort_si, slide.effort_si
    if count < ROW:
        return before._replace(
            samples_in_a_row=count, position=position, velocity=velocity, measured=measured
        )
    load1, load2, own1, own2, coupled1, coupled2, friction1, friction2 = _terms(
        leg,
        frictions[0],
        frictions[1],
        *before.position,
        0.5 * (before.velocity[0] + hip.velocity_si),
        0.5 * (before.velocity[1] + slide.velocity_si),
        (hip.velocity_si - before.velocity[0]) / hip.elapsed_s,
        (slide.velocity_si - before.velocity[1]) / slide.elapsed_s,
    )
    return InverseDynamics(
        samples_in_a_row=count,
        position=position,
        velocity=velocity,
        measured=measured,
        effort=(
            0.5 * (before.measured[0] + hip.effort_si),
            0.5 * (before.measured[1] + slide.effort_si),
        ),
        load=(load1, load2),
        inertia=(own1 + coupled1, own2 + coupled2),
        coupled=(coupled1, coupled2),
        friction=(friction1, friction2),
    )


class Needed(NamedTuple):
    """Effort that a motion needs beyond the load g(q): N·m and N."""

    whole: Pair
    """Inertia, Coriolis terms, dampers and friction of the static law (13)."""
    certain: Pair
    """The same, with friction only where it makes the need less.

    At a turn friction reverses faster than any person.
    """


def needed(
    leg: tuple[float, ...],
    frictions: tuple[Law, Law],
    position: Pair,
    velocity: Pair,
    acceleration: Pair,
) -> Needed:
    """Effort that a motion needs beyond the load g(q): N·m and N.

    Args:
        leg: as in `evaluate`.
        frictions: as in `evaluate`.
        position: of hip and slide.
        velocity: of hip and slide.
        acceleration: of hip and slide.
    """
    hip, slide, certain_hip, certain_slide = _needed(
        leg, frictions[0], frictions[1], *position, *velocity, *acceleration
    )
    return Needed((hip, slide), (certain_hip, certain_slide))


def warm_up(leg: tuple[float, ...], frictions: tuple[Law, Law]) -> None:
    """Compile the kernels or load them from the cache, before the first cycle."""
    _terms(leg, frictions[0], frictions[1], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    needed(leg, frictions, (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))


@inline
def _friction(of: Law, position: float, speed: float) -> float:
    """Friction of the static law (13) where an axis is."""
    law, over = of
    return static_friction(
        at_position(FrictionParameters(*law), OverPosition(*over), position), speed
    )


@kernel
def _terms(
    leg: tuple[float, ...],
    hip_friction: Law,
    slide_friction: Law,
    hip: float,
    slide: float,
    hip_speed: float,
    slide_speed: float,
    hip_acceleration: float,
    slide_acceleration: float,
) -> tuple[float, float, float, float, float, float, float, float]:
    d = dynamics(LegParameters(*leg), hip, slide, hip_speed, slide_speed, 1.0)
    return (
        d.bias_hip,
        d.bias_slide,
        d.m11 * hip_acceleration,
        d.m22 * slide_acceleration,
        d.m12 * slide_acceleration,
        d.m12 * hip_acceleration,
        _friction(hip_friction, hip, hip_speed),
        _friction(slide_friction, slide, slide_speed),
    )


@kernel
def _needed(
    leg: tuple[float, ...],
    hip_friction: Law,
    slide_friction: Law,
    hip: float,
    slide: float,
    hip_speed: float,
    slide_speed: float,
    hip_acceleration: float,
    slide_acceleration: float,
) -> tuple[float, float, float, float]:
    p = LegParameters(*leg)
    moving = dynamics(p, hip, slide, hip_speed, slide_speed, 1.0)
    resting = dynamics(p, hip, slide, 0.0, 0.0, 0.0)
    hip_need = moving.m11 * hip_acceleration + moving.m12 * slide_acceleration
    slide_need = moving.m12 * hip_acceleration + moving.m22 * slide_acceleration
    hip_need += moving.bias_hip - resting.bias_hip
    slide_need += moving.bias_slide - resting.bias_slide
    hip_whole = hip_need + _friction(hip_friction, hip, hip_speed)
    slide_whole = slide_need + _friction(slide_friction, slide, slide_speed)
    return hip_whole, slide_whole, _less(hip_need, hip_whole), _less(slide_need, slide_whole)


@kernel
def _less(first: float, second: float) -> float:
    """The smaller of two efforts in one direction; 0 if their directions differ."""
    return max(min(first, second), 0.0) + min(max(first, second), 0.0)
