"""Search for the project's own files when a command line does not name them."""

from pathlib import Path

from daemon.config.strict import MISSING, ConfigError


def configs_folder(option: str, wanted: str) -> Path:
    """Find the folder of configurations: in the clone, the installation or the current folder.

    Args:
        option: the option that would have named the file.
        wanted: the file in that folder.

    Raises:
        ConfigError: no folder has the file.
    """
    ours = Path(__file__).resolve().parent
    for folder in (ours.parent / "configs", ours / "configs", Path.cwd() / "configs"):
        if (folder / wanted).exists():
            return folder
    raise ConfigError("command line", option, MISSING, f"a file, as there is no configs/{wanted}")
