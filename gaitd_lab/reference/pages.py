"""`python -m gaitd_lab.reference.pages FOLDER`: write the generated parts of its pages."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from gaitd_toml import decoded, read_toml

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
        page.write_text(filled(page.read_text("utf-8"), made), "utf-8")


def filled(text: str, parts: Mapping[str, str]) -> str:
    """Return a page with the text between the comments `NAME: begin` and `NAME: end` replaced.

    Args:
        text: the page.
        parts: new text of each name.

    Raises:
        ValueError: the page has no place for one of them.
    """
    for name, part in parts.items():
        begin, end = f"<!-- {name}: begin -->\n", f"<!-- {name}: end -->"
        before, found, rest = text.partition(begin)
        _, closed, after = rest.partition(end)
        if not (found and closed):
            raise ValueError(f"the page has no lines {begin!r} and {end!r}")
        text = f"{before}{begin}{part}\n{end}{after}"
    return text


if __name__ == "__main__":
    write(Path(sys.argv[1]))
