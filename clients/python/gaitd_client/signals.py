"""The signals that end a client's program in order: only the first one counts.

What ends in order may take seconds: drives are switched off, a lease is released. An exception of
a second signal would leave that half done.
"""

import signal
from collections.abc import Generator
from contextlib import contextmanager
from types import FrameType
from typing import Final

ENDS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that end a program: Ctrl-C, an end by the system, a terminal that is closed."""


@contextmanager
def interrupted_once() -> Generator[None]:
    """Let the first of these signals raise KeyboardInterrupt, and ignore those after it."""
    before = [signal.signal(end, _interrupt) for end in ENDS]
    try:
        yield
    finally:
        for end, handler in zip(ENDS, before, strict=True):
            signal.signal(end, handler)


def ignore_ends() -> None:
    """Ignore these signals from now on, because the end has begun without one."""
    for end in ENDS:
        signal.signal(end, signal.SIG_IGN)


def _interrupt(_signal: int, _frame: FrameType | None) -> None:
    ignore_ends()
    raise KeyboardInterrupt
