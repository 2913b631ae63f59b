"""Requests of a program that must not wait for their answers, which may take seconds."""

import json
from typing import Any, Final, NamedTuple

import zenoh
from gaitd_client import wire
from gaitd_client.connection import (
    ANSWER_TIMEOUT_S,
    Target,
    decode_answer,
    json_of,
    open_session,
)
from gaitd_client.errors import NoAnswerError, NoServiceError, reason_of

TAKEN_WITHIN_S: Final = 2.0
UNANSWERED: Final = "unanswered"


class Ask(NamedTuple):
    """A request to the service over Zenoh."""

    name: str
    payload: dict[str, Any]


class Requests:
    """At most one pending request to a service, each in a session of its own."""

    def __init__(self, target: Target, client: str) -> None:
        """Start without a request; `client` is the client name in the requests."""
        self._target, self._client = target, client
        self._session: zenoh.Session | None = None
        self._answers: list[tuple[str, str]] = []
        """Outcome and reason of the request; the first one counts."""

    def send(self, request: Ask) -> None:
        """Send a request; the outcome of an earlier one is dropped.

        The gateway has the request when this returns: it processes queries in order, and two later
        ones have been answered. The core therefore takes it with the next cycle, on each run.
        """
        self.close()
        self._answers = answers = list[tuple[str, str]]()
        try:
            self._session = session = open_session(self._target)
        except NoServiceError:
            answers.append((UNANSWERED, "the service does not accept a client"))
            return

        def take(reply: zenoh.Reply) -> None:
            data = json_of(reply)
            if data is not None:
                answers.append(_outcome(data, request.name))

        def finish() -> None:
            answers.append((UNANSWERED, "another trainer, or it hangs"))

        session.get(
            self._target.control(request.name),
            zenoh.handlers.Callback(take, finish),
            payload=json.dumps({"client": self._client, **request.payload}),
            timeout=ANSWER_TIMEOUT_S,
        )
        for _ in range(2):
            for _reply in session.get(self._target.control("status"), timeout=TAKEN_WITHIN_S):
                pass

    def outcome(self) -> tuple[str | None, str]:
        """Return outcome and reason; None until the answer."""
        return self._answers[0] if self._answers else (None, "")

    def close(self) -> None:
        """Close the session; a pending answer is not waited for."""
        if self._session is not None:
            self._session.close()
            self._session = None


def _outcome(data: bytes, name: str) -> tuple[str, str]:
    try:
        reply = decode_answer(data, wire.Reply, name)
    except NoAnswerError as error:
        return UNANSWERED, str(error)
    return reply.outcome, reason_of(reply)
