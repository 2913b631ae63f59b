"""Sockets of another process, shut down from outside: a network that is gone in the middle."""

import contextlib
import ctypes
import os
import socket
from pathlib import Path

PIDFD_GETFD = 438
"""System call number, the same on all architectures (Linux 5.6)."""
LISTENING, ESTABLISHED = "0A", "01"


def cut(pid: int, port: int, state: str) -> int:
    """Shut down a process' TCP sockets on a local port; how many.

    Raises:
        OSError: this needs ptrace rights, and a kernel that knows pidfd_getfd.
    """
    inodes = _inodes(pid, port, state)
    pidfd = os.pidfd_open(pid)
    try:
        return sum(_shut_down(pidfd, number) for number in _numbers(pid, inodes))
    finally:
        os.close(pidfd)


def _inodes(pid: int, port: int, state: str) -> set[str]:
    lines = Path(f"/proc/{pid}/net/tcp").read_text().splitlines()[1:]
    rows = [line.split() for line in lines]
    return {row[9] for row in rows if row[1].endswith(f":{port:04X}") and row[3] == state}


def _numbers(pid: int, inodes: set[str]) -> list[int]:
    found = []
    for link in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):
            target = str(link.readlink())
            if target.startswith("socket:[") and target[8:-1] in inodes:
                found.append(int(link.name))
    return found


def _shut_down(pidfd: int, number: int) -> bool:
    libc = ctypes.CDLL(None, use_errno=True)
    ours = libc.syscall(PIDFD_GETFD, pidfd, number, 0)
    if ours < 0:
        raise OSError(ctypes.get_errno(), "pidfd_getfd")
    with socket.socket(fileno=ours) as end:
        end.shutdown(socket.SHUT_RDWR)
    return True
