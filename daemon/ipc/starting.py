"""What a core says while it starts, and has no ring yet: a lock on a file beside the ring.

The lock is the kernel's (flock(2)): it ends with its process, however that ends. Several cores may
hold it at a time; the reader looks whether any does.
"""

import fcntl
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Final

STARTING_NAME: Final = "core.starting"


@contextmanager
def said(runtime: Path) -> Generator[Callable[[], None]]:
    """Say that the core starts, until the yielded function is called, or the block ends."""
    with ExitStack() as saying:
        # A directory that cannot be used is the error of those who need it: this is only a notice.
        with suppress(OSError):
            runtime.mkdir(parents=True, exist_ok=True)
            file = saying.enter_context((runtime / STARTING_NAME).open("ab"))
            # Never waits: a reader that is stopped at the wrong moment must not hold up a core.
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        yield saying.close


def starting(runtime: Path) -> bool:
    """Return whether a core of this directory starts."""
    try:
        with (runtime / STARTING_NAME).open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:  # the lock is held; or no core has ever started here
        return isinstance(error, BlockingIOError)
    return False
