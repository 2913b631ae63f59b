"""Where the project's own files are when a command does not name one."""

from pathlib import Path

from daemon.config.strict import MISSING, ConfigError


def configs_folder(option: str, wanted: str) -> Path:
    """The folder of configurations: of the clone that we run from, installed with us, or here.

    Args:
        option: that would have named the file.
        wanted: the file in that folder.

    Raises:
        ConfigError: no folder has it.
    """
    ours = Path(__file__).resolve().parent
    for folder in (ours.parent / "configs", ours / "configs", Path.cwd() / "configs"):
        if (folder / wanted).exists():
            return folder
    raise ConfigError("command line", option, MISSING, f"a file, as there is no configs/{wanted}")
