"""`gaitd core` with what no signal can do to it: UTC that steps, and memory that is not there.

    altered_core.py core --config FILE

Lines on stdin: `utc SECONDS` moves the wall clock of this process by so much and nothing else;
`memory` makes every cycle fail as Python does when the system gives no memory. Only the clock's
`utc_ns` and the making of the record are replaced; everything else is the product's own.
"""

import sys
import threading

from daemon.clock import MonotonicClock
from daemon.core import recording
from gaitd.__main__ import main

step_ns = 0
record = recording.record
utc_ns = MonotonicClock.utc_ns


def no_memory(*_: object) -> None:
    raise MemoryError("no memory for the record of this cycle")


def obey() -> None:
    global step_ns  # noqa: PLW0603 - one process, one clock
    for line in sys.stdin:
        word, _, seconds = line.strip().partition(" ")
        if word == "utc":
            step_ns += int(float(seconds) * 1e9)
        elif word == "memory":
            recording.record = no_memory


MonotonicClock.utc_ns = lambda self: utc_ns(self) + step_ns
threading.Thread(target=obey, daemon=True).start()
main()
