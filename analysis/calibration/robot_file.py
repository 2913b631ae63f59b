"""The calibrated robot.toml: the given file with some numbers replaced.

TOML of this project has one `key = number` per line, below its `[table]`. Only such lines are
changed, and the result is decoded again and compared before it is written.
"""

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import msgspec

from analysis.calibration.quantities import value_of
from daemon.config.settings import Robot
from daemon.config.strict import Document, decoded, read_toml

_TABLE: Final = re.compile(r"^\s*\[([A-Za-z0-9_.]+)\]\s*(#.*)?$")
_NUMBER: Final = re.compile(r"^(\s*)([A-Za-z0-9_]+)(\s*=\s*)([-+0-9.eE_]+)([ \t]*)(#.*)?(\r?\n?)$")
DIGITS: Final = 6


class RobotFileError(Exception):
    """A robot file that cannot be rewritten line by line; names the key."""


def rewritten(text: str, values: Mapping[str, tuple[float, str]]) -> str:
    """Replace the numbers of some dotted keys, each with a comment.

    Raises:
        RobotFileError: a key has no line of its own with a number.
    """
    left = dict(values)
    table, lines = "", []
    for line in text.splitlines(keepends=True):
        heading = _TABLE.match(line)
        if heading:
            table = heading[1]
        number = _NUMBER.match(line)
        key = f"{table}.{number[2]}" if number else ""
        if number and key in left:
            value, comment = left.pop(key)
            head = f"{number[1]}{number[2]}{number[3]}{as_toml(value)}"
            lines.append(f"{head}  # {comment}{number[7]}")
        else:
            lines.append(line)
    if left:
        raise RobotFileError(f"no line `key = number` for {', '.join(left)}")
    return "".join(lines)


def as_toml(value: float) -> str:
    """Format as a TOML float, never an integer."""
    text = f"{value:.{DIGITS}g}"
    return text if any(mark in text for mark in ".en") else f"{text}.0"


def write(given: Path, output: Path, values: Mapping[str, tuple[float, str]]) -> Robot:
    """Write the calibrated file beside the given one.

    Args:
        given: the initial robot file; never written.
        output: replaced if it exists.
        values: number and comment by dotted key.

    Raises:
        RobotFileError: `output` is `given`, or a key has no line of its own.
        ConfigError: the result would not be a valid robot file; nothing is written.
        OSError: the file cannot be written.
    """
    if output.exists() and output.samefile(given):
        raise RobotFileError(f"{output}: is the file to begin with; give --output another name")
    before = read_toml(given)
    with given.open(encoding="utf-8", newline="") as file:
        text = rewritten(file.read(), values)
    robot = _decoded(text, output)
    _only_these_differ(decoded(before, Robot), robot, values)
    with output.open("w", encoding="utf-8", newline="") as file:
        file.write(text)
    return robot


def _decoded(text: str, output: Path) -> Robot:
    return decoded(Document(output, "", tomllib.loads(text)), Robot)


def _only_these_differ(
    before: Robot, after: Robot, values: Mapping[str, tuple[float, str]]
) -> None:
    for key, (value, _) in values.items():
        if abs(value_of(after, key) - value) > 1e-4 * max(abs(value), 1e-9):
            raise RobotFileError(f"{key} would read {value_of(after, key)!r}, not {value!r}")
    expected = _without(before, values)
    if _without(after, values) != expected:
        raise RobotFileError("something else than the calibrated numbers would change")


def _without(robot: Robot, values: Mapping[str, tuple[float, str]]) -> object:
    table = msgspec.to_builtins(robot)
    for key in values:
        *path, name = key.split(".")
        part = table
        for step in path:
            part = part[step]
        part[name] = None
    return table
