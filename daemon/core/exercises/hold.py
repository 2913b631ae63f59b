"""Mode HOLD: brake from a speed with the deceleration of a quick stop, then hold the end."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

from daemon.core.core_config import CoreConfig
from daemon.core.exercises.exercise import Exercise, LegSample, LegStart, Reference
from daemon.core.motion.gait_shape import Pair
from daemon.core.safety.limits import AxisLimits
from daemon.ipc.record import ModeRequest


@dataclass(frozen=True, slots=True, kw_only=True)
class Hold(Exercise):
    """Brakes from `start` and then holds the final position."""

    start: Pair
    start_velocity: Pair
    deceleration: Pair

    @classmethod
    def braking(cls, start: Pair, velocity: Pair, limits: tuple[AxisLimits, AxisLimits]) -> Self:
        """Brake from a pose and its speeds, both rad, m and per s."""
        hip, slide = limits
        return cls(
            start=start,
            start_velocity=velocity,
            deceleration=(
                hip.quick_stop_deceleration_si_per_s2,
                slide.quick_stop_deceleration_si_per_s2,
            ),
        )

    @classmethod
    def begin(
        cls, legs: Sequence[LegStart], wanted: ModeRequest, config: CoreConfig
    ) -> Sequence[Exercise]:
        """Hold the present pose of each leg, from rest."""
        del wanted, config
        return [cls.braking(leg.pose, (0.0, 0.0), leg.limits) for leg in legs]

    def advance(self, leg: LegSample, dt_s: float) -> Self:
        """See `Exercise`."""
        del leg
        return replace(self, elapsed_s=self.elapsed_s + dt_s)

    def targets(self, leg: LegSample) -> Reference:
        """Reference on the braking ramp, then at its end."""
        del leg
        (p0, v0), (p1, v1) = (
            _on_ramp(start, velocity, deceleration, self.elapsed_s)
            for start, velocity, deceleration in zip(
                self.start, self.start_velocity, self.deceleration, strict=True
            )
        )
        return Reference((p0, p1), (v0, v1), (0.0, 0.0), guided=True)


def _on_ramp(start: float, velocity: float, deceleration: float, elapsed_s: float) -> Pair:
    """Position and velocity of one axis after a time of braking."""
    braking_s = abs(velocity) / deceleration
    time_s = min(elapsed_s, braking_s)
    sign = math.copysign(1.0, velocity)
    position = start + velocity * time_s - 0.5 * sign * deceleration * time_s**2
    # At the end of the ramp the reference stands: a rest of rounding would be a motion.
    return position, velocity - sign * deceleration * time_s if time_s < braking_s else 0.0
