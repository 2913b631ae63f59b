"""The file that `--config` names, and its paths; nothing of drives, mechanism or numerics.

The gateway reads its configuration here: it shares no code with the drives (ARCHITECTURE.md).
"""

import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gaitd_toml import ConfigError, read_toml

from daemon.config.settings import Bus, Trainer
from daemon.config.unread import UnreadError, decoded_in_part, unless_unread

SIMULATED: Final = "simulated"
"""The interface whose channel is the socket of `gaitd sim`, which controls time."""
LABORATORY: Final = "gaitd-lab"
"""Distribution with virtual drives and simulated time; never on a trainer."""
LABORATORY_BY: Final = "pip install ./clients/python . ./gaitd_lab in a clone of gaitd"
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


def has_real_drives(bus: Bus) -> bool:
    """True unless all drives of a bus are virtual: as declared, or by its interface or its name."""
    if isinstance(bus.virtual_drives, tuple):
        return True
    on_vcan = bus.interface == "socketcan" and bus.channel.startswith("vcan")
    return not (bus.interface in (SIMULATED, "virtual") or on_vcan or bus.virtual_drives)


def drive_names(trainer: Trainer) -> tuple[str, ...]:
    """Names of all drives, LEG/AXIS, leg by leg, hip before slide."""
    return tuple(f"{leg.name}/{axis}" for leg in trainer.leg for axis in ("hip", "slide"))


def real_drives(trainer: Trainer) -> tuple[str, ...]:
    """Names of the drives that `gaitd sim` does not play on the bus of a configuration."""
    declared = trainer.bus.virtual_drives
    virtual = declared if isinstance(declared, tuple) else ()
    if not has_real_drives(trainer.bus):
        return ()
    return tuple(name for name in drive_names(trainer) if name not in virtual)


def load_trainer(path: Path) -> TrainerFile:
    """Read the trainer file alone and resolve its paths relative to its own folder.

    Raises:
        ConfigError: the file, one of its values, or one of its paths is invalid.
    """
    file, errors = read_trainer(path)
    if errors:
        raise ConfigError.combined(errors)
    return file


def read_trainer(path: Path) -> tuple[TrainerFile, list[ConfigError]]:
    """As `load_trainer`, with `UNREAD` in place of what was refused, and all errors.

    Raises:
        ConfigError: the file cannot be read, or its syntax is wrong.
    """
    document = read_toml(path)
    trainer, errors = decoded_in_part(document, Trainer)
    file = TrainerFile(
        path=path,
        sha256=document.sha256,
        trainer=trainer,
        robot=unless_unread(lambda: beside(path, trainer.robot)),
        limits=unless_unread(lambda: beside(path, trainer.limits)),
        runtime=unless_unread(lambda: beside(path, trainer.paths.runtime).absolute()),
        state=unless_unread(lambda: beside(path, trainer.paths.state).absolute()),
        sim=unless_unread(lambda: None if trainer.sim is None else beside(path, trainer.sim)),
        keys=unless_unread(
            lambda: beside(path, trainer.zenoh.keys).absolute() if trainer.zenoh.keys else None
        ),
        channel=unless_unread(lambda: _channel(path, trainer)),
    )
    for check in (_check_channel, _check_virtual_drives, _check_paths):
        with suppress(UnreadError):
            errors += check(file)
    return file, errors


def beside(file: Path, named: str) -> Path:
    """The path that `file` means by `named`: relative ones start at the file's own folder."""
    # normpath, not resolve(): the operator must recognise the path in the file.
    return Path(os.path.normpath(file.parent / named))


def is_file(path: Path) -> bool:
    """True if there is this file; there is none whose name is too long or cannot be looked up."""
    try:
        return path.is_file()
    except OSError:
        return False


def _channel(path: Path, trainer: Trainer) -> str:
    channel = trainer.bus.channel
    if trainer.bus.interface != SIMULATED:
        return channel
    return str(beside(path, channel).absolute())


def _check_channel(file: TrainerFile) -> Iterator[ConfigError]:
    simulated = file.trainer.bus.interface == SIMULATED
    if simulated and len(os.fsencode(file.channel)) > SOCKET_PATH_BYTES_MAX:
        allowed = f"the path of a socket, at most {SOCKET_PATH_BYTES_MAX} bytes"
        yield ConfigError(file.path, "bus.channel", file.channel, allowed)


def _check_virtual_drives(file: TrainerFile) -> Iterator[ConfigError]:
    names = file.trainer.bus.virtual_drives
    if not isinstance(names, tuple):
        return
    known = drive_names(file.trainer)
    wrong = [name for name in names if name not in known or names.count(name) > 1]
    if file.trainer.bus.interface == SIMULATED:
        allowed = "absent on a simulated bus: `gaitd sim --without DRIVE` leaves out a drive there"
    elif wrong:
        allowed = f"some of {', '.join(known)}, each once; not {wrong[0]}"
    elif not names or len(names) == len(known):
        allowed = f"some of {', '.join(known)}; true for all, absent for none"
    else:
        return
    yield ConfigError(file.path, "bus.virtual_drives", list(names), allowed)


def _check_paths(file: TrainerFile) -> Iterator[ConfigError]:
    path, runtime, state = file.path, file.runtime, file.state
    for key, directory in (("paths.runtime", runtime), ("paths.state", state)):
        try:
            is_taken = directory.exists() and not directory.is_dir()
        except OSError as error:
            allowed = f"the name of a directory ({(error.strerror or 'no name').lower()})"
            yield ConfigError(path, key, directory, allowed)
            continue
        if is_taken:
            yield ConfigError(path, key, directory, "a directory, or a name that is still free")
    if state == runtime or runtime in state.parents:
        outside = f"a directory outside {runtime}, which is lost in a restart of the machine"
        yield ConfigError(path, "paths.state", file.trainer.paths.state, outside)
    longest = len(os.fsencode(runtime / _LONGEST_SOCKET_NAME))
    if longest > SOCKET_PATH_BYTES_MAX:
        room = SOCKET_PATH_BYTES_MAX - len(_LONGEST_SOCKET_NAME) - 1
        allowed = (
            f"a path of at most {room} bytes, because it holds the sockets of core and gateway"
        )
        yield ConfigError(path, "paths.runtime", runtime, allowed)
