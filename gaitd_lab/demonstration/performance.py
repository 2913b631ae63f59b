"""The run of a demonstration: acts, their messages, and the display.

One loop runs ten times a second of simulated time: it reads new messages, requests the script's
next action, executes it, and updates the display. In simulated time its results do not depend on
the speed of this computer: requests reach the gateway before time passes, and the script receives
the cycles up to the same instant on each run.
"""

import json
import threading
import time
from pathlib import Path
from typing import Final, Protocol

import zenoh

from daemon import wire
from gaitd.remote import ANSWER_TIMEOUT_S, Target, open_client
from gaitd_lab.demonstration.feed import HEARD, TRUE, Audience, Track, TruthTail
from gaitd_lab.demonstration.judgement import Span, judge, pairs
from gaitd_lab.demonstration.picture import Results
from gaitd_lab.demonstration.script import (
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
from gaitd_lab.demonstration.stage import Stage, Tempo, stage
from gaitd_lab.demonstration.view import Moment
from observer.jit import is_cached

CLIENT: Final = "gaitd demo"
"""Client name in the requests."""
TAKEN_WITHIN_S: Final = 2.0
SETTLE_S: Final = 0.3
"""Time after an act for its last messages and rows of truth."""
BEFORE: Final = Scene("the virtual drives and the service start", Kind.INTERLUDE)
COMPILING: Final = Scene(
    "the virtual drives and the service start; the first start compiles for about a minute",
    Kind.INTERLUDE,
)


class Screen(Protocol):
    """The display of a demonstration."""

    def show(self, moment: Moment) -> None:
        """Called at every turn; may skip drawing."""
        ...

    def scene(self, scene: Scene) -> None:
        """Begin a scene."""
        ...


class Requests:
    """At most one pending request to the service, over a session of its own."""

    def __init__(self, target: Target) -> None:
        """Start without a request."""
        self._target = target
        self._session: zenoh.Session | None = None
        self._replies: list[str] = []
        self._is_answered = threading.Event()

    def ask(self, request: Ask) -> None:
        """Send a request; the outcome of an earlier one is dropped.

        The gateway has the request when this returns: it processes queries in order, and two later
        ones have been answered. The core therefore takes it with the next cycle, on each run.

        Raises:
            ActError: the service refuses the session.
        """
        replies: list[str] = []
        is_answered = threading.Event()
        self._replies, self._is_answered = replies, is_answered

        def take(reply: zenoh.Reply) -> None:
            sample = reply.ok or reply.err
            if sample is not None and str(sample.encoding).startswith("application/json"):
                replies.append(sample.payload.to_string())

        session = self._opened()
        session.get(
            self._key(request.name),
            zenoh.handlers.Callback(take, is_answered.set),
            payload=json.dumps({"client": CLIENT, **request.payload}),
            timeout=ANSWER_TIMEOUT_S,
        )
        for _ in range(2):
            for _reply in session.get(self._key("status"), timeout=TAKEN_WITHIN_S):
                pass

    def outcome(self) -> tuple[str | None, str]:
        """Return outcome and reason; None until the answer."""
        if not self._is_answered.is_set():
            return None, ""
        if not self._replies:
            return "unanswered", "another trainer, or it hangs"
        reply = json.loads(self._replies[0])
        return reply.get("outcome", "refused"), reply.get("reason", "")

    def close(self) -> None:
        """Close the session; a pending answer is not waited for."""
        if self._session is not None:
            self._session.close()

    def _key(self, name: str) -> str:
        return wire.key(self._target.trainer, wire.CONTROL, name)

    def _opened(self) -> zenoh.Session:
        if self._session is None:
            self._session = open_client(self._target.endpoints)
        if self._session is None:
            raise ActError("the service does not accept a client any more")
        return self._session


class Performance:
    """All acts in sequence, and their results."""

    def __init__(
        self, configs: Path, plan: Plan, screen: Screen, tempo: Tempo | None = None
    ) -> None:
        """Prepare; `play` begins."""
        self._tempo = tempo or Tempo()
        self._configs = configs
        self._plan = plan
        self._screen = screen
        self._heard, self._true = Track(HEARD), Track(TRUE)
        self._spans: list[Span] = []
        self._health: list[wire.Health] = []
        self._scene = _first_scene()
        self._scene_since_ns = self._now_ns = time.monotonic_ns()
        self._began_s = time.monotonic()

    def play(self) -> Results:
        """Play to the end, or to the first error; the results are evaluated in every case."""
        trouble = ""
        try:
            self._act(gait_act(self._plan), empty=False)
            if self._plan.paper_s > 0:
                self._act(paper_act(self._plan), empty=True)
        except ActError as error:
            where = f"; logs, truth and black box are in {error.folder}" if error.folder else ""
            trouble = f"{error}{where}"
        except KeyboardInterrupt:
            trouble = "interrupted"
        self._end_span()
        both = pairs(self._heard, self._true)
        rows = judge(self._spans, both)
        return Results(both, self._spans, rows, self._health, trouble)

    def _act(self, act: Act, *, empty: bool) -> None:
        with stage(self._configs, empty=empty, tempo=self._tempo, begin_ns=self._now_ns) as where:
            tail = TruthTail(where.truth, self._true)
            outstanding = Requests(where.target)
            audience = Audience(where.target, where.leg, self._heard, where.time)
            self._look_at(where)
            self._begin_scene(_first_scene())
            try:
                with audience:
                    self._turns(act, where, audience, tail, outstanding)
            except ActError as error:
                if stopped := where.stopped():
                    raise ActError(f"{error}; {', '.join(stopped)}") from error
                raise
            finally:
                if audience.health is not None and self._tempo.wall_clock:
                    self._health.append(audience.health)
                outstanding.close()
                tail.read()
                tail.close()

    def _turns(
        self, act: Act, where: Stage, audience: Audience, tail: TruthTail, outstanding: Requests
    ) -> None:
        action = next(act)
        over = False
        while not over:
            self._do(action, where, outstanding)
            where.check()
            audience.connect()
            tail.read()
            self._screen.show(self._moment(audience, where))
            where.time.turn(gateway_is_there=audience.is_connected)
            self._look_at(where)
            audience.catch_up(self._now_ns)
            now = audience.situation(
                self._now_ns, where.time.began_ns or self._now_ns, *outstanding.outcome()
            )
            action, over = _next(act, now)
        time.sleep(SETTLE_S)

    def _look_at(self, where: Stage) -> None:
        self._now_ns = where.time.now_ns()

    def _do(self, action: Action, where: Stage, outstanding: Requests) -> None:
        if isinstance(action, Ask):
            outstanding.ask(action)
        elif isinstance(action, Patient):
            where.patient(action.programme)
        elif isinstance(action, Scene):
            self._begin_scene(action)

    def _begin_scene(self, scene: Scene) -> None:
        self._end_span()
        self._scene = scene
        self._screen.scene(scene)

    def _end_span(self) -> None:
        span = Span(self._scene.title, self._scene.kind, self._scene_since_ns, self._now_ns)
        self._spans.append(span)
        self._scene_since_ns = self._now_ns

    def _moment(self, audience: Audience, where: Stage) -> Moment:
        return Moment(
            now_ns=self._now_ns,
            elapsed_s=time.monotonic() - self._began_s,
            scene=self._scene,
            scene_s=(self._now_ns - self._scene_since_ns) * 1e-9,
            speed_ratio=where.time.speed_ratio,
            audience=audience,
            heard=self._heard,
            true=self._true,
        )


def _first_scene() -> Scene:
    """Return the scene shown until the service answers; the first start takes long."""
    return BEFORE if is_cached() else COMPILING


def _next(act: Act, now: Situation) -> tuple[Action, bool]:
    """Return the act's next action, and whether the act is over."""
    try:
        return act.send(now), False
    except StopIteration:
        return None, True
