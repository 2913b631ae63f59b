"""Processes that end with us, and where they and their files find room."""

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
"""Asks the kernel for a signal when we are gone, however we went (PR_SET_PDEATHSIG), and becomes
the command behind it, if we are not gone already. A function between fork and exec would do the
same, but not beside threads."""


def tied(*words: str, number: signal.Signals = signal.SIGTERM) -> list[str]:
    """The command `python WORDS...` that gets a signal when this process is gone.

    Args:
        words: what Python runs.
        number: of the signal; SIGKILL also ends what is stopped and cannot obey.
    """
    python = sys.executable
    program = _END_WITH_PARENT.format(number=int(number))
    return [python, "-c", program, str(os.getpid()), python, *words]


def free_ports(count: int) -> list[int]:
    """Ports of the loopback interface that nobody listens on now."""
    with contextlib.ExitStack() as holding:
        ports: list[int] = []
        for _ in range(count):
            holder = holding.enter_context(socket.socket())
            holder.bind(("127.0.0.1", 0))
            ports.append(holder.getsockname()[1])
        return ports


def memory_folder() -> str | None:
    """A file system in memory where there is one: a disk that writes back stalls who writes to it.

    Measured: 110 ms without an answer, half a minute after the truth was first written to a disk.
    """
    return SHARED_MEMORY if os.access(SHARED_MEMORY, os.W_OK | os.X_OK) else None
