"""Lock of a service directory: creates it and lets only one process of each kind use it.

The lock is the kernel's (flock(2)): it ends with its process, however that ends, so a `kill -9`
leaves nothing to clean up. The lock file contains the pid of its holder.

Two cores on one runtime directory would take each other's socket and ring; two on one state
directory would overwrite each other's state file.
"""

import contextlib
import errno
import fcntl
import os
from collections.abc import Generator
from pathlib import Path
from typing import BinaryIO, Final

from gaitd_toml import ConfigError

from daemon.system.files import make_folder

_HELD: Final = (errno.EAGAIN, errno.EACCES)
"""Error numbers of flock(2) for a lock held by another process; the second on some file systems."""
_PID_LENGTH_MAX: Final = 20


@contextlib.contextmanager
def hold(config: Path, key: str, directory: Path, part: str) -> Generator[None]:
    """Create the directory, and keep every other process of this kind out of it.

    Args:
        config: the trainer file.
        key: of the trainer file that names the directory.
        directory: made with its parents, if it is not there.
        part: `core` or `gateway`; the lock is `PART.lock`.

    Raises:
        ConfigError: the directory cannot be made or written, or another process holds it.
    """
    path = directory / f"{part}.lock"
    with directory_errors(config, key, directory):
        make_folder(directory)
        file = path.open("ab+", buffering=0)
    with file:
        with directory_errors(config, key, directory):
            if not _lock(file):
                allowed = f"a directory of its own: a gaitd {part}{_holder(file)} holds {path}"
                raise ConfigError(config, key, directory, allowed, following="gaitd status")
            file.truncate(0)
            file.write(b"%d\n" % os.getpid())
        yield


@contextlib.contextmanager
def directory_errors(config: Path, key: str, directory: Path) -> Generator[None]:
    """Convert errors of the system about a service directory into configuration errors.

    Raises:
        ConfigError: in place of an OSError, with the system's message.
    """
    try:
        yield
    except OSError as error:
        place = f" ({error.filename})" if error.filename else ""
        allowed = f"a directory that can be written: {error.strerror}{place}"
        raise ConfigError(config, key, directory, allowed, following="") from error


def _lock(file: BinaryIO) -> bool:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in _HELD:
            return False
        raise
    return True


def _holder(file: BinaryIO) -> str:
    file.seek(0)
    pid = file.read(_PID_LENGTH_MAX).decode("ascii", "replace").strip()
    return f" with pid {pid}" if pid else ""
