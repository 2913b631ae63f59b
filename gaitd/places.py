"""Where the project's own files are when a command does not name one."""

from pathlib import Path

from daemon.config.strict import MISSING, ConfigError


def configs_folder(option: str, wanted: str) -> Path:
    """The folder of configurations: of the clone that we run from, or where we are.

    Args:
        option: that would have named the file.
        wanted: the file in that folder.

    Raises:
        ConfigError: neither folder has it.
    """
    for folder in (Path(__file__).resolve().parent.parent / "configs", Path.cwd() / "configs"):
        if (folder / wanted).exists():
            return folder
    raise ConfigError("command line", option, MISSING, f"a file, as there is no configs/{wanted}")
