"""The people of a training, at their pages: they see what a page shows, and press its buttons.

Each uses the page's own HTTP and WebSocket, as a browser does. A request runs in a thread, so that
simulated time is never held up by its answer.
"""

import contextlib
import http.client
import json
import threading
import time
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Final, NamedTuple, Self

import msgspec
from gaitd_client import PlanLimits

from gaitd_lab.demonstration.pages import HOST, address_of
from gaitd_lab.demonstration.script import Seen
from gaitd_lab.processes import ManagedProcess
from gaitd_lab.requests import UNANSWERED

REQUEST_S: Final = 30.0
"""Longest wait for a page's answer, by the computer's clock."""
RETRY_S: Final = 0.2
REFUSED: Final = 400
"""An answer of HTTP from here on is none that was asked for."""
FAILED: Final = "failed"


class _Frame(msgspec.Struct, frozen=True):
    seq: int
    now: Seen


class Answered(NamedTuple):
    """The answer to a button: `done`, `refused`, or that there was none."""

    outcome: str
    reason: str = ""


class _Page:
    """Requests to one page."""

    def __init__(self, port: int) -> None:
        self.port = port
        self.origin = address_of(port).rstrip("/")
        self.headers = {"origin": self.origin, "content-type": "application/json"}

    def ask(self, method: str, path: str, body: object = None) -> http.client.HTTPResponse:
        """Return the answer, which is still to be read."""
        connection = http.client.HTTPConnection(HOST, self.port, timeout=REQUEST_S)
        payload = None if body is None else json.dumps(body)
        connection.request(method, path, payload, self.headers)
        return connection.getresponse()

    def press(self, path: str, body: object) -> Answered:
        """Send what a button sends; return the answer."""
        try:
            with self.ask("POST", path, body) as answer:
                found: dict[str, Any] = json.load(answer)
        except (OSError, http.client.HTTPException, ValueError) as error:
            return Answered(UNANSWERED, str(error))
        return Answered(found["outcome"], found.get("reason", ""))


class PatientAtPage:
    """Looks at the patient's page."""

    def __init__(self, port: int) -> None:
        """Prepare; `with` begins to look."""
        self._page = _Page(port)
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._look, name="patient", daemon=True)
        self._decoder = msgspec.json.Decoder(_Frame)
        self.seen = Seen()
        """The newest frame; empty while there is no page."""

    def press(self, button: str) -> Answered:
        """Press a button of the session."""
        return self._page.press("/session", {"button": button})

    def _look(self) -> None:
        from websockets.exceptions import WebSocketException
        from websockets.sync.client import connect
        from websockets.typing import Origin

        address = f"ws://{HOST}:{self._page.port}/live"
        while not self._is_over.wait(RETRY_S):
            with (
                contextlib.suppress(OSError, WebSocketException, msgspec.DecodeError),
                connect(address, origin=Origin(self._page.origin)) as socket,
            ):
                while not self._is_over.is_set():
                    frame = self._decoder.decode(socket.recv())
                    socket.send(str(frame.seq))
                    self.seen = frame.now
            self.seen = Seen()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over.set()
        self._thread.join()


class TherapistAtPage:
    """Logs in on the therapist's page, and releases a plan there."""

    def __init__(self, port: int, password: str) -> None:
        """Prepare."""
        self._page, self._password = _Page(port), password

    def release(self, plan: PlanLimits) -> Answered:
        """Log in, and release the plan."""
        page = _Page(self._page.port)
        try:
            with self._logged_in() as login:
                if login.status >= REFUSED:
                    return Answered(FAILED, f"the login is refused: {login.read().decode()}")
                page.headers["cookie"] = (login.getheader("set-cookie") or "").partition(";")[0]
            with page.ask("GET", "/session.json") as session:
                page.headers["x-csrf-token"] = json.load(session)["csrf"]
        except (OSError, http.client.HTTPException, ValueError) as error:
            return Answered(UNANSWERED, str(error))
        return page.press("/plan", {"plan": msgspec.to_builtins(plan)})

    def _logged_in(self) -> http.client.HTTPResponse:
        """Ask until the page is there: its server may still start."""
        end_s = time.monotonic() + REQUEST_S
        while True:
            try:
                return self._page.ask("POST", "/login", {"password": self._password})
            except ConnectionRefusedError:
                if time.monotonic() > end_s:
                    raise
                time.sleep(RETRY_S)


class People:
    """Patient and therapist of a training, and the newest request of either."""

    def __init__(
        self,
        pages: Sequence[ManagedProcess],
        patient: PatientAtPage,
        therapist: TherapistAtPage,
        plan: PlanLimits,
    ) -> None:
        """Prepare.

        Args:
            pages: servers of both pages.
            patient: who is looking at the page.
            therapist: not yet logged in.
            plan: what the therapist releases.
        """
        self._pages = pages
        self._patient, self._therapist, self._plan = patient, therapist, plan
        self._threads = ThreadPoolExecutor(1, "people")
        self._asked: Future[Answered] | None = None

    @property
    def seen(self) -> Seen:
        """What the patient sees now."""
        return self._patient.seen

    def press(self, button: str) -> None:
        """Let the patient press a button."""
        self._asked = self._threads.submit(self._patient.press, button)

    def release(self) -> None:
        """Let the therapist log in, and release the plan."""
        self._asked = self._threads.submit(self._therapist.release, self._plan)

    def outcome(self) -> tuple[str | None, str]:
        """Return outcome and reason of the newest request; None until its answer."""
        asked = self._asked
        return (None, "") if asked is None or not asked.done() else asked.result()

    def check(self) -> None:
        """Check that both pages are served.

        Raises:
            ServiceError: one has ended; with its last output.
        """
        for server in self._pages:
            server.check()

    def close(self) -> None:
        """Do not wait for what is not answered."""
        self._threads.shutdown(wait=False, cancel_futures=True)
