"""State of a process that simulated time waits for."""

from pathlib import Path
from typing import Final

STOPPED: Final = "T"
"""Stopped, as after SIGSTOP: the process is not waited for."""
IN_A_DEBUGGER: Final = "t"
"""Stopped by a debugger: the process is waited for without a limit."""


def process_state(pid: int) -> str:
    """Return the state of a process from /proc, `T` for a stopped one; empty if it is gone."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace")
    except OSError:
        return ""
    return text.rpartition(")")[2].split()[0]
