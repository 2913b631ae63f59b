"""`Session`: one training session with a trainer; the impure shell of `machine.py`.

Threads: this session's, which reads the streams and steps; two for requests, because DISABLE must
not wait for the answer to another one; one that writes the history, because a disk may take a
second. None of them is waited for by `press` and `view`.
"""

import threading
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor, wait
from types import TracebackType
from typing import Final, Self

from gaitd_client import (
    ClientError,
    Clock,
    DriveState,
    Event,
    EventCode,
    Mode,
    NotValid,
    RequestRefusedError,
    Stream,
    Stride,
    Trainer,
)
from gaitd_texts import Reader, catalogue
from msgspec.structs import replace

from gaitd_session.advice import Failure, Why, refusal_of
from gaitd_session.goals import valid_share
from gaitd_session.machine import (
    ACTIVE,
    Answer,
    Button,
    Inputs,
    Phase,
    Request,
    RequestKind,
    State,
    TrainerState,
    begin,
    next_middles,
    step,
    went_on,
)
from gaitd_session.profile import Profile
from gaitd_session.steps import StrideShare, works_against
from gaitd_session.store import (
    BlockRow,
    EndRow,
    GoalRow,
    History,
    InterruptionRow,
    MarkRow,
    Row,
    SelfTestRow,
    SessionRow,
    StoreError,
    StrideRow,
)
from gaitd_session.view import View, view_of

POLL_S: Final = 0.05
"""Time of the computer between two steps."""
LATE_LOOK_S: Final = 3 * POLL_S
"""A look at the streams that comes so late says nothing about a silence: this program was late, and
messages may wait to be received."""
LATE_LOOKS_MAX: Final = 3
"""So many late looks in a row are not counted; then a silence is one."""
FLUSH_S: Final = 2.0
"""Time between two writes while strides come: what a power cut can lose."""
SELF_TEST_VALID_NS: Final = 20 * 3_600_000_000_000
"""As `self_test.valid_h` of the shipped service, which refuses a gait where its own is due."""
INTERRUPTED_PHASES: Final = frozenset({Phase.PAUSED, Phase.STOPPED, Phase.NO_SIGNAL})
STRONGEST_FIRST: Final = (Button.END, Button.PAUSE, Button.START)
WITHOUT_POWER: Final = frozenset(
    {"not_ready_to_switch_on", "switch_on_disabled", "ready_to_switch_on", "fault"}
)
"""CiA 402 power states in which a drive exerts no torque."""
AXES: Final = ("hip", "slide")
LEAVE_S: Final = 8.0
"""Time of the computer: at its end a session begins no further request to disable after it. The
last one has its answer 10 s later at most."""
NOT_ENDED: Final = "the session has not ended in order"
LEAVE_LOOKS: Final = 4
"""Looks at the newest message after each, `POLL_S` apart: it may be older than the answer."""


class SessionError(Exception):
    """The session's thread has ended by an error, which is on stderr; `left_on` has the drives."""


class Session:
    """One session of a plan; use it as a context manager. `press` and `view` never wait."""

    def __init__(self, trainer: Trainer, profile: Profile, history: History, clock: Clock) -> None:
        """Prepare a session; it begins with `with`.

        Args:
            trainer: connected, or connecting (`keep_trying`); needs the role session.
            profile: of the patient.
            history: of `open_history`. Leaving `with` does not close it.
            clock: measures the plan's times.

        A history that cannot be read is not used, and the view says so.
        """
        self._trainer, self._profile, self._clock = trainer, profile, clock
        self.left_on = ""
        """Why the drives may be on; empty after `with`: they are off, or were never enabled."""
        self._store, self._trouble = history
        self._tested_utc_ns, middles = 0, {}
        if self._store is not None:
            try:
                self._tested_utc_ns = self._store.self_test_utc_ns(profile.id)
                middles = self._store.middles(profile.id)
            except StoreError as error:
                self._store, self._trouble = None, f"{error}; this session is not kept"
        self._history_trouble = self._trouble
        self._state = begin(profile, middles, self_test_due=True)
        self._passed: set[str] = set()
        self._utc_ns = 0
        self._marks: deque[Event] = deque()
        self._buttons: deque[Button] = deque()
        self._strides: deque[Stride | NotValid] = deque()
        self._asked: list[Future[Answer]] = []
        self._writing: Future[None] | None = None
        self._has_failed = False
        self._written: list[Row] = []
        self._rows: list[Row] = []
        self._flushed_s = self._looked_s = self._now_s()
        self._late_look_count = 0
        self._seen = "", 0
        """The core's boot and the cycle of its newest messages."""
        self._silent_utc_ns: int | None = None
        """When the present silence has ended a START; None: there is none, or it has ended none."""
        self._has_begun = self._has_ended = False
        self._is_over = threading.Event()
        self._view = self._view_of(None, self._now_s())
        self._requests = ThreadPoolExecutor(2, "requests")
        self._writer = ThreadPoolExecutor(1, "history")
        self._thread = threading.Thread(target=self._run, name="session", daemon=True)

    def press(self, button: Button) -> None:
        """Press a button; one that is not among the view's does nothing."""
        self._buttons.append(button)

    def view(self) -> View:
        """Return what a display shows now.

        Raises:
            SessionError: the session's thread has ended by an error.
        """
        was_started = self._thread.ident is not None
        if was_started and not self._thread.is_alive() and not self._is_over.is_set():
            raise SessionError("the session has ended by an error, see stderr; start it again")
        return self._view

    def __enter__(self) -> Self:
        self._subscribe()
        self.left_on = NOT_ENDED
        self._thread.start()
        return self

    def _subscribe(self) -> None:
        self._safety = self._trainer.safety()
        self._events = self._trainer.events(history_count=0)
        self._events.call(self._take_event)
        self._drives: list[Stream[DriveState]] = []
        self._stride_streams: list[Stream[Stride]] = []
        self._axes = {f"{leg}/{axis}" for leg in self._profile.legs for axis in AXES}
        for leg in self._profile.legs:
            self._drives += [self._trainer.drive(f"{leg}/{axis}") for axis in AXES]
            strides = self._trainer.stride(leg)
            strides.call(self._strides.append)
            self._stride_streams.append(strides)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """End the session: disable the drives if it has enabled them, and write what is left."""
        self._is_over.set()
        self._thread.join()
        for stream in (self._safety, self._events, *self._drives, *self._stride_streams):
            stream.close()
        self._requests.shutdown()
        self._writer.shutdown()

    # --- in the session's thread ----------------------------------------------------------------

    def _run(self) -> None:
        try:
            while not self._is_over.wait(POLL_S):
                self._advance()
        finally:
            self._leave()

    def _advance(self) -> None:
        now_s = self._now_s()
        trainer, is_late = self._read(), self._is_late(now_s)
        if trainer is None and is_late and not self._buttons:
            return
        before, strides = self._state, self._new_strides()
        if before.phase is Phase.WAITING:
            age_ns = self._utc_ns - self._tested_utc_ns
            before = replace(before, self_test_due=not 0 <= age_ns <= SELF_TEST_VALID_NS)
        inputs = Inputs(
            trainer,
            self._pressed(),
            self._answer(),
            [
                StrideShare(stride.leg, valid_share(stride), works_against(stride))
                for stride in strides
            ],
        )
        after, request = step(before, inputs, now_s)
        self._state = after
        if request is not None:
            if request.kind is RequestKind.SELF_TEST:
                self._passed.clear()
            self._asked.append(self._requests.submit(self._ask, request))
        self._check_written()
        self._note(before, after, trainer, strides, now_s)
        self._view = self._view_of(trainer, now_s)

    def _is_late(self, now_s: float) -> bool:
        """Return whether this look is too late to tell a silent trainer from a late program."""
        is_late, self._looked_s = now_s - self._looked_s > LATE_LOOK_S, now_s
        self._late_look_count = self._late_look_count + 1 if is_late else 0
        return 0 < self._late_look_count <= LATE_LOOKS_MAX

    def _view_of(self, trainer: TrainerState | None, now_s: float) -> View:
        return view_of(
            self._state,
            trainer,
            now_s,
            is_kept=self._store is not None and not self._has_failed,
            history_trouble=self._trouble,
        )

    def _now_s(self) -> float:
        return self._clock.now_ns() * 1e-9

    def _read(self) -> TrainerState | None:
        safety = self._safety.newest()
        drives = [stream.newest() for stream in self._drives]
        if isinstance(safety, NotValid) or safety.mode is None or safety.verdict is None:
            return None
        known = [drive for drive in drives if not isinstance(drive, NotValid)]
        if len(known) < len(drives):
            return None
        # A message that is not fresh tells what was before: it proves nothing.
        fresh = [drive for drive in known if drive.fresh]
        are_all_fresh = len(fresh) == len(drives)
        is_open = any(drive.hand_switch_closed is not True for drive in fresh)
        self._utc_ns = safety.sample_time_ns or self._utc_ns
        before, self._seen = (
            self._seen,
            (
                safety.core_boot_id or "",
                max(drive.cycle for drive in known),
            ),
        )
        is_same_core = before[0] == self._seen[0]
        verdict = safety.verdict
        return TrainerState(
            boot_id=self._seen[0],
            mode=safety.mode,
            is_enabled=bool(safety.active),
            stage=safety.stage,
            cause=verdict.cause,
            has_power=not are_all_fresh
            or any(drive.power_state not in WITHOUT_POWER for drive in fresh),
            hand_switch_held=False if is_open else are_all_fresh or None,
            self_test_passed=self._passed >= self._axes,
            unseen_cycle_count=self._seen[1] - before[1] if is_same_core else 0,
        )

    def _take_event(self, event: Event | NotValid) -> None:
        """Take the result of a self-test, or a mark, in a thread of its stream."""
        if not isinstance(event, Event):
            return
        if event.code == EventCode.SELF_TEST_PASSED and event.subject is not None:
            self._passed.add(event.subject)
        elif event.code == EventCode.MARK:
            self._marks.append(event)

    def _pressed(self) -> Button | None:
        """Return the strongest of the buttons pressed since the last step.

        The others are dropped: a START that waits would begin a motion later.
        """
        pressed: set[Button] = set()
        while self._buttons:
            pressed.add(self._buttons.popleft())
        return next((button for button in STRONGEST_FIRST if button in pressed), None)

    def _new_strides(self) -> list[Stride]:
        strides: list[Stride] = []
        while self._strides:
            item = self._strides.popleft()
            if not isinstance(item, NotValid):
                strides.append(item)
        return strides

    # --- requests -------------------------------------------------------------------------------

    def _ask(self, request: Request) -> Answer:
        """Send a request and wait for its answer; in a thread of its own."""
        try:
            match request.kind:
                case RequestKind.ENABLE:
                    self._trainer.enable()
                case RequestKind.DISABLE:
                    self._trainer.disable()
                case RequestKind.RESET:
                    self._trainer.reset()
                case RequestKind.SELF_TEST:
                    self._trainer.mode(Mode.SELF_TEST)
                case RequestKind.GAIT:
                    self._trainer.mode(
                        Mode.GAIT,
                        cadence_hz=request.cadence_hz,
                        amplitude_ratio=request.amplitude_ratio,
                        duration_s=request.duration_s,
                        baseline=request.is_passive,
                    )
        except RequestRefusedError as error:
            return Answer(request.number, error.reply.refusal or refusal_of(Failure.NO_ANSWER))
        except ClientError as error:
            return Answer(request.number, refusal_of(Failure.NO_ANSWER, str(error)))
        return Answer(request.number)

    def _answer(self) -> Answer | None:
        for future in self._asked:
            if future.done():
                self._asked.remove(future)
                return future.result()
        return None

    def _leave(self) -> None:
        """Switch the drives off if this session has enabled them, and write what is left."""
        state, left_on = self._state, ""
        if state.phase in ACTIVE or state.off_since_s is not None:
            is_late = threading.Event()
            timer = threading.Timer(LEAVE_S, is_late.set)
            timer.start()
            is_pending = any(not future.done() for future in self._asked)
            left_on = self._switch_off(is_late)
            self._requests.shutdown()
            if is_pending:
                # An ENABLE that was under way may have been granted after that.
                left_on = self._switch_off(is_late)
            timer.cancel()
        self.left_on = left_on
        if self._has_begun and not self._has_ended:
            walked = self._block_rows(state, self._now_s()) if state.phase is Phase.WALKING else []
            silence = self._silence_rows(state, None)
            self._rows += [*walked, *silence, EndRow(self._utc_ns, "left")]
        self._rows += self._mark_rows()
        for _ in range(2):  # what is being written, then the rest
            if self._writing is not None:
                wait([self._writing])
            self._check_written()
            self._flush()

    def _switch_off(self, is_late: threading.Event) -> str:
        """Request DISABLE until the drives are off; return why they may be on, empty if not."""
        disable = Request(self._state.request_number + 1, RequestKind.DISABLE)
        english = catalogue(Reader.OPERATOR, "en")
        while True:
            refusal = self._ask(disable).refusal
            for _ in range(LEAVE_LOOKS):
                safety = self._safety.newest()
                is_silent = isinstance(safety, NotValid)
                if (is_silent and refusal is None) or (not is_silent and safety.active is False):
                    return ""
                is_late.wait(POLL_S)
            if is_late.is_set():
                return (
                    "the service says that they are on"
                    if refusal is None
                    else english.refusal(refusal)
                )

    # --- history --------------------------------------------------------------------------------

    def _note(
        self,
        before: State,
        after: State,
        trainer: TrainerState | None,
        strides: list[Stride],
        now_s: float,
    ) -> None:
        """Collect the rows of a step, and write them each `FLUSH_S` and where the phase changes."""
        is_change = after.phase is not before.phase
        is_due = is_change or now_s - self._flushed_s >= FLUSH_S
        if before.phase is Phase.WALKING:
            number = before.block_index + 1
            self._rows += [_stride_row(stride, number) for stride in strides]
            if is_due:
                self._rows += self._block_rows(before, now_s)
        if is_change:
            self._rows += self._change_rows(before, after, trainer)
        self._rows += self._mark_rows()
        if self._rows and is_due:
            self._flush()
            self._flushed_s = now_s

    def _change_rows(self, before: State, after: State, trainer: TrainerState | None) -> list[Row]:
        """Return what a change of the phase adds to the history."""
        rows: list[Row] = []
        if after.phase in ACTIVE and not self._has_begun:
            self._has_begun = True
            name = self._trainer.target.trainer
            rows.append(SessionRow(self._profile.id, name, self._utc_ns))
        if before.self_test_due and not after.self_test_due:
            self._tested_utc_ns = self._utc_ns
            rows.append(SelfTestRow(self._profile.id, self._utc_ns))
        if before.phase is Phase.NO_SIGNAL:
            rows += self._silence_rows(before, trainer)
        if before.phase in ACTIVE and after.phase is Phase.NO_SIGNAL:
            self._silent_utc_ns = self._utc_ns
        elif before.phase in ACTIVE and after.phase in INTERRUPTED_PHASES:
            refusal = after.refusal
            reason = "" if refusal is None else str(refusal.values.get("failure", refusal.code))
            if after.phase is Phase.STOPPED and trainer is not None:
                reason = trainer.cause
            elif after.why is not None:
                reason = after.why
            rows.append(InterruptionRow(self._utc_ns, after.phase, reason))
        if after.phase is Phase.FINISHED and self._has_begun and not self._has_ended:
            self._has_ended = True
            end = "complete" if after.block is None else "ended"
            rows.append(EndRow(self._utc_ns, end))
        return rows

    def _mark_rows(self) -> list[Row]:
        """Return the new marks; one from before START is of the session that it begins."""
        rows: list[Row] = []
        while self._marks:
            mark = self._marks.popleft()
            is_before = not self._has_begun
            rows.append(MarkRow(self._profile.id, mark.time_ns, mark.said, is_before))
        return rows

    def _silence_rows(self, before: State, trainer: TrainerState | None) -> list[Row]:
        """Return the row of a silence at its end, which says what it was."""
        silent_utc_ns, self._silent_utc_ns = self._silent_utc_ns, None
        if silent_utc_ns is None:
            return []
        why = Why.LATE_HERE if went_on(trainer) else Why.NO_SIGNAL
        return [InterruptionRow(silent_utc_ns, before.phase, why)]

    def _block_rows(self, state: State, now_s: float) -> list[Row]:
        """Return the present block as far as it was walked, with its goals."""
        block = state.block
        if block is None:
            return []
        number, walk, after = state.block_index + 1, block.walk, next_middles(state)
        walked_s = state.block_walked_s(now_s)
        row = BlockRow(
            number, block.kind, walk.cadence_hz, walk.amplitude_ratio, walk.duration_s, walked_s
        )
        goals = (GoalRow(number, leg.leg, leg.middle_ratio, after[leg.leg]) for leg in state.legs)
        return [row, *goals]

    def _flush(self) -> None:
        """Begin to write the rows, one batch at a time: a later one would lack its session."""
        if self._store is None:
            self._rows = []
        elif self._rows and self._writing is None:
            self._written, self._rows = self._rows, []
            self._writing = self._writer.submit(self._store.write, self._written)

    def _check_written(self) -> None:
        """Take note of a batch that is written; one that has failed is written with the next."""
        if self._writing is None or not self._writing.done():
            return
        writing, self._writing = self._writing, None
        try:
            writing.result()
            self._trouble, self._has_failed = self._history_trouble, False
        except StoreError as error:
            self._rows = self._written + self._rows
            self._trouble, self._has_failed = str(error), True


def _stride_row(stride: Stride, block: int) -> StrideRow:
    return StrideRow(
        block=block,
        leg=stride.leg,
        end_utc_ns=stride.sample_time_ns,
        duration_s=stride.duration_s,
        share_ratio=stride.share_ratio,
        share_ratio_std=stride.share_ratio_std,
        work_positive_j=stride.work_positive_j,
        work_negative_j=stride.work_negative_j,
        is_valid=valid_share(stride) is not None,
    )
