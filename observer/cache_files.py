"""Files of compiled kernels on the disk: none that a power cut may have torn is ever loaded.

numba writes them without fsync, as pickles without a checksum: after a power cut a file may have
its name and its size, and zeros or nothing in it. So `settle` brings files to the disk, and notes
their sizes and times in a file beside them. A process that begins to use a cache calls `enter`: it
removes what is not noted, unless another process uses the same cache; after a power cut none does.
numba compiles again what is missing.
"""

import contextlib
import fcntl
import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Final

NOTES: Final = "settled.json"
LOCK: Final = "in_use.lock"
ENDS: Final = (".nbi", ".nbc")
Files = dict[str, list[int]]
"""Size in bytes and time of change in ns, by path below the folder."""


def enter(folder: Path) -> int:
    """Remove the files that may not be whole, if this process is the only one here.

    Returns: a descriptor; while it is open no other process removes anything.

    Raises:
        OSError: they cannot be removed.
    """
    lock = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    with contextlib.suppress(BlockingIOError):
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        settled = _notes(folder)
        for name, stamp in _files(folder).items():
            if settled.get(name) != stamp:
                (folder / name).unlink(missing_ok=True)
    fcntl.flock(lock, fcntl.LOCK_SH)
    return lock


def settle(folder: Path) -> int:
    """Bring all files to the disk that are not noted yet; returns their number.

    Raises:
        OSError: the disk is full or fails.
    """
    settled = _notes(folder)
    found = _files(folder)
    new = [folder / name for name, stamp in found.items() if settled.get(name) != stamp]
    if new:
        _sync({*new, *(path.parent for path in new), folder, folder.parent})
        _write_notes(folder, found)
    return len(new)


def _notes(folder: Path) -> Files:
    """What is noted; nothing if there are no notes, or torn ones."""
    try:
        return json.loads((folder / NOTES).read_bytes())
    except (FileNotFoundError, ValueError):
        return {}


def _write_notes(folder: Path, files: Files) -> None:
    new = folder / f"{NOTES}.{os.getpid()}"  # other processes may do the same
    new.write_text(json.dumps(files, indent=0))
    _sync([new])
    new.replace(folder / NOTES)
    _sync([folder])


def _files(folder: Path) -> Files:
    found: Files = {}
    for path in sorted(folder.rglob("*")):
        if path.suffix in ENDS:
            with contextlib.suppress(FileNotFoundError):  # another process has removed it
                stat = path.stat()
                found[str(path.relative_to(folder))] = [stat.st_size, stat.st_mtime_ns]
    return found


def _sync(paths: Iterable[Path]) -> None:
    for path in paths:
        with contextlib.suppress(FileNotFoundError):
            opened = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
            try:
                os.fsync(opened)
            finally:
                os.close(opened)
