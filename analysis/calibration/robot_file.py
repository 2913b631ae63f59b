"""The calibrated robot.toml: the given file with some numbers replaced."""

import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final

from gaitd_toml import MISSING, SMALLEST, ConfigError, Document, decoded

from daemon.config.edits import Value, edited
from daemon.config.settings import MissedLimit, Robot

DIGITS: Final = 6
ACCEPTED: Final = re.compile(
    r"(^#[^\n]*\n)*^\[calibration\][^\n]*\n([^\[\n][^\n]*\n?)*", re.MULTILINE
)
"""The table that an accepted calibration wrote, with the comments above it."""


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


def write(
    given: Path,
    output: Path,
    values: Mapping[str, tuple[Value, str]],
    missed: Sequence[tuple[MissedLimit, str]] = (),
) -> None:
    """Write the calibrated file beside the given one.

    Args:
        given: the initial robot file.
        output: another file, replaced if it exists.
        values: value and comment by dotted key.
        missed: limits that the result misses, with the reasons; without one the file says none.

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
    text = ACCEPTED.sub("", text).rstrip() + ("\r\n" if "\r\n" in text else "\n")
    if missed:
        text += "\n" + _accepted(missed)
    decoded(Document(output, "", tomllib.loads(text)), Robot)
    with output.open("w", encoding="utf-8", newline="") as file:
        file.write(text)


def _accepted(missed: Sequence[tuple[MissedLimit, str]]) -> str:
    reasons = "".join(f"# {limit}: {reason}\n" for limit, reason in missed)
    names = ", ".join(f'"{limit}"' for limit, _ in missed)
    return (
        f"# Written by `gaitd calibrate --accept` although limits were missed:\n{reasons}"
        f"[calibration]\nmissed_limits = [{names}]\n"
    )


def _short(value: float) -> float:
    """A value as the file has it: what is smaller than a file may hold is 0."""
    return float(f"{value:.{DIGITS}g}") if abs(value) >= SMALLEST else 0.0
