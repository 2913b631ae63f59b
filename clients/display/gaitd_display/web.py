"""What the servers share: headers, origin, the WebSocket of a page, STOP, and the run.

Every answer has a content security policy that allows nothing but this server's own files. A
request that changes something needs an `Origin` of this server: a page of another site in the same
browser cannot stop or release a leg. STOP needs no login.
"""

import asyncio
import contextlib
import functools
import signal
import socket
from collections.abc import AsyncGenerator, Awaitable, Callable, Coroutine, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from types import FrameType
from typing import Any, Final, NamedTuple

import anyio
import msgspec
import uvicorn
from gaitd_client import (
    ClientError,
    Configuration,
    NoAnswerError,
    Reply,
    RequestRefusedError,
    Trainer,
)
from gaitd_client.wire import Refusal
from gaitd_names import ExitCode, RefusalCode
from gaitd_program import CommandError
from starlette.applications import Starlette
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect, Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from gaitd_display.connections import STOP_PATH, WAIT_S, Connections
from gaitd_display.feed import Feed, PageQueue, TooManyPagesError
from gaitd_display.messages import PATH as MESSAGES_PATH
from gaitd_display.messages import TRY_LATER
from gaitd_display.settings import Web
from gaitd_display.words import Spoken, page_texts, spoken

STATIC: Final = Path(__file__).resolve().parent / "static"
FRAME: Final = ("tokens", "frame")
"""Style sheets of each page with STOP."""
BODY_MAX_BYTES: Final = 4096
STOPS_MAX: Final = 8
"""Stops that may wait for their answer; each has a thread, so that no other request delays one."""
CONFIGURATION_POLL_S: Final = 1.0
PING_S: Final = 2.0
BACKLOG: Final = 128
"""Connections that may wait to be accepted."""
GOING_AWAY: Final = 1001
FORBIDDEN: Final = 4403
LOGIN_OVER: Final = 4401
"""Codes with which a WebSocket is closed; common.js reads them."""
OUTSTANDING: Final = Refusal(code=RefusalCode.ANSWER_OUTSTANDING, subject=None, values={}, said="")
FORBIDDEN_ORIGIN: Final = "forbidden: the page is not of this server"
HEADERS: Final[Mapping[str, str]] = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
        "font-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'self'; "
        "frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
    "Cache-Control": "no-store",
}


class Answer(msgspec.Struct, frozen=True):
    """Answer to a button."""

    outcome: str
    """done, refused, or no_answer: the outcome is unknown."""
    reason: str = ""
    """A code, or what a library has said."""
    said: Spoken | None = None
    """Why it is refused, for the operator; None: the code says all."""


class Guard:
    """Refuses other hosts and origins before anything else, and adds the headers."""

    def __init__(self, app: ASGIApp, web: Web) -> None:
        """Guard the application."""
        self._app, self._origins = app, web.allowed_origins
        self._hosts = {origin.partition("://")[2] for origin in self._origins}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle a connection."""
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(HEADERS)
            await send(message)

        if self._is_ours(scope):
            await self._app(scope, receive, with_headers)
        elif scope["type"] == "http":
            refusal = PlainTextResponse(FORBIDDEN_ORIGIN, 403)
            await refusal(scope, receive, with_headers)
        else:
            # Refused before it is accepted: the browser gets 403.
            await WebSocket(scope, receive, send).close(FORBIDDEN)

    def _is_ours(self, scope: Scope) -> bool:
        headers = Headers(scope=scope)
        if headers.get("host") not in self._hosts:
            return False  # also what another name for this address would allow (DNS rebinding)
        is_reading = scope["type"] == "http" and scope["method"] in {"GET", "HEAD"}
        # A browser always names the origin of a WebSocket. What names none is a program, and may
        # read messages.
        is_program = scope["path"] == MESSAGES_PATH and "origin" not in headers
        return is_reading or is_program or headers.get("origin") in self._origins


async def small_body(request: Request, most_bytes: int = BODY_MAX_BYTES) -> bytes:
    """Return the body of a request.

    Raises:
        ValueError: it is longer than any of ours, or does not come.
    """
    body = b""
    try:
        async with asyncio.timeout(WAIT_S):
            async for part in request.stream():
                body += part
                if len(body) > most_bytes:
                    raise ValueError(f"more than {most_bytes} bytes")
    except TimeoutError as error:
        raise ValueError(f"not complete after {WAIT_S:g} s") from error
    return body


def page(name: str, *styles: str, is_stop_first: bool = False) -> Response:
    """Return a page: its own part in the frame of all pages, which has STOP.

    Args:
        name: of `NAME.html`, its own part, and of `NAME.js`.
        styles: of each `STYLE.css`, after those of all pages with STOP.
        is_stop_first: STOP and its neighbours come before the own part for the keyboard.
    """
    frame, body = (
        (STATIC / f"{part}.html").read_text(encoding="utf-8") for part in ("frame", name)
    )
    links = "\n".join(
        f'<link rel="stylesheet" href="/static/{style}.css">' for style in (*FRAME, *styles)
    )
    above, below = ("", body) if is_stop_first else (body, "")
    values = (("styles", links), ("name", name), ("above", above), ("below", below))
    for key, value in values:
        frame = frame.replace(f"{{{{{key}}}}}", value)
    return HTMLResponse(frame)


def json(answer: msgspec.Struct | Mapping[str, Any], status: int = 200) -> Response:
    """Return a response with JSON."""
    return Response(msgspec.json.encode(answer), status, media_type="application/json")


async def ask(request: Callable[[], Reply], threads: Executor | None = None) -> Response:
    """Send a request to the service in a thread; return its outcome.

    Args:
        request: sends it and waits.
        threads: where; None: those of the loop.
    """
    loop = asyncio.get_running_loop()
    try:
        reply = await loop.run_in_executor(threads, request)
    except RequestRefusedError as error:
        return json(refused(error.reply.refusal), 409)
    except ClientError as error:
        return json(Answer("no_answer", str(error)), 504)
    return json(Answer(str(reply.outcome)))


def refused(refusal: Refusal | None) -> Answer:
    """Return the answer that a request is refused."""
    if refusal is None:
        return Answer("refused")
    return Answer("refused", refusal.code, spoken(lambda texts: texts.refusal(refusal)))


class Stops:
    """STOP of all pages, in threads of its own."""

    def __init__(self, trainer: Trainer) -> None:
        """Use the trainer."""
        self._trainer = trainer
        self._threads = ThreadPoolExecutor(STOPS_MAX, thread_name_prefix="stop")
        self._waiting_count = 0

    async def stop(self, _request: Request) -> Response:
        """Stop now."""
        if self._waiting_count >= STOPS_MAX:
            return json(Answer("no_answer", f"{STOPS_MAX} stops wait for their answer"), 504)
        self._waiting_count += 1
        try:
            return await ask(self._trainer.stop, self._threads)
        finally:
            self._waiting_count -= 1

    def close(self) -> None:
        """End the threads."""
        self._threads.shutdown(wait=False, cancel_futures=True)


async def live(
    socket: WebSocket, feed: Feed, until: Callable[[], Awaitable[object]] | None = None
) -> None:
    """Serve the WebSocket of one page until either side ends, or its login, as `until` returns."""
    await socket.accept()  # also of one that is refused: a page sees the code of an accepted one
    try:
        page = feed.join()
    except TooManyPagesError:
        await socket.close(TRY_LATER)
        return
    code = GOING_AWAY
    ends = [lambda: _send(socket, page), lambda: _receive(socket, page)]
    if until is not None:

        async def login_over() -> None:
            nonlocal code
            await until()
            code = LOGIN_OVER

        ends.append(login_over)
    try:
        async with anyio.create_task_group() as group:

            async def run(end: Callable[[], Awaitable[object]]) -> None:
                await end()
                group.cancel_scope.cancel()

            for end in ends:
                group.start_soon(run, end)
    finally:
        feed.leave(page)
    with contextlib.suppress(RuntimeError, WebSocketDisconnect):  # the page has closed it
        await socket.close(code)


async def _send(socket: WebSocket, page: PageQueue) -> None:
    with contextlib.suppress(WebSocketDisconnect):
        while True:
            await socket.send_text(await page.next())


async def _receive(socket: WebSocket, page: PageQueue) -> None:
    """Take acknowledgements. Anything else ends the connection: it is not our page."""
    with contextlib.suppress(WebSocketDisconnect, ValueError, KeyError):
        while True:
            page.acknowledge(int(await socket.receive_text()))


class Served(NamedTuple):
    """What a server adds to the shared routes."""

    page: Callable[[Request], Awaitable[Response]]
    routes: Sequence[BaseRoute]
    live: Callable[[WebSocket], Awaitable[None]]


@contextlib.asynccontextmanager
async def connected(trainer: Trainer) -> AsyncGenerator[None]:
    """Be connected to the trainer; a first try that fails goes on in its thread."""
    await asyncio.to_thread(trainer.__enter__)
    try:
        yield
    finally:
        await asyncio.to_thread(trainer.__exit__, None, None, None)


async def follow_configuration(
    trainer: Trainer,
    boot_id: Callable[[], str | None],
    use: Callable[[Configuration | None], None],
) -> None:
    """Read the configuration of each new core, until cancelled.

    Args:
        trainer: connected.
        boot_id: returns the boot id of the running core; None: not known.
        use: gets the configuration; None as long as a new core does not answer.
    """
    read_of: str | None = None
    while True:
        running = boot_id()
        if running is not None and running != read_of:
            configuration = await asyncio.to_thread(_configuration, trainer)
            read_of = None if configuration is None else running
            use(configuration)
        await asyncio.sleep(CONFIGURATION_POLL_S)


def _configuration(trainer: Trainer) -> Configuration | None:
    try:
        return trainer.configuration()
    except NoAnswerError:
        return None


@contextlib.asynccontextmanager
async def working(*works: Coroutine[Any, Any, object]) -> AsyncGenerator[None]:
    """Run the works until the server ends; an error of one of them ends the server.

    A server without its feed would keep its pages at "no connection"; systemd starts a new one.
    """
    loop = asyncio.get_running_loop()

    def ended(task: asyncio.Task[object]) -> None:
        if not task.cancelled() and (error := task.exception()) is not None:
            loop.call_exception_handler({"message": "the server ends", "exception": error})
            loop.stop()

    tasks = [asyncio.create_task(work) for work in works]
    for task in tasks:
        task.add_done_callback(ended)
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def make_app(
    web: Web,
    served: Served,
    stops: Stops | None,
    lifespan: Callable[[Starlette], contextlib.AbstractAsyncContextManager[None]],
) -> ASGIApp:
    """Return the application of a server; without `stops` its page only reads."""

    async def texts(_request: Request) -> Response:
        return json(page_texts())

    async def alive(_request: Request) -> Response:
        return PlainTextResponse("ok")

    app = Starlette(
        routes=[
            Route("/", served.page),
            Route("/texts.json", texts),
            Route("/alive", alive),
            *([] if stops is None else [Route(STOP_PATH, stops.stop, methods=["POST"])]),
            WebSocketRoute("/live", served.live),
            *served.routes,
            Mount("/static", StaticFiles(directory=STATIC)),
        ],
        exception_handlers={ClientDisconnect: _gone},
        lifespan=lifespan,
    )
    return Guard(app, web)


async def _gone(_request: Request, _error: Exception) -> Response:
    return PlainTextResponse("the page has gone", 400)


class Server(uvicorn.Server):
    """Ends in order whatever comes after the first signal: the session switches its drives off."""

    def __init__(self, app: ASGIApp, web: Web) -> None:
        """Listen, so that a port in use is known before anything begins.

        A client that connects before the start is accepted after it.

        Raises:
            OSError: the address cannot be used.
        """
        self._connections = Connections(app)
        self._listeners = _listening(web)
        self._accepting = contextlib.AsyncExitStack()
        super().__init__(
            uvicorn.Config(
                self._connections,
                host=web.host,
                port=web.port,
                ssl_certfile=web.certificate,
                ssl_keyfile=web.key,
                ws="websockets-sansio",
                ws_max_size=BODY_MAX_BYTES,
                ws_ping_interval=PING_S,
                ws_ping_timeout=PING_S,
                timeout_graceful_shutdown=1,
                server_header=False,
                access_log=False,
                log_level="warning",
                proxy_headers=False,
            )
        )

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """End at the first signal."""
        if not self.should_exit:
            super().handle_exit(sig, frame)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start without sockets of uvicorn; say where the page is, once it can be opened."""
        assert sockets is None  # noqa: S101 - invariant: `serve` gives none
        await super().startup([])
        config = self.config
        make: Callable[..., asyncio.Protocol] = config.http_protocol_class
        protocol = functools.partial(
            make, config=config, server_state=self.server_state, app_state=self.lifespan.state
        )
        accept = self._connections.accept(self._listeners, protocol, config.ssl)
        await self._accepting.enter_async_context(working(accept))
        scheme = "https" if config.is_ssl else "http"
        print(f"gaitd-display: {scheme}://{config.host}:{config.port}/", flush=True)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Accept nothing any more, then end what goes on."""
        await self._accepting.aclose()
        for listener in self._listeners:
            listener.close()
        await super().shutdown(sockets)


def _listening(web: Web) -> list[socket.socket]:
    """Return the sockets that listen at an address; a name may have several.

    Linux lets two sockets with SO_REUSEADDR bind one port while none of them listens.
    """
    found = socket.getaddrinfo(web.host, web.port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    listeners: list[socket.socket] = []
    with contextlib.ExitStack() as opened:  # none of them stays open if another one fails
        for family, *_, address in found:
            listener = opened.enter_context(socket.socket(family, socket.SOCK_STREAM))
            listeners.append(listener)
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if family is socket.AF_INET6:
                listener.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            listener.setblocking(False)
            listener.bind(address)
            listener.listen(BACKLOG)
        opened.pop_all()
    return listeners


def serve(app: ASGIApp, web: Web) -> None:
    """Serve until SIGTERM, SIGINT or SIGHUP.

    Raises:
        CommandError: the address cannot be used now.
    """
    try:
        server = Server(app, web)
    except (OSError, UnicodeError) as error:  # the latter of a name that no machine can have
        reason = getattr(error, "strerror", None) or str(error)
        text = f"{web.host}:{web.port}: {reason.lower()}"
        raise CommandError(text, ExitCode.UNAVAILABLE) from error
    signal.signal(signal.SIGHUP, server.handle_exit)
    with contextlib.suppress(KeyboardInterrupt):  # uvicorn raises the signal again at its end
        server.run()
    if not server.started:
        raise CommandError(f"{web.host}:{web.port}: not served", ExitCode.UNAVAILABLE)
