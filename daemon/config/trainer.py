"""The file that `--config` names, and its paths; nothing of drives, mechanism or numerics.

The gateway reads its configuration here: it shares no code with the drives (ARCHITECTURE.md).
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from daemon.config.settings import Trainer
from daemon.config.strict import ConfigError, decoded, read_toml

SIMULATED: Final = "simulated"
"""The interface whose channel is the socket of `gaitd sim`, which controls time."""
SOCKET_PATH_BYTES_MAX: Final = 107
"""sun_path of unix(7) holds 108 bytes with the closing zero."""
_LONGEST_SOCKET_NAME: Final = "gateway.sock"


@dataclass(frozen=True, slots=True)
class TrainerFile:
    """The trainer file and every path it names, absolute or relative to the working directory."""

    path: Path
    sha256: str
    trainer: Trainer
    robot: Path
    limits: Path
    runtime: Path
    """Directory of the IPC channel: ring and sockets."""
    state: Path
    """Directory that survives a restart."""
    sim: Path | None
    """plant.toml of the virtual drives."""
    keys: Path | None
    """Folder of `gaitd keys`; None: clients need no keys."""
    channel: str
    """Channel of the bus; an absolute path where the bus is simulated."""


def load_trainer(path: Path) -> TrainerFile:
    """Read the trainer file alone and resolve its paths relative to its own folder.

    Raises:
        ConfigError: the file, one of its values, or one of its paths is invalid.
    """
    document = read_toml(path)
    trainer = decoded(document, Trainer)
    _check_paths(path, trainer)
    return TrainerFile(
        path=path,
        sha256=document.sha256,
        trainer=trainer,
        robot=beside(path, trainer.robot),
        limits=beside(path, trainer.limits),
        runtime=beside(path, trainer.paths.runtime).absolute(),
        state=beside(path, trainer.paths.state).absolute(),
        sim=beside(path, trainer.sim) if trainer.sim is not None else None,
        keys=beside(path, trainer.zenoh.keys).absolute() if trainer.zenoh.keys else None,
        channel=_channel(path, trainer),
    )


def beside(file: Path, named: str) -> Path:
    """The path that `file` means by `named`: relative ones start at the file's own folder."""
    # normpath, not resolve(): the operator must recognise the path in the file.
    return Path(os.path.normpath(file.parent / named))


def _channel(path: Path, trainer: Trainer) -> str:
    channel = trainer.bus.channel
    if trainer.bus.interface != SIMULATED:
        return channel
    absolute = str(beside(path, channel).absolute())
    if len(os.fsencode(absolute)) > SOCKET_PATH_BYTES_MAX:
        allowed = f"the path of a socket, at most {SOCKET_PATH_BYTES_MAX} bytes"
        raise ConfigError(path, "bus.channel", absolute, allowed)
    return absolute


def _check_paths(path: Path, trainer: Trainer) -> None:
    runtime = beside(path, trainer.paths.runtime).absolute()
    state = beside(path, trainer.paths.state).absolute()
    for key, directory in (("paths.runtime", runtime), ("paths.state", state)):
        if directory.exists() and not directory.is_dir():
            raise ConfigError(path, key, directory, "a directory, or a name that is still free")
    if state == runtime or runtime in state.parents:
        outside = f"a directory outside {runtime}, which is lost in a restart of the machine"
        raise ConfigError(path, "paths.state", trainer.paths.state, outside)
    longest = len(os.fsencode(runtime / _LONGEST_SOCKET_NAME))
    if longest > SOCKET_PATH_BYTES_MAX:
        room = SOCKET_PATH_BYTES_MAX - len(_LONGEST_SOCKET_NAME) - 1
        allowed = (
            f"a path of at most {room} bytes, because it holds the sockets of core and gateway"
        )
        raise ConfigError(path, "paths.runtime", runtime, allowed)
