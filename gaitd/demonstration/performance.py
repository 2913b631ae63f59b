"""The performance: acts on their stages, messages to the audience, pictures on the screen.

One loop looks around ten times a second: read what came, ask the script what to do, do it, show.
Requests to the service run in a thread of their own, because an answer may take seconds.
"""

import json
import shutil
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Final, Protocol

from daemon import wire
from gaitd.demonstration.feed import HEARD, TRUE, Audience, Track, TruthTail
from gaitd.demonstration.judgement import Span, judge, pairs, within
from gaitd.demonstration.picture import Results
from gaitd.demonstration.script import (
    Act,
    ActError,
    Action,
    Ask,
    Kind,
    Patient,
    Plan,
    Scene,
    Situation,
    gait_act,
    paper_act,
)
from gaitd.demonstration.stage import Stage, stage
from gaitd.demonstration.view import Moment
from gaitd.remote import Answer, Target, ask

TURN_S: Final = 0.1
REPEATS_MAX: Final = 2
SETTLE_S: Final = 0.3
"""After an act: the last messages and rows of truth are on their way."""
BEFORE: Final = Scene("the virtual drives and the service start", Kind.INTERLUDE)


class Screen(Protocol):
    """Where a performance is shown."""

    def show(self, moment: Moment) -> None:
        """Called at every turn; draws as often as it likes."""
        ...

    def scene(self, scene: Scene) -> None:
        """A scene begins."""
        ...

    def say(self, words: str) -> None:
        """Something that a person should know now; it is also in the results."""
        ...


class Outstanding:
    """At most one request to the service, asked in a thread."""

    def __init__(self, target: Target, client: str = "gaitd demo") -> None:
        """Nothing is asked yet; `client` is the name that the service hears."""
        self._target = target
        self._client = client
        self._thread = ThreadPoolExecutor(max_workers=1)
        self._answer: Future[Answer] | None = None

    def ask(self, request: Ask) -> None:
        """Ask; the outcome of an earlier request is forgotten."""
        payload = {"client": self._client, **request.payload}
        self._answer = self._thread.submit(ask, self._target, request.name, payload)

    def outcome(self) -> tuple[str | None, str]:
        """Outcome and reason; None while nobody has answered."""
        if self._answer is None or not self._answer.done():
            return None, ""
        answer = self._answer.result()
        if answer.text is None:
            return "unanswered", answer.trouble
        reply = json.loads(answer.text)
        return reply.get("outcome", "refused"), reply.get("reason", "")

    def close(self) -> None:
        """Wait for an answer that is still coming, at most as long as `ask` itself does."""
        self._thread.shutdown(cancel_futures=True)


class Performance:
    """All acts, one after the other, and what they leave."""

    def __init__(self, configs: Path, plan: Plan, screen: Screen) -> None:
        """Prepare; `play` begins."""
        self._configs = configs
        self._plan = plan
        self._screen = screen
        self._heard, self._true = Track(HEARD), Track(TRUE)
        self._spans: list[Span] = []
        self._health: list[wire.Health] = []
        self._repeats: list[str] = []
        self._scene, self._scene_since_s = BEFORE, time.monotonic()
        self._began_s = time.monotonic()

    def play(self) -> Results:
        """Play to the end, or to the first trouble; whatever happened, the results are judged."""
        trouble = ""
        try:
            self._act_or_again(gait_act, empty=False)
            if self._plan.paper_s > 0:
                self._act_or_again(paper_act, empty=True)
        except ActError as error:
            trouble = _words(error)
        except KeyboardInterrupt:
            trouble = "interrupted"
        self._end_span()
        both = within(pairs(self._heard, self._true), self._spans)
        rows = judge(self._spans, both)
        return Results(both, self._spans, rows, self._health, trouble, tuple(self._repeats))

    def _act_or_again(self, act: Callable[[Plan], Act], *, empty: bool) -> None:
        """Play an act; again if this machine, and not the service, was too slow for it.

        The virtual drives are a process among others. When they or the core are not let run for
        longer than the service may wait for a drive, it stops, as it must.
        """
        while True:
            before, health = len(self._spans), len(self._health)
            try:
                self._act(act(self._plan), empty=empty)
            except ActError as error:
                if not error.held_up or len(self._repeats) >= REPEATS_MAX:
                    raise
                self._scene, self._scene_since_s = BEFORE, time.monotonic()
                del self._spans[before:], self._health[health:]
                self._repeats.append(
                    f"this computer stood still ({', '.join(error.held_up)}); "
                    f"the act is played again ({error})"
                )
                if error.folder is not None:
                    shutil.rmtree(error.folder, ignore_errors=True)
                self._screen.say(self._repeats[-1])
            else:
                return

    def _act(self, act: Act, *, empty: bool) -> None:
        self._begin_scene(BEFORE)
        with stage(self._configs, empty=empty) as where:
            tail = TruthTail(where.truth, self._true)
            outstanding = Outstanding(where.target)
            audience = Audience(where.target, where.leg, self._heard)
            try:
                with audience, where.excused():
                    self._turns(act, where, audience, tail, outstanding)
            finally:
                if audience.health is not None:
                    self._health.append(audience.health)
                outstanding.close()
                tail.read()
                tail.close()

    def _turns(
        self, act: Act, where: Stage, audience: Audience, tail: TruthTail, outstanding: Outstanding
    ) -> None:
        action = next(act)
        settled_s: float | None = None
        while settled_s is None or time.monotonic() < settled_s:
            self._do(action, where, outstanding)
            action = None
            where.check()
            audience.connect()
            tail.read()
            self._screen.show(self._moment(audience))
            time.sleep(TURN_S)
            if settled_s is None:
                now = audience.situation(time.monotonic(), *outstanding.outcome())
                action, over = _next(act, now)
                settled_s = time.monotonic() + SETTLE_S if over else None

    def _do(self, action: Action, where: Stage, outstanding: Outstanding) -> None:
        if isinstance(action, Ask):
            outstanding.ask(action)
        elif isinstance(action, Patient):
            where.patient(action.programme)
        elif isinstance(action, Scene):
            self._begin_scene(action)

    def _begin_scene(self, scene: Scene) -> None:
        self._end_span()
        self._scene, self._scene_since_s = scene, time.monotonic()
        self._screen.scene(scene)

    def _end_span(self) -> None:
        begin_ns, end_ns = round(self._scene_since_s * 1e9), time.monotonic_ns()
        self._spans.append(Span(self._scene.title, self._scene.kind, begin_ns, end_ns))
        self._scene_since_s = time.monotonic()

    def _moment(self, audience: Audience) -> Moment:
        now_s = time.monotonic()
        return Moment(
            now_ns=round(now_s * 1e9),
            elapsed_s=now_s - self._began_s,
            scene=self._scene,
            scene_s=now_s - self._scene_since_s,
            audience=audience,
            heard=self._heard,
            true=self._true,
        )


def _words(error: ActError) -> str:
    how = f"; this computer stood still: {', '.join(error.held_up)}" if error.held_up else ""
    where = f"; logs, truth and black box are in {error.folder}" if error.folder else ""
    return f"{error}{how}{where}"


def _next(act: Act, now: Situation) -> tuple[Action, bool]:
    """The act's next action, and whether it is over."""
    try:
        return act.send(now), False
    except StopIteration:
        return None, True
