"""Homing and sign test of a single axis, with all other axes without power.

For both the drives are brought up anew with a special torque limit in the drive, then this one
axis is enabled, and afterwards all drives are brought up with their usual limits. The other axes
stay without power. Both are for the empty machine.

**Homing** is the drive's own (mode 6); the core starts it, monitors its bits, its time and its
limits, and accepts the position when the drive shows that home is attained and reached.

**Sign test**: torque rises slowly in the joint's positive direction until the joint has moved a
little or the bound is reached, and falls to zero; then the same in the other direction. An axis
that moves against its torque would run away from any hold. Whether positive is up or down cannot be
measured: the operator confirms it. The proof needs both.

    homing       enabling -> searching -> done, or failed
    sign test    enabling -> forth -> resting -> back -> ending -> done, or failed

Pure: time and everything else are arguments.
"""

from dataclasses import dataclass, replace
from enum import Enum
from typing import Final, NamedTuple

from daemon.ipc.record import Stage
from drives.signals import HomingState


class PreparationStep(Enum):
    """Step of a homing or sign test; the value is the text for the operator."""

    WAITING = "the drives get their limits for it"
    ENABLING = "enabling"
    SEARCHING = "searching home"
    FORTH = "pushing forth"
    RESTING = "resting"
    BACK = "pushing back"
    ENDING = "resting again"
    DONE = "done"
    FAILED = "failed"


STAGE_OF: Final = {
    PreparationStep.WAITING: Stage.PREPARING,
    PreparationStep.ENABLING: Stage.PREPARING,
    PreparationStep.SEARCHING: Stage.PLAYING,
    PreparationStep.FORTH: Stage.PLAYING,
    PreparationStep.RESTING: Stage.PLAYING,
    PreparationStep.BACK: Stage.PLAYING,
    PreparationStep.ENDING: Stage.ENDING,
    PreparationStep.DONE: Stage.OVER,
    PreparationStep.FAILED: Stage.OVER,
}
"""The stage in the record for each step."""

HOME_FOUND: Final = frozenset({HomingState.ATTAINED, HomingState.DONE})
OVER: Final = frozenset({PreparationStep.DONE, PreparationStep.FAILED})

HOMING_BEGIN_CYCLES: Final = 20
"""Time within which the drive must show that homing has begun."""
REST_CYCLES: Final = 30
"""Time at rest between two pushes."""
REST_MAX_CYCLES: Final = 300
HELD_CYCLES: Final = 50
"""Duration of the largest push before the joint counts as not moved."""


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


class Seen(NamedTuple):
    """Inputs of a homing or sign test in one cycle."""

    ready: bool
    """The drive is enabled and in the requested mode."""
    homing: HomingState
    position_si: float
    at_rest: bool


@dataclass(frozen=True, slots=True)
class Homing:
    """State of the homing of one axis."""

    axis: str
    asked_cycle: int
    rules: HomingRules
    step: PreparationStep = PreparationStep.WAITING
    cycles: int = 0
    """Cycles in this step."""
    found: HomingState | None = None
    """ATTAINED or DONE, as last shown: with each of them the position origin may change."""
    begun: bool = False
    """The homing state shown by the drive belongs to this homing, not to an earlier one."""
    why: str = ""
    """Reason of a failure."""

    @property
    def effort_si(self) -> float:
        """Always 0: the drive's own loops move the axis."""
        return 0.0

    @property
    def searching(self) -> bool:
        """True while the drive is to search home."""
        return self.step is PreparationStep.SEARCHING


@dataclass(frozen=True, slots=True)
class SignTest:
    """State of the sign test of one axis: two pushes and the measured motion."""

    axis: str
    asked_cycle: int
    rules: PushRules
    period_s: float
    step: PreparationStep = PreparationStep.WAITING
    cycles: int = 0
    effort_si: float = 0.0
    from_si: float = 0.0
    rest_cycles: int = 0
    moved_forth_si: float = 0.0
    moved_back_si: float = 0.0
    effort_forth_si: float = 0.0
    effort_back_si: float = 0.0
    why: str = ""

    @property
    def searching(self) -> bool:
        """Always False: a sign test is no homing."""
        return False


Preparation = Homing | SignTest


def begin(preparation: Preparation) -> Preparation:
    """Begin with enabling the axis; the drives have been brought up with the special limits."""
    return replace(preparation, step=PreparationStep.ENABLING, cycles=0)


def advance(preparation: Preparation, seen: Seen) -> Preparation:
    """Advance a homing or sign test by one cycle."""
    if isinstance(preparation, Homing):
        return _advance_homing(replace(preparation, cycles=preparation.cycles + 1), seen)
    return _advance_test(replace(preparation, cycles=preparation.cycles + 1), seen)


# --- homing ---------------------------------------------------------------------------------------


def _advance_homing(run: Homing, seen: Seen) -> Preparation:
    if run.step is PreparationStep.ENABLING and seen.ready:
        # The drive may still show an earlier home: then only a state after motion counts.
        begun = seen.homing in {HomingState.NOT_STARTED, HomingState.IN_PROGRESS}
        return replace(run, step=PreparationStep.SEARCHING, cycles=0, begun=begun)
    if run.step is not PreparationStep.SEARCHING:
        return run
    if seen.homing in {HomingState.FAILED, HomingState.FAILED_MOVING}:
        return _failed(run, "the drive reports a homing error")
    if run.cycles > run.rules.timeout_cycles:
        return _failed(run, f"home was not found in time; the drive says: {seen.homing.value}")
    if seen.homing is HomingState.IN_PROGRESS:
        return replace(run, begun=True)
    if run.begun and seen.homing in HOME_FOUND:
        step = PreparationStep.DONE if seen.homing is HomingState.DONE else run.step
        return replace(run, step=step, found=seen.homing)
    if run.cycles > HOMING_BEGIN_CYCLES:
        return _failed(run, f"the drive does not home; it says: {seen.homing.value}")
    return run


def _failed(preparation: Preparation, why: str) -> Preparation:
    return replace(preparation, step=PreparationStep.FAILED, why=why)


# --- sign -----------------------------------------------------------------------------------------


def _advance_test(test: SignTest, seen: Seen) -> Preparation:
    match test.step:
        case PreparationStep.ENABLING if seen.ready:
            return _push(test, PreparationStep.FORTH, seen)
        case PreparationStep.FORTH:
            return _pushed(test, seen, 1.0)
        case PreparationStep.RESTING:
            return _rested(test, seen)
        case PreparationStep.BACK:
            return _pushed(test, seen, -1.0)
        case PreparationStep.ENDING:
            return _rested(test, seen)
        case _:
            return test


def _push(test: SignTest, step: PreparationStep, seen: Seen) -> SignTest:
    return replace(test, step=step, cycles=0, effort_si=0.0, from_si=seen.position_si)


def _pushed(test: SignTest, seen: Seen, direction: float) -> SignTest:
    moved_si = seen.position_si - test.from_si
    rules = test.rules
    if abs(moved_si) >= rules.motion_si or _held_long_enough(test):
        return _end_of_push(test, moved_si)
    effort_si = min(
        abs(test.effort_si) + rules.effort_rate_si_per_s * test.period_s, rules.effort_max_si
    )
    return replace(test, effort_si=direction * effort_si)


def _held_long_enough(test: SignTest) -> bool:
    step_si = test.rules.effort_rate_si_per_s * test.period_s
    return test.cycles > test.rules.effort_max_si / step_si + HELD_CYCLES


def _end_of_push(test: SignTest, moved_si: float) -> SignTest:
    if test.step is PreparationStep.FORTH:
        return replace(
            test,
            step=PreparationStep.RESTING,
            cycles=0,
            rest_cycles=0,
            effort_si=0.0,
            moved_forth_si=moved_si,
            effort_forth_si=test.effort_si,
        )
    return replace(
        test,
        step=PreparationStep.ENDING,
        cycles=0,
        rest_cycles=0,
        effort_si=0.0,
        moved_back_si=moved_si,
        effort_back_si=test.effort_si,
    )


def _rested(test: SignTest, seen: Seen) -> Preparation:
    test = replace(test, rest_cycles=test.rest_cycles + 1 if seen.at_rest else 0)
    if test.rest_cycles < REST_CYCLES:
        too_long = test.cycles > REST_MAX_CYCLES
        return _failed(test, "the axis does not come to rest") if too_long else test
    return (
        _push(test, PreparationStep.BACK, seen)
        if test.step is PreparationStep.RESTING
        else _judge(test)
    )


def _judge(test: SignTest) -> Preparation:
    """Done if at least one push moved the joint along its torque, and none against it."""
    along = (test.moved_forth_si, -test.moved_back_si)
    motion_si = test.rules.motion_si
    if min(along) <= -motion_si:
        return _failed(test, "it moves against its torque: motor or encoder is the wrong way round")
    if max(along) < motion_si:
        bound_si = test.rules.effort_max_si
        return _failed(test, f"{bound_si:g} do not move it: is it blocked, or at its end stop?")
    return replace(test, step=PreparationStep.DONE)


def evidence(test: SignTest) -> str:
    """Text with the efforts and motions of the two pushes; SI units at the joint."""
    return (
        f"pushed forth with {test.effort_forth_si:+.3g} it moved {test.moved_forth_si:+.3g},"
        f" back with {test.effort_back_si:+.3g} it moved {test.moved_back_si:+.3g}"
    )
