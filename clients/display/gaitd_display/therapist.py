"""The therapist's server: role `operator`, with a login. STOP works without it."""

import asyncio
import contextlib
import secrets
from collections.abc import AsyncGenerator, Callable, Coroutine
from typing import Annotated, Any, Final

import msgspec
from gaitd_client import (
    Clock,
    Estimate,
    Mode,
    NoAnswerError,
    PlanLimits,
    Reply,
    Status,
    Trainer,
)
from gaitd_client.wire import MARK_LENGTH_MAX, ONE_LINE
from gaitd_session.session import AXES
from msgspec import Meta
from starlette.applications import Starlette
from starlette.requests import HTTPConnection, Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp
from starlette.websockets import WebSocket

from gaitd_display.controls import Command
from gaitd_display.feed import Feed
from gaitd_display.login import Attempts, Session, Sessions, read_hash
from gaitd_display.profile_form import PROFILE_MAX_BYTES, profile_form, save_profile
from gaitd_display.progress import read_progress
from gaitd_display.settings import TherapistSettings
from gaitd_display.therapist_view import (
    UNKNOWN_PLAN,
    TherapistState,
    TherapistView,
    event_item,
    leg_view,
    plan_view,
    stride_item,
)
from gaitd_display.web import (
    LOGIN_OVER,
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
from gaitd_display.words import spoken

COOKIE: Final = "__Host-gaitd"
CSRF_HEADER: Final = "x-csrf-token"
STYLES: Final = ("figure", "therapist")
PLAN_POLL_S: Final = 2.0
SESSION_POLL_S: Final = 1.0


class Wish(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Body of a button's request."""

    command: Command


class PlanWish(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Body of a request that releases a plan; null withdraws it."""

    plan: PlanLimits | None


class MarkWish(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Body of a request that writes a mark."""

    text: Annotated[str, Meta(min_length=1, max_length=MARK_LENGTH_MAX, pattern=ONE_LINE)]


Number = float | None


class ProfileWish(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Body of a request that changes the profile."""

    sha256: str
    """SHA-256 of the file that the form was filled from."""
    values: dict[str, dict[str, Number | dict[str, Number] | list[dict[str, Number]]]]
    """Those of the form; null: what was typed is no number."""


class Password(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Body of a login."""

    password: Annotated[str, Meta(min_length=1, max_length=1000)]


class SessionText(msgspec.Struct, frozen=True):
    """What the page needs of its session."""

    csrf: str
    language: str


class TherapistServer:
    """Connects messages, view, login and requests."""

    def __init__(self, settings: TherapistSettings, trainer: Trainer, clock: Clock) -> None:
        """Prepare.

        Args:
            settings: of this server.
            trainer: not yet entered.
            clock: measures attempts and sessions.

        Raises:
            PasswordError: the hash of the file cannot be used.
        """
        self._settings, self._trainer = settings, trainer
        self._hash = read_hash(settings.login.password_hash)
        self._attempts = Attempts(clock)
        self._sessions = Sessions(clock, settings.login.session_max_min)
        self._checking, self._asking = asyncio.Lock(), asyncio.Lock()
        self._reading = asyncio.Lock()
        self.state = TherapistState(secrets.token_hex(4), has_session=settings.session is not None)
        self._read: Callable[[], TherapistView]
        self._boot_id: str | None = None
        self.feed = Feed(self._view)
        self._stops = Stops(trainer)
        self.app: ASGIApp = make_app(
            settings.web,
            Served(
                self._page,
                [
                    Route("/login", self._login, methods=["POST"]),
                    Route("/logout", self._logout, methods=["POST"]),
                    Route("/session.json", self._session_text),
                    Route("/act", self._act, methods=["POST"]),
                    Route("/plan", self._plan, methods=["POST"]),
                    Route("/mark", self._mark, methods=["POST"]),
                    Route("/progress.json", self._progress),
                    Route("/profile.json", self._profile),
                    Route("/profile", self._change_profile, methods=["POST"]),
                ],
                self._live,
            ),
            self._stops,
            self._lifespan,
        )

    # --- messages -------------------------------------------------------------------------------

    @contextlib.asynccontextmanager
    async def _lifespan(self, _app: Starlette) -> AsyncGenerator[None]:
        async with connected(self._trainer):
            configuration = follow_configuration(
                self._trainer, lambda: self._boot_id, self.state.use
            )
            works = [self._follow_plan(), configuration, *self._subscribe()]
            async with working(self.feed.run(), *works):
                yield
        self._stops.close()

    def _subscribe(self) -> list[Coroutine[Any, Any, None]]:
        """Make the streams; return the works that send their items."""
        trainer, legs = self._trainer, self._settings.legs
        streams = [(leg, trainer.estimate(leg), trainer.activity(leg)) for leg in legs]
        names = [f"{leg}/{axis}" for leg in legs for axis in AXES]
        drives = {name: trainer.drive(name) for name in names}
        safety, health = trainer.safety(), trainer.health()

        def read() -> TherapistView:
            newest = [(leg, estimate.newest(), power.newest()) for leg, estimate, power in streams]
            spoken = [estimate for _, estimate, _ in newest if isinstance(estimate, Estimate)]
            self._boot_id = spoken[0].core_boot_id if spoken else None
            return self.state.view(
                tuple(leg_view(*one) for one in newest),
                safety.newest(),
                health.newest(),
                {name: drive.newest() for name, drive in drives.items()},
            )

        self._read = read
        return [
            *(self.feed.follow(trainer.stride(leg), stride_item) for leg in legs),
            self.feed.follow(trainer.events(), event_item),
        ]

    def _view(self) -> TherapistView:
        return self._read()

    async def _follow_plan(self) -> None:
        """Read the released plan, which no message has; also a plan of another operator."""
        while True:
            status = None
            if self._trainer.is_connected and self.feed.page_count:
                status = await asyncio.to_thread(self._status)
            self.state.plan = UNKNOWN_PLAN if status is None else plan_view(status.plan)
            await asyncio.sleep(PLAN_POLL_S)

    def _status(self) -> Status | None:
        try:
            return self._trainer.status()
        except NoAnswerError:
            return None

    # --- login ----------------------------------------------------------------------------------

    def _session(self, connection: HTTPConnection) -> Session | None:
        return self._sessions.of(connection.cookies.get(COOKIE))

    async def _page(self, request: Request) -> Response:
        return page("therapist" if self._session(request) else "login", *STYLES)

    async def _login(self, request: Request) -> Response:
        try:
            password = msgspec.json.decode(await small_body(request), type=Password).password
        except ValueError as error:
            return json(Answer("refused", str(error)), 400)
        async with self._checking:  # one at a time: each takes 32 MB
            if self._attempts.are_exhausted:
                return json(Answer("refused", "locked"), 429)
            self._attempts.fail()
            if not await asyncio.to_thread(self._hash.fits, password):
                return json(Answer("refused", "wrong_password"), 401)
            self._attempts.succeed()
        answer = json(Answer("done"))
        answer.set_cookie(
            COOKIE, self._sessions.begin(), path="/", secure=True, httponly=True, samesite="strict"
        )
        return answer

    async def _logout(self, request: Request) -> Response:
        if (refusal := self._refusal(request)) is not None:
            return refusal
        self._sessions.end(request.cookies.get(COOKIE))
        answer = json(Answer("done"))
        answer.delete_cookie(COOKIE, path="/", secure=True, httponly=True, samesite="strict")
        return answer

    async def _session_text(self, request: Request) -> Response:
        session = self._session(request)
        language = self._settings.language
        if session is None:
            return json(SessionText("", language))
        return json(SessionText(session.csrf, language))

    def _refusal(self, request: Request) -> Response | None:
        """Return the refusal of a request without session or CSRF token; None: it may go on."""
        session = self._session(request)
        if session is None:
            return json(Answer("refused", "login"), 401)
        given = request.headers.get(CSRF_HEADER, "").encode()
        if not secrets.compare_digest(given, session.csrf.encode()):
            return json(Answer("refused", "the request is not of the page"), 403)
        return None

    async def _live(self, socket: WebSocket) -> None:
        if self._session(socket) is None:
            await socket.accept()  # so that the page sees the code
            await socket.close(LOGIN_OVER)
            return

        async def over() -> None:
            while self._session(socket) is not None:
                await asyncio.sleep(SESSION_POLL_S)

        await live(socket, self.feed, over)

    # --- requests -------------------------------------------------------------------------------

    async def _act(self, request: Request) -> Response:
        if (refusal := self._refusal(request)) is not None:
            return refusal
        try:
            command = msgspec.json.decode(await small_body(request), type=Wish).command
        except ValueError as error:
            return json(Answer("refused", str(error)), 400)
        return await self._ask(lambda: self._request(command))

    async def _plan(self, request: Request) -> Response:
        if (refusal := self._refusal(request)) is not None:
            return refusal
        try:
            plan = msgspec.json.decode(await small_body(request), type=PlanWish).plan
        except ValueError as error:
            return json(Answer("refused", str(error)), 400)
        trainer = self._trainer
        answer = await self._ask(
            trainer.withdraw_plan if plan is None else lambda: trainer.release_plan(plan)
        )
        # Refused: as before. Not answered: it may be either.
        if answer.status_code != 409:
            self.state.plan = plan_view(plan) if answer.status_code == 200 else UNKNOWN_PLAN
        return answer

    async def _mark(self, request: Request) -> Response:
        if (refusal := self._refusal(request)) is not None:
            return refusal
        try:
            text = msgspec.json.decode(await small_body(request), type=MarkWish).text
        except ValueError as error:
            why = spoken(lambda texts: texts.text("label.mark_allowed", highest=MARK_LENGTH_MAX))
            return json(Answer("refused", str(error), why), 400)
        return await self._ask(lambda: self._trainer.mark(text))

    async def _progress(self, request: Request) -> Response:
        if self._session(request) is None:
            return json(Answer("refused", "login"), 401)
        async with self._reading:  # one at a time
            return json(await asyncio.to_thread(read_progress, self._settings.session))

    async def _profile(self, request: Request) -> Response:
        if self._session(request) is None:
            return json(Answer("refused", "login"), 401)
        async with self._reading:
            return await asyncio.to_thread(profile_form, self._settings.session)

    async def _change_profile(self, request: Request) -> Response:
        if (refusal := self._refusal(request)) is not None:
            return refusal
        try:
            body = await small_body(request, PROFILE_MAX_BYTES)
            wish = msgspec.json.decode(body, type=ProfileWish)
        except ValueError as error:
            return json(Answer("refused", str(error)), 400)
        async with self._reading:
            return await asyncio.to_thread(
                save_profile, self._settings.session, wish.sha256, wish.values
            )

    async def _ask(self, request: Callable[[], Reply]) -> Response:
        if self._asking.locked():
            return json(refused(OUTSTANDING), 409)
        async with self._asking:
            return await ask(request)

    def _request(self, command: Command) -> Reply:
        """Send the request of a button, in a thread."""
        trainer = self._trainer
        if command is Command.ENABLE:
            return trainer.enable()
        if command is Command.DISABLE:
            return trainer.disable()
        if command is Command.RESET:
            return trainer.reset()
        return trainer.mode(Mode(command))
