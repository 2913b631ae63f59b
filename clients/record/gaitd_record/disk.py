"""Names of files on the disk."""

import os
from pathlib import Path


def sync_folder(folder: Path) -> None:
    """Wait until the disk has the names in a folder: fsync of a file does not bring its name.

    Raises:
        OSError: the folder cannot be opened, or the disk fails.
    """
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def replace(draft: Path, path: Path) -> None:
    """Give a whole file its name, once it is on the disk.

    Raises:
        OSError: it cannot be brought to the disk.
    """
    with draft.open("rb") as file:
        os.fsync(file.fileno())
    draft.replace(path)
