"""The state machine of a session: pure, as a table.

Rules:
1. Nothing moves before START is pressed with the hand switch held and the trainer ready. One START
   is good for one block, with the self-test before it where that is due.
2. Motion is announced: after START the drives hold the leg for `ANNOUNCE_S` before the self-test or
   the gait is requested. The service announces the gait a second time.
3. Whatever ends a block early, ends what START has allowed: a stop, a lost signal, a restart of the
   trainer, an open hand switch, a refused or unanswered request, PAUSE, another client's request.
   Only another START goes on, with the rest of the block. An active phase names the events that it
   survives; every other event leads to PAUSED.
4. One exception moves nothing: a block that the trainer has walked on through a lost signal is
   followed again. Time without signal does not count as walked.
5. In PAUSED, REST and FINISHED the drives are off, so the patient may let go of the hand switch.
   DISABLE is requested on the way there, and again until the drives are off. Drives that another
   client has enabled later are left alone until the patient presses PAUSE. Without a signal the
   drives may be on: DISABLE is then requested as well, except while a block may be followed
   (rule 4).
6. A stop is left when the trainer is ready again. Where no drive has power, START requests RESET,
   which then takes nothing from the leg; the daily press of the emergency stop ends like that.
   Where drives hold the leg, a session never requests RESET: the leg might drift.
7. NO_SIGNAL and STOPPED return to the phase at rest that was left, or to PAUSED. PAUSE and END are
   accepted in them: without a signal they request DISABLE at once.
8. A self-test is passed only if the service has said so of each axis. One that another client has
   ended is not.
9. The session is finished after the last block, or by END.

    WAITING -START-> ENABLING -> ANNOUNCED -> STARTING -> WALKING -> REST -START-> ENABLING ...
                                     ^            |                   `-> FINISHED
                                     `- SELF_TEST <

Time is an argument, seconds of any monotonic clock. The service enforces the plan's limits.
"""

import math
from collections.abc import Mapping, Sequence
from enum import Enum, StrEnum, auto
from types import MappingProxyType
from typing import Final, NamedTuple

from gaitd_client import Cause, Mode, RefusalCode, Stage
from gaitd_client.wire import Refusal
from msgspec import Struct
from msgspec.structs import replace

from gaitd_session.advice import Failure, Why, refusal_of
from gaitd_session.goals import STRIDES_MIN, band_about, next_middle
from gaitd_session.plan import Block, BlockKind, blocks_of
from gaitd_session.profile import Goal, Profile
from gaitd_session.steps import Result, Step, StrideShare, rows_of, step_of

ANNOUNCE_S: Final = 3.0
"""Time between the announcement and the request for motion."""
LATE_S: Final = 60.0
"""Longest time from ENABLE to hold, and from the request to motion; the service announces a gait
for up to 30 s."""
SELF_TEST_LATE_S: Final = 240.0
"""Longest self-test: the service waits, then moves each axis of each leg."""
RESULT_LATE_S: Final = 2.0
"""Longest time from the end of the self-test to its results, which are other messages."""
LEFT_MIN_S: Final = 2.0
"""A block with less left is complete."""
OFF_RETRY_S: Final = 1.0
OFF_SETTLE_S: Final = 2.0
"""Drives that are off for so long, with no request pending, stay off."""
NOT_PASSED: Final = refusal_of(Failure.TEST_WITHOUT_RESULT)


class Phase(StrEnum):
    """State of the session."""

    WAITING = auto()
    """Nothing has begun."""
    ENABLING = auto()
    ANNOUNCED = auto()
    """The drives hold the leg, and motion is announced."""
    STARTING = auto()
    """Motion is requested, and announced by the service."""
    SELF_TEST = auto()
    WALKING = auto()
    REST = auto()
    PAUSED = auto()
    STOPPED = auto()
    """A stop is latched."""
    NO_SIGNAL = auto()
    FINISHED = auto()


ACTIVE: Final = frozenset(
    {Phase.ENABLING, Phase.ANNOUNCED, Phase.STARTING, Phase.SELF_TEST, Phase.WALKING}
)
"""A START is in force."""
AT_REST: Final = frozenset({Phase.WAITING, Phase.REST, Phase.PAUSED, Phase.FINISHED})


class Button(StrEnum):
    """What a patient can press."""

    START = auto()
    PAUSE = auto()
    END = auto()


class Event(Enum):
    """What a step has found: at most one of the trainer, then a button, then time or an answer."""

    # of the trainer
    SILENT = "no valid message"
    STOPPED = "a stop is latched or under way"
    RESTARTED = "the core is not the one that was started"
    LET_GO = "the hand switch is open while START is in force"
    READY = "mode ready"
    OFF = "mode off, bringing_up, or stopping as requested"
    HOLDING = "mode hold"
    TESTING = "mode self_test, as requested"
    TESTED = "mode hold after the self-test, which was passed"
    ANNOUNCING = "mode gait, as requested, and nothing moves yet"
    MOVING = "mode gait, as requested"
    OTHER = "another mode, or one that was not requested"
    # buttons
    START = "START, allowed"
    END = "END"
    PAUSE = "PAUSE"
    # time and answers
    ANNOUNCE_OVER = "the announcement was long enough"
    LATE = "what was requested has not come"
    FAILED = "a request was refused or not answered"


RETURN: Final = None
"""In the table: to `State.returns_to`."""

_AT_REST_ROW: Final[Mapping[Event, Phase | None]] = {
    Event.SILENT: Phase.NO_SIGNAL,
    Event.STOPPED: Phase.STOPPED,
    Event.START: Phase.ENABLING,
    Event.END: Phase.FINISHED,
}
_ACTIVE_ROW: Final[Mapping[Event, Phase | None]] = {
    **dict.fromkeys(set(Event) - {Event.START}, Phase.PAUSED),
    Event.SILENT: Phase.NO_SIGNAL,
    Event.STOPPED: Phase.STOPPED,
    Event.END: Phase.FINISHED,
}
"""Rule 3; each active phase adds what it survives."""

TABLE: Final[Mapping[Phase, Mapping[Event, Phase | None]]] = MappingProxyType(
    {
        Phase.WAITING: _AT_REST_ROW,
        Phase.REST: _AT_REST_ROW,
        Phase.PAUSED: _AT_REST_ROW,
        Phase.FINISHED: {Event.SILENT: Phase.NO_SIGNAL, Event.STOPPED: Phase.STOPPED},
        Phase.ENABLING: {
            **_ACTIVE_ROW,
            Event.READY: Phase.ENABLING,
            Event.HOLDING: Phase.ANNOUNCED,
        },
        Phase.ANNOUNCED: {
            **_ACTIVE_ROW,
            Event.HOLDING: Phase.ANNOUNCED,
            Event.ANNOUNCE_OVER: Phase.STARTING,
        },
        Phase.STARTING: {
            **_ACTIVE_ROW,
            Event.HOLDING: Phase.STARTING,
            Event.ANNOUNCING: Phase.STARTING,
            Event.TESTING: Phase.SELF_TEST,
            Event.MOVING: Phase.WALKING,
        },
        Phase.SELF_TEST: {
            **_ACTIVE_ROW,
            Event.TESTING: Phase.SELF_TEST,
            Event.TESTED: Phase.ANNOUNCED,
            Event.HOLDING: Phase.SELF_TEST,
        },
        Phase.WALKING: {**_ACTIVE_ROW, Event.MOVING: Phase.WALKING},
        Phase.STOPPED: {
            Event.SILENT: Phase.NO_SIGNAL,
            Event.READY: RETURN,
            Event.START: Phase.STOPPED,
        },
        Phase.NO_SIGNAL: {
            Event.STOPPED: Phase.STOPPED,
            Event.RESTARTED: RETURN,
            Event.READY: RETURN,
            Event.OFF: RETURN,
            Event.HOLDING: RETURN,
            Event.TESTING: RETURN,
            Event.ANNOUNCING: RETURN,
            Event.MOVING: Phase.WALKING,
            Event.OTHER: RETURN,
        },
    }
)
"""The phase after an event; without an entry the event changes nothing."""


WHY_OF: Final[Mapping[Event, Why]] = {
    Event.SILENT: Why.NO_SIGNAL,
    Event.RESTARTED: Why.RESTARTED,
    Event.LET_GO: Why.HAND_SWITCH,
    Event.LATE: Why.LATE,
    **dict.fromkeys(
        (
            *(Event.READY, Event.OFF, Event.HOLDING, Event.TESTING, Event.TESTED),
            *(Event.ANNOUNCING, Event.MOVING, Event.OTHER),
        ),
        Why.ENDED_ELSEWHERE,
    ),
}
"""What an event says that ends a START; a stop, a refusal and a button speak for themselves."""
SILENCE_CYCLES: Final = 20
"""Cycles in the silence that is no signal, 200 ms."""

CALM_MODES: Final[Mapping[str, Event]] = {
    Mode.READY: Event.READY,
    Mode.OFF: Event.OFF,
    Mode.BRINGING_UP: Event.OFF,
    Mode.STOPPING: Event.OFF,
    Mode.HOLD: Event.HOLDING,
}
"""Modes without motion; of all others GAIT and SELF_TEST are those of a session."""


class RequestKind(StrEnum):
    """What a session requests of the trainer."""

    ENABLE = auto()
    DISABLE = auto()
    SELF_TEST = auto()
    GAIT = auto()
    RESET = auto()


class Request(NamedTuple):
    """A request to the trainer, answered by an `Answer` with its number."""

    number: int
    kind: RequestKind
    cadence_hz: float = 0.0
    amplitude_ratio: float = 0.0
    duration_s: float = 0.0
    is_passive: bool = False
    """The patient relaxes: see `BlockKind.PASSIVE`."""


class Answer(NamedTuple):
    """The answer to a request."""

    number: int
    refusal: Refusal | None = None
    """Why it was refused, or that there was no answer; None: done."""


class TrainerState(NamedTuple):
    """What the newest messages say about the trainer."""

    boot_id: str
    mode: str
    """A `Mode`, or a name that a later version of the service sends."""
    is_enabled: bool
    """The drives are enabled on purpose."""
    stage: str | None
    cause: str
    """A `Cause`."""
    has_power: bool
    """A drive may exert torque, or its power state is not known."""
    hand_switch_held: bool | None
    """Every drive reads the hand switch as closed, or one does not; None: not each has said it."""
    self_test_passed: bool = False
    """The self-test that was requested last has been passed by each axis of the legs."""
    unseen_cycle_count: int = 0
    """Cycles of the core between these messages and those of the look before."""


class Inputs(NamedTuple):
    """All that a step is told."""

    trainer: TrainerState | None
    """None: no signal."""
    button: Button | None = None
    answer: Answer | None = None
    strides: Sequence[StrideShare] = ()


class LegGoal(Struct, frozen=True):
    """The target of one leg, and its strides of the present block."""

    leg: str
    middle_ratio: float
    """Middle of its target band."""
    strides: tuple[StrideShare, ...] = ()
    """Those of the present block, until the next one begins."""
    has_proposed: bool = False
    """A block before has proposed the band."""
    valid_before_count: int = 0
    """Valid strides of the blocks before."""
    share_before_sum_ratio: float = 0.0
    """Sum of their shares."""
    in_band_before_count: int = 0
    """Steps of the blocks before that were in the target."""

    @property
    def valid_shares(self) -> list[float]:
        """Shares of the valid strides."""
        return [one.share_ratio for one in self.strides if one.share_ratio is not None]


class State(Struct, frozen=True, kw_only=True):
    """State of a session; `begin` makes the first one."""

    blocks: tuple[Block, ...]
    goal: Goal
    legs: tuple[LegGoal, ...]
    steps: tuple[Step, ...] = ()
    """Strides of all legs in the present block as they are judged, oldest first."""
    best_row_before_count: int = 0
    """Longest row of steps in the target in the blocks before."""
    self_test_due: bool
    phase: Phase = Phase.WAITING
    since_s: float = 0.0
    """When the phase began."""
    test_ended_s: float | None = None
    """When mode self_test was left in SELF_TEST; None: not yet."""
    returns_to: Phase = Phase.WAITING
    """Phase at rest after NO_SIGNAL or STOPPED."""
    may_follow: bool = False
    """In NO_SIGNAL: the block that the trainer walks is the one that was begun (rule 4)."""
    block_index: int = 0
    """The present or next block; the number of blocks after the last one."""
    walked_s: float = 0.0
    """Time of the present block before its last interruption."""
    walked_before_s: float = 0.0
    """Time of the blocks before."""
    playing_since_s: float | None = None
    """When the gait of the block began to play; None: it does not."""
    rest_until_s: float = 0.0
    """START is not accepted before."""
    boot_id: str = ""
    """Boot id of the core at START."""
    request_number: int = 0
    """Number of the newest request."""
    pending: RequestKind | None = None
    """The newest request, while it is not answered."""
    off_since_s: float | None = None
    """Since when the drives are wanted off (rule 5); None: they are not."""
    off_requested_s: float = -math.inf
    wants_reset: bool = False
    """RESET is requested in this step."""
    refusal: Refusal | None = None
    """Why the last START or block has failed."""
    why: Why | None = None
    """What has ended the last START early; None: nothing has, or `refusal` or a stop says it."""

    @property
    def best_row_count(self) -> int:
        """Longest row of steps in the target."""
        return max(self.best_row_before_count, rows_of(self.steps)[1])

    def in_band_count(self, leg: str) -> int:
        """Steps of a leg in the present block that are in the target."""
        return sum(step.leg == leg and step.result is Result.WITHIN for step in self.steps)

    @property
    def block(self) -> Block | None:
        """The present or next block; None after the last one."""
        return self.blocks[self.block_index] if self.block_index < len(self.blocks) else None

    def block_walked_s(self, now_s: float) -> float:
        """Time of the present block that was walked."""
        since_s = self.playing_since_s
        return self.walked_s + (0.0 if since_s is None else now_s - since_s)

    def block_left_s(self, now_s: float) -> float:
        """Time of the present block that is left; 0 after the last one."""
        block = self.block
        return 0.0 if block is None else max(block.walk.duration_s - self.block_walked_s(now_s), 0)


def begin(profile: Profile, middles: Mapping[str, float], *, self_test_due: bool) -> State:
    """Return the first state of a session.

    Args:
        profile: of the patient.
        middles: by leg, the middle of the target band that the last session has ended with.
        self_test_due: a self-test comes before the first block.
    """
    goal = profile.goal
    legs = (
        LegGoal(leg, band_about(middles.get(leg, goal.share_start_ratio), goal).middle_ratio)
        for leg in profile.legs
    )
    return State(
        blocks=blocks_of(profile), goal=goal, legs=tuple(legs), self_test_due=self_test_due
    )


def step(state: State, inputs: Inputs, now_s: float) -> tuple[State, Request | None]:
    """Advance a session.

    Args:
        state: the state before.
        inputs: what has happened since the last step.
        now_s: time of any monotonic clock.

    Returns: the state after, and the request to be sent.
    """
    before = state
    state = _with_strides(state, inputs.strides)
    state = _found(state, _trainer_event(state, inputs, now_s), inputs, now_s)
    if inputs.button is Button.START and state.phase is not before.phase:
        # What it meant when it was pressed is over: it must not mean something else now.
        inputs = inputs._replace(button=None)
    for find in (_button_event, _answer_event, _time_event):
        state = _found(state, find(state, inputs, now_s), inputs, now_s)
    state = _playing(state, inputs.trainer, now_s)
    if inputs.answer is not None and inputs.answer.number == state.request_number:
        # What the request has done may be seen a moment later.
        off_since_s = None if state.off_since_s is None else now_s
        if state.pending is RequestKind.RESET:
            state = replace(state, refusal=inputs.answer.refusal)
        state = replace(state, pending=None, off_since_s=off_since_s)
    return _request(before, state, inputs.trainer, now_s)


# --- events -----------------------------------------------------------------------------------


def _trainer_event(state: State, inputs: Inputs, _now_s: float) -> Event | None:
    trainer = inputs.trainer
    if trainer is None:
        return Event.SILENT
    is_stopping = trainer.mode == Mode.STOPPING
    if trainer.mode == Mode.FAULT or (is_stopping and trainer.cause != Cause.NONE):
        return Event.STOPPED
    is_followed = state.phase is Phase.NO_SIGNAL and state.may_follow
    if (state.phase in ACTIVE or is_followed) and trainer.boot_id != state.boot_id:
        return Event.RESTARTED
    if state.phase in ACTIVE and trainer.hand_switch_held is False:
        return Event.LET_GO
    if trainer.mode == Mode.GAIT:
        is_ours = not state.self_test_due and (state.phase is not Phase.NO_SIGNAL or is_followed)
        if not is_ours:
            return Event.OTHER
        waits = trainer.stage in {None, Stage.PREPARING, Stage.ANNOUNCING}
        return Event.ANNOUNCING if waits else Event.MOVING
    if trainer.mode == Mode.SELF_TEST:
        return Event.TESTING if state.self_test_due else Event.OTHER
    if state.phase is Phase.SELF_TEST and trainer.mode == Mode.HOLD and trainer.self_test_passed:
        return Event.TESTED
    return CALM_MODES.get(trainer.mode, Event.OTHER)


def may_start(state: State, trainer: TrainerState | None, now_s: float) -> bool:
    """Return whether START would be accepted now."""
    if trainer is None or not trainer.hand_switch_held or Event.START not in TABLE[state.phase]:
        return False
    if state.phase is Phase.STOPPED:
        return may_reset(trainer) and state.pending is None
    return trainer.mode == Mode.READY and now_s >= state.rest_until_s


def may_reset(trainer: TrainerState) -> bool:
    """Return whether RESET takes nothing from the leg (rule 6)."""
    return trainer.mode == Mode.FAULT and not trainer.has_power


def _button_event(state: State, inputs: Inputs, now_s: float) -> Event | None:
    match inputs.button:
        case Button.START:
            return Event.START if may_start(state, inputs.trainer, now_s) else None
        case Button.PAUSE:
            return Event.PAUSE
        case Button.END:
            return Event.END
        case None:
            return None


def _answer_event(state: State, inputs: Inputs, _now_s: float) -> Event | None:
    answer = inputs.answer
    if answer is None or answer.number != state.request_number or state.phase not in ACTIVE:
        return None
    return Event.FAILED if answer.refusal else None


def _time_event(state: State, inputs: Inputs, now_s: float) -> Event | None:
    elapsed_s = now_s - state.since_s
    match state.phase:
        case Phase.ANNOUNCED:
            is_held = inputs.trainer is not None and inputs.trainer.hand_switch_held
            return Event.ANNOUNCE_OVER if is_held and elapsed_s >= ANNOUNCE_S else None
        case Phase.ENABLING | Phase.STARTING:
            return Event.LATE if elapsed_s >= LATE_S else None
        case Phase.SELF_TEST:
            ended_s = state.test_ended_s
            has_no_result = ended_s is not None and now_s - ended_s >= RESULT_LATE_S
            return Event.LATE if has_no_result or elapsed_s >= SELF_TEST_LATE_S else None
        case _:
            return None


# --- the state after an event -----------------------------------------------------------------


def _found(state: State, event: Event | None, inputs: Inputs, now_s: float) -> State:
    return state if event is None else _after(state, event, inputs, now_s)


def _after(state: State, event: Event, inputs: Inputs, now_s: float) -> State:
    if event in {Event.PAUSE, Event.END} and state.phase not in ACTIVE:
        # Rules 5 and 7.
        state = replace(state, may_follow=False, off_since_s=now_s)
        if event is Event.END and state.phase not in AT_REST:
            state = replace(state, returns_to=Phase.FINISHED)
    if event is Event.START and state.phase is Phase.STOPPED:
        return replace(state, wants_reset=True)
    row = TABLE[state.phase]
    if event not in row:
        return state
    after = row[event] or state.returns_to
    if after is state.phase:
        if after is Phase.SELF_TEST and event is Event.HOLDING and state.test_ended_s is None:
            return replace(state, test_ended_s=now_s)
        return state
    return _entered(_left(state, event, inputs, now_s), after, inputs.trainer, now_s)


def _left(state: State, event: Event, inputs: Inputs, now_s: float) -> State:
    """What leaving the phase by this event changes."""
    if state.phase in ACTIVE:
        state = replace(state, why=WHY_OF.get(event))
    elif state.why is Why.NO_SIGNAL and went_on(inputs.trainer):
        state = replace(state, why=Why.LATE_HERE)
    match state.phase:
        case Phase.SELF_TEST if event is Event.TESTED:
            return replace(state, self_test_due=False)
        case Phase.SELF_TEST if event is Event.LATE and state.test_ended_s is not None:
            return replace(state, refusal=NOT_PASSED, why=None)
        case Phase.WALKING:
            walked_s = state.block_walked_s(now_s)
            state = replace(state, walked_s=walked_s, playing_since_s=None)
        case _:
            pass
    answer = inputs.answer
    if event is Event.FAILED and answer is not None:
        is_due = state.self_test_due or (
            state.pending is RequestKind.GAIT
            and answer.refusal is not None
            and answer.refusal.code == RefusalCode.SELF_TEST_DUE
        )
        return replace(state, refusal=answer.refusal, self_test_due=is_due)
    return state


def went_on(trainer: TrainerState | None) -> bool:
    """Return whether the core has gone on during the silence that these messages end."""
    return trainer is not None and trainer.unseen_cycle_count >= SILENCE_CYCLES


def _entered(state: State, after: Phase, trainer: TrainerState | None, now_s: float) -> State:
    was = state.phase
    if was is Phase.WALKING and state.block_left_s(now_s) <= LEFT_MIN_S:
        state = _with_block_complete(state, now_s)
        rest = Phase.REST if state.block is not None else Phase.FINISHED
        after, state = (rest if after is Phase.PAUSED else after), replace(state, returns_to=rest)
    elif was in ACTIVE:
        state = replace(state, returns_to=Phase.PAUSED)
    elif was in AT_REST:
        state = replace(state, returns_to=was)
    if after is Phase.ENABLING and state.walked_s == 0.0:
        # The strides are those of the block before; a block that goes on keeps its own.
        state = _with_next_block(state)
    off_since_s = state.off_since_s
    if after in ACTIVE or after is Phase.STOPPED:
        off_since_s = None
    elif was in ACTIVE:
        off_since_s = now_s
    begins = after is Phase.ENABLING
    tells = after not in ACTIVE | {Phase.STOPPED, Phase.REST, Phase.FINISHED}
    return replace(
        state,
        phase=after,
        since_s=now_s,
        test_ended_s=None,
        off_since_s=off_since_s,
        may_follow=was is Phase.WALKING and state.returns_to is Phase.PAUSED,
        boot_id=trainer.boot_id if begins and trainer is not None else state.boot_id,
        refusal=None if begins or Phase.STOPPED in {was, after} else state.refusal,
        why=state.why if tells else None,
    )


def _with_block_complete(state: State, now_s: float) -> State:
    block = state.blocks[state.block_index]
    return replace(
        state,
        block_index=state.block_index + 1,
        walked_s=0.0,
        walked_before_s=state.walked_before_s + state.walked_s,
        rest_until_s=now_s + block.walk.rest_s,
    )


def _with_next_block(state: State) -> State:
    """Begin a block: its band follows from the strides of the block before."""
    middles = next_middles(state)
    legs = (
        LegGoal(
            leg.leg,
            middles[leg.leg],
            has_proposed=leg.has_proposed or len(leg.valid_shares) >= STRIDES_MIN,
            valid_before_count=leg.valid_before_count + len(leg.valid_shares),
            share_before_sum_ratio=leg.share_before_sum_ratio + sum(leg.valid_shares),
            in_band_before_count=leg.in_band_before_count + state.in_band_count(leg.leg),
        )
        for leg in state.legs
    )
    return replace(state, legs=tuple(legs), steps=(), best_row_before_count=state.best_row_count)


def next_middles(state: State) -> dict[str, float]:
    """Return, by leg, the middle of the target band for the block after the one of the strides."""
    return {
        leg.leg: next_middle(
            leg.middle_ratio, leg.valid_shares, state.goal, is_first=not leg.has_proposed
        )
        for leg in state.legs
    }


def _with_strides(state: State, strides: Sequence[StrideShare]) -> State:
    is_passive = state.block is not None and state.block.kind is BlockKind.PASSIVE
    if state.phase is not Phase.WALKING or is_passive:
        return state
    for stride in strides:
        legs = {leg.leg: leg for leg in state.legs}
        leg = legs.get(stride.leg)
        if leg is None:
            continue
        leg = replace(leg, strides=(*leg.strides, stride))
        step = step_of(leg.strides, band_about(leg.middle_ratio, state.goal))
        legs[leg.leg] = leg
        state = replace(state, legs=tuple(legs.values()), steps=(*state.steps, step))
    return state


def _playing(state: State, trainer: TrainerState | None, now_s: float) -> State:
    """Begin to count the time of a block."""
    plays = trainer is not None and trainer.stage in {Stage.PLAYING, Stage.ENDING}
    if state.phase is Phase.WALKING and plays and state.playing_since_s is None:
        return replace(state, playing_since_s=now_s)
    return state


# --- requests ---------------------------------------------------------------------------------


def _request(
    before: State, state: State, trainer: TrainerState | None, now_s: float
) -> tuple[State, Request | None]:
    kind = RequestKind.RESET if state.wants_reset else _wanted(before, state)
    if kind is None:
        state, is_off_wanted = _off(state, trainer, now_s)
        if not is_off_wanted:
            return state, None
        kind = RequestKind.DISABLE
    number = state.request_number + 1
    state = replace(state, request_number=number, pending=kind, wants_reset=False)
    block = state.block
    if kind is not RequestKind.GAIT or block is None:
        return state, Request(number, kind)
    walk = block.walk
    if block.kind is BlockKind.PASSIVE:  # a part of a minute would be too short
        whole_s = walk.duration_s
        return state, Request(
            number, kind, walk.cadence_hz, walk.amplitude_ratio, whole_s, is_passive=True
        )
    left_s = state.block_left_s(now_s)
    return state, Request(number, kind, walk.cadence_hz, walk.amplitude_ratio, left_s)


def _wanted(before: State, state: State) -> RequestKind | None:
    """The request that entering a phase makes."""
    if state.phase is before.phase:
        return None
    match state.phase:
        case Phase.ENABLING:
            return RequestKind.ENABLE
        case Phase.STARTING:
            return RequestKind.SELF_TEST if state.self_test_due else RequestKind.GAIT
        case _:
            return None


def _off(state: State, trainer: TrainerState | None, now_s: float) -> tuple[State, bool]:
    """Return whether DISABLE is to be requested now (rule 5)."""
    if state.off_since_s is None or (trainer is None and state.may_follow):
        return state, False
    if trainer is None or trainer.is_enabled:
        is_asked = state.pending is RequestKind.DISABLE
        if is_asked or now_s - state.off_requested_s < OFF_RETRY_S:
            return state, False
        return replace(state, off_requested_s=now_s), True
    is_settled = state.pending is None and now_s - state.off_since_s >= OFF_SETTLE_S
    return (replace(state, off_since_s=None) if is_settled else state), False
