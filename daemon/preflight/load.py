"""Reads all files of one configuration into one frozen `Settings`, or raises all faults together.

The trainer file names the others; their paths are relative to the file that names them. Each is
read once, hashed, decoded strictly (`gaitd_toml`), and then all are compared with each other
(`files.py`). A refused table or file hides no fault of another: the checks that do not need it
still run. The gateway, which must not import the drives, reads the trainer file alone, with
`trainer.load_trainer`.
"""

import hashlib
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from gaitd_toml import ConfigError, Document, load_toml, read_bytes, read_toml

from daemon.config.baseline import load_baseline
from daemon.config.bundle import LegDrives, Settings
from daemon.config.limit_settings import Limits
from daemon.config.robot import frictional
from daemon.config.settings import Leg, Robot
from daemon.config.trainer import beside, is_file, read_trainer
from daemon.config.unread import UNREAD, UnreadError, decoded_in_part, is_read, unless_unread
from daemon.preflight.files import check_all
from drives.cia402.axis_file import AxisFile
from drives.cia402.profile import DriveDescription, DriveProfile, contradictions

T = TypeVar("T")

__all__ = ["ConfigError", "LegDrives", "Settings", "load", "load_toml", "read_all"]


def load(path: Path) -> Settings:
    """Read a trainer file and all that it names.

    Raises:
        ConfigError: all problems, by file, key, value and what would be allowed.
    """
    settings, errors = read_in_part(path)
    errors += check_all(settings).errors
    if errors:
        raise ConfigError.combined(errors)
    return settings


def read_all(path: Path) -> Settings:
    """Read the files of a trainer file, each valid in itself, not yet compared with each other.

    Raises:
        ConfigError: a file cannot be read, or values in it are not allowed.
    """
    settings, errors = read_in_part(path)
    if errors:
        raise ConfigError.combined(errors)
    return settings


def read_in_part(path: Path) -> tuple[Settings, list[ConfigError]]:
    """As `read_all`, with `UNREAD` in place of each refused table or file, and all errors.

    Raises:
        ConfigError: the trainer file cannot be read, or its syntax is wrong.
    """
    file, errors = read_trainer(path)
    reader = _Reader({str(path): file.sha256}, errors)
    trainer = file.trainer
    robot = reader.table(path, "robot", lambda: trainer.robot, Robot)
    return Settings(
        file=file,
        robot=robot,
        limits=reader.table(path, "limits", lambda: trainer.limits, Limits),
        legs=unless_unread(
            lambda: tuple(
                _leg(reader, path, f"leg[{index}]", leg, file.robot, robot)
                for index, leg in enumerate(trainer.leg)
            )
        ),
        hashes=reader.hashes,
    ), errors


class _Reader:
    """Reads files that other files name, each once, and keeps their hashes and all errors."""

    def __init__(self, hashes: dict[str, str], errors: list[ConfigError]) -> None:
        self.hashes = hashes
        self.errors = errors
        self._documents: dict[Path, Document] = {}
        self._tables: dict[Path, Any] = {}

    def table(self, named_in: Path, key: str, name: Callable[[], str], kind: type[T]) -> T:
        """The contents of a file, or as much of it as can be decoded; `UNREAD` without it."""
        with self.collected():
            document = self.document(named_in, key, name())
            if document.path not in self._tables:
                self._tables[document.path], errors = decoded_in_part(document, kind)
                self.errors += errors
            return self._tables[document.path]
        return UNREAD

    @contextmanager
    def collected(self) -> Generator[None]:
        """Collect an error; what follows in the block is left out, as where a value is unread."""
        try:
            yield
        except ConfigError as error:
            self.add(error)
        except UnreadError:
            pass

    def add(self, error: ConfigError) -> None:
        """Add an error once, although two drives share the file that is wrong."""
        if str(error) not in map(str, self.errors):
            self.errors.append(error)

    def document(self, named_in: Path, key: str, name: str) -> Document:
        """The file that `named_in` refers to; if missing, the error is reported for `named_in`."""
        path = _existing(named_in, key, name)
        if path not in self._documents:
            self._documents[path] = read_toml(path)
            self.hashes[str(path)] = self._documents[path].sha256
        return self._documents[path]

    def hashed(self, named_in: Path, key: str, name: str) -> Path:
        """Hash a file that is parsed elsewhere, and return its path."""
        path = _existing(named_in, key, name)
        self.hashes[str(path)] = hashlib.sha256(read_bytes(path, "file")).hexdigest()
        return path


def _existing(named_in: Path, key: str, name: str) -> Path:
    path = beside(named_in, name)
    if not is_file(path):
        raise ConfigError(named_in, key, name, f"a file that exists; there is no {path}")
    return path


def _leg(
    reader: _Reader, path: Path, key: str, leg: Leg, robot_file: Path, robot: Robot
) -> LegDrives:
    baseline = None
    if leg.baseline is not None:
        with reader.collected():
            named = reader.hashed(path, f"{key}.baseline", leg.baseline)
            if str(robot_file) in reader.hashes:
                hashed = reader.hashes[str(robot_file)]
                baseline = load_baseline(named, hashed, frictional(robot))
    return LegDrives(
        name=leg.name,
        hip=_drive(reader, f"{leg.name}/hip", path, f"{key}.hip", leg.hip),
        slide=_drive(reader, f"{leg.name}/slide", path, f"{key}.slide", leg.slide),
        hip_file=beside(path, leg.hip),
        slide_file=beside(path, leg.slide),
        baseline=baseline,
    )


def _drive(reader: _Reader, name: str, trainer: Path, key: str, file: str) -> DriveDescription:
    path = beside(trainer, file)
    axis = reader.table(trainer, key, lambda: file, AxisFile)
    profile = reader.table(path, "profile", lambda: axis.profile, DriveProfile)
    eds = ""
    with reader.collected():
        eds = str(reader.hashed(path, "eds", axis.eds))
    if not (is_read(axis) and is_read(profile)):
        return UNREAD
    paths = {"axis": path, "profile": beside(path, axis.profile)}
    errors = contradictions(profile, axis)
    for error in errors:
        reader.add(ConfigError(paths[error.part], error.key, error.value, error.allowed))
    return UNREAD if errors else DriveDescription(name, profile, axis, eds)
