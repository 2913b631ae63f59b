"""Strict reading of a TOML file into a struct; an error names file, key, value and what is allowed.

The struct says what each key may hold. What no struct says is refused in every key: a number that
is not finite, one between 0 and `SMALLEST`, and text that no name of a file or machine can have.
"""

import math
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, TypeVar, cast

import msgspec

SMALLEST: Final = 1e-9
"""Size of the smallest number other than 0."""
_INTEGER_END: Final = 2**63
_SHOWN_LENGTH_MAX: Final = 60

T = TypeVar("T")


class TomlError(Exception):
    """A file cannot be used: `file`, `key` (dotted), `value`, and what is `allowed`."""

    def __init__(self, file: Path, key: str, value: object, allowed: str) -> None:
        """Make the message; without a key the whole file is meant, and None is a missing value."""
        place = f"{file}: {key} = {_shown(value)}" if key else f"{file}"
        super().__init__(f"{place}: {allowed}")
        self.file, self.key, self.value, self.allowed = file, key, value, allowed


def read(file: Path, kind: type[T]) -> T:
    """Read a file into a struct; relative paths in it are relative to its folder.

    Raises:
        TomlError: the file cannot be read, or as `parse`.
    """
    try:
        text = file.read_bytes().decode()
    except OSError as error:
        reason = error.strerror or "it cannot be read"
        raise TomlError(file, "", None, f"{reason}; a readable TOML file is needed") from error
    except UnicodeDecodeError as error:
        raise TomlError(file, "", None, f"a TOML file is UTF-8 text ({error})") from error
    return parse(text, file, kind)


def parse(text: str, file: Path, kind: type[T]) -> T:
    """Decode a text as the content of `file`.

    Raises:
        TomlError: its syntax is wrong, or a key is missing, unknown or has a wrong value.
    """
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also of an integer of thousands of digits
        raise TomlError(file, "", None, f"TOML syntax: {error}") from error
    for key, value, allowed in _refused_in_every_key(table, ""):
        raise TomlError(file, key, value, allowed)

    def path(_: type, value: object) -> Path:
        if not isinstance(value, str) or not value:
            raise ValueError("Expected the name of a file or folder")
        return file.parent / value

    try:
        return msgspec.convert(table, kind, dec_hook=path)
    except msgspec.ValidationError as error:
        raise _error_of(file, table, str(error)) from error


def _refused_in_every_key(value: object, key: str) -> Iterator[tuple[str, object, str]]:
    """Values that no struct refuses, with their keys and what is allowed, in the file's order."""
    match value:
        case float() if not math.isfinite(value):
            yield key, value, "a finite number is needed"
        case float() if 0 < abs(value) < SMALLEST:
            yield key, value, f"0 or at least {SMALLEST:g} in size is needed"
        case int() if not -_INTEGER_END <= value < _INTEGER_END:
            yield key, value, "an integer of at most 64 bits is needed"
        case str() if "\0" in value:
            yield key, value, "text without the character 0 is needed"
        case dict():
            for name, inner in cast("dict[str, object]", value).items():
                yield from _refused_in_every_key(inner, f"{key}.{name}" if key else name)
        case list():
            for index, inner in enumerate(cast("list[object]", value)):
                yield from _refused_in_every_key(inner, f"{key}[{index}]")
        case _:
            pass


def _error_of(file: Path, table: dict[str, Any], message: str) -> TomlError:
    """Make the error from that of msgspec: `Expected ... - at `$.plan.block[0].rest_s``."""
    allowed, _, place = message.partition(" - at ")
    key = place.strip("`").removeprefix("$").removeprefix(".")
    field = re.search(r"required field `(\w+)`|unknown field `(.+)`", allowed)
    if field is None:
        return TomlError(file, key, _value_at(table, key), allowed)
    name = field[1] or field[2]
    full = f"{key}.{name}" if key else name
    if field[1]:
        return TomlError(file, full, None, "this key is missing")
    owner = _value_at(table, key)
    return TomlError(file, full, owner[name], "this key is unknown")


def _value_at(table: dict[str, Any], key: str) -> Any:  # noqa: ANN401 - any TOML value
    value: Any = table
    for name, index in re.findall(r"(\w+)|\[(\d+)\]", key):
        value = value[name] if name else value[int(index)]
    return value


def _shown(value: object) -> str:
    if value is None:
        return "(missing)"
    text = f'"{value}"' if isinstance(value, str) else str(value)
    short = text[: _SHOWN_LENGTH_MAX - 1] + "…"
    return text if len(text) <= _SHOWN_LENGTH_MAX else short
