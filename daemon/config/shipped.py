"""The folder of the configurations that come with the project."""

from pathlib import Path

from gaitd_toml import COMMAND_LINE, MISSING, ConfigError


def configs_folder(option: str, wanted: str) -> Path:
    """Find the folder of configurations: in the clone, the installation or the current folder.

    Args:
        option: the option that would have named the file.
        wanted: the file in that folder.

    Raises:
        ConfigError: no folder has the file.
    """
    root = Path(__file__).resolve().parents[2]
    for folder in (root / "configs", root / "gaitd" / "configs", Path.cwd() / "configs"):
        if (folder / wanted).exists():
            return folder
    raise ConfigError(COMMAND_LINE, option, MISSING, f"a file, as there is no configs/{wanted}")
