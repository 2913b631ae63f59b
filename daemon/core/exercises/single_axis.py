"""Homing and sign test of a single axis, with all other axes without power: what both share.

For both the drives are brought up anew with a special torque limit in the drive, then this one
axis is enabled, and afterwards all drives are brought up with their usual limits. The other axes
stay without power. Both are for the empty machine. `homing.py` and `sign_test.py` have the two.

    waiting -> enabling -> the steps of its own -> done, or failed

An object is frozen; `advance` returns the one of the next cycle. Time and measurements are
arguments.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, Final, NamedTuple, Self

from gaitd_names import AxisStep, EventCode, Failure, Mode, Stage

from daemon.core.safety.limits import AxisLimits
from daemon.ipc.report import Refusal
from drives.signals import DriveFeedback, HomingState, OperationMode

_STAGE_OF: Final = {
    AxisStep.WAITING: Stage.PREPARING,
    AxisStep.ENABLING: Stage.PREPARING,
    AxisStep.SEARCHING: Stage.PLAYING,
    AxisStep.FORTH: Stage.PLAYING,
    AxisStep.RESTING: Stage.PLAYING,
    AxisStep.BACK: Stage.PLAYING,
    AxisStep.ENDING: Stage.ENDING,
    AxisStep.DONE: Stage.OVER,
    AxisStep.FAILED: Stage.OVER,
}
"""The stage in the record for each step."""

OVER: Final = frozenset({AxisStep.DONE, AxisStep.FAILED})


class AxisSample(NamedTuple):
    """Measured state of the axis in one cycle."""

    ready: bool
    """The drive is enabled and in the requested mode."""
    homing: HomingState
    position_si: float
    at_rest: bool


class PushRules(NamedTuple):
    """Settings of [commissioning] in the trainer file, for one axis; SI units at the joint."""

    effort_max_si: float
    effort_rate_si_per_s: float
    motion_si: float


class HomingRules(NamedTuple):
    """Settings of [homing] in an axis file, in SI units and cycles."""

    effort_max_si: float
    speed_max_si_per_s: float
    """Speed limit during homing."""
    timeout_cycles: int


class AxisStart(NamedTuple):
    """What a homing or sign test is begun with."""

    name: str
    push: PushRules
    homing: HomingRules | None
    """None: this axis cannot be homed."""
    sign_proven: bool
    signs_must_be_proven: bool
    cycle: int
    """Cycle of the request."""
    period_s: float


class Result(NamedTuple):
    """What a finished homing or sign test has shown."""

    code: EventCode
    homed: bool = False
    """The position of the axis is valid."""
    moved_si: tuple[float, float] | None = None
    """Motion forth and back of a sign test, for the operator to confirm; None: no sign test."""
    evidence: tuple[float, ...] = ()
    """The values of the event: effort and motion forth, effort and motion back of a sign test."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SingleAxis(ABC):
    """A homing or sign test of one axis."""

    mode: ClassVar[Mode]
    operation_mode: ClassVar[OperationMode]
    """The drive's mode of operation during it."""

    axis: str
    requested_cycle: int
    step: AxisStep = AxisStep.WAITING
    cycles: int = 0
    """Cycles in this step."""
    effort_si: float = 0.0
    """Effort to command: N·m or N."""
    why: Failure = Failure.NONE

    @classmethod
    @abstractmethod
    def may_begin(cls, axis: AxisStart) -> Refusal | None:
        """The reason to refuse it; None if it may begin."""

    @classmethod
    @abstractmethod
    def begin(cls, axis: AxisStart) -> "SingleAxis":
        """The homing or sign test, waiting for its bring-up; `may_begin` has returned no reason."""

    @abstractmethod
    def advance(self, axis: AxisSample) -> "SingleAxis":
        """The homing or sign test one cycle later."""

    @abstractmethod
    def limits(self, usual: AxisLimits, *, moving: bool) -> AxisLimits:
        """The limits in force; `moving`: the axis is enabled for it."""

    @abstractmethod
    def result(self) -> Result:
        """What has been shown when it is done."""

    @property
    def stage(self) -> Stage:
        """The stage for the record."""
        return _STAGE_OF[self.step]

    @property
    def searching(self) -> bool:
        """The drive is to search home."""
        return self.step is AxisStep.SEARCHING

    @property
    def is_over(self) -> bool:
        """It is done, or it has failed."""
        return self.step in OVER

    @property
    def by_drive(self) -> bool:
        """The drive moves the axis by itself, up to its own stop, and sets its origin anew."""
        return self.operation_mode is OperationMode.HOMING

    def enabling(self) -> Self:
        """Begin with enabling: the drives have been brought up with the special limits."""
        return replace(self, step=AxisStep.ENABLING, cycles=0)

    def failed(self, why: Failure) -> Self:
        """Ended without a result."""
        return replace(self, step=AxisStep.FAILED, why=why)

    def moves_origin(self, feedback: DriveFeedback) -> bool:
        """True if this sample is the first after a change of the position's origin."""
        del feedback
        return False
