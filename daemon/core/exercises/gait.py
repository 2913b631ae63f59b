"""Mode GAIT: announced, approached, walked with ramps of cadence and amplitude, ended at mid pose.

    announcing -> approaching -> playing -> ending (one whole stride) -> over

Each leg walks the same strides with a phase offset. Phases are in strides.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Self

from gaitd_names import RefusalCode, Stage

from daemon.config.settings import Impedance
from daemon.core.core_config import CoreConfig
from daemon.core.exercises import approach
from daemon.core.exercises.approach import Approach, minimum_jerk
from daemon.core.exercises.exercise import Exercise, LegSample, LegStart, Reference
from daemon.core.exercises.guards import GuardInputs
from daemon.core.motion.gait_shape import GaitShape, Pair, gait_angles, joints_of_angles
from daemon.ipc.record import ModeRequest
from daemon.ipc.report import Refusal

START_CADENCE_RATIO: Final = 0.5
"""Share of the cadence at which the first stride begins."""
CADENCE_MIN_HZ: Final = 0.02
"""Lowest cadence: a gait ends with a whole stride, which must not take longer than 50 s."""
DURATION_MAX_S: Final = 3600.0
"""Longest gait of one request."""
_WALKING: Final = frozenset({Stage.PLAYING, Stage.ENDING})


@dataclass(frozen=True, slots=True, kw_only=True)
class GaitPlan:
    """Constants of one gait of one leg."""

    leg: tuple[float, ...]
    """`LegParameters` as a plain tuple."""
    shape: GaitShape
    impedance: Impedance
    way: Approach
    start: Pair
    announce_s: float
    cadence_hz: float
    amplitude_ratio: float
    duration_s: float
    ramp_strides: float
    phase_offset_strides: float
    """Phase offset of this leg: the other leg walks half a stride later."""
    period_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Gait(Exercise):
    """The gait of one leg."""

    plan: GaitPlan
    stage: Stage | None = Stage.ANNOUNCING
    strides: float = 0.0
    end_strides: float = 0.0
    """Value of `strides` when stage ENDING began."""

    @classmethod
    def refuse(cls, wanted: ModeRequest, now: GuardInputs) -> Refusal | None:
        """See `Exercise`."""
        if not CADENCE_MIN_HZ <= wanted.cadence_hz <= now.cadence_max_hz:
            values = wanted.cadence_hz, CADENCE_MIN_HZ, now.cadence_max_hz
            return Refusal(RefusalCode.CADENCE_OUT_OF_RANGE, values=values)
        if not 0 < wanted.amplitude_ratio <= 1:
            values = wanted.amplitude_ratio, 0.0, 1.0
            return Refusal(RefusalCode.AMPLITUDE_OUT_OF_RANGE, values=values)
        if not 0 < wanted.duration_s <= DURATION_MAX_S:
            values = wanted.duration_s, 0.0, DURATION_MAX_S
            return Refusal(RefusalCode.DURATION_OUT_OF_RANGE, values=values)
        return None

    @classmethod
    def may_begin(cls, legs: Sequence[LegStart], config: CoreConfig) -> Refusal | None:
        """The way to mid pose must be clear."""
        return approach.blocked(legs, config)

    @classmethod
    def begin(
        cls, legs: Sequence[LegStart], wanted: ModeRequest, config: CoreConfig
    ) -> Sequence[Exercise]:
        """See `Exercise`."""
        gait = config.gait
        return [
            cls(
                plan=GaitPlan(
                    leg=tuple(map(float, leg.parameters)),
                    shape=leg.shape,
                    impedance=gait.impedance,
                    way=way,
                    start=leg.pose,
                    announce_s=gait.announce_s,
                    cadence_hz=wanted.cadence_hz,
                    amplitude_ratio=wanted.amplitude_ratio,
                    duration_s=wanted.duration_s,
                    ramp_strides=gait.ramp_strides,
                    phase_offset_strides=leg.phase_offset_strides,
                    period_s=config.period_s,
                )
            )
            for leg, way in zip(legs, approach.to_mid_pose(legs, config), strict=True)
        ]

    def advance(self, leg: LegSample, dt_s: float) -> Self:
        """See `Exercise`; the announcement lasts until all drives are in the gait's mode."""
        if self.stage is Stage.ANNOUNCING and leg.mode_changing:
            return self
        return self._later(dt_s)

    def targets(self, leg: LegSample) -> Reference:
        """Reference with the pose now, and the velocity to the pose one cycle later."""
        del leg
        dt_s = self.plan.period_s
        now, soon = self.pose(), self._later(dt_s).pose()
        velocity = (soon[0] - now[0]) / dt_s, (soon[1] - now[1]) / dt_s
        return Reference(now, velocity, (0.0, 0.0), guided=True)

    @property
    def impedance(self) -> Impedance | None:
        """See `Exercise`."""
        return self.plan.impedance

    @property
    def stride_hz(self) -> float | None:
        """See `Exercise`."""
        return self.plan.cadence_hz if self.stage in _WALKING else None

    @property
    def gait_phase(self) -> float:
        """See `Exercise`."""
        if self.stage not in _WALKING:
            return -1.0
        return (self.strides + self.plan.phase_offset_strides) % 1.0

    def _later(self, dt_s: float) -> Self:
        plan, stage = self.plan, self.stage
        elapsed_s = self.elapsed_s + dt_s
        strides, end_strides = self.strides, self.end_strides
        if stage is Stage.PLAYING or stage is Stage.ENDING:
            strides += dt_s * self._cadence_hz()
        if stage is Stage.ANNOUNCING and elapsed_s >= plan.announce_s:
            stage, elapsed_s = Stage.APPROACHING, 0.0
        elif stage is Stage.APPROACHING and elapsed_s >= plan.way.duration_s:
            stage, elapsed_s = Stage.PLAYING, 0.0
        elif stage is Stage.PLAYING and elapsed_s >= plan.duration_s:
            stage, elapsed_s, end_strides = Stage.ENDING, 0.0, strides
        elif stage is Stage.ENDING and strides >= end_strides + 1:
            stage, elapsed_s = Stage.OVER, 0.0
        return type(self)(
            plan=plan, stage=stage, elapsed_s=elapsed_s, strides=strides, end_strides=end_strides
        )

    def pose(self) -> Pair:
        """Hip angle in rad and slide position in m of the reference."""
        plan = self.plan
        if self.stage is Stage.ANNOUNCING:
            return plan.start
        if self.stage is Stage.APPROACHING:
            return plan.way.joints(plan.leg, self.elapsed_s)
        angles = gait_angles(
            plan.shape, self.strides + plan.phase_offset_strides, self._amplitude_ratio()
        )
        return joints_of_angles(plan.leg, angles)

    def _cadence_hz(self) -> float:
        part = min(self.strides / self.plan.ramp_strides, 1.0)
        return self.plan.cadence_hz * (START_CADENCE_RATIO + (1 - START_CADENCE_RATIO) * part)

    def _amplitude_ratio(self) -> float:
        plan = self.plan
        rising = minimum_jerk(self.strides / plan.ramp_strides)
        if self.stage is Stage.PLAYING:
            return plan.amplitude_ratio * rising
        if self.stage is Stage.OVER:
            return 0.0
        risen = minimum_jerk(self.end_strides / plan.ramp_strides)
        return plan.amplitude_ratio * risen * (1 - minimum_jerk(self.strides - self.end_strides))
