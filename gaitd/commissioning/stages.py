"""The stages of the procedure: what each says, asks or requests, and how an observation ends it.

A stage is a pair of functions: of what comes out at its begin, and of its end. The steps at the end
of this file are the stages of each task in their order.
"""

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Final

from gaitd_client import Cause, Mode, Outcome, Reply, StopCategory
from gaitd_names import EventCode, RefusalCode, Untested

from analysis.acceptance.record import FindingCode, Judgement, Reason, ReasonCode
from daemon.ipc.record import CycleRecord
from gaitd.commissioning.measures import ENDS, distance_unit
from gaitd.commissioning.messages import (
    EXPECTED,
    Instruction,
    InstructionCode,
    Output,
    ReadObjects,
    Request,
)
from gaitd.commissioning.procedure import (
    NEXT,
    STEP_MAX_S,
    Move,
    Scene,
    Stage,
    Way,
    failed,
    missing,
)
from gaitd.commissioning.stops import drive_of

READY_MAX_S: Final = 30.0
BEGIN_MAX_S: Final = 60.0
REST_MAX_S: Final = 20.0
AFTER_STOP_S: Final = 1.2
STOP_MAX_S: Final = 10.0
RETRY_S: Final = 0.5
STEADY_S: Final = 1.0
"""Time in mode hold; the static load is compared after it."""
BETWEEN_S: Final = 0.5
"""After a motion the service passes mode ready before the bring-up that ends it."""
A_MOMENT_S: Final = 0.1
"""Until a sample or an event has arrived."""
FAST_RATIO: Final = 0.95
"""A stop is asked for at this share of the highest common speed of both axes in a stride."""
BEFORE_STOP_COUNT: Final = 50
"""Records before a stop that are kept with it."""
AT_REST: Final = frozenset({Mode.OFF, Mode.BRINGING_UP, Mode.READY, Mode.FAULT})
"""Modes in which the service moves nothing and holds nothing."""
PRESSED: Final = frozenset({Cause.STO_ACTIVE, Cause.DRIVE_FAULT, Cause.EMERGENCY})
"""Causes of a stop that an emergency stop may leave."""
BY_REFUSAL: Final[Mapping[str, InstructionCode]] = {
    RefusalCode.HAND_SWITCH_OPEN: InstructionCode.HOLD_HAND_SWITCH,
    RefusalCode.STO_ACTIVE: InstructionCode.RELEASE_STO,
    RefusalCode.LEG_MOVES: InstructionCode.KEEP_STILL,
}
"""What the operator is to do, by the code of the refusal."""
BY_UNTESTED: Final[Mapping[str, InstructionCode]] = {
    Untested.HAND_SWITCH_OPEN: InstructionCode.RELEASE_HAND_SWITCH,
    Untested.HAND_SWITCH_CLOSED: InstructionCode.HOLD_HAND_SWITCH,
    Untested.STO_ACTIVE: InstructionCode.PRESS_STO,
    Untested.STO_RELEASED: InstructionCode.RELEASE_STO,
}
"""The same by the state of an input that the service has still to see."""

BY_ANOTHER_COMMAND: Final = frozenset({RefusalCode.SIGN_NOT_PROVEN, RefusalCode.NOT_REFERENCED})
"""Refusals that no waiting ends: an axis has to be moved alone before."""


def instruction_after(reply: Reply) -> Instruction:
    """What the operator is to do after a refusal; to wait, if its code asks for nothing."""
    refusal = reply.refusal
    if refusal is None:
        return Instruction(InstructionCode.WAIT)
    untested = refusal.values.get("untested")
    code = BY_REFUSAL.get(refusal.code) if untested is None else BY_UNTESTED.get(str(untested))
    return Instruction(code or InstructionCode.WAIT, refusal.subject or "", refusal=refusal)


# --- stages of every procedure --------------------------------------------------------------------


def _refused(scene: Scene, reply: Reply) -> Reason:
    values = {"request": reply.request, "outcome": str(reply.outcome)}
    service, refusal = scene.seen.service, reply.refusal
    return Reason(ReasonCode.REFUSED, scene.task.axis, values, service, refusal)


def _reached(scene: Scene, mode: str, within_s: float = READY_MAX_S) -> Move | None:
    if scene.mode == mode:
        return NEXT
    late = scene.without(mode)
    if scene.mode == Mode.FAULT:
        return failed(late)
    return missing(late) if scene.has_passed(within_s) else None


def _ready(scene: Scene) -> Move | None:
    if scene.mode == Mode.READY:
        return Move(known={"is_set_up": True})
    return failed(scene.without(Mode.READY)) if scene.has_passed(READY_MAX_S) else None


def _objects(scene: Scene) -> Move | None:
    if not scene.seen.objects:
        return None
    judged = {one.judgement for one in scene.seen.objects}
    if Judgement.NOT_MEASURED in judged and Judgement.FAILED not in judged:
        why = scene.state.blocked or scene.because(ReasonCode.UNREAD)
        return Move(outputs=scene.seen.objects, known={"blocked": why})
    return Move(outputs=scene.seen.objects)


def _agreed(scene: Scene) -> Move | None:
    announced = scene.task.announced
    return NEXT if announced is None or announced.code not in EXPECTED else _confirmed(scene)


def _confirmed(scene: Scene) -> Move | None:
    answer = scene.seen.answer
    if answer is None:
        return None
    return NEXT if answer.value else missing(scene.because(ReasonCode.NOT_CONFIRMED))


def _latched(scene: Scene) -> Move:
    mode, verdict = scene.mode, scene.seen.service.verdict
    may_reset = RESET in scene.task.stages
    if mode == Mode.HOLD:
        return Move(STEADY)
    if mode == Mode.FAULT:
        was_measured = verdict is not None and verdict.cause == scene.state.measured
        is_mine = may_reset and was_measured
        return Move(RESET) if is_mine else failed(scene.because(ReasonCode.STOPPED))
    if mode != Mode.READY and not may_reset:
        return failed(scene.without(Mode.READY))
    return Move(ENABLED)


def _repeated(scene: Scene, request: str) -> Move | None:
    """Repeat a request, and show the operator what is missing, until it is done."""
    state, reply = scene.state, scene.seen.reply
    if reply is not None:
        if reply.outcome == Outcome.DONE:
            return NEXT
        code = None if reply.refusal is None else reply.refusal.code
        if code in BY_ANOTHER_COMMAND or scene.has_passed(STEP_MAX_S):
            return failed(_refused(scene, reply))
        shown = instruction_after(reply)
        said = () if shown == state.shown else (shown,)
        return Move(Way.STAY, said, {"shown": shown})
    if scene.has_passed(STEP_MAX_S + RETRY_S):
        return failed(scene.because(ReasonCode.NOT_IN_TIME, within_s=STEP_MAX_S))
    if scene.seen.now_s - state.asked_s < RETRY_S:
        return None
    return Move(Way.STAY, (Request(request),), {"asked_s": scene.seen.now_s})


def _enabled(scene: Scene) -> Move | None:
    if scene.seen.reply is not None or scene.mode == Mode.READY:
        return _repeated(scene, "enable")
    may_reset = RESET in scene.task.stages
    if scene.mode == Mode.FAULT:
        was_driving = any(record.mode not in AT_REST for record in _of_stage(scene))
        if may_reset and _was_pressed(scene) and not was_driving:
            said = Instruction(InstructionCode.STO_SEEN, service=scene.seen.service)
            return Move(RESET, (said,))
        shown = scene.state.shown
        has_asked = shown is not None and shown.code is InstructionCode.PRESS_STO
        is_answer = has_asked and _was_pressed(scene)
        return failed(scene.because(ReasonCode.STO_ACTED if is_answer else ReasonCode.STOPPED))
    # Another client's request: to enable now would be outside this procedure.
    return _repeated(scene, "enable") if may_reset else failed(scene.without(Mode.READY))


def _of_stage(scene: Scene) -> list[CycleRecord]:
    return [one for one in scene.seen.records if one.seq >= scene.state.began_seq]


def _was_pressed(scene: Scene) -> bool:
    """True if the fault is one that the emergency stop leaves, and it was open."""
    drives = [drive for record in _of_stage(scene) for drive in record.drives]
    has_said = any(one.code == EventCode.STO_ACTIVATED for one in scene.state.reports)
    was_open = has_said or not all(drive.sto_released for drive in drives)
    verdict = scene.seen.service.verdict
    return was_open and verdict is not None and verdict.cause in PRESSED


def _steady(scene: Scene) -> Move | None:
    if not scene.has_passed(STEADY_S):
        return None
    return NEXT if scene.mode == Mode.HOLD else failed(scene.without(Mode.HOLD))


def _requested(scene: Scene) -> Move | None:
    reply = scene.seen.reply
    if reply is None:
        return None
    return NEXT if reply.outcome == Outcome.DONE else missing(_refused(scene, reply))


def _entered(scene: Scene) -> Move | None:
    has_ended = any(one.code in ENDS for one in scene.state.reports)
    return NEXT if has_ended else _reached(scene, scene.task.mode)


def _run(scene: Scene) -> Move | None:
    if scene.mode != scene.task.mode:
        return NEXT
    limit_s = scene.task.run_max_s
    is_late = scene.has_passed(limit_s)
    return missing(scene.because(ReasonCode.NOT_IN_TIME, within_s=limit_s)) if is_late else None


def _unstopped(scene: Scene) -> Move:
    """Block after a self-test that has ended in a stop, whatever it has found."""
    if scene.mode == Mode.FAULT and scene.state.failed is None:
        return Move(known={"blocked": scene.because(ReasonCode.STOPPED)})
    return NEXT


# --- what the operator sees and does --------------------------------------------------------------


def _seen(scene: Scene) -> Move | None:
    answer, code = scene.seen.answer, FindingCode.DIRECTION
    if scene.state.failed is not None:
        return Move(Way.END)
    if answer is None or answer.value:
        return None if answer is None else NEXT
    if answer.value is None:
        unseen = scene.found(code, Judgement.NOT_MEASURED, why=ReasonCode.NOT_CONFIRMED)
        return Move(Way.END, (unseen,))
    wrong = scene.found(code, Judgement.FAILED, why=ReasonCode.MOVED_OPPOSITE)
    return Move(Way.END, (wrong,), {"blocked": wrong.reason})


def _witnessed(scene: Scene) -> Move | None:
    moved = _requested(scene)
    seen = scene.found(FindingCode.DIRECTION, Judgement.PASSED)
    return Move(outputs=(seen,)) if moved is NEXT else moved


def _sampled(scene: Scene) -> Move | None:
    if not scene.has_passed(A_MOMENT_S):
        return None
    record = scene.newest
    place_si = None if record is None else drive_of(record, scene.task.axis).position
    if place_si is None:
        return missing(scene.because(ReasonCode.NO_SAMPLE))
    return Move(known={"marks_si": (*scene.state.marks_si, place_si)})


def _measured(scene: Scene) -> Move | None:
    if scene.seen.answer is None:
        return None
    distance = scene.seen.answer.value
    if not distance or not math.isfinite(distance):
        return missing(scene.because(ReasonCode.NOT_CONFIRMED))
    _, size_si = distance_unit(scene.task.axis)
    return Move(known={"distance_si": distance * size_si})


# --- a stop in gait -------------------------------------------------------------------------------


def _in_gait(scene: Scene, reached: Move | None, within_s: float) -> Move | None:
    if scene.mode != Mode.GAIT or (reached is None and scene.has_passed(within_s)):
        return failed(scene.without(Mode.GAIT))
    return reached


def _walking(scene: Scene) -> Move | None:
    walks = scene.newest is not None and scene.newest.gait_phase >= 0
    return _in_gait(scene, NEXT if walks else None, BEGIN_MAX_S)


def _speed(record: CycleRecord, axis: str) -> float:
    return abs(drive_of(record, axis).velocity or 0.0)


def _fast_ratio(record: CycleRecord, highest: Mapping[str, float]) -> float:
    """Speed of the slower axis, as share of its highest one."""
    return min(_speed(record, axis) / (speed or 1.0) for axis, speed in highest.items())


def _watched(scene: Scene) -> Move | None:
    """Watch a stride for the highest speeds; at the next one the machine is stopped."""
    if not scene.has_passed(scene.task.stride_s):
        return None
    records = [one for one in scene.seen.records if one.seq > scene.state.began_seq]
    if not records:
        return failed(scene.without(Mode.GAIT))
    highest = {axis: max(_speed(one, axis) for one in records) for axis in scene.task.axes}
    fast_ratio = FAST_RATIO * max(_fast_ratio(record, highest) for record in records)
    return Move(known={"highest": highest, "fast_ratio": fast_ratio})


def _fast(scene: Scene) -> Move | None:
    """Wait until both axes are as fast together as in the stride before."""
    record, state, move = scene.newest, scene.state, None
    if record is not None and _fast_ratio(record, state.highest) >= state.fast_ratio:
        move = Move(known={"from_seq": record.seq - BEFORE_STOP_COUNT})
    return _in_gait(scene, move, 2 * scene.task.stride_s)


def _stopped(scene: Scene) -> Move | None:
    reply, verdict = scene.seen.reply, scene.seen.service.verdict
    if reply is not None and reply.outcome != Outcome.DONE:
        return failed(_refused(scene, reply))
    if verdict is not None and verdict.category != StopCategory.NONE:
        return NEXT
    is_late = scene.has_passed(STEP_MAX_S)
    return failed(scene.because(ReasonCode.NO_STOP)) if is_late else None


def _traced(scene: Scene) -> Move | None:
    stop = scene.task.stop
    measured = "" if stop is None else str(stop.cause)
    return Move(known={"measured": measured}) if scene.has_passed(AFTER_STOP_S) else None


def _left(scene: Scene) -> Move | None:
    """The machine is stopped before the procedure ends; a stop in force is told."""
    service = scene.seen.service
    if scene.mode == Mode.FAULT:
        return Move(outputs=(Instruction(InstructionCode.LEFT_STOPPED, service=service),))
    if not scene.mode or scene.mode in AT_REST:
        return NEXT
    may_move = Instruction(InstructionCode.MAY_NOT_HAVE_STOPPED, service=service)
    return Move(outputs=(may_move,)) if scene.has_passed(STOP_MAX_S) else None


# --- the stages -----------------------------------------------------------------------------------


def after(duration_s: float) -> Callable[[Scene], Move | None]:
    """The end of a stage that lasts so long."""
    return lambda scene: NEXT if scene.has_passed(duration_s) else None


def _referenced(scene: Scene) -> Move:
    """An axis whose position is valid is not moved."""
    record = scene.newest
    is_valid = record is not None and drive_of(record, scene.task.axis).referenced
    return Move(JUDGED) if is_valid else NEXT


def _stop(scene: Scene) -> tuple[Output, ...]:
    now = None if scene.task.stop is None else scene.task.stop.now
    return (Request("stop") if now is None else Instruction(now),)


def _leave(scene: Scene) -> tuple[Output, ...]:
    blocked = scene.state.blocked
    can_ask = blocked is None or blocked.code is not ReasonCode.NO_SERVICE
    moves = scene.mode and scene.mode not in AT_REST
    stop = Request("stop") if can_ask and moves else None
    return tuple(one for one in (*scene.task.missing, stop) if one is not None)


def _tell_witnessed(scene: Scene) -> tuple[Output, ...]:
    return (Request("mode", {**scene.task.request.arguments, "witnessed": True}),)


def _ask_sight(scene: Scene) -> tuple[Output, ...]:
    asked = Instruction(InstructionCode.WAS_SEEN, scene.task.axis)
    return (asked,) if scene.state.failed is None else ()


def _ask_distance(scene: Scene) -> tuple[Output, ...]:
    values = {"distance_unit": distance_unit(scene.task.axis)[0]}
    return (Instruction(InstructionCode.DISTANCE, scene.task.axis, values),)


def _mark(code: InstructionCode) -> Stage:
    return Stage(_confirmed, lambda scene: (Instruction(code, scene.task.axis),))


READY: Final = Stage(_ready)
OBJECTS: Final = Stage(
    _objects, lambda scene: (ReadObjects(scene.task.axis, scene.state.is_set_up),)
)
VALID: Final = Stage(_referenced)
AGREED: Final = Stage(_agreed, lambda scene: (scene.task.announced,))
LATCHED: Final = Stage(_latched)
RESET: Final = Stage(partial(_repeated, request="reset"), lambda _: (Request("reset"),))
CLEARED: Final = Stage(partial(_reached, mode=Mode.READY))
ENABLED: Final = Stage(_enabled, lambda _: (Request("enable"),))
HELD: Final = Stage(partial(_reached, mode=Mode.HOLD))
STEADY: Final = Stage(_steady)
REQUESTED: Final = Stage(_requested, lambda scene: (scene.task.request,))
ENTERED: Final = Stage(_entered)
RUN: Final = Stage(_run)
REPORTED: Final = Stage(after(A_MOMENT_S))
JUDGED: Final = Stage(lambda _: NEXT, lambda scene: tuple(scene.task.judge(scene)))
UNSTOPPED: Final = Stage(_unstopped)
BETWEEN: Final = Stage(after(BETWEEN_S))
SETTLED: Final = Stage(partial(_reached, mode=Mode.READY))
SEEN: Final = Stage(_seen, _ask_sight)
CONFIRMED: Final = Stage(_witnessed, _tell_witnessed)
MARK: Final = _mark(InstructionCode.MOVE_TO_MARK)
SECOND_MARK: Final = _mark(InstructionCode.MOVE_TO_SECOND_MARK)
SAMPLED: Final = Stage(_sampled)
DISTANCE: Final = Stage(_measured, _ask_distance)
WALKING: Final = Stage(_walking)
RAMPED: Final = Stage(lambda scene: after(scene.task.ramp_s)(scene))
WATCHED: Final = Stage(_watched)
FAST: Final = Stage(_fast)
STOPPED: Final = Stage(_stopped, _stop)
RESTED: Final = Stage(lambda scene: NEXT if scene.mode == Mode.FAULT else after(REST_MAX_S)(scene))
TRACED: Final = Stage(_traced)
LEFT: Final = Stage(_left, _leave)

# --- the steps ------------------------------------------------------------------------------------

_MOTION: Final = (REQUESTED, ENTERED, RUN)
_TO_HOLD: Final = (LATCHED, RESET, CLEARED, ENABLED, HELD, STEADY)
_TEST: Final = (*_MOTION, REPORTED, JUDGED, UNSTOPPED)
_SIGHT: Final = (SEEN, CONFIRMED)
SIGN: Final = (AGREED, *_MOTION, JUDGED, BETWEEN, SETTLED, *_SIGHT)
UNITS: Final = (MARK, SAMPLED, SECOND_MARK, SAMPLED, DISTANCE, JUDGED)
POSITION: Final = (VALID, AGREED, *_MOTION, BETWEEN, SETTLED, JUDGED)
SELF_TEST: Final = (AGREED, *_TO_HOLD, *_TEST)
STOP_IN_GAIT: Final = (
    *(AGREED, *_TO_HOLD, REQUESTED, ENTERED, WALKING, RAMPED, WATCHED, FAST),
    *(STOPPED, RESTED, TRACED, JUDGED),
)
DAILY_TEST: Final = (LATCHED, ENABLED, HELD, STEADY, AGREED, *_TEST)
"""Nothing is reset."""
HOMING: Final = (REQUESTED, ENTERED, RUN, REPORTED, JUDGED, BETWEEN, SETTLED)
SIGN_TEST: Final = (REQUESTED, AGREED, *HOMING[1:], *_SIGHT)
"""It is announced once it is accepted: the drives are brought up before it begins."""
