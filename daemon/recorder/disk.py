"""The thread that waits for the disk, so that the gateway's loop never does.

Jobs run one after the other, in the order of their requests. A failed job is counted and reported,
once until one of its kind works again; it is never retried automatically, and whatever it raises
the next job runs (`worker.py`). The queue is bounded: a disk that hangs loses the jobs after it,
but uses no more memory.
"""

import queue
import threading
from collections.abc import Callable
from typing import Final, NamedTuple

from daemon.recorder.worker import Worker

JOBS_MAX: Final = 64
END_TIMEOUT_S: Final = 3.0
"""Time that an ending gateway waits for its disk."""


class WriteError(NamedTuple):
    """A write error and its reason; an empty reason: writing works again."""

    what: str
    reason: str


class _Job(NamedTuple):
    what: str
    run: Callable[[], None]


class Disk:
    """A thread and its queue of jobs."""

    def __init__(self) -> None:
        """Start the thread."""
        self.failed_count = 0
        self._jobs: queue.Queue[_Job | None] = queue.Queue(JOBS_MAX)
        self._reports: queue.SimpleQueue[WriteError] = queue.SimpleQueue()
        self._failing: set[str] = set()
        self._running = ""
        self._worker = Worker("disk", self._work, self._ended)

    def submit(self, what: str, run: Callable[[], None]) -> bool:
        """Queue a job; False if the queue is full and the job is dropped.

        Args:
            what: name of the kind of job, for reports; the same for all jobs of a kind.
            run: is called in the thread; of its exceptions only OSError is expected, and none
                ends the thread.
        """
        try:
            self._jobs.put_nowait(_Job(what, run))
        except queue.Full:
            self._fail(what, "the disk is too slow or does not respond")
            return False
        return True

    def errors(self) -> list[WriteError]:
        """Errors and recoveries since the last call."""
        return [self._reports.get_nowait() for _ in range(self._reports.qsize())]

    def settle(self) -> None:
        """Wait until all queued jobs are done; for tests only, because a disk may hang."""
        done = threading.Event()
        self._jobs.put(_Job("settle", done.set))
        done.wait()

    def close(self) -> None:
        """Finish the queued jobs, for a bounded time."""
        try:
            self._jobs.put(None, timeout=END_TIMEOUT_S)
        except queue.Full:
            return
        self._worker.join(END_TIMEOUT_S)

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            self._running = job.what
            try:
                job.run()
            except OSError as error:
                self._fail(job.what, error.strerror or str(error))
            else:
                if job.what in self._failing:
                    self._failing.discard(job.what)
                    self._reports.put(WriteError(job.what, ""))

    def _ended(self, why: str) -> bool:
        self._fail(self._running, why)
        return True

    def _fail(self, what: str, reason: str) -> None:
        self.failed_count += 1
        if what not in self._failing:
            self._failing.add(what)
            self._reports.put(WriteError(what, reason))
