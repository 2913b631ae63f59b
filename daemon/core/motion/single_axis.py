"""One axis at a time, before anything else may be enabled: homing it, and proving its sign.

For either the drives are brought up anew with a torque limit of its own in the drive, then this one
axis is enabled, and afterwards all drives are brought up with their usual limits. The other axes
stay without power. Both are for the empty machine.

**Homing** is the drive's own (mode 6); the core starts it, watches its bits, its time and its
limits, and believes the position when the drive says that home is attained and reached.

**Proving a sign**: torque rises slowly in the joint's positive direction until the joint has moved
a little or the bound is reached, falls to nothing, and the same in the other direction. An axis
that moves against its torque would run away from any hold. What no number can tell, whether
positive is up or down, the person who watches confirms: only both together are a proof.

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
    """How far a preparation is; the value is what a person reads."""

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
"""What each step is for a program that follows the record."""

HOME_FOUND: Final = frozenset({HomingState.ATTAINED, HomingState.DONE})
OVER: Final = frozenset({PreparationStep.DONE, PreparationStep.FAILED})

HOMING_BEGIN_CYCLES: Final = 20
"""Until the drive must show that it has begun."""
REST_CYCLES: Final = 30
"""At rest for so long between two pushes."""
REST_MAX_CYCLES: Final = 300
HELD_CYCLES: Final = 50
"""The largest push lasts so long before the joint counts as not moved."""


class PushRules(NamedTuple):
    """[commissioning] of the trainer file, for one axis; SI units at the joint."""

    effort_max_si: float
    effort_rate_si_per_s: float
    motion_si: float


class HomingRules(NamedTuple):
    """[homing] of an axis file, in the terms of the core."""

    effort_max_si: float
    speed_max_si_per_s: float
    """Faster is no search."""
    timeout_cycles: int


class Seen(NamedTuple):
    """What a preparation looks at in one cycle."""

    ready: bool
    """Enabled, and in the mode that is wanted."""
    homing: HomingState
    position_si: float
    at_rest: bool


@dataclass(frozen=True, slots=True)
class Homing:
    """The homing of one axis."""

    axis: str
    asked_cycle: int
    rules: HomingRules
    step: PreparationStep = PreparationStep.WAITING
    cycles: int = 0
    """In this step."""
    found: HomingState | None = None
    """ATTAINED or DONE, whichever has been shown last: with either, positions may count anew."""
    begun: bool = False
    """What the drive shows of home is of this homing."""
    why: str = ""
    """It failed."""

    @property
    def effort_si(self) -> float:
        """The core asks for none: the drive's own loops move the axis."""
        return 0.0

    @property
    def searching(self) -> bool:
        """Whether the drive is to home."""
        return self.step is PreparationStep.SEARCHING


@dataclass(frozen=True, slots=True)
class SignTest:
    """Two pushes of one axis, and what they moved."""

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
        """No homing."""
        return False


Preparation = Homing | SignTest


def begin(preparation: Preparation) -> Preparation:
    """The drives have their limits: enable the axis."""
    return replace(preparation, step=PreparationStep.ENABLING, cycles=0)


def advance(preparation: Preparation, seen: Seen) -> Preparation:
    """One cycle on."""
    if isinstance(preparation, Homing):
        return _advance_homing(replace(preparation, cycles=preparation.cycles + 1), seen)
    return _advance_test(replace(preparation, cycles=preparation.cycles + 1), seen)


# --- homing ---------------------------------------------------------------------------------------


def _advance_homing(run: Homing, seen: Seen) -> Preparation:
    if run.step is PreparationStep.ENABLING and seen.ready:
        # A home of earlier times may still be shown: then only what follows motion is news.
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
    """At least one push moved the joint its way, and none the other way."""
    along = (test.moved_forth_si, -test.moved_back_si)
    motion_si = test.rules.motion_si
    if min(along) <= -motion_si:
        return _failed(test, "it moves against its torque: motor or encoder is the wrong way round")
    if max(along) < motion_si:
        bound_si = test.rules.effort_max_si
        return _failed(test, f"{bound_si:g} do not move it: is it blocked, or at its end stop?")
    return replace(test, step=PreparationStep.DONE)


def evidence(test: SignTest) -> str:
    """What the two pushes did, in words; SI units at the joint."""
    return (
        f"pushed forth with {test.effort_forth_si:+.3g} it moved {test.moved_forth_si:+.3g},"
        f" back with {test.effort_back_si:+.3g} it moved {test.moved_back_si:+.3g}"
    )
