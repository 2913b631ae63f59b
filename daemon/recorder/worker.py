"""A thread that waits for a disk, so that the gateway's loop never does, and that does not end.

An exception in it is a bug of ours or something that nobody thought of, such as a file of another
program in our folder. Without a word the black box, the request log or the core's notes would not
be kept any more from then on. It is told, logged, and the thread begins anew.
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
            ended: told why, in the thread; whether to begin anew.
        """
        self._name, self._work, self._ended = name, work, ended
        self._log = logging.getLogger("gaitd.gateway")
        # One that hangs in a system call must not keep the process from ending.
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def join(self, timeout_s: float | None = None) -> None:
        """Wait for its end."""
        self._thread.join(timeout_s)

    def _run(self) -> None:
        while True:
            try:
                self._work()
            except Exception as bug:  # noqa: BLE001 - told, logged, and what comes next is done
                what = f"unexpected {type(bug).__name__}: {bug}"
                self._log.exception("thread %s has ended by a bug", self._name)
                if self._ended(what):
                    continue
            return
