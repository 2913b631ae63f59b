"""Mode EXCITE: an open-loop scenario about g of mid pose, inside a window of positions.

    approaching (with a rest at mid pose, until the drives are in torque mode) -> playing -> over

The load is g of mid pose throughout: the springs then bring the leg back, as in the paper. With
g(q) every pose would be in equilibrium, and the leg would drift until it leaves its window.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Final, Self

from gaitd_names import RefusalCode, Stage

from daemon.config.settings import Sinusoid
from daemon.core.core_config import CoreConfig
from daemon.core.exercises import approach
from daemon.core.exercises.approach import Approach
from daemon.core.exercises.exercise import Exercise, LegSample, LegStart, Reference
from daemon.core.exercises.guards import GuardInputs
from daemon.core.motion.gait_shape import Pair, gait_angles, joints_of_angles, load_at
from daemon.ipc.record import ModeRequest
from daemon.ipc.report import Refusal
from observer.mechanism.parameters import LegParameters

SETTLE_S: Final = 1.0
"""Rest at mid pose before an excitation begins."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Excite(Exercise):
    """An open-loop scenario of one leg."""

    continues_effort: ClassVar[bool] = False

    leg: LegParameters
    way: Approach
    middle: Pair
    middle_load: Pair
    """g at mid pose: N·m, N."""
    window: Pair
    """Half width of the window about mid pose: rad, m."""
    torque: tuple[Sinusoid, ...]
    artificial: tuple[Sinusoid, ...]
    duration_s: float
    stage: Stage | None = Stage.APPROACHING

    @classmethod
    def refuse(cls, wanted: ModeRequest, now: GuardInputs) -> Refusal | None:
        """See `Exercise`."""
        longest_s = now.scenarios.get(wanted.scenario)
        if longest_s is None:
            return Refusal(RefusalCode.NO_SUCH_SCENARIO, said=", ".join(sorted(now.scenarios)))
        if not 0 < wanted.duration_s <= longest_s:
            values = wanted.duration_s, 0.0, longest_s
            return Refusal(RefusalCode.DURATION_OUT_OF_RANGE, values=values)
        if wanted.scenario not in now.artificial:
            return None
        if now.patient_configured:
            return Refusal(RefusalCode.PATIENT_CONFIGURED)
        return Refusal(RefusalCode.LEASE_HELD) if now.lease_held else None

    @classmethod
    def may_begin(cls, legs: Sequence[LegStart], config: CoreConfig) -> Refusal | None:
        """The way to mid pose must be clear."""
        return approach.blocked(legs, config)

    @classmethod
    def begin(
        cls, legs: Sequence[LegStart], wanted: ModeRequest, config: CoreConfig
    ) -> Sequence[Exercise]:
        """See `Exercise`."""
        scenario = config.excite[wanted.scenario]
        middles = [
            joints_of_angles(leg.parameters, gait_angles(leg.shape, 0.0, 0.0)) for leg in legs
        ]
        ways = approach.to_mid_pose(legs, config)
        return [
            cls(
                leg=leg.parameters,
                way=way,
                middle=middle,
                middle_load=load_at(leg.parameters, middle),
                window=(math.radians(scenario.hip.window_deg), scenario.slide.window_m),
                torque=scenario.torque,
                artificial=scenario.artificial,
                duration_s=wanted.duration_s,
            )
            for leg, way, middle in zip(legs, ways, middles, strict=True)
        ]

    def advance(self, leg: LegSample, dt_s: float) -> Self:
        """See `Exercise`; it is over after its time, or when an axis has left the window."""
        later = replace(self, elapsed_s=self.elapsed_s + dt_s)
        if later.stage is Stage.APPROACHING:
            return later.begun_in_torque_mode(leg, self.way.duration_s + SETTLE_S)
        if later.stage is Stage.PLAYING and (
            later.elapsed_s >= self.duration_s or self._left_window(leg.position)
        ):
            return replace(later, stage=Stage.OVER, elapsed_s=0.0)
        return later

    def targets(self, leg: LegSample) -> Reference:
        """Guided to mid pose first, then torque only."""
        if self.stage is Stage.APPROACHING:
            pose = self.way.joints(self.leg, self.elapsed_s)
            return Reference(pose, (0.0, 0.0), (0.0, 0.0), guided=True)
        feedforward = _sum(self.torque, self.elapsed_s)
        return Reference(leg.position, (0.0, 0.0), feedforward, guided=False, load=self.middle_load)

    @property
    def artificial_si(self) -> Pair:
        """d_art: the observer's input is the measured effort less this one (paper, section 4)."""
        if self.stage is not Stage.PLAYING:
            return 0.0, 0.0
        return _sum(self.artificial, self.elapsed_s)

    @property
    def is_artificial(self) -> bool:
        """See `Exercise`."""
        return bool(self.artificial) and self.stage is Stage.PLAYING

    def _left_window(self, measured: Pair) -> bool:
        return any(
            abs(position - middle) > width
            for position, middle, width in zip(measured, self.middle, self.window, strict=True)
        )


def _sum(parts: tuple[Sinusoid, ...], elapsed_s: float) -> Pair:
    total = {"hip": 0.0, "slide": 0.0}
    for part in parts:
        if part.start_s <= elapsed_s < part.end_s:
            total[part.axis] += _value(part, elapsed_s - part.start_s)
    return total["hip"], total["slide"]


def _value(part: Sinusoid, since_start_s: float) -> float:
    if part.kind == "step":
        return part.amplitude_si
    return part.amplitude_si * math.sin(2 * math.pi * part.frequency_hz * since_start_s)
