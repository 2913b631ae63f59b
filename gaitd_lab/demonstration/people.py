"""The people of a training, at their pages: they see what a page shows, and press its buttons.

Each uses the page's own HTTP and WebSocket, as a browser does. A request runs in a thread, so that
simulated time is never held up by its answer.
"""

import contextlib
import http.client
import json
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Final, Self

import msgspec
from gaitd_client import PlanLimits

from gaitd_lab.demonstration.clients import HOST, address_of
from gaitd_lab.demonstration.training_script import Seen
from gaitd_lab.requests import UNANSWERED

REQUEST_S: Final = 30.0
"""Longest wait for a page's answer, by the computer's clock."""
RETRY_S: Final = 0.2
REFUSED: Final = 400
"""An answer of HTTP from here on is none that was asked for."""
FAILED: Final = "failed"

Outcome = tuple[str | None, str]
"""`done`, `refused`, or that there was no answer, and the reason; None while it is pending."""


class _Frame(msgspec.Struct, frozen=True):
    seq: int
    now: Seen


class _Page:
    """Requests to one page."""

    def __init__(self, port: int) -> None:
        self.port, self.origin = port, address_of(port).rstrip("/")
        self.headers = {"origin": self.origin, "content-type": "application/json"}

    def ask(self, method: str, path: str, body: object = None) -> http.client.HTTPResponse:
        """Return the answer, which is still to be read."""
        connection = http.client.HTTPConnection(HOST, self.port, timeout=REQUEST_S)
        payload = None if body is None else json.dumps(body)
        connection.request(method, path, payload, self.headers)
        return connection.getresponse()

    def press(self, path: str, body: object) -> Outcome:
        """Send what a button sends; return the answer."""
        with self.ask("POST", path, body) as answer:
            found: dict[str, Any] = json.load(answer)
        return found["outcome"], found.get("reason", "")


class People:
    """Patient and therapist, and the newest request of either."""

    def __init__(
        self, patient_port: int, therapist_port: int, password: str, plan: PlanLimits
    ) -> None:
        """Prepare; `with` lets the patient look at the page.

        Args:
            patient_port: of the patient's page.
            therapist_port: of the therapist's page.
            password: of the therapist, who is not yet logged in.
            plan: what the therapist releases.
        """
        self._patient, self._therapist_port = _Page(patient_port), therapist_port
        self._password, self._plan = password, plan
        self._threads = ThreadPoolExecutor(1, "people")
        self._asked: Future[Outcome] | None = None
        self._is_over = threading.Event()
        self._looking = threading.Thread(target=self._look, name="patient", daemon=True)
        self.seen = Seen()
        """The newest frame of the patient's page; empty while there is no page."""

    def press(self, button: str) -> None:
        """Let the patient press a button of the session."""
        self._ask(lambda: self._patient.press("/session", {"button": button}))

    def release(self) -> None:
        """Let the therapist log in, and release the plan."""
        self._ask(self._release)

    def outcome(self) -> Outcome:
        """Return outcome and reason of the newest request; None until its answer."""
        asked = self._asked
        return (None, "") if asked is None or not asked.done() else asked.result()

    def _ask(self, request: Callable[[], Outcome]) -> None:
        def answered() -> Outcome:
            try:
                return request()
            except (OSError, http.client.HTTPException, ValueError) as error:
                return UNANSWERED, str(error)

        self._asked = self._threads.submit(answered)

    def _release(self) -> Outcome:
        page = _Page(self._therapist_port)
        with self._login(page) as login:
            if login.status >= REFUSED:
                return FAILED, f"the login is refused: {login.read().decode()}"
            page.headers["cookie"] = (login.getheader("set-cookie") or "").partition(";")[0]
        with page.ask("GET", "/session.json") as session:
            page.headers["x-csrf-token"] = json.load(session)["csrf"]
        return page.press("/plan", {"plan": msgspec.to_builtins(self._plan)})

    def _login(self, page: _Page) -> http.client.HTTPResponse:
        """Ask until the page is there: its server may still start."""
        end_s = time.monotonic() + REQUEST_S
        while True:
            try:
                return page.ask("POST", "/login", {"password": self._password})
            except ConnectionRefusedError:
                if time.monotonic() > end_s:
                    raise
                time.sleep(RETRY_S)

    def _look(self) -> None:
        from websockets.exceptions import WebSocketException
        from websockets.sync.client import connect
        from websockets.typing import Origin

        decoder = msgspec.json.Decoder(_Frame)
        address = f"ws://{HOST}:{self._patient.port}/live"
        while not self._is_over.wait(RETRY_S):
            with (
                contextlib.suppress(OSError, WebSocketException, msgspec.DecodeError),
                connect(address, origin=Origin(self._patient.origin)) as socket,
            ):
                while not self._is_over.is_set():
                    frame = decoder.decode(socket.recv())
                    socket.send(str(frame.seq))
                    self.seen = frame.now
            self.seen = Seen()

    def __enter__(self) -> Self:
        self._looking.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Do not wait for what is not answered."""
        self._is_over.set()
        self._threads.shutdown(wait=False, cancel_futures=True)
        self._looking.join()
