"""Hand guiding, mode HAND_GUIDING: the leg can be moved by hand, to get a patient out.

There is no stiffness: the drives carry g(q) at the present pose and damp the motion. Damping is
small up to the speed at which a hand leads a leg, and larger beyond it. In the margins before the
ends of the range the larger damping begins at lower speeds, and a spring leads back in, as it does
before the stretched pose. None of these efforts steps. Friction holds a leg that is let go. Above
the speed limit of this mode the machine stops, and also when the hand switch opens, as in any mode.
Hand guiding begins once the drives are in torque mode and ends after its time: then the leg is held
where it is.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Final, NamedTuple, Self

import msgspec
import numpy as np
from gaitd_names import ProgressCode, Stage

from daemon.config.settings import HandGuiding as Settings
from daemon.core.core_config import CoreConfig
from daemon.core.exercises.exercise import Exercise, LegSample, LegStart, Reference
from daemon.core.motion.gait_shape import Pair
from daemon.core.safety.limits import AxisLimits
from daemon.ipc.record import ModeRequest
from daemon.ipc.report import Progress
from observer.mechanism.mechanism import singularity_ratio
from observer.mechanism.parameters import LegParameters

STRETCHED_MARGIN_RATIO: Final = 2.0
"""Start of the margin before the stretched pose, as a multiple of the ratio that stops."""
GRADIENT_STEP: Final = 1e-3
"""Step of the numerical gradient, rad or m."""


class Guiding(NamedTuple):
    """Damping and spring of one axis: N·m, rad/s or N, m/s."""

    damping_si: float
    slow_si_per_s: float
    damping_beyond_si: float
    edge_si: float
    """Spring effort at a hard limit that leads back in."""


def guiding_settings(rules: Settings) -> tuple[Guiding, Guiding]:
    """Settings of [hand_guiding] for hip and slide; its tables have the order of `Guiding`."""
    hip, slide = msgspec.structs.astuple(rules.hip), msgspec.structs.astuple(rules.slide)
    return Guiding(*hip), Guiding(*slide)


@dataclass(frozen=True, slots=True, kw_only=True)
class HandGuiding(Exercise):
    """Hand guiding of one leg."""

    # No step of torque from hold to hand guiding, which begins once the drives are in torque mode.
    continues_effort_at_stages: ClassVar[bool] = True

    start: Pair
    """Pose held until the drives are in torque mode."""
    leg: LegParameters
    limits: tuple[AxisLimits, AxisLimits]
    guiding: tuple[Guiding, Guiding]
    stretched_stop_ratio: float
    """|sin| of the angle between shank and shoe that stops the machine."""
    duration_s: float
    stage: Stage | None = Stage.PREPARING

    @classmethod
    def begin(
        cls, legs: Sequence[LegStart], wanted: ModeRequest, config: CoreConfig
    ) -> Sequence[Exercise]:
        """See `Exercise`."""
        del wanted
        return [
            cls(
                start=leg.pose,
                leg=leg.parameters,
                limits=leg.limits,
                guiding=guiding_settings(config.hand_guiding),
                stretched_stop_ratio=config.thresholds.singularity_stop_ratio,
                duration_s=config.hand_guiding.duration_max_s,
            )
            for leg in legs
        ]

    def advance(self, leg: LegSample, dt_s: float) -> Self:
        """See `Exercise`; it begins once both drives are in torque mode."""
        elapsed_s = self.elapsed_s + dt_s
        if elapsed_s >= self.duration_s:
            return replace(self, stage=Stage.OVER, elapsed_s=0.0)
        if self.stage is Stage.PREPARING and leg.in_torque_mode:
            return replace(self, stage=Stage.PLAYING, elapsed_s=0.0)
        return replace(self, elapsed_s=elapsed_s)

    def targets(self, leg: LegSample) -> Reference:
        """The start pose at first, then damping and springs only."""
        if self.stage is Stage.PREPARING:
            return Reference(self.start, (0.0, 0.0), (0.0, 0.0), guided=True)
        hip, slide = (
            slowing(*axis) + leading_in(axis[0], axis[1], axis[3])
            for axis in zip(self.guiding, leg.position, leg.velocity, self.limits, strict=True)
        )
        bent_nm, bent_n = bending(self.leg, self.guiding, self.stretched_stop_ratio, leg.position)
        feedforward = hip + bent_nm, slide + bent_n
        return Reference(leg.position, (0.0, 0.0), feedforward, guided=False)

    def progress(self) -> Progress | None:
        """See `Exercise`."""
        if self.stage is not Stage.PLAYING:
            return Exercise.progress(self)
        left_s = self.duration_s - self.elapsed_s
        return Progress(ProgressCode.GUIDED_BY_HAND, "", (left_s,))


def slowing(guiding: Guiding, position_si: float, velocity_si: float, limits: AxisLimits) -> float:
    """Damping effort of one axis against its motion, N·m or N; 0 at rest."""
    slow_si = guiding.slow_si_per_s * (1 - _depth(position_si, velocity_si, limits))
    beyond_si = max(abs(velocity_si) - slow_si, 0.0)
    against_si = guiding.damping_si * abs(velocity_si) + guiding.damping_beyond_si * beyond_si
    return -math.copysign(against_si, velocity_si)


def _depth(position_si: float, velocity_si: float, limits: AxisLimits) -> float:
    """Depth in the margin ahead of the motion: 0 before it, 1 at the hard limit."""
    room_si = (
        limits.position_max_si - position_si
        if velocity_si > 0
        else position_si - limits.position_min_si
    )
    return min(max(1 - room_si / limits.soft_margin_si, 0.0), 1.0)


def leading_in(guiding: Guiding, position_si: float, limits: AxisLimits) -> float:
    """Spring effort in the soft margins of one axis, N·m or N; 0 outside of them."""
    below_si = max(limits.position_min_si + limits.soft_margin_si - position_si, 0.0)
    above_si = max(position_si - limits.position_max_si + limits.soft_margin_si, 0.0)
    return guiding.edge_si * (below_si - above_si) / limits.soft_margin_si


def bending(
    leg: LegParameters, guiding: tuple[Guiding, Guiding], stop_ratio: float, position: Pair
) -> Pair:
    """Efforts away from the stretched pose, along the gradient of its distance; N·m, N.

    `stop_ratio` is the |sin| of the angle between shank and shoe that stops the machine.
    """
    width = stop_ratio * (STRETCHED_MARGIN_RATIO - 1)
    depth = (stop_ratio + width - _stretched(leg, position)) / width
    if depth <= 0:
        return 0.0, 0.0
    slope = (
        _slope(leg, position, (GRADIENT_STEP, 0.0)),
        _slope(leg, position, (0.0, GRADIENT_STEP)),
    )
    edges = guiding[0].edge_si, guiding[1].edge_si
    scale = min(edge_si / abs(one) for edge_si, one in zip(edges, slope, strict=True) if one != 0.0)
    return depth * scale * slope[0], depth * scale * slope[1]


def _slope(leg: LegParameters, position: Pair, step: Pair) -> float:
    ahead = _stretched(leg, (position[0] + step[0], position[1] + step[1]))
    behind = _stretched(leg, (position[0] - step[0], position[1] - step[1]))
    return (ahead - behind) / (2 * GRADIENT_STEP)


def _stretched(leg: LegParameters, position: Pair) -> float:
    return float(singularity_ratio(leg, np.array(position)))
