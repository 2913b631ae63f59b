"""Load: processes that only compute, running beside a measurement."""

import contextlib
import subprocess
from collections.abc import Generator
from typing import Final

from gaitd_lab.processes import tied

BURN: Final = "while True: pass"


@contextlib.contextmanager
def burners(count: int) -> Generator[None]:
    """Start this many load processes, which end with this process."""
    burning = [subprocess.Popen(tied("-c", BURN)) for _ in range(count)]
    try:
        yield
    finally:
        for process in burning:
            process.kill()
            process.wait()
