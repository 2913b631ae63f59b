"""The run of a demonstration: acts, their messages, and the display.

One loop runs ten times a second of simulated time: it reads new messages, requests the script's
next action, executes it, and updates the display. In simulated time its results do not depend on
the speed of this computer: requests reach the gateway before time passes, and the script receives
the cycles up to the same instant on each run.
"""

import contextlib
import time
from collections.abc import Generator, Iterator
from functools import partial
from pathlib import Path
from typing import Final, Protocol

from gaitd_client import wire

from gaitd_lab.demonstration.evaluation import Span, evaluate, pairs
from gaitd_lab.demonstration.feed import RECEIVED, TRUE, Receiver, Track, TruthTail
from gaitd_lab.demonstration.helper import helper
from gaitd_lab.demonstration.pages import PageSpot, engineer_page
from gaitd_lab.demonstration.people import People
from gaitd_lab.demonstration.picture import Results, Walk
from gaitd_lab.demonstration.script import (
    Act,
    Action,
    Ask,
    EmergencyStop,
    HandSwitch,
    Help,
    Kind,
    Patient,
    Plan,
    Press,
    Release,
    Scene,
    Situation,
    gait_act,
    paper_act,
    tiring_act,
)
from gaitd_lab.demonstration.stage import Setting, Stage, stage
from gaitd_lab.demonstration.training import (
    BLOCK_COUNT,
    Training,
    TrainingPlan,
    TrainingResult,
)
from gaitd_lab.demonstration.training_script import training_act
from gaitd_lab.demonstration.view import Moment
from gaitd_lab.processes import ManagedProcess, ServiceError, Tempo
from gaitd_lab.requests import Requests
from observer.jit import is_cached

CLIENT: Final = "gaitd demo"
"""Client name in the requests."""
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


class Performance:
    """All acts in sequence, and their results."""

    def __init__(
        self,
        configs: Path,
        plan: Plan,
        tempo: Tempo | None = None,
        engineer: PageSpot | None = None,
        training: TrainingPlan | None = None,
    ) -> None:
        """Prepare; `play` begins.

        Args:
            configs: folder of the shipped configurations.
            plan: durations of the parts.
            tempo: pace of time; None: the computer's.
            engineer: the engineer's page; None: there is none.
            training: a session is played, in place of the plan's parts; None: it is not.
        """
        self._engineer = engineer or PageSpot(None, "")
        self._training = training
        self._trained: TrainingResult | None = None
        self._people: People | None = None
        self._tempo = tempo or Tempo()
        self._configs = configs
        self._plan = plan
        self._received, self._true = Track(RECEIVED), Track(TRUE)
        self._spans: list[Span] = []
        self._health: list[wire.Health] = []
        self._walks: list[Walk] = []
        self._helper: ManagedProcess | None = None
        self._scene = _first_scene()
        self._scene_since_ns = self._now_ns = time.monotonic_ns()
        self._began_s = time.monotonic()
        self._screen: Screen

    def play(self, screen: Screen) -> Results:
        """Play to the end, or to the first error; the results are evaluated in every case.

        Args:
            screen: the display on the terminal.
        """
        self._screen = screen
        trouble = ""
        try:
            for act, setting in self._acts():
                self._act(act, setting)
        except ServiceError as error:
            where = f"; logs, truth and black box are in {error.folder}" if error.folder else ""
            trouble = f"{error}{where}"
        except KeyboardInterrupt:
            trouble = "interrupted"
        self._end_span()
        both = pairs(self._received, self._true)
        rows = evaluate(self._spans, both)
        walks = self._walks if self._plan.tiring_s > 0 else []
        return Results(both, self._spans, rows, self._health, trouble, walks, self._trained)

    def _acts(self) -> Iterator[tuple[Act, Setting]]:
        plan, training = self._plan, self._training
        if training is not None:
            yield training_act(BLOCK_COUNT, hands_on=training.hands_on), Setting.TRAINING
        elif plan.tiring_s > 0:
            for helped in (False, True):
                yield tiring_act(plan, helped=helped), Setting.PATIENT
        else:
            yield gait_act(plan), Setting.PATIENT
            if plan.paper_s > 0:
                yield paper_act(plan), Setting.EMPTY

    def _act(self, act: Act, setting: Setting) -> None:
        with stage(self._configs, setting, tempo=self._tempo, begin_ns=self._now_ns) as where:
            tail = TruthTail(where.truth_path, self._true)
            requests = Requests(where.target, CLIENT)
            receiver = Receiver(where.target, where.leg, self._received, where.time)
            self._look_at(where)
            self._begin_scene(_first_scene())
            engineer = engineer_page(where, self._engineer.port, where.credentials.get("engineer"))
            try:
                # The seat is given up first: the pages end in the act's time.
                with receiver, engineer, self._at_pages(where), contextlib.closing(where.time):
                    self._turns(act, where, receiver, tail, requests)
            except ServiceError as error:
                if stopped := where.stopped():
                    raise ServiceError(f"{error}; {', '.join(stopped)}") from error
                raise
            finally:
                if self._helper is not None:
                    self._helper.end()
                    self._helper = None
                self._walks.append(Walk(receiver.strides, receiver.helps))
                if receiver.health is not None and self._tempo.wall_clock:
                    self._health.append(receiver.health)
                requests.close()
                tail.read()
                tail.close()

    @contextlib.contextmanager
    def _at_pages(self, where: Stage) -> Generator[None]:
        """Serve the pages of a training inside the context; then read what it has been."""
        if self._training is None:
            yield
            return
        training = Training(where, self._training)
        try:
            with training.people() as self._people:
                yield
        finally:
            self._people = None
            self._trained = training.result()

    def _turns(
        self, act: Act, where: Stage, receiver: Receiver, tail: TruthTail, requests: Requests
    ) -> None:
        action = next(act)
        over = False
        while not over:
            self._do(action, where, requests)
            where.check()
            for beside in (self._helper, self._people):
                if beside is not None:
                    beside.check()
            receiver.connect()
            tail.read()
            shown = partial(self._screen.show, self._moment(receiver, where))
            where.time.turn(shown, gateway_is_there=receiver.is_connected)
            self._look_at(where)
            receiver.catch_up(self._now_ns)
            began_ns = where.time.began_ns or self._now_ns
            asked = requests if self._people is None else self._people
            now = receiver.situation(self._now_ns, began_ns, *asked.outcome())
            if self._people is not None:
                now = now._replace(seen=self._people.seen)
            action, over = _next(act, now)
        time.sleep(SETTLE_S)

    def _look_at(self, where: Stage) -> None:
        self._now_ns = where.time.now_ns()

    def _do(self, action: Action, where: Stage, requests: Requests) -> None:
        if isinstance(action, Ask):
            requests.send(action)
        elif isinstance(action, HandSwitch):
            where.inject("clear hand_switch_open *" if action.is_held else "hand_switch_open *")
        elif isinstance(action, EmergencyStop):
            where.inject("sto_open *" if action.is_pressed else "clear sto_open *")
        elif isinstance(action, Press) and self._people is not None:
            self._people.press(action.button)
        elif isinstance(action, Release) and self._people is not None:
            self._people.release()
        elif isinstance(action, Patient):
            where.inject(f"patient {action.programme}")
        elif isinstance(action, Help):
            self._helper = helper(where.target, where.channel, where.folder)
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

    def _moment(self, receiver: Receiver, where: Stage) -> Moment:
        return Moment(
            now_ns=self._now_ns,
            elapsed_s=time.monotonic() - self._began_s,
            scene=self._scene,
            scene_s=(self._now_ns - self._scene_since_ns) * 1e-9,
            speed_ratio=where.time.speed_ratio,
            receiver=receiver,
            received=self._received,
            true=self._true,
            pages=self._engineer.shown if self._training is None else self._training.shown,
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
