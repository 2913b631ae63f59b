"""What a display shows of a session: one word, what to do now, times, goals."""

from collections.abc import Mapping
from typing import Final

import msgspec
from gaitd_client import Cause, Mode
from gaitd_client.wire import Refusal
from gaitd_names import RefusalCode, Untested

from gaitd_session.advice import Advice, Why
from gaitd_session.goals import band_about
from gaitd_session.machine import (
    ACTIVE,
    ANNOUNCE_S,
    AT_REST,
    Button,
    LegGoal,
    Phase,
    State,
    TrainerState,
    may_reset,
    may_start,
)
from gaitd_session.plan import BlockKind
from gaitd_session.steps import Step, rows_of

ADVICE_ON_UNTESTED: Final[Mapping[str, Advice]] = {
    Untested.STO_ACTIVE: Advice.PRESS_EMERGENCY_STOP_AND_RELEASE_IT,
    Untested.STO_RELEASED: Advice.RELEASE_EMERGENCY_STOP,
    Untested.HAND_SWITCH_OPEN: Advice.LET_GO_AND_HOLD_HAND_SWITCH,
    Untested.HAND_SWITCH_CLOSED: Advice.LET_GO_AND_HOLD_HAND_SWITCH,
}
"""What a patient can do about the input that was not seen to act.

Refusals have codes of the same names, `sto_active` for example, with another meaning.
"""

STEPS_SHOWN: Final = 12
"""The newest steps, of all legs."""


class BlockView(msgspec.Struct, frozen=True, kw_only=True):
    """The present or next block."""

    number: int
    """From 1; the passive minute and the warm-up count."""
    count: int
    kind: BlockKind


class LegView(msgspec.Struct, frozen=True, kw_only=True):
    """Target and strides of one leg; in REST those of the block before."""

    leg: str
    band_low_ratio: float
    """Lower end of the target band, of `Stride.share_ratio`."""
    band_high_ratio: float
    stride_count: int
    valid_count: int
    """Strides of the block whose share is known."""
    in_band_count: int
    """Those of them that are judged within the band."""
    session_valid_count: int
    """Valid strides of all blocks."""
    session_in_band_count: int
    share_ratio: float | None
    """Share of the last stride; None: there is none, or it is not valid."""


class View(msgspec.Struct, frozen=True, kw_only=True):
    """What a display shows; `msgspec.json.encode` gives its JSON."""

    phase: Phase
    advice: Advice
    refusal: Refusal | None
    """Why the last START was refused; None: it was not."""
    cause: str
    """Cause of the stop, in STOPPED; else none."""
    why: Why | None
    """What has ended the last START early; None: nothing, or a refusal or a stop."""
    buttons: tuple[Button, ...]
    """Those that do something now; the first one is the large one."""
    block: BlockView | None
    block_left_s: float
    """In REST: the rest that is left."""
    block_s: float
    """Whole time of the block; in REST that of the rest."""
    announce_left_s: float
    """In ANNOUNCED: time until motion is requested, before which nothing moves; else 0."""
    session_left_s: float
    """All blocks and rests that are left."""
    session_walked_s: float
    session_share_ratio: float | None
    """Mean share of all valid strides; None: there is none."""
    legs: tuple[LegView, ...]
    steps: tuple[Step, ...]
    """The newest steps of the block, oldest first: how each stride is judged."""
    row_count: int
    """Steps in the target now, without one beside it; of all legs."""
    best_row_count: int
    """The longest such row of the session."""
    goal_in_band_ratio: float
    """The goal of a block: `in_band_count` of its valid strides."""
    may_be_replaced: bool
    """The session is finished, and the drives are off as it has requested: another may begin."""
    is_kept: bool
    """The history is written, as far as is known."""
    history_trouble: str
    """What is wrong with the history; empty if nothing is."""


def view_of(
    state: State,
    trainer: TrainerState | None,
    now_s: float,
    *,
    is_kept: bool = True,
    history_trouble: str = "",
) -> View:
    """Return what a display shows.

    Args:
        state: of the session.
        trainer: as the step before has seen it.
        now_s: the time of that step.
        is_kept: the history is written.
        history_trouble: what is wrong with the history; empty if nothing is.
    """
    advice = _advice(state, trainer, now_s)
    number = state.block_index + 1
    block = state.block
    rest_s = max(state.rest_until_s - now_s, 0.0) if state.phase is Phase.REST else 0.0
    announced_s = now_s - state.since_s if state.phase is Phase.ANNOUNCED else ANNOUNCE_S
    cause = trainer.cause if state.phase is Phase.STOPPED and trainer else Cause.NONE
    return View(
        phase=state.phase,
        advice=advice,
        refusal=state.refusal,
        cause=cause,
        why=state.why,
        buttons=_buttons(state, trainer, now_s),
        block=None
        if block is None
        else BlockView(number=number, count=len(state.blocks), kind=block.kind),
        block_left_s=rest_s if state.phase is Phase.REST else state.block_left_s(now_s),
        block_s=_block_s(state),
        announce_left_s=max(ANNOUNCE_S - announced_s, 0.0),
        session_walked_s=state.walked_before_s + state.block_walked_s(now_s),
        session_left_s=rest_s + _blocks_left_s(state, now_s),
        session_share_ratio=_mean_share(state.legs),
        legs=tuple(_leg(leg, state) for leg in state.legs),
        steps=state.steps[-STEPS_SHOWN:],
        row_count=rows_of(state.steps)[0],
        best_row_count=state.best_row_count,
        goal_in_band_ratio=state.goal.in_band_goal_ratio,
        may_be_replaced=state.phase is Phase.FINISHED
        and state.off_since_s is None
        and trainer is not None
        and trainer.mode == Mode.READY,
        is_kept=is_kept,
        history_trouble=history_trouble,
    )


def _advice(state: State, trainer: TrainerState | None, now_s: float) -> Advice:
    match state.phase:
        case Phase.NO_SIGNAL:
            return Advice.CHECK_CONNECTION
        case Phase.STOPPED if trainer is not None and may_reset(trainer):
            return Advice.PRESS_START_TO_RESET
        case Phase.STOPPED:
            return Advice.CALL_FOR_HELP
        case Phase.WALKING:
            is_passive = state.block is not None and state.block.kind is BlockKind.PASSIVE
            return Advice.RELAX if is_passive else Advice.WALK
        case _ if state.phase in ACTIVE:
            return Advice.LIE_STILL
        case _ if trainer is not None and trainer.is_enabled:
            return Advice.TRAINER_IS_USED if state.off_since_s is None else Advice.WAIT
        case Phase.FINISHED:
            return Advice.DONE
        case _:
            return _advice_at_rest(state, trainer, now_s)


def _advice_at_rest(state: State, trainer: TrainerState | None, now_s: float) -> Advice:
    if trainer is None or trainer.mode != Mode.READY:
        return Advice.WAIT  # the hand switch is still watched: whoever lets go of it now is stopped
    if now_s < state.rest_until_s:
        return Advice.REST
    if (refusal := state.refusal) is not None:
        return _advice_on(refusal)
    return Advice.PRESS_START if trainer.hand_switch_held else Advice.HOLD_HAND_SWITCH


def _advice_on(refusal: Refusal) -> Advice:
    if refusal.code == RefusalCode.STO_ACTIVE:
        return Advice.RELEASE_EMERGENCY_STOP
    untested = str(refusal.values.get("untested"))
    return ADVICE_ON_UNTESTED.get(untested, Advice.TRY_AGAIN_OR_CALL_THERAPIST)


def _buttons(state: State, trainer: TrainerState | None, now_s: float) -> tuple[Button, ...]:
    is_enabled = trainer is not None and trainer.is_enabled
    does_something = {
        Button.START: may_start(state, trainer, now_s),
        Button.PAUSE: state.phase in ACTIVE
        or (state.phase is Phase.NO_SIGNAL and state.may_follow)
        or (state.phase in AT_REST and is_enabled),
        Button.END: Phase.FINISHED not in {state.phase, _phase_after(state)},
    }
    return tuple(button for button, does in does_something.items() if does)


def _phase_after(state: State) -> Phase:
    """The phase at rest that follows NO_SIGNAL and STOPPED; else the present one."""
    return state.phase if state.phase in ACTIVE | AT_REST else state.returns_to


def _blocks_left_s(state: State, now_s: float) -> float:
    """Time of the blocks that are left and of the rests between them."""
    left = state.blocks[state.block_index :]
    rests_s = sum(block.walk.rest_s for block in left[:-1])
    return state.block_left_s(now_s) + sum(block.walk.duration_s for block in left[1:]) + rests_s


def _block_s(state: State) -> float:
    if state.phase is Phase.REST:
        return state.blocks[state.block_index - 1].walk.rest_s
    return 0.0 if state.block is None else state.block.walk.duration_s


def _mean_share(legs: tuple[LegGoal, ...]) -> float | None:
    count = sum(leg.valid_before_count + len(leg.valid_shares) for leg in legs)
    total = sum(leg.share_before_sum_ratio + sum(leg.valid_shares) for leg in legs)
    return total / count if count else None


def _leg(leg: LegGoal, state: State) -> LegView:
    band = band_about(leg.middle_ratio, state.goal)
    return LegView(
        leg=leg.leg,
        band_low_ratio=band.low_ratio,
        band_high_ratio=band.high_ratio,
        stride_count=len(leg.strides),
        valid_count=len(leg.valid_shares),
        in_band_count=state.in_band_count(leg.leg),
        session_valid_count=leg.valid_before_count + len(leg.valid_shares),
        session_in_band_count=leg.in_band_before_count + state.in_band_count(leg.leg),
        share_ratio=leg.strides[-1].share_ratio if leg.strides else None,
    )
