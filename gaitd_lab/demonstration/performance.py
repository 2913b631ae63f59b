"""The run of a demonstration: acts, their messages, and the display.

Time passes in turns of a tenth of a second. In simulated time the results do not depend on the
speed of this computer: requests reach the gateway before time passes, and an act sees the cycles
up to the same instant on each run.
"""

import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from gaitd_client import wire

from daemon.config.edits import Edits
from gaitd_lab.demonstration.clients import engineer_settings, shipped_settings
from gaitd_lab.demonstration.evaluation import Results, Span, Walk, evaluate, pairs
from gaitd_lab.demonstration.feed import LegTracks, Receiver, TruthTail
from gaitd_lab.demonstration.script import Scene, Situation
from gaitd_lab.demonstration.stage import Stage, stage
from gaitd_lab.demonstration.view import Moment
from gaitd_lab.processes import ServiceError, Tempo
from gaitd_lab.requests import Ask, Requests
from observer.jit import is_cached
from sim_drives.plant.truth import truth_path

CLIENT: Final = "gaitd demo"
"""Client name in the requests."""
SETTLE_S: Final = 0.3
"""Time after an act for its last messages and rows of truth."""
BEFORE: Final = Scene("the virtual drives and the service start")
COMPILING: Final = Scene(
    "the virtual drives and the service start; the first start compiles for about a minute"
)
NO_ROLES: Final[Mapping[str, str]] = MappingProxyType({})


class Act(NamedTuple):
    """An act, and what its service is like."""

    play: "Callable[[Playing], None]"
    edits: Edits = MappingProxyType({})
    roles: Mapping[str, str] = NO_ROLES
    """Role of each client, if the service has keys."""


class Performance:
    """All acts in sequence, and their results."""

    def __init__(
        self,
        trainer: Path,
        tempo: Tempo,
        show: Callable[[Moment], None],
        *,
        pages: str = "",
        engineer_port: int | None = None,
        own_pages: Path | None = None,
    ) -> None:
        """Prepare; `play` begins.

        Args:
            trainer: trainer file among the shipped configurations.
            tempo: pace of time.
            show: displays a moment; called at every turn, and may skip drawing.
            pages: where the pages are, for the live view.
            engineer_port: of the engineer's page; None: there is none.
            own_pages: folder that the engineer's server serves, too; None: it serves none.
        """
        self.trainer, self.tempo, self.engineer_port = trainer, tempo, engineer_port
        self.own_pages = own_pages
        self._show, self._pages = show, pages
        self.legs: dict[str, LegTracks] = {}
        self._spans: list[Span] = []
        self._health: list[wire.Health] = []
        self._walks: list[Walk] = []
        self._scene = _first_scene()
        self._scene_since_ns = self.now_ns = time.monotonic_ns()
        self._began_s = time.monotonic()

    def play(self, acts: Sequence[Act]) -> Results:
        """Play to the end, or to the first error; the results are evaluated in every case."""
        trouble = ""
        try:
            for act in acts:
                self._act(act)
        except ServiceError as error:
            where = f"; logs, truth and black box are in {error.folder}" if error.folder else ""
            trouble = f"{error}{where}"
        except KeyboardInterrupt:
            trouble = "interrupted"
        self._end_span()
        legs = pairs(self.legs)
        rows = evaluate(self._spans, legs)
        return Results(legs, self._spans, rows, self._health, trouble, self._walks)

    def _act(self, act: Act) -> None:
        tempo, begin_ns = self.tempo, self.now_ns
        with stage(self.trainer, act.edits, act.roles, tempo=tempo, begin_ns=begin_ns) as where:
            self.now_ns = where.time.now_ns()
            self.begin(_first_scene())
            playing = Playing(self, where)
            receiver = playing.receiver
            try:
                # The seat is given up first: the clients end in the act's time.
                with receiver.trainer, contextlib.closing(where.time):
                    playing.start_page()
                    act.play(playing)
                    time.sleep(SETTLE_S)
            finally:
                self._walks.append(Walk(receiver.strides, receiver.helps))
                if receiver.health is not None and tempo.wall_clock:
                    self._health.append(receiver.health)
                playing.close()

    def begin(self, scene: Scene) -> None:
        """Begin a scene, which ends the one before."""
        self._end_span()
        self._scene = scene

    def _end_span(self) -> None:
        span = Span(self._scene.title, self._scene.kind, self._scene_since_ns, self.now_ns)
        self._spans.append(span)
        self._scene_since_ns = self.now_ns

    def show(self, receiver: Receiver, speed_ratio: float | None) -> None:
        """Display the present moment."""
        moment = Moment(
            now_ns=self.now_ns,
            elapsed_s=time.monotonic() - self._began_s,
            scene=self._scene,
            scene_s=(self.now_ns - self._scene_since_ns) * 1e-9,
            speed_ratio=speed_ratio,
            receiver=receiver,
            legs=self.legs,
            pages=self._pages,
        )
        self._show(moment)


class Playing:
    """One act that is being played: the `Player` of its script."""

    def __init__(self, performance: Performance, where: Stage) -> None:
        """Subscribe to the service of the act."""
        self.where = where
        self._performance = performance
        self._requests = Requests(where.target, CLIENT)
        legs = {leg: performance.legs.setdefault(leg, LegTracks.new()) for leg in where.legs}
        self._tails = [
            TruthTail(truth_path(where.truth_path, leg, legs), tracks.true)
            for leg, tracks in legs.items()
        ]
        received = {leg: tracks.received for leg, tracks in legs.items()}
        self.receiver = Receiver(where.target, received, where.time)

    def start_page(self) -> None:
        """Start the engineer's page; the demonstration goes on if it ends."""
        where, port = self.where, self._performance.engineer_port
        if port is not None:
            settings = engineer_settings(
                where, port, where.credentials.get("engineer"), self._performance.own_pages
            )
            where.start_client("engineer", settings, is_needed=False)

    def turn(self) -> Situation:
        """As `Player.turn`."""
        where, performance, receiver = self.where, self._performance, self.receiver
        where.check()
        for tail in self._tails:
            tail.read()
        where.time.turn(
            partial(performance.show, receiver, where.time.speed_ratio),
            receiver.newest_ns,
            gateway_is_there=receiver.trainer.is_connected,
        )
        now_ns = performance.now_ns = where.time.now_ns()
        began_ns = now_ns if where.time.began_ns is None else where.time.began_ns
        return receiver.situation(now_ns, began_ns, *self._requests.outcome())

    def begin(self, scene: Scene) -> None:
        """As `Player.begin`."""
        self._performance.begin(scene)

    def ask(self, name: str, payload: dict[str, Any]) -> None:
        """As `Player.ask`."""
        self._requests.send(Ask(name, payload))

    def drives(self, command: str) -> None:
        """As `Player.drives`."""
        self.where.inject(command)

    def start_assist(self) -> None:
        """As `Player.start_assist`."""
        self.where.start_client("assist", shipped_settings("assist", self.where, {}))

    def close(self) -> None:
        """Close what is read; a pending answer is not waited for."""
        self._requests.close()
        for tail in self._tails:
            tail.close()


def _first_scene() -> Scene:
    """Return the scene shown until the service answers; the first start takes long."""
    return BEFORE if is_cached() else COMPILING
