"""What the core asks of the kernel and of Python so that 10 ms stay 10 ms.

Each wish is granted or named: `prepare` returns what was refused, and the service runs on with
what it got, because a desk without privileges must be able to run it too. `gaitd doctor` explains.
"""

import ctypes
import gc
import os
import resource
import sys
from collections.abc import Sequence

MCL_CURRENT = 1
MCL_FUTURE = 2
MCL_ONFAULT = 4
"""Lock pages when they are touched: without it numpy's address space alone costs 150 MB."""


def prepare(priority: int, processors: Sequence[int]) -> list[str]:
    """Ask for SCHED_FIFO on these processors, locked memory and a quiet garbage collector.

    Args:
        priority: SCHED_FIFO priority; 0 asks for no real-time scheduling.
        processors: by number, for this thread alone: those of libraries stay where they are.
            Empty asks for none.

    Returns:
        One sentence for each wish that the machine refused.
    """
    refused = _lock_memory()
    if processors:
        refused += _settle_on(processors)
    if priority > 0:
        refused += _schedule(priority)
    # Everything is built by now; a collection costs a whole cycle, and the loop makes no cycles.
    gc.collect()
    gc.freeze()
    gc.disable()
    # One Python thread is all there is; nobody waits for the interpreter.
    sys.setswitchinterval(1.0)
    return refused


def tidy() -> None:
    """Free what only the collector can, where it does not run by itself.

    A cycle leaves nothing of the kind. A bring-up does: canopen's network, nodes and clients hold
    each other, some 2000 blocks each time, and a bus without power is tried once a second. What was
    frozen is not looked at, so this takes a millisecond or two, between bring-up and first SYNC.
    """
    if not gc.isenabled():
        gc.collect()


def _schedule(priority: int) -> list[str]:
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except PermissionError:
        soft, _ = resource.getrlimit(resource.RLIMIT_RTPRIO)
        return [f"SCHED_FIFO priority {priority} refused: RLIMIT_RTPRIO is {soft}"]
    return []


def _settle_on(processors: Sequence[int]) -> list[str]:
    try:
        os.sched_setaffinity(0, processors)
    except (OSError, ValueError):
        wanted = ", ".join(map(str, processors))
        given = ", ".join(map(str, sorted(os.sched_getaffinity(0))))
        return [f"realtime_cpus = [{wanted}] refused: the processors given are {given}"]
    return []


def _lock_memory() -> list[str]:
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) == 0:
        return []
    soft, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    error = os.strerror(ctypes.get_errno())
    return [f"mlockall refused ({error}): RLIMIT_MEMLOCK is {soft}"]
