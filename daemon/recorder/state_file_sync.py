"""Syncs the core's state file to the disk, so that a latched stop survives a power cut.

The core writes its state into a mapped page and calls no fsync. A thread of the gateway reads the
page a few times a second and calls fsync when it has changed: nothing waits for this thread, and it
does not block the others, because reading and fsync release the interpreter lock.

Until then a power cut leaves an older page. That page is safe, too: a page written while drives are
enabled states that the end of the run is unknown (`core/modes/latched_stop.py`).
"""

import logging
import os
import threading
from pathlib import Path
from typing import Final

from daemon.ipc.state_file import SIZE
from daemon.recorder.worker import Worker

PERIOD_S: Final = 0.2


class StateFileSync:
    """A thread that syncs one file to the disk whenever it has changed."""

    def __init__(self, path: Path) -> None:
        """Start the thread; a file that does not exist yet is waited for."""
        self._path = path
        self._synced = b""
        self._error = ""
        self._log = logging.getLogger("gaitd.gateway")
        self._over = threading.Event()
        self._worker = Worker("notes", self._work, self._ended)

    def sync(self) -> bool:
        """Check the file once and sync it; true if it had changed.

        Raises:
            OSError: the file cannot be read, or the disk fails.
        """
        file = os.open(self._path, os.O_RDONLY)
        try:
            page = os.read(file, SIZE)
            if page == self._synced:
                return False
            os.fsync(file)  # of all its dirty pages, also through the mapping of the core
            self._synced = page
        finally:
            os.close(file)
        return True

    def close(self) -> None:
        """Sync for the last time, and end the thread."""
        self._over.set()
        self._worker.join()

    def _work(self) -> None:
        over = False
        while not over:
            over = self._over.wait(PERIOD_S)
            try:
                self.sync()
                self._error = ""
            except FileNotFoundError:
                continue
            except OSError as error:
                self._log_failure(str(error))

    def _ended(self, why: str) -> bool:
        self._log_failure(why)
        return not self._over.is_set()

    def _log_failure(self, why: str) -> None:
        """Log a failure once: a power cut may now lose a latched stop."""
        if why != self._error:
            self._error = why
            self._log.error("the core's state file is not on the disk: %s", why)
