"""Files of which a power cut leaves the content of before, the new one, or none: never a part."""

import os
from pathlib import Path


def replace_file(path: Path, data: bytes, owner: tuple[int, int] | None = None) -> None:
    """Replace a file as a whole, readable by its owner alone, and wait until the disk has it.

    Args:
        path: of the file.
        data: its new content.
        owner: user and group; None: those of this process.

    Raises:
        OSError: the disk is full or fails, or the folder cannot be written.
    """
    new = path.with_name(f".{path.name}.new")
    new.unlink(missing_ok=True)
    # O_EXCL: a link is a file that exists.
    descriptor = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
    with os.fdopen(descriptor, "wb") as file:
        file.write(data)
        file.flush()
        if owner is not None:
            os.fchown(descriptor, *owner)
        os.fsync(descriptor)
    new.replace(path)
    sync_folder(path.parent)


def remove_file(path: Path) -> None:
    """Remove a file, if there is one, and wait until the disk has no name of it.

    Raises:
        OSError: it cannot be removed, or the disk fails.
    """
    path.unlink(missing_ok=True)
    sync_folder(path.parent)


def make_folder(folder: Path, mode: int = 0o777) -> None:
    """Make a folder with its parents, unless it is there, and wait until the disk has its name.

    Raises:
        OSError: it cannot be made, or the disk fails.
    """
    if not folder.is_dir():
        make_folder(folder.parent, mode)
        folder.mkdir(mode, exist_ok=True)
        sync_folder(folder.parent)


def sync_folder(folder: Path) -> None:
    """Wait until the disk has the names in a folder.

    Raises:
        OSError: the folder cannot be opened, or the disk fails.
    """
    opened = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)
