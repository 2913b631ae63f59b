"""The calibrated robot.toml: the given file with some numbers replaced."""

import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

from gaitd_toml import MISSING, SMALLEST, ConfigError, Document, decoded

from daemon.config.edits import Value, edited
from daemon.config.settings import Robot

DIGITS: Final = 6


def refuse_missing_lines(document: Document, option: str, keys: Iterable[str]) -> None:
    """Refuse a robot file without the lines that a result is written to, before the work.

    Raises:
        ConfigError: names each line to add.
    """
    errors: list[ConfigError] = []
    for key in keys:
        *path, name = key.split(".")
        table = document.table
        for part in path:
            table = table[part]
        if name not in table:
            where = f"the table {'.'.join(path)}, written as its other keys are"
            allowed = f"add `{name} = 0.0` to {where}, for {option} to change"
            errors.append(ConfigError(document.path, key, MISSING, allowed))
    if errors:
        raise ConfigError.combined(errors)


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
        short = _short(value) if isinstance(value, float) else value
        text = edited(given.name, text, key, short, comment)
    decoded(Document(output, "", tomllib.loads(text)), Robot)
    with output.open("w", encoding="utf-8", newline="") as file:
        file.write(text)


def _short(value: float) -> float:
    """A value as the file has it: what is smaller than a file may hold is 0."""
    return float(f"{value:.{DIGITS}g}") if abs(value) >= SMALLEST else 0.0
