"""A running service by its messages: its status is polled, requests go over Zenoh."""

import time
from typing import Final

from gaitd_client import ClientError, NoAnswerError, Reply, Trainer

from analysis.acceptance.record import Finding, Report, Service
from gaitd.commissioning.messages import Observation, ReadObjects, Request

STATUS_S: Final = 0.25
"""Time between two polls of the status."""


class NoRecordsError(ClientError):
    """The service answers, but it has no records of the core."""


class RemoteService:
    """A service by its messages."""

    def __init__(self, trainer: Trainer) -> None:
        self._trainer = trainer
        self._known = {event.id for event in trainer.status().events}

    def request(self, request: Request) -> Reply:
        """See `Source`."""
        return self._trainer.request(request.name, **request.arguments)

    def read(self, wanted: ReadObjects) -> tuple[Finding, ...]:
        """Refuse: objects can be read beside the service alone."""
        raise NoAnswerError(f"the objects of {wanted.drive} cannot be read over the network")

    def newest(self) -> Observation:
        """See `Source`."""
        status = self._trainer.status()
        safety = status.safety
        if not safety.valid or safety.mode is None:
            raise NoRecordsError("no records arrive from the core; look at the machine")
        new = [event for event in status.events if event.id not in self._known]
        self._known |= {event.id for event in new}
        return Observation(
            time.monotonic(),
            Service(safety.mode, safety.verdict),
            reports=tuple(
                Report(event.code, event.subject or "", event.values, event.said) for event in new
            ),
            progress=safety.progress,
        )

    def following(self) -> Observation:
        """See `Source`."""
        time.sleep(STATUS_S)
        return self.newest()
