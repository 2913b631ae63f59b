"""`python -m gaitd_lab.reference.pages FOLDER`: write the generated parts of its pages."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from gaitd_toml import decoded, read_toml

from analysis import markdown
from daemon.config.limit_settings import Limits
from daemon.config.shipped import configs_folder
from gaitd_lab.reference import bits, modes, roles, schemas, typescript

TYPES: Final = "../clients/display/gaitd_display/static/gaitd.d.mts"
"""Seen from docs/."""


def parts() -> Mapping[str, Mapping[str, str]]:
    """Return the generated parts of each page; categories are those of the shipped limits.toml."""
    file = configs_folder("configs", "limits.toml") / "limits.toml"
    return {
        "bits.md": bits.parts(),
        "messages.md": schemas.message_parts(),
        "configuration.md": schemas.configuration_parts(),
        "modes.md": modes.parts(decoded(read_toml(file), Limits).stop_category),
        "security.md": roles.parts(),
        # In a comment that the part closes and opens.
        TYPES: {"messages": f"*/\n{typescript.declarations()}\n/*"},
    }


def write(folder: Path) -> None:
    """Write the parts into the pages of this folder.

    Raises:
        OSError: a page cannot be read or written.
        ValueError: a page has no place for one of its parts.
    """
    for name, made in parts().items():
        page = folder / name
        page.write_text(markdown.filled(page.read_text("utf-8"), made), "utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
