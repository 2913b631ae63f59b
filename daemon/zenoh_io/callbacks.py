"""Callbacks of Zenoh that are known to be over."""

import threading
from collections.abc import Callable
from typing import Any, Final

import zenoh

LAST_S: Final = 2.0
"""Longest wait for callbacks that only put a message into a queue."""


class Callbacks:
    """The callbacks of one queryable or subscriber.

    Zenoh receives in one thread and calls back in another one. Neither `undeclare` nor
    `Session.close` waits for messages between the two: eclipse-zenoh 1.10 went on to call back for
    a second after its session was closed. A stop among them would be lost with the queue that the
    callback puts it into.
    """

    def __init__(self, receive: Callable[[Any], None]) -> None:
        """`receive` is called with each message, in a thread of Zenoh."""
        self._are_over = threading.Event()
        self.handler = zenoh.handlers.Callback(receive, self._are_over.set)

    def wait(self) -> bool:
        """Wait for the callbacks of all that had been received when it was undeclared.

        Returns: False if they take longer than `LAST_S`.
        """
        return self._are_over.wait(LAST_S)
