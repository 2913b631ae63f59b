"""What a core says while it starts, and has no ring yet: pid and text in a file beside the ring.

A core that has ended, however that was, says nothing: its pid is gone.
"""

import os
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

STARTING_NAME: Final = "core.starting"
COMPILES: Final = "the core starts; the first start of a version compiles for a minute or two"


@contextmanager
def said(runtime: Path) -> Generator[None]:
    """Say that the core starts, until `begun` or the end of the block."""
    # A directory that cannot be used is the error of those who need it: this is only a notice.
    with suppress(OSError):
        runtime.mkdir(parents=True, exist_ok=True)
        (runtime / STARTING_NAME).write_text(f"{os.getpid()}\n{COMPILES}\n", encoding="utf-8")
    try:
        yield
    finally:
        begun(runtime)


def begun(runtime: Path) -> None:
    """Say no longer that this core starts."""
    with suppress(OSError):
        (runtime / STARTING_NAME).unlink(missing_ok=True)


def starting(runtime: Path) -> str:
    """What the core of this directory says while it starts; empty if none starts."""
    try:
        pid, _, text = (runtime / STARTING_NAME).read_text(encoding="utf-8").partition("\n")
        os.kill(int(pid), 0)
    except PermissionError:
        return COMPILES  # of another user's process, which is there
    except (OSError, ValueError, OverflowError):
        return ""
    return text.strip()
