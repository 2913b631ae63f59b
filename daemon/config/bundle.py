"""The whole configuration of the service: every file read, hashed and decoded."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from daemon.config.limit_settings import Limits
from daemon.config.settings import Robot, Trainer
from daemon.config.trainer import TrainerFile
from drives.cia402.profile import DriveDescription
from observer.baseline import Baseline


@dataclass(frozen=True, slots=True)
class LegDrives:
    """The two drives of one leg, and the axis files that describe them."""

    name: str
    """`right` or `left`."""
    hip: DriveDescription
    slide: DriveDescription
    hip_file: Path
    slide_file: Path
    baseline: Baseline | None = None
    """What a passive patient has shown; None: nothing."""


@dataclass(frozen=True, slots=True)
class Settings:
    """One configuration, read once; no file is kept open or read again."""

    file: TrainerFile
    """The trainer file with its resolved paths."""
    robot: Robot
    limits: Limits
    legs: tuple[LegDrives, ...]
    hashes: Mapping[str, str]
    """SHA-256 of each file that was read, by its path."""

    @property
    def trainer(self) -> Trainer:
        """The contents of the trainer file."""
        return self.file.trainer

    @property
    def runtime(self) -> Path:
        """Absolute path of the directory of ring and sockets."""
        return self.file.runtime

    @property
    def state(self) -> Path:
        """Absolute path of the directory that survives a restart."""
        return self.file.state

    @property
    def drives(self) -> tuple[DriveDescription, ...]:
        """All drives, leg by leg, hip before slide: the order of the records."""
        return tuple(drive for leg in self.legs for drive in (leg.hip, leg.slide))
