"""The calibrated robot.toml: the given file with some numbers replaced."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from daemon.config.edits import Value, edited
from daemon.config.settings import Robot
from daemon.config.strict import Document, decoded

DIGITS: Final = 6


def write(given: Path, output: Path, values: Mapping[str, tuple[Value, str]]) -> None:
    """Write the calibrated file beside the given one.

    Args:
        given: the initial robot file.
        output: another file, replaced if it exists.
        values: value and comment by dotted key.

    Raises:
        EditError: a key has no line of its own.
        ConfigError: the result would not be a valid robot file; nothing is written.
        OSError: the file cannot be written.
    """
    with given.open(encoding="utf-8", newline="") as file:
        text = file.read()
    for key, (value, comment) in values.items():
        short = float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value
        text = edited(given.name, text, key, short, comment)
    decoded(Document(output, "", tomllib.loads(text)), Robot)
    with output.open("w", encoding="utf-8", newline="") as file:
        file.write(text)
