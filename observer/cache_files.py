"""Files of compiled kernels on the disk: none that a power cut may have torn is ever loaded.

numba writes them without fsync, as pickles without a checksum: after a power cut a file may have
its name and its size, and zeros or nothing in it. So `settle` brings files to the disk, and notes
their sizes and times in a file beside them. The first process after a start of the computer calls
`remove_unsettled`: it removes what is not noted. numba compiles again what is missing.
"""

import contextlib
import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Final

NOTES: Final = "settled.json"
ENDS: Final = (".nbi", ".nbc")
Files = dict[str, list[int]]
"""Size in bytes and time of change in ns, by path below the folder."""


def remove_unsettled(folder: Path, boot_id: str) -> int:
    """Remove the files that may not be whole; returns their number.

    Args:
        folder: of one cache.
        boot_id: another one after each start of the computer; what was written since is whole.

    Raises:
        OSError: they cannot be removed, or the disk fails.
    """
    noted_boot_id, settled = _notes(folder)
    if noted_boot_id == boot_id:
        return 0
    found = _files(folder)
    torn = [name for name, stamp in found.items() if settled.get(name) != stamp]
    for name in torn:
        (folder / name).unlink(missing_ok=True)
    _write_notes(folder, boot_id, {n: stamp for n, stamp in found.items() if n not in torn})
    return len(torn)


def settle(folder: Path, boot_id: str) -> int:
    """Bring all files to the disk that are not noted yet; returns their number.

    Raises:
        OSError: the disk is full or fails.
    """
    _, settled = _notes(folder)
    found = _files(folder)
    new = [folder / name for name, stamp in found.items() if settled.get(name) != stamp]
    if new:
        _sync({*new, *(path.parent for path in new), folder, folder.parent})
        _write_notes(folder, boot_id, found)
    return len(new)


def _notes(folder: Path) -> tuple[str, Files]:
    """Boot id and files as noted; nothing if there are no notes, or torn ones."""
    try:
        notes = json.loads((folder / NOTES).read_bytes())
        return notes["boot_id"], notes["files"]
    except (FileNotFoundError, ValueError, KeyError, TypeError):
        return "", {}


def _write_notes(folder: Path, boot_id: str, files: Files) -> None:
    new = folder / f"{NOTES}.{os.getpid()}"  # other processes may do the same
    new.write_text(json.dumps({"boot_id": boot_id, "files": files}, indent=0))
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
