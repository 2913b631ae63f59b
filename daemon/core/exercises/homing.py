"""Mode REFERENCE: the drive's own homing (mode 6) of one axis of the empty machine.

    enabling -> searching -> done, or failed

The core starts it, monitors its bits, its time and its limits, and accepts the position when the
drive shows that home is attained and reached.
"""

from dataclasses import dataclass, replace
from typing import ClassVar, Final, Self

from gaitd_names import EventCode, Failure, Mode, RefusalCode

from daemon.core.exercises.single_axis import (
    AxisSample,
    AxisStart,
    AxisStep,
    HomingRules,
    Result,
    SingleAxis,
)
from daemon.core.period import cycles
from daemon.core.safety.limits import AxisLimits
from daemon.ipc.report import Refusal
from drives.cia402.power_state import homing_state
from drives.signals import DriveFeedback, HomingState, OperationMode

HOME_FOUND: Final = frozenset({HomingState.ATTAINED, HomingState.DONE})
BEGIN_CYCLES: Final = cycles(0.2)
"""Time within which the drive must show that homing has begun."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Homing(SingleAxis):
    """The homing of one axis; its effort is 0, because the drive's own loops move the axis."""

    mode: ClassVar[Mode] = Mode.REFERENCE
    operation_mode: ClassVar[OperationMode] = OperationMode.HOMING

    rules: HomingRules
    found: HomingState | None = None
    """ATTAINED or DONE, as last shown: with each of them the position origin may change."""
    begun: bool = False
    """The homing state shown by the drive belongs to this homing, not to an earlier one."""

    @classmethod
    def may_begin(cls, axis: AxisStart) -> Refusal | None:
        """See `SingleAxis`."""
        if axis.homing is None:
            return Refusal(RefusalCode.NO_HOMING, axis.name)
        if axis.signs_must_be_proven and not axis.sign_proven:
            return Refusal(RefusalCode.SIGN_NOT_PROVEN, axis.name)
        return None

    @classmethod
    def begin(cls, axis: AxisStart) -> SingleAxis:
        """See `SingleAxis`."""
        if axis.homing is None:
            raise RuntimeError(f"{axis.name} cannot be homed: the request was not refused")
        return cls(axis=axis.name, requested_cycle=axis.cycle, rules=axis.homing)

    def advance(self, axis: AxisSample) -> Self:
        """See `SingleAxis`."""
        run = replace(self, cycles=self.cycles + 1)
        if run.step is AxisStep.ENABLING and axis.ready:
            # The drive may still show an earlier home: then only a state after motion counts.
            begun = axis.homing in {HomingState.NOT_STARTED, HomingState.IN_PROGRESS}
            return replace(run, step=AxisStep.SEARCHING, cycles=0, begun=begun)
        if run.step is not AxisStep.SEARCHING:
            return run
        if axis.homing in {HomingState.FAILED, HomingState.FAILED_MOVING}:
            return run.failed(Failure.HOMING_ERROR)
        if run.cycles > run.rules.timeout_cycles:
            return run.failed(Failure.HOME_NOT_FOUND)
        if axis.homing is HomingState.IN_PROGRESS:
            return replace(run, begun=True)
        if run.begun and axis.homing in HOME_FOUND:
            step = AxisStep.DONE if axis.homing is HomingState.DONE else run.step
            return replace(run, step=step, found=axis.homing)
        if run.cycles > BEGIN_CYCLES:
            return run.failed(Failure.DOES_NOT_HOME)
        return run

    def limits(self, usual: AxisLimits, *, moving: bool) -> AxisLimits:
        """See `SingleAxis`."""
        limits = usual._replace(effort_max_si=self.rules.effort_max_si)
        return limits._replace(velocity_max_si=self.rules.speed_max_si_per_s) if moving else limits

    def result(self) -> Result:
        """See `SingleAxis`."""
        return Result(EventCode.HOMED, homed=True)

    def moves_origin(self, feedback: DriveFeedback) -> bool:
        """True if this sample is the first that shows home as attained or reached."""
        if not self.begun or feedback.mode_display != OperationMode.HOMING:
            return False
        state = homing_state(feedback.statusword)
        return state in HOME_FOUND and state is not self.found
