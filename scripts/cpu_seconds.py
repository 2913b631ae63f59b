"""Run a step of `make test` and log its CPU-seconds: cpu_seconds.py FILE NAME COMMAND ...

Adds a line `SECONDS NAME` to FILE, which pytest prints with its own figures
(tests/support/cpu_seconds.py). The exit code is that of the command.
"""

import resource
import subprocess
import sys
from pathlib import Path


def main() -> int:
    """Run the command, log its CPU time, and return its exit code."""
    file, name, *command = sys.argv[1:]
    code = subprocess.run(command, check=False).returncode
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    with Path(file).open("a", encoding="utf-8") as notes:
        notes.write(f"{used.ru_utime + used.ru_stime:.1f} {name}\n")
    return code


if __name__ == "__main__":
    sys.exit(main())
