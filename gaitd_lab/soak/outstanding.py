"""A request of the soak to the service, asked in a thread, because an answer may take seconds."""

import json
from concurrent.futures import Future, ThreadPoolExecutor

from gaitd.remote import Answer, Target, ask
from gaitd_lab.demonstration.script import Ask


class Outstanding:
    """At most one request to the service, asked in a thread."""

    def __init__(self, target: Target, client: str = "gaitd demo") -> None:
        """Nothing is asked yet; `client` is the name that the service hears."""
        self._target = target
        self._client = client
        self._thread = ThreadPoolExecutor(max_workers=1)
        self._answer: Future[Answer] | None = None

    def ask(self, request: Ask) -> None:
        """Ask; the outcome of an earlier request is forgotten."""
        payload = {"client": self._client, **request.payload}
        self._answer = self._thread.submit(ask, self._target, request.name, payload)

    def outcome(self) -> tuple[str | None, str]:
        """Outcome and reason; None while nobody has answered."""
        if self._answer is None or not self._answer.done():
            return None, ""
        answer = self._answer.result()
        if answer.text is None:
            return "unanswered", answer.trouble
        reply = json.loads(answer.text)
        return reply.get("outcome", "refused"), reply.get("reason", "")

    def close(self) -> None:
        """Wait for an answer that is still coming, at most as long as `ask` itself does."""
        self._thread.shutdown(cancel_futures=True)
