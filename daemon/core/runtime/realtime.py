"""Real-time settings of kernel and Python that keep the cycle at 10 ms.

`prepare` returns the requests that were refused, and the service runs without them, because it must
also run on a development computer without privileges. `gaitd doctor` explains.
"""

import ctypes
import gc
import os
import resource
import sys
from collections.abc import Sequence

from gaitd_names import EventCode

from daemon.ipc.report import Event

MCL_CURRENT = 1
MCL_FUTURE = 2
MCL_ONFAULT = 4
"""Lock pages when they are first used: otherwise numpy's address space alone costs 150 MB."""


def prepare(priority: int, processors: Sequence[int]) -> list[Event]:
    """Request SCHED_FIFO and these processors, lock memory, and stop the garbage collector.

    Args:
        priority: SCHED_FIFO priority; 0 requests no real-time scheduling.
        processors: processor numbers for this thread only; threads of libraries are not moved.
            Empty requests none.

    Returns:
        An event for each request that was refused.
    """
    refused = _lock_memory()
    if processors:
        refused += _settle_on(processors)
    if priority > 0:
        refused += _schedule(priority)
    # A collection takes a whole cycle, and the loop creates no reference cycles.
    gc.collect()
    gc.freeze()
    gc.disable()
    # There is only one Python thread, so no other thread waits for the interpreter.
    sys.setswitchinterval(1.0)
    return refused


def tidy() -> None:
    """Run the garbage collector once after a bring-up, if it does not run by itself.

    A cycle of the loop leaves no garbage for it. A bring-up does: canopen's network, nodes and
    clients refer to each other, some 2000 blocks each time, and a bus without power is tried once a
    second. Frozen objects are skipped, so this takes a millisecond or two, between bring-up and
    first SYNC.
    """
    if not gc.isenabled():
        gc.collect()


def _schedule(priority: int) -> list[Event]:
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except PermissionError:
        soft, _ = resource.getrlimit(resource.RLIMIT_RTPRIO)
        return [Event(EventCode.PRIORITY_REFUSED, values=(priority, soft))]
    return []


def _settle_on(processors: Sequence[int]) -> list[Event]:
    try:
        os.sched_setaffinity(0, processors)
    except (OSError, ValueError):
        given = ", ".join(map(str, sorted(os.sched_getaffinity(0))))
        return [Event(EventCode.PROCESSORS_REFUSED, said=given)]
    return []


def _lock_memory() -> list[Event]:
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) == 0:
        return []
    soft, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    error = os.strerror(ctypes.get_errno())
    return [Event(EventCode.MEMORY_NOT_LOCKED, values=(soft,), said=error)]
