"""A process that only sleeps until each point of a grid: what the machine itself does to a SYNC.

`python -m gaitd_lab.benchmark.bare_timer PRIORITY PERIOD_NS SECONDS`

It has the core's class and priority, and prints how late each point was, in ns, as JSON. What the
host of a virtual machine, an interrupt or a busy kernel delays, is late here, too.
"""

import contextlib
import json
import os
import sys
import time


def lateness_ns(period_ns: int, seconds: float) -> list[int]:
    """Sleep until each point of the grid, and return how late each was."""
    late_ns: list[int] = []
    due_ns = time.monotonic_ns()
    end_ns = due_ns + int(seconds * 1e9)
    while due_ns < end_ns:
        due_ns += period_ns
        time.sleep(max(due_ns - time.monotonic_ns(), 0) * 1e-9)
        late_ns.append(time.monotonic_ns() - due_ns)
        if late_ns[-1] > period_ns:  # the points that it slept through are missed once
            due_ns += late_ns[-1] // period_ns * period_ns
    return late_ns


def main(priority: int, period_ns: int, seconds: float) -> None:
    """Print the lateness of each point."""
    with contextlib.suppress(PermissionError):  # the core runs without, too
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    print(json.dumps(lateness_ns(period_ns, seconds)))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]))
