"""Reads all files of one configuration into one frozen `Settings`, or raises the first fault.

The trainer file names the others; their paths are relative to the file that names them. Each is
read once, hashed, decoded strictly (`strict.py`), and then all are compared with each other
(`files.py`). The gateway, which must not import the drives, reads the trainer file alone, with
`trainer.load_trainer`.
"""

import hashlib
from pathlib import Path

from daemon.config.baseline import load_baseline
from daemon.config.bundle import LegDrives, Settings
from daemon.config.limit_settings import Limits
from daemon.config.settings import Leg, Robot
from daemon.config.strict import ConfigError, Document, decoded, load_toml, read_toml
from daemon.config.trainer import beside, load_trainer
from daemon.preflight.files import check_together
from drives.cia402.axis_file import AxisFile
from drives.cia402.profile import DriveDescription, DriveProfile, describe
from drives.errors import DescriptionError

__all__ = ["ConfigError", "LegDrives", "Settings", "load", "load_toml", "read_all"]


def load(path: Path) -> Settings:
    """Read a trainer file and all that it names.

    Raises:
        ConfigError: the first problem, by file, key, value and what would be allowed.
    """
    settings = read_all(path)
    check_together(settings)
    return settings


def read_all(path: Path) -> Settings:
    """Read the files of a trainer file, each valid in itself, not yet compared with each other.

    Raises:
        ConfigError: a file cannot be read, or one of its values is not allowed.
    """
    file = load_trainer(path)
    reader = _Reader({str(path): file.sha256})
    trainer = file.trainer
    robot = decoded(reader.document(path, "robot", trainer.robot), Robot)
    limits = decoded(reader.document(path, "limits", trainer.limits), Limits)
    legs = tuple(
        _leg(reader, path, f"leg[{index}]", leg, file.robot)
        for index, leg in enumerate(file.trainer.leg)
    )
    return Settings(file=file, robot=robot, limits=limits, legs=legs, hashes=reader.hashes)


class _Reader:
    """Reads files that other files name, each once, and keeps their hashes."""

    def __init__(self, hashes: dict[str, str]) -> None:
        self.hashes = hashes
        self._documents: dict[Path, Document] = {}

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
        self.hashes[str(path)] = hashlib.sha256(path.read_bytes()).hexdigest()
        return path


def _existing(named_in: Path, key: str, name: str) -> Path:
    path = beside(named_in, name)
    if not path.is_file():
        raise ConfigError(named_in, key, name, f"a file that exists; there is no {path}")
    return path


def _leg(reader: _Reader, path: Path, key: str, leg: Leg, robot: Path) -> LegDrives:
    baseline = None
    if leg.baseline is not None:
        named = reader.hashed(path, f"{key}.baseline", leg.baseline)
        baseline = load_baseline(named, reader.hashes[str(robot)])
    return LegDrives(
        name=leg.name,
        hip=_drive(reader, f"{leg.name}/hip", path, f"{key}.hip", leg.hip),
        slide=_drive(reader, f"{leg.name}/slide", path, f"{key}.slide", leg.slide),
        hip_file=beside(path, leg.hip),
        slide_file=beside(path, leg.slide),
        baseline=baseline,
    )


def _drive(reader: _Reader, name: str, trainer: Path, key: str, file: str) -> DriveDescription:
    axis_document = reader.document(trainer, key, file)
    axis = decoded(axis_document, AxisFile)
    profile_document = reader.document(axis_document.path, "profile", axis.profile)
    profile = decoded(profile_document, DriveProfile)
    eds = reader.hashed(axis_document.path, "eds", axis.eds)
    try:
        return describe(name, profile, axis, str(eds))
    except DescriptionError as error:
        at_fault = profile_document if error.part == "profile" else axis_document
        raise ConfigError(at_fault.path, error.key, error.value, error.allowed) from error
