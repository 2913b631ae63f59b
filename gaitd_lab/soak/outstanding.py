"""A request of the soak to the service, sent in a thread, because an answer may take seconds."""

import json
from concurrent.futures import Future, ThreadPoolExecutor

from gaitd.remote import Answer, Target, ask
from gaitd_lab.demonstration.script import Ask


class Outstanding:
    """At most one pending request to the service, sent in a thread."""

    def __init__(self, target: Target, client: str = "gaitd demo") -> None:
        """Start without a request; `client` is the client name in the requests."""
        self._target = target
        self._client = client
        self._thread = ThreadPoolExecutor(max_workers=1)
        self._answer: Future[Answer] | None = None

    def ask(self, request: Ask) -> None:
        """Send a request; the outcome of an earlier one is dropped."""
        payload = {"client": self._client, **request.payload}
        self._answer = self._thread.submit(ask, self._target, request.name, payload)

    def outcome(self) -> tuple[str | None, str]:
        """Return outcome and reason; None until the answer."""
        if self._answer is None or not self._answer.done():
            return None, ""
        answer = self._answer.result()
        if answer.text is None:
            return "unanswered", answer.trouble
        reply = json.loads(answer.text)
        return reply.get("outcome", "refused"), reply.get("reason", "")

    def close(self) -> None:
        """Wait for a pending answer, at most as long as `ask` itself does."""
        self._thread.shutdown(cancel_futures=True)
