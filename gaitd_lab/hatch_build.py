"""Build hook of hatchling: which folders are in wheel and source distribution of gaitd-lab.

In a clone two of its packages are beside this folder, and hatchling takes no folder from there by
itself. In an unpacked source distribution all three are in the folder of the project file.
"""

from pathlib import Path
from typing import Any, Final

from hatchling.builders.config import BuilderConfig
from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PACKAGES: Final = ("gaitd_lab", "sim_drives", "simtime")
NOT_OF_A_PACKAGE: Final = ("LICENSE", "hatch_build.py", "pyproject.toml")


class Packages(BuildHookInterface[BuilderConfig]):
    """Includes every file of the packages."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Name the files, unless the installation is editable: that one names a folder."""
        if version == "editable":
            return
        here = Path(self.root)
        around = here if (here / "simtime").is_dir() else here.parent
        for package in PACKAGES:
            for file in (around / package).rglob("*.*"):
                if file.suffix != ".pyc" and file.name not in NOT_OF_A_PACKAGE:
                    build_data["force_include"][str(file)] = str(file.relative_to(around))
