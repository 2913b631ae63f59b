"""Brings the core's notes to the disk, so that a latched stop survives a power cut.

The core writes its notes into a mapped page and calls no fsync. A thread of ours here looks at the
page a few times a second and calls fsync where it has changed: nothing waits for this
thread, and it takes nothing from the others, because reading and fsync let go of the interpreter.
Until then a power cut leaves an older page. That one is never clean either where it matters: a page
written while drives are enabled says that nobody knows how it ended (`core/steps/latching.py`).
"""

import logging
import os
import threading
from pathlib import Path
from typing import Final

from daemon.ipc.state_file import SIZE
from daemon.recorder.worker import Worker

PERIOD_S: Final = 0.2


class NotesDisk:
    """A thread that keeps one file as it is in memory on the disk, too."""

    def __init__(self, path: Path) -> None:
        """Begin to look; a file that is not there yet is waited for."""
        self._path = path
        self._kept = b""
        self._trouble = ""
        self._log = logging.getLogger("gaitd.gateway")
        self._over = threading.Event()
        self._worker = Worker("notes", self._work, self._ended)

    def look(self) -> bool:
        """Look once; whether there was something to bring to the disk.

        Raises:
            OSError: the file cannot be read, or the disk fails.
        """
        file = os.open(self._path, os.O_RDONLY)
        try:
            page = os.read(file, SIZE)
            if page == self._kept:
                return False
            os.fsync(file)  # of all that is dirty in it, also through the mapping of the core
            self._kept = page
        finally:
            os.close(file)
        return True

    def close(self) -> None:
        """Look for the last time, and end."""
        self._over.set()
        self._worker.join()

    def _work(self) -> None:
        over = False
        while not over:
            over = self._over.wait(PERIOD_S)
            try:
                self.look()
                self._trouble = ""
            except FileNotFoundError:
                continue
            except OSError as error:
                self._tell(str(error))

    def _ended(self, why: str) -> bool:
        self._tell(why)
        return not self._over.is_set()

    def _tell(self, why: str) -> None:
        """Said once: a power cut may now lose a stop that is latched."""
        if why != self._trouble:
            self._trouble = why
            self._log.error("the notes of the core are not on the disk: %s", why)
