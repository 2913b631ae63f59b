"""Load: processes that only compute, beside what is measured."""

import contextlib
import os
import subprocess
import sys
from collections.abc import Generator
from typing import Final

from gaitd.demonstration.stage import END_WITH_PARENT

BURN: Final = "while True: pass"


@contextlib.contextmanager
def burners(count: int) -> Generator[None]:
    """So many of them, which end with us."""
    python = sys.executable
    command = [python, "-c", END_WITH_PARENT, str(os.getpid()), python, "-c", BURN]
    burning = [subprocess.Popen(command) for _ in range(count)]
    try:
        yield
    finally:
        for process in burning:
            process.kill()
            process.wait()
