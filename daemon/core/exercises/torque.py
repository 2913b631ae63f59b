"""Mode TORQUE: g(q) carries the leg, and a controller's assist moves it without guidance."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

from gaitd_names import RefusalCode, Stage

from daemon.core.core_config import CoreConfig
from daemon.core.exercises.exercise import Exercise, LegSample, LegStart, Reference
from daemon.core.exercises.guards import GuardInputs
from daemon.ipc.record import ModeRequest
from daemon.ipc.report import Progress, Refusal


@dataclass(frozen=True, slots=True, kw_only=True)
class Torque(Exercise):
    """Ends with the lease of its controller only (`steps/controllers.py`)."""

    stage: Stage | None = Stage.PLAYING

    @classmethod
    def refuse(cls, wanted: ModeRequest, now: GuardInputs) -> Refusal | None:
        """See `Exercise`."""
        del wanted
        return None if now.lease_held else Refusal(RefusalCode.LEASE_NEEDED)

    @classmethod
    def begin(
        cls, legs: Sequence[LegStart], wanted: ModeRequest, config: CoreConfig
    ) -> Sequence[Exercise]:
        """See `Exercise`."""
        del wanted, config
        return [cls() for _ in legs]

    def advance(self, leg: LegSample, dt_s: float) -> Self:
        """See `Exercise`."""
        del leg
        return replace(self, elapsed_s=self.elapsed_s + dt_s)

    def targets(self, leg: LegSample) -> Reference:
        """Reference at the measured pose, without stiffness or damping."""
        return Reference(leg.position, (0.0, 0.0), (0.0, 0.0), guided=False)

    def progress(self) -> Progress | None:
        """Nothing beside the mode: what happens is up to the controller."""
        return None
