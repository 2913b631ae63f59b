"""Whether this process can open another file or connection."""

import os


def has_free_descriptor() -> bool:
    """Try to open a file; False if the process or the machine has no descriptor left."""
    try:
        descriptor = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return False
    os.close(descriptor)
    return True
