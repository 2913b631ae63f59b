"""Changes of some keys of a configuration file, whose text and comments are kept, or of a table.

A key is named by its place, `gait.announce_s`, or `leg.0.name` in the first of the `[[leg]]`
tables. Its value must be on the key's own line. A TOML reader checks that the file differs in this
key alone: an edit is either right or refused.
"""

import copy
import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec

T = TypeVar("T", bound=msgspec.Struct)
Value = bool | int | float | str | Sequence[str]
Edits = Mapping[str, Mapping[str, Value]]
"""Key and value by file, relative to the folder of configurations."""

HEADING: Final = re.compile(r"^\[(\[)?\s*([\w.]+)\s*\]")
ENTRY: Final = re.compile(r"^([\w.]+)\s*=")


class EditError(Exception):
    """A key that cannot be changed as it is named."""


def edit(folder: Path, edits: Edits) -> None:
    """Change files below `folder` in place.

    Raises:
        EditError: a file or key that does not exist, or whose value is longer than its line.
    """
    for name, values in edits.items():
        path = folder / name
        if not path.is_file():
            raise EditError(f"there is no {name} among the configurations to edit")
        text = path.read_text(encoding="utf-8")
        for key, value in values.items():
            text = edited(name, text, key, value)
        path.write_text(text, encoding="utf-8")


def edited(name: str, text: str, key: str, value: Value, comment: str = "") -> str:
    """Return the text of a file with another value of one key.

    Args:
        name: the file's, for messages.
        text: the file's.
        key: place of the key.
        value: the new one.
        comment: replaces the line's own.

    Raises:
        EditError: there is no such key, or its value is longer than its line.
    """
    lines = text.split("\n")
    number = _line_of(lines, key)
    if number is None:
        raise EditError(f"{name} has no key {key}")
    plain = value if isinstance(value, bool | int | float | str) else list(value)
    written = json.dumps(plain, ensure_ascii=False)
    end = "\r" if lines[number].endswith("\r") else ""
    entry = lines[number].partition("=")[0].rstrip()
    lines[number] = f"{entry} = {written}{f'  # {comment}' if comment else ''}{end}"
    after = "\n".join(lines)
    wanted = tomllib.loads(text)
    _put(wanted, key.split("."), json.loads(written))
    try:
        found: dict[str, Any] = tomllib.loads(after)
    except tomllib.TOMLDecodeError:
        found = {}
    if found != wanted:
        raise EditError(
            f"{name}: the value of {key} does not stand on one line, or {written} cannot"
        )
    return after


def replaced(table: T, values: Mapping[str, object]) -> T:
    """Return a table with other values of some keys, named by place: `springs.hip.rest_rad`."""
    for key, value in values.items():
        name, _, inner = key.partition(".")
        new = replaced(getattr(table, name), {inner: value}) if inner else value
        table = msgspec.structs.replace(table, **{name: new})
    return table


def _line_of(lines: Sequence[str], key: str) -> int | None:
    """Return the line of the key, located by the headings above it."""
    table, seen = "", dict[str, int]()
    for number, line in enumerate(lines):
        if heading := HEADING.match(line):
            table = heading[2]
            if heading[1]:
                seen[table] = seen.get(table, -1) + 1
                table = f"{table}.{seen[table]}"
        elif (entry := ENTRY.match(line)) and f"{table}.{entry[1]}".lstrip(".") == key:
            return number
    return None


def _put(tree: object, parts: Sequence[str], value: object) -> None:
    """Set the value at one place in a tree."""
    table: Any = tree
    for part in parts[:-1]:
        table = table[int(part)] if isinstance(table, list) else table[part]
    table[parts[-1]] = copy.copy(value)
