"""What the computer says of a process that is waited for."""

from pathlib import Path
from typing import Final

STOPPED: Final = "T"
"""As after SIGSTOP: it is not waited for."""
IN_A_DEBUGGER: Final = "t"
"""At a breakpoint: it is waited for, however long."""


def process_state(pid: int) -> str:
    """The state of a process as /proc has it, `T` for a stopped one; empty if it is gone."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace")
    except OSError:
        return ""
    return text.rpartition(")")[2].split()[0]
