"""Requests of a program that must not wait for their answers, which may take seconds."""

import json
from typing import Final

import zenoh
from gaitd_client import wire

from daemon.zenoh_io.client import ANSWER_TIMEOUT_S, Answer, Target, json_text, open_client
from gaitd_lab.demonstration.script import Ask

TAKEN_WITHIN_S: Final = 2.0


class Requests:
    """At most one pending request to a service, each in a session of its own."""

    def __init__(self, target: Target, client: str) -> None:
        """Start without a request; `client` is the client name in the requests."""
        self._target, self._client = target, client
        self._session: zenoh.Session | None = None
        self._answers: list[Answer] = []

    def send(self, request: Ask) -> None:
        """Send a request; the outcome of an earlier one is dropped.

        The gateway has the request when this returns: it processes queries in order, and two later
        ones have been answered. The core therefore takes it with the next cycle, on each run.
        """
        self.close()
        self._answers = answers = list[Answer]()
        try:
            self._session = session = open_client(self._target)
        except zenoh.ZError:
            answers.append(Answer(None, "the service does not accept a client"))
            return

        def take(reply: zenoh.Reply) -> None:
            text = json_text(reply)
            if text is not None:
                answers.append(Answer(text))

        def finish() -> None:
            answers.append(Answer(None, "another trainer, or it hangs"))

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
        if not self._answers:
            return None, ""
        reply = self._answers[0].decode(wire.Reply)
        if reply is None:
            return "unanswered", self._answers[0].trouble
        return reply.outcome, reply.reason

    def close(self) -> None:
        """Close the session; a pending answer is not waited for."""
        if self._session is not None:
            self._session.close()
            self._session = None
