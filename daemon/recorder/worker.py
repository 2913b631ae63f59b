"""A thread that waits for a disk, so that the gateway's loop never does, and that restarts itself.

An exception in it is a bug of ours or an unforeseen case, such as a file of another program in our
folder. If the thread ended silently, the black box, the request log or the core's state file would
not be kept from then on. So the exception is reported and logged, and the thread begins anew.
"""

import logging
import threading
from collections.abc import Callable


class Worker:
    """A thread around one function, which returns when there is nothing left to do."""

    def __init__(self, name: str, work: Callable[[], None], ended: Callable[[str], bool]) -> None:
        """Start the thread.

        Args:
            name: of the thread.
            work: runs in it, and again when it has ended by an exception.
            ended: called in the thread with the reason; returns whether to begin anew.
        """
        self._name, self._work, self._ended = name, work, ended
        self._log = logging.getLogger("gaitd.gateway")
        # A daemon thread: a hanging system call must not keep the process from ending.
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def join(self, timeout_s: float | None = None) -> None:
        """Wait for its end."""
        self._thread.join(timeout_s)

    def _run(self) -> None:
        while True:
            try:
                self._work()
            except Exception as bug:  # noqa: BLE001 - reported and logged; restarted if wanted
                what = f"unexpected {type(bug).__name__}: {bug}"
                self._log.exception("thread %s has ended by a bug", self._name)
                if self._ended(what):
                    continue
            return
