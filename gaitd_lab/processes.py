"""Child processes that end with this process, their ports, and a folder for their files."""

import contextlib
import os
import signal
import socket
import sys
from typing import Final

SHARED_MEMORY: Final = "/dev/shm"
_END_WITH_PARENT: Final = (
    "import ctypes, os, sys; ctypes.CDLL(None).prctl(1, {number}); "
    "os.getppid() == int(sys.argv[1]) and os.execv(sys.argv[2], sys.argv[2:])"
)
"""Requests a signal from the kernel for the end of the parent (PR_SET_PDEATHSIG), and then executes
the given command, unless the parent has already ended. A function between fork and exec would do
the same, but is not safe beside threads.
"""


def tied(*words: str, number: signal.Signals = signal.SIGTERM) -> list[str]:
    """Return the command `python WORDS...` that gets a signal when this process has ended.

    Args:
        words: arguments of Python.
        number: number of the signal; SIGKILL also ends a stopped process.
    """
    python = sys.executable
    program = _END_WITH_PARENT.format(number=int(number))
    return [python, "-c", program, str(os.getpid()), python, *words]


def free_ports(count: int) -> list[int]:
    """Return ports of the loopback interface that are not in use."""
    with contextlib.ExitStack() as holding:
        ports: list[int] = []
        for _ in range(count):
            holder = holding.enter_context(socket.socket())
            holder.bind(("127.0.0.1", 0))
            ports.append(holder.getsockname()[1])
        return ports


def memory_folder() -> str | None:
    """Return a folder in memory if there is one: a disk's write-back stalls its writers.

    Measured: 110 ms without an answer, half a minute after the truth was first written to a disk.
    """
    return SHARED_MEMORY if os.access(SHARED_MEMORY, os.W_OK | os.X_OK) else None
