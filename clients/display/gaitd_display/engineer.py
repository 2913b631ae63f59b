"""The engineer's server: role `display`, no login, loopback alone. It reads, and requests nothing.

The only query that it sends is for the configuration, which has the geometry of the mechanism.
"""

import contextlib
from collections.abc import AsyncGenerator, Callable, Coroutine
from pathlib import Path
from typing import Any, Final, NamedTuple

from gaitd_client import (
    Activity,
    Configuration,
    DriveState,
    Estimate,
    Health,
    NotValid,
    Safety,
    Stream,
    Trainer,
)
from gaitd_session.session import AXES
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp
from starlette.websockets import WebSocket

from gaitd_display.engineer_view import (
    ENGLISH,
    EngineerView,
    Memory,
    Row,
    Span,
    drive_view,
    leg_now,
    row_of,
    second_of,
    verdict_of,
)
from gaitd_display.feed import Feed
from gaitd_display.geometry import Geometry, geometry_of
from gaitd_display.messages import PATH, MessageSockets
from gaitd_display.settings import EngineerSettings
from gaitd_display.therapist_view import event_item, stride_item
from gaitd_display.truth import TruthFile
from gaitd_display.web import (
    STATIC,
    Served,
    connected,
    follow_configuration,
    json,
    live,
    make_app,
    working,
)

LEGS: Final = ("right", "left")


class _Streams(NamedTuple):
    """What is read, by leg or by drive."""

    estimates: dict[str, Stream[Estimate]]
    activities: dict[str, Stream[Activity]]
    drives: dict[str, Stream[DriveState]]
    safety: Stream[Safety]
    health: Stream[Health]


class EngineerServer:
    """Connects messages, truth, view and the memory of the last minute."""

    def __init__(
        self, settings: EngineerSettings, trainer: Trainer, utc_ahead_ns: Callable[[], int]
    ) -> None:
        """Prepare.

        Args:
            settings: of this server.
            trainer: not yet entered.
            utc_ahead_ns: UTC less monotonic time of this computer, for the truth's rows.
        """
        self._settings, self._trainer, self._utc_ahead_ns = settings, trainer, utc_ahead_ns
        self._memory = Memory(LEGS)
        self._legs: tuple[str, ...] = ()
        """Legs of the running service; empty until it has answered."""
        self._geometry: Geometry | None = None
        self._boot_id: str | None = None
        self._truths: dict[str, TruthFile] = {}
        self._streams: _Streams
        self.feed = Feed(self._view)
        self.app: ASGIApp = make_app(
            settings.web,
            Served(self._page, self._routes(), self._live),
            None,
            self._lifespan,
        )

    @contextlib.asynccontextmanager
    async def _lifespan(self, _app: Starlette) -> AsyncGenerator[None]:
        async with connected(self._trainer):
            configuration = follow_configuration(self._trainer, lambda: self._boot_id, self._use)
            works = [configuration, *self._subscribe()]
            async with working(self.feed.run(), *works):
                yield
        for truth in self._truths.values():
            truth.close()

    def _subscribe(self) -> list[Coroutine[Any, Any, None]]:
        """Make the streams; return the works that send their items."""
        trainer = self._trainer
        names = [f"{leg}/{axis}" for leg in LEGS for axis in AXES]
        self._streams = _Streams(
            {leg: trainer.estimate(leg) for leg in LEGS},
            {leg: trainer.activity(leg) for leg in LEGS},
            {name: trainer.drive(name) for name in names},
            trainer.safety(),
            trainer.health(),
        )
        return [
            *(self.feed.follow(trainer.stride(leg), stride_item) for leg in LEGS),
            self.feed.follow(trainer.events(), event_item),
        ]

    def _view(self) -> EngineerView:
        streams = self._streams
        newest = {leg: stream.newest() for leg, stream in streams.estimates.items()}
        rows = {leg: self._row(leg, estimate) for leg, estimate in newest.items()}
        spoken = [one for one in newest.values() if isinstance(one, Estimate)]
        # An estimate comes in each cycle: without one nothing of the past is shown as present.
        said = streams.safety.newest()
        safety = said if spoken and isinstance(said, Safety) and said.valid else None
        self._boot_id = spoken[0].core_boot_id if spoken else None
        time_ms = max((row.time_ms for row in rows.values() if row is not None), default=None)
        mode = spoken[0].mode if spoken else None
        verdict = verdict_of(safety)
        self._memory.add_span(Span.of(time_ms or self._memory.newest_ms, mode, verdict))
        health = streams.health.newest()
        second = None if isinstance(health, NotValid) else second_of(health)
        if second is not None:
            self._memory.add_second(second)
        legs = self._legs or tuple(leg for leg, row in rows.items() if row is not None)
        return EngineerView(
            time_ms=time_ms,
            mode=mode,
            progress=ENGLISH.progress(safety.progress) if safety else "",
            lease_holder=safety.lease_holder if safety else None,
            verdict=verdict,
            legs=tuple(leg_now(leg, rows[leg], streams.activities[leg].newest()) for leg in legs),
            drives=tuple(
                drive_view(f"{leg}/{axis}", streams.drives[f"{leg}/{axis}"].newest())
                for leg in legs
                for axis in AXES
            ),
            second=second,
            geometry=self._geometry,
            has_truth=any(row is not None and row.hip_true_nm is not None for row in rows.values()),
            truth_trouble="; ".join(one.trouble for one in self._truths.values() if one.trouble),
        )

    def _row(self, leg: str, estimate: Estimate | NotValid) -> Row | None:
        """Return the newest row of a leg, and remember it; None: the leg is silent."""
        if isinstance(estimate, NotValid):
            self._memory.add_row(leg, None)
            return None
        truth = self._truths.get(leg)
        if truth is not None:
            truth.read()
        row = row_of(estimate, truth.at(estimate.sample_time_ns) if truth else None)
        self._memory.add_row(leg, row)
        return row

    def _use(self, configuration: Configuration | None) -> None:
        """Take the configuration of the running core; None: it has not answered."""
        if configuration is None:
            self._legs, self._geometry = (), None
            return
        self._legs = tuple(leg for leg in LEGS if leg in configuration.leg_names)
        self._geometry = geometry_of(configuration.robot, configuration.limits)
        paths = truth_paths(self._settings.truth, self._legs)
        if {leg: truth.path for leg, truth in self._truths.items()} != paths:
            for truth in self._truths.values():
                truth.close()
            self._truths = {leg: TruthFile(path, self._utc_ahead_ns) for leg, path in paths.items()}

    def _routes(self) -> list[BaseRoute]:
        routes: list[BaseRoute] = [
            Route("/past.json", self._past),
            WebSocketRoute(PATH, MessageSockets(self._trainer).serve),
        ]
        if (folder := self._settings.pages) is not None:
            routes.append(Mount("/pages", StaticFiles(directory=folder, html=True)))
        return routes

    # --- pages ----------------------------------------------------------------------------------

    async def _page(self, _request: Request) -> Response:
        return HTMLResponse((STATIC / "engineer.html").read_text(encoding="utf-8"))

    async def _past(self, _request: Request) -> Response:
        return json(self._memory.past())

    async def _live(self, socket: WebSocket) -> None:
        await live(socket, self.feed)


def truth_paths(truth: Path | None, legs: tuple[str, ...]) -> dict[str, Path]:
    """Return the file of each leg, as `gaitd sim --truth` names it; with two legs one for each."""
    if truth is None:
        return {}
    if len(legs) == 1:
        return {legs[0]: truth}
    return {leg: truth.with_stem(f"{truth.stem}_{leg}") for leg in legs}
