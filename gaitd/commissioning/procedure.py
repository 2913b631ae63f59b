"""The procedure as a function of state and observation: `step`. It reads no clock and no text.

A plan (`plans.py`) is a list of tasks, a task has stages, and a stage is left when what it waits
for has been observed. Rules:

1. What a stage says, asks or requests comes out when it begins; it ends with a later observation.
   At most one output of a step waits for a reply, an answer or objects, and is the last one.
2. Nothing is commanded here: each motion is a mode of the service, whose limits and stops are in
   force. The operator agrees to each motion of an acceptance before it is requested.
3. A task that has failed blocks all that move the machine after it; they are findings, not
   measured, with the first reason. What could not be done, and has not failed, blocks nothing.
4. A stop in force is reset in two cases: it is the one that was measured last; or it is the fault
   that some drives report when the emergency stop is pressed without power, as the check of the
   inputs asks for. Every other one is for the operator, and blocks. A task without RESET resets
   nothing.
5. A request that waits for the operator (enable, reset) is repeated, and its refusal is shown as
   an instruction by its code.
6. The last task of an acceptance leaves the machine stopped, also after an interruption.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any, Final, NamedTuple

import msgspec

from analysis.acceptance.record import (
    NO_VALUES,
    Finding,
    FindingCode,
    Judgement,
    Reason,
    ReasonCode,
    Report,
    Section,
    StopTrace,
    Values,
)
from daemon.ipc.record import CycleRecord
from gaitd.commissioning.messages import Instruction, Observation, Output, Request
from gaitd.commissioning.stops import WayToStop

STEP_MAX_S: Final = 120.0
"""Time for each step that the operator does, and for a self-test."""


class Task(NamedTuple):
    """A step of the procedure."""

    stages: "tuple[Stage, ...]"
    section: Section = Section.REST
    """What its findings are about."""
    is_always_done: bool = False
    """Also if a step has failed before."""
    axes: tuple[str, ...] = ()
    """LEG/AXIS of each that it is about."""
    announced: Instruction | None = None
    request: Request = Request("mode")
    run_max_s: float = STEP_MAX_S
    judge: "Callable[[Scene], Iterable[Finding | StopTrace]]" = lambda _: ()
    missing: tuple[Finding, ...] = ()
    """What is not measured if the task is not done; empty: the whole section, of each axis."""
    stride_s: float = 0.0
    ramp_s: float = 0.0
    """Until the gait has its amplitude."""
    stop: WayToStop | None = None

    @property
    def mode(self) -> str:
        """The mode that it requests."""
        return str(self.request.arguments["mode"])

    @property
    def axis(self) -> str:
        """The axis of a task of one axis; empty for all."""
        return self.axes[0] if len(self.axes) == 1 else ""


def not_measured(
    axes: Iterable[str], section: Section, code: FindingCode = FindingCode.STEP
) -> tuple[Finding, ...]:
    """This has not been measured, on each of these axes."""
    return tuple(Finding(one, section, code, Judgement.NOT_MEASURED) for one in axes)


class State(NamedTuple):
    """How far the procedure is."""

    task: int = 0
    stage: int = 0
    began_s: float | None = None
    """Begin of the stage; None: it has not begun."""
    began_seq: int = 0
    """Newest record at the stage's begin."""
    from_seq: int = 0
    """From this record on they belong to the task."""
    asked_s: float = 0.0
    """When a request was repeated last."""
    shown: Instruction | None = None
    reports: tuple[Report, ...] = ()
    """Events since the task's begin."""
    marks_si: tuple[float, ...] = ()
    """Positions in which the operator held the axis."""
    distance_si: float = 0.0
    """Between them, as the operator has measured it."""
    highest: Mapping[str, float] = {}
    """Highest speed of each axis in a stride, SI."""
    fast_ratio: float = 0.0
    failed: Finding | None = None
    """The first of the task that has failed."""
    is_set_up: bool = False
    """The service was ready at the begin: bring-up has set the drives' objects."""
    measured: str = ""
    """Cause of the stop that was measured last, which may be reset."""
    blocked: Reason | None = None
    """Why nothing is moved any more."""


BEGIN: Final = State()


class Scene(NamedTuple):
    """What a stage is judged by."""

    task: Task
    state: State
    seen: Observation

    @property
    def mode(self) -> str:
        """The service's mode."""
        return self.seen.service.mode

    @property
    def newest(self) -> CycleRecord | None:
        """The newest record."""
        return self.seen.records[-1] if self.seen.records else None

    def has_passed(self, duration_s: float) -> bool:
        """True if the stage has lasted so long, or nothing is received any more."""
        began_s = self.seen.now_s if self.state.began_s is None else self.state.began_s
        return self.seen.is_silent or self.seen.now_s - began_s >= duration_s

    @property
    def records(self) -> list[CycleRecord]:
        """Those of the task; none if the service is on another computer."""
        return [one for one in self.seen.records if one.seq >= self.state.from_seq]

    def without(self, mode: str) -> Reason:
        """The reason that the service is not in this mode."""
        return self.because(ReasonCode.NO_MODE, mode=mode)

    def because(self, code: ReasonCode, **values: float | str | None) -> Reason:
        """A reason about this task, with the state of the service."""
        return Reason(code, self.task.axis, values, self.seen.service)

    def found(
        self,
        code: FindingCode,
        judged: Judgement,
        values: Values = NO_VALUES,
        why: ReasonCode | None = None,
    ) -> Finding:
        """A finding about the task's axis, with its values in the reason as well."""
        reason = None if why is None else self.because(why, **values)
        return Finding(self.task.axis, self.task.section, code, judged, values, reason)


class Way(Enum):
    """Where a stage leads to, if not to another one of the task."""

    STAY = auto()
    NEXT = auto()
    END = auto()
    """To the next task."""


class Move(NamedTuple):
    """What an observation does to a stage."""

    to: "Way | Stage" = Way.NEXT
    outputs: tuple[Output, ...] = ()
    known: Mapping[str, Any] = {}
    """Fields of the state that change."""
    why: Reason | None = None
    """The task is not done."""
    blocks: bool = False
    """It has failed: nothing is moved any more."""


NEXT: Final = Move()


def missing(why: Reason) -> Move:
    """The task cannot be done."""
    return Move(Way.END, why=why)


def failed(why: Reason) -> Move:
    """The task has failed."""
    return Move(Way.END, why=why, blocks=True)


@dataclass(frozen=True)
class Stage:
    """Part of a task, with what it says, asks or requests when it begins."""

    end: Callable[[Scene], Move | None]
    """How an observation ends it; None: it goes on."""
    begin: Callable[[Scene], tuple[Output | None, ...]] = lambda _: ()


# --- the procedure --------------------------------------------------------------------------------


def step(
    tasks: tuple[Task, ...], state: State, seen: Observation
) -> tuple[State, tuple[Output, ...]]:
    """Go on with an observation: the state after it, and what is said, requested and found."""
    outputs: tuple[Output, ...] = ()
    state = state._replace(reports=state.reports + seen.reports)
    while not is_over(tasks, state):
        task = tasks[state.task]
        scene = Scene(task, state, seen)
        if state.began_s is not None:
            move = task.stages[state.stage].end(scene)
        elif state.blocked and not task.is_always_done:
            move = missing(state.blocked)
        else:
            state, said = _begin(scene)
            return state, outputs + said
        if move is None:
            break
        state, new = _moved(scene, move)
        outputs += new
        if move.to is Way.STAY:
            break
    return state, outputs


def is_over(tasks: tuple[Task, ...], state: State) -> bool:
    """True after the last task."""
    return state.task >= len(tasks)


def may_move(tasks: tuple[Task, ...], state: State) -> str:
    """The axis that a procedure of one axis has set in motion, without its end; else empty."""
    has_begun = state.began_s is not None or state.stage > 0
    return tasks[state.task].axis if has_begun and not is_over(tasks, state) else ""


def interrupted(
    tasks: tuple[Task, ...], state: State, why: Reason
) -> tuple[State, tuple[Finding, ...]]:
    """End the procedure: what follows is not measured, and the last task leaves the machine."""
    rest = not_measured(tasks[-1].axes, Section.REST)
    state = state._replace(task=len(tasks) - 1, stage=0, began_s=None, blocked=why)
    return state, tuple(msgspec.structs.replace(one, reason=why) for one in rest)


def _begin(scene: Scene) -> tuple[State, tuple[Output, ...]]:
    task, state, seen = scene
    seq = 0 if scene.newest is None else scene.newest.seq
    if state.stage == 0:
        state = state._replace(from_seq=seq, reports=(), shown=None, marks_si=(), failed=None)
    state = state._replace(began_s=seen.now_s, began_seq=seq, asked_s=seen.now_s)
    said = task.stages[state.stage].begin(scene._replace(state=state))
    outputs = tuple(one for one in said if one is not None)
    return _noted(state, outputs), outputs


def _moved(scene: Scene, move: Move) -> tuple[State, tuple[Output, ...]]:
    """The state after a move, and its outputs with the findings of a task that was not done."""
    task, outputs = scene.task, move.outputs
    if move.why is not None:
        judged = Judgement.FAILED if move.blocks else Judgement.NOT_MEASURED
        known = {"judgement": judged, "reason": move.why}
        missed = task.missing or not_measured(task.axes, task.section)
        outputs += tuple(msgspec.structs.replace(one, **known) for one in missed)
    state = _noted(scene.state._replace(**move.known), outputs)
    if move.to is Way.STAY:
        return state, outputs
    if isinstance(move.to, Stage):
        return state._replace(stage=task.stages.index(move.to), began_s=None), outputs
    if move.to is Way.NEXT and state.stage + 1 < len(task.stages):
        return state._replace(stage=state.stage + 1, began_s=None), outputs
    blocked = state.blocked or (move.why if move.blocks else None)
    if blocked is None and state.failed is not None:
        section = state.failed.section
        blocked = Reason(ReasonCode.FAILED_BEFORE, state.failed.drive, {"section": section})
    return state._replace(task=state.task + 1, stage=0, began_s=None, blocked=blocked), outputs


def _noted(state: State, outputs: tuple[Output, ...]) -> State:
    found = (one for one in outputs if isinstance(one, Finding))
    bad = (one for one in found if one.judgement is Judgement.FAILED)
    return state._replace(failed=state.failed or next(bad, None))
