"""The patient's server: role `session`, no login. It listens on loopback for the screen beside it.

Beyond loopback it shows the page and stops; the way out is offered on the machine's own screen
only, because without login everyone who reaches the page could press its buttons.
"""

import asyncio
import contextlib
import secrets
from collections.abc import AsyncGenerator, Callable, Coroutine, Iterable, Mapping
from typing import Any, Final

import msgspec
from gaitd_client import (
    Clock,
    Event,
    NotValid,
    Reply,
    Stream,
    Stride,
    Trainer,
)
from gaitd_session import Button
from gaitd_session.machine import ANNOUNCE_S
from gaitd_session.session import AXES
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp
from starlette.websockets import WebSocket

from gaitd_display.feed import Feed
from gaitd_display.patient_view import PatientState, PatientView
from gaitd_display.scenes import Now, Scene, scene_of
from gaitd_display.settings import FAR_RATIO, TEXT_MAX_RATIO, Page, PatientSettings
from gaitd_display.training import Training
from gaitd_display.way_out import Action
from gaitd_display.web import (
    OUTSTANDING,
    Answer,
    Served,
    Stops,
    ask,
    connected,
    follow_configuration,
    json,
    live,
    make_app,
    page,
    refused,
    small_body,
    working,
)
from gaitd_display.words import Word

SETTLED_NS: Final = 1_500_000_000
"""So long a button that begins something is not yet offered, where what it begins has changed."""
PROFILE_POLL_S: Final = 2.0
NOT_OFFERED: Final = "not_offered"


class Wish(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Body of a button's request."""

    action: Action


class PageText(msgspec.Struct, frozen=True, kw_only=True):
    """What the page needs once."""

    page: Page
    diagonal_mm: float
    """Diagonal of the configured screen."""
    far_mm: float
    """Least size of text that has to be read from the chair."""
    far_ratio: float
    """Size of that text before it is enlarged; see `FAR_RATIO`."""
    text_max_ratio: float
    announce_s: float
    """So long motion is announced."""
    losses: Mapping[Word, Scene]
    """What is said where the server cannot say it."""


class Press(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Body of a button of the session."""

    button: Button


class Offers:
    """What a press would begin, as long as it has been offered for `SETTLED_NS`.

    A second tap on a button must not be a press of what the page offers next.
    """

    def __init__(self, clock: Clock) -> None:
        """Start without an offer."""
        self._clock = clock
        self._since_ns: dict[str, int] = {}

    def settled(self, offers: Iterable[str]) -> frozenset[str]:
        """Take the present offers; return those that stand for long enough."""
        now_ns = self._clock.now_ns()
        self._since_ns = {offer: self._since_ns.get(offer, now_ns) for offer in offers}
        return frozenset(
            offer for offer, since_ns in self._since_ns.items() if now_ns - since_ns >= SETTLED_NS
        )


async def _follow_profile(training: Training) -> None:
    """Take a changed profile, which the therapist's page may have written, before a session."""
    while True:
        await asyncio.sleep(PROFILE_POLL_S)
        await asyncio.to_thread(training.refresh)


class PatientServer:
    """Connects messages, view and requests."""

    def __init__(self, settings: PatientSettings, trainer: Trainer, clock: Clock) -> None:
        """Prepare.

        Args:
            settings: of this server.
            trainer: not yet entered.
            clock: measures the times of the session.

        Raises:
            ConfigError: the check of the way out, or the profile of the session, cannot be used.
        """
        self._settings, self._trainer = settings, trainer
        self.state = PatientState(settings, secrets.token_hex(4))
        self.feed = Feed(self._view)
        self._stops = Stops(trainer)
        self._training: Training | None = None
        if settings.session is not None:
            self._training = Training(settings.session, trainer, clock)
        self._read: Callable[[], PatientView]
        self._offers = Offers(clock)
        self._action: Action | None = None
        self._buttons: tuple[Button, ...] = ()
        self._asking = asyncio.Lock()
        self.app: ASGIApp = make_app(
            settings.web,
            Served(
                self._page,
                [
                    Route("/page.json", self._page_text),
                    Route("/act", self._act, methods=["POST"]),
                    Route("/session", self._press, methods=["POST"]),
                ],
                self._live,
            ),
            self._stops,
            self._lifespan,
        )

    @contextlib.asynccontextmanager
    async def _lifespan(self, _app: Starlette) -> AsyncGenerator[None]:
        async with connected(self._trainer):
            configuration = follow_configuration(
                self._trainer, lambda: self.state.boot_id, self.state.use
            )
            works = [configuration, *self._subscribe()]
            async with working(self.feed.run(), *works), self._trained():
                yield
        self._stops.close()

    @contextlib.asynccontextmanager
    async def _trained(self) -> AsyncGenerator[None]:
        """Run the session, if there is one; at its end it switches off what it has switched on."""
        if self._training is None:
            yield
            return
        training = self._training
        await asyncio.to_thread(training.begin)
        try:
            async with working(_follow_profile(training)):
                yield
        finally:
            await asyncio.to_thread(self._training.end)

    def _subscribe(self) -> list[Coroutine[Any, Any, None]]:
        """Make the streams; return the works that send their items."""
        trainer = self._trainer
        legs = [leg.name for leg in self._settings.leg]
        activities = {leg: trainer.activity(leg) for leg in legs}
        drives = [trainer.drive(f"{leg}/{axis}") for leg in legs for axis in AXES]
        safety = trainer.safety()

        def read() -> PatientView:
            newest = safety.newest()
            mode = None if isinstance(newest, NotValid) else newest.mode
            return self.state.take(
                [(leg, stream.newest()) for leg, stream in activities.items()],
                newest,
                [stream.newest() for stream in drives],
                None if self._training is None else self._training.view(mode),
            )

        self._read = read
        return [
            *(self._follow_strides(trainer.stride(leg)) for leg in legs),
            self._follow_events(trainer.events()),
        ]

    async def _follow_strides(self, strides: Stream[Stride]) -> None:
        async for stride in strides:
            if not isinstance(stride, NotValid):
                self.state.take_stride(stride)

    async def _follow_events(self, events: Stream[Event]) -> None:
        async for event in events:
            if not isinstance(event, NotValid):
                self.state.take_event(event)

    def _view(self) -> PatientView:
        view = self._read()
        training = view.training
        buttons = () if training is None or view.mode is None else training.buttons
        begins = [view.action, *(one for one in buttons if one is Button.START)]
        settled = self._offers.settled(offer for offer in begins if offer is not None)
        self._action = view.action if view.action in settled else None
        self._buttons = tuple(one for one in buttons if one is not Button.START or one in settled)
        if training is not None:
            training = msgspec.structs.replace(training, buttons=self._buttons)
        return msgspec.structs.replace(view, action=self._action, training=training)

    async def _page(self, _request: Request) -> Response:
        return page("patient", "figure", "patient", is_stop_first=True)

    async def _page_text(self, _request: Request) -> Response:
        settings = self._settings
        losses = (Word.NO_CONNECTION, Word.TOO_MANY_PAGES)
        return json(
            PageText(
                page=settings.page,
                diagonal_mm=settings.screen.diagonal_mm,
                far_mm=settings.screen.far_mm,
                far_ratio=FAR_RATIO,
                text_max_ratio=TEXT_MAX_RATIO,
                announce_s=ANNOUNCE_S,
                losses={word: scene_of(Now(word, None)) for word in losses},
            )
        )

    async def _live(self, socket: WebSocket) -> None:
        await live(socket, self.feed)

    async def _act(self, request: Request) -> Response:
        try:
            action = msgspec.json.decode(await small_body(request), type=Wish).action
        except ValueError as error:
            return json(Answer("refused", str(error)), 400)
        if action != self._action:
            return json(Answer("refused", NOT_OFFERED), 409)
        if self._asking.locked():
            return json(refused(OUTSTANDING), 409)
        async with self._asking:
            return await ask(lambda: self._request(action))

    async def _press(self, request: Request) -> Response:
        try:
            button = msgspec.json.decode(await small_body(request), type=Press).button
        except ValueError as error:
            return json(Answer("refused", str(error)), 400)
        if self._training is None or button not in self._buttons:
            return json(Answer("refused", NOT_OFFERED), 409)
        if button is not Button.START:
            # What ends a motion waits for nothing.
            await asyncio.to_thread(self._training.press, button)
            return json(Answer("done"))
        if self._asking.locked():
            return json(refused(OUTSTANDING), 409)
        async with self._asking:
            await asyncio.to_thread(self._training.press, button)
        return json(Answer("done"))

    def _request(self, action: Action) -> Reply:
        """Send the request of a button, in a thread."""
        trainer = self._trainer
        if action is Action.RESET:
            self.state.way_out.reset_is_asked()
            try:
                return trainer.reset()
            finally:
                self.state.way_out.reset_is_answered()
        if action is Action.ENABLE:
            return trainer.enable()
        return trainer.mode(action)
