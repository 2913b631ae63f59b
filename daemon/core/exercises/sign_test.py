"""Mode COMMISSION: the sign test of one axis of the empty machine.

    enabling -> forth -> resting -> back -> ending -> done, or failed

Torque rises slowly in the joint's positive direction until the joint has moved a little or the
bound is reached, and falls to zero; then the same in the other direction. An axis that moves
against its torque would run away from any hold. Whether positive is up or down cannot be measured:
the operator confirms it. The proof needs both.
"""

from dataclasses import dataclass, replace
from typing import ClassVar, Final

from gaitd_names import EventCode, Failure, Mode

from daemon.core.exercises.single_axis import (
    AxisSample,
    AxisStart,
    AxisStep,
    PushRules,
    Result,
    SingleAxis,
)
from daemon.core.period import cycles
from daemon.core.safety.limits import AxisLimits
from daemon.ipc.report import Refusal
from drives.signals import OperationMode

REST_CYCLES: Final = cycles(0.3)
"""Time at rest between two pushes."""
REST_MAX_CYCLES: Final = cycles(3.0)
HELD_CYCLES: Final = cycles(0.5)
"""Duration of the largest push before the joint counts as not moved."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SignTest(SingleAxis):
    """The sign test of one axis: two pushes and the measured motion."""

    mode: ClassVar[Mode] = Mode.COMMISSION
    operation_mode: ClassVar[OperationMode] = OperationMode.CYCLIC_SYNC_TORQUE

    rules: PushRules
    period_s: float
    from_si: float = 0.0
    rest_cycles: int = 0
    moved_forth_si: float = 0.0
    moved_back_si: float = 0.0
    effort_forth_si: float = 0.0
    effort_back_si: float = 0.0

    @classmethod
    def may_begin(cls, axis: AxisStart) -> Refusal | None:
        """See `SingleAxis`."""
        del axis
        return None

    @classmethod
    def begin(cls, axis: AxisStart) -> SingleAxis:
        """See `SingleAxis`."""
        return cls(
            axis=axis.name, requested_cycle=axis.cycle, rules=axis.push, period_s=axis.period_s
        )

    def advance(self, axis: AxisSample) -> SingleAxis:
        """See `SingleAxis`."""
        return _advanced(replace(self, cycles=self.cycles + 1), axis)

    def limits(self, usual: AxisLimits, *, moving: bool) -> AxisLimits:
        """See `SingleAxis`."""
        del moving
        return usual._replace(effort_max_si=self.rules.effort_max_si)

    def result(self) -> Result:
        """See `SingleAxis`; efforts and motions are in SI units at the joint."""
        moved_si = self.moved_forth_si, self.moved_back_si
        evidence = self.effort_forth_si, moved_si[0], self.effort_back_si, moved_si[1]
        return Result(EventCode.SIGN_TESTED, False, moved_si, evidence)


def _advanced(test: SignTest, axis: AxisSample) -> SignTest:
    match test.step:
        case AxisStep.ENABLING if axis.ready:
            return _push(test, AxisStep.FORTH, axis)
        case AxisStep.FORTH:
            return _pushed(test, axis, 1.0)
        case AxisStep.BACK:
            return _pushed(test, axis, -1.0)
        case AxisStep.RESTING | AxisStep.ENDING:
            return _rested(test, axis)
        case _:
            return test


def _push(test: SignTest, step: AxisStep, axis: AxisSample) -> SignTest:
    return replace(test, step=step, cycles=0, effort_si=0.0, from_si=axis.position_si)


def _pushed(test: SignTest, axis: AxisSample, direction: float) -> SignTest:
    moved_si = axis.position_si - test.from_si
    rules = test.rules
    step_si = rules.effort_rate_si_per_s * test.period_s
    held_long_enough = test.cycles > rules.effort_max_si / step_si + HELD_CYCLES
    if abs(moved_si) >= rules.motion_si or held_long_enough:
        return _end_of_push(test, moved_si)
    effort_si = min(abs(test.effort_si) + step_si, rules.effort_max_si)
    return replace(test, effort_si=direction * effort_si)


def _end_of_push(test: SignTest, moved_si: float) -> SignTest:
    ended = replace(test, cycles=0, rest_cycles=0, effort_si=0.0)
    if test.step is AxisStep.FORTH:
        return replace(
            ended, step=AxisStep.RESTING, moved_forth_si=moved_si, effort_forth_si=test.effort_si
        )
    return replace(
        ended, step=AxisStep.ENDING, moved_back_si=moved_si, effort_back_si=test.effort_si
    )


def _rested(test: SignTest, axis: AxisSample) -> SignTest:
    test = replace(test, rest_cycles=test.rest_cycles + 1 if axis.at_rest else 0)
    if test.rest_cycles < REST_CYCLES:
        too_long = test.cycles > REST_MAX_CYCLES
        return test.failed(Failure.KEEPS_MOVING) if too_long else test
    return _push(test, AxisStep.BACK, axis) if test.step is AxisStep.RESTING else _checked(test)


def _checked(test: SignTest) -> SignTest:
    """Done if at least one push moved the joint along its torque, and none against it."""
    along = (test.moved_forth_si, -test.moved_back_si)
    motion_si = test.rules.motion_si
    if min(along) <= -motion_si:
        return test.failed(Failure.MOVES_AGAINST_TORQUE)
    if max(along) < motion_si:
        return test.failed(Failure.DOES_NOT_MOVE)
    return replace(test, step=AxisStep.DONE)
