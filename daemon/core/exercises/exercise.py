"""The protocol of an exercise: what one leg does in one mode, from the request to the end.

Rules:
1. An exercise is a frozen class in one file of this folder; each leg has its own object. The row of
   its mode in `modes/table.py` names the class and the guards that hold before it begins.
2. `refuse` checks the arguments of a request and the state of the service, `may_begin` the room at
   the present pose of all legs; each returns the reason to refuse, or nothing. `begin` then returns
   one object for each leg.
3. `advance` is called once a cycle and returns the object of the next cycle. A change of `stage` is
   published as an event. Stage OVER ends the exercise, and the leg is held where it is.
4. `targets` returns the reference of this cycle. Nothing here commands a drive: the reference is
   followed by `steps/impedance.py` and bounded by `safety/bounds.py`.
5. Time, measurements and settings are arguments. No exercise reads a clock or the core's state.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Final, NamedTuple, Self

from gaitd_names import Failure, ProgressCode, Stage

from daemon.config.settings import Impedance
from daemon.core.core_config import CoreConfig
from daemon.core.exercises.guards import GuardInputs
from daemon.core.motion.gait_shape import GaitShape, Pair
from daemon.core.safety.limits import AxisLimits
from daemon.ipc.record import ModeRequest
from daemon.ipc.report import Progress, Refusal
from observer.mechanism.friction import FrictionParameters, OverPosition
from observer.mechanism.parameters import LegParameters

BEGIN_MAX_S: Final = 20.0
"""Longest wait for torque mode: a drive changes to it at rest, and a leg may be kept moving."""


class Reference(NamedTuple):
    """Reference of one leg in one cycle: position, velocity, and effort on top of g(q)."""

    position: Pair
    """Hip in rad, slide in m."""
    velocity: Pair
    """Hip in rad/s, slide in m/s."""
    feedforward: Pair
    """Effort on top of g: N·m, N."""
    guided: bool
    """The impedance pulls to the reference; otherwise torque is open-loop."""
    load: Pair | None = None
    """g of a fixed pose, where an open loop works about that pose; None: g(q)."""


class LegStart(NamedTuple):
    """What an exercise is begun with: constants of a leg, and its pose."""

    name: str
    axis_names: tuple[str, str]
    parameters: LegParameters
    shape: GaitShape
    limits: tuple[AxisLimits, AxisLimits]
    friction: tuple[FrictionParameters, FrictionParameters]
    over: tuple[OverPosition, OverPosition]
    """How friction rises along the axes."""
    effort_offset: Pair
    """What the drives show at no effort: N·m, N."""
    phase_offset_strides: float
    pose: Pair
    """The present reference of a guided leg, else the measured pose: hip in rad, slide in m."""


class LegSample(NamedTuple):
    """Measured state of a leg in one cycle, from raw drive values: hip and slide."""

    position: Pair
    """rad, m."""
    velocity: Pair
    """From encoder differences: rad/s, m/s."""
    excess: Pair
    """Measured effort less g(q): N·m, N."""
    fresh: tuple[bool, bool]
    """The sample of the axis is of this cycle."""
    in_torque_mode: bool
    """Both drives show torque mode, and it was requested."""
    mode_changing: bool
    """A drive of any leg has not been sent the mode of operation of this exercise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Exercise(ABC):
    """What one leg does in one mode; the defaults are those of a leg that does not walk."""

    continues_effort: ClassVar[bool] = True
    """The first effort is the last one sent; the difference to the reference's effort fades."""
    continues_effort_at_stages: ClassVar[bool] = False
    """The same at each change of stage."""
    legs_in_turn: ClassVar[bool] = False
    """Leg after leg: the exercise is over with the last leg, otherwise with the first one."""

    stage: Stage | None = None
    """None: the exercise has no stages and no end."""
    elapsed_s: float = 0.0
    """Time in the stage."""
    failure: Failure = Failure.NONE
    """The reason why it is over without having begun."""

    @classmethod
    def refuse(cls, wanted: ModeRequest, now: GuardInputs) -> Refusal | None:
        """The reason to refuse a request for its arguments or the state of the service."""
        del wanted, now
        return None

    @classmethod
    def may_begin(cls, legs: Sequence[LegStart], config: CoreConfig) -> Refusal | None:
        """The reason why there is no room for it at the present pose; None if there is."""
        del legs, config
        return None

    @classmethod
    @abstractmethod
    def begin(
        cls, legs: Sequence[LegStart], wanted: ModeRequest, config: CoreConfig
    ) -> Sequence["Exercise"]:
        """The exercise of each leg; `may_begin` has returned no reason."""

    @abstractmethod
    def advance(self, leg: LegSample, dt_s: float) -> Self:
        """The exercise one cycle later."""

    @abstractmethod
    def targets(self, leg: LegSample) -> Reference:
        """The reference of this cycle."""

    def begun_in_torque_mode(self, leg: LegSample, after_s: float) -> Self:
        """PLAYING once the stage has lasted for `after_s` and both drives are in torque mode.

        Without torque mode for BEGIN_MAX_S more it is OVER, with NO_REST as its failure.
        """
        if self.elapsed_s < after_s:
            return self
        if leg.in_torque_mode:
            return replace(self, stage=Stage.PLAYING, elapsed_s=0.0)
        if self.elapsed_s < after_s + BEGIN_MAX_S:
            return self
        return replace(self, stage=Stage.OVER, elapsed_s=0.0, failure=Failure.NO_REST)

    def progress(self) -> Progress | None:
        """What happens now, beside mode and stage."""
        return Progress(ProgressCode.EXERCISING, "", (self.elapsed_s,))

    @property
    def impedance(self) -> Impedance | None:
        """The impedance of guidance; None: that of holding."""
        return None

    @property
    def stride_hz(self) -> float | None:
        """The cadence while the leg walks; None while it does not."""
        return None

    @property
    def gait_phase(self) -> float:
        """Phase 0 to 1 of the stride, or -1 while the leg does not walk."""
        return -1.0

    @property
    def artificial_si(self) -> Pair:
        """Artificial disturbance of the observer's input in this cycle: N·m, N."""
        return 0.0, 0.0

    @property
    def is_artificial(self) -> bool:
        """The scenario under way has an artificial disturbance, now or later."""
        return False
