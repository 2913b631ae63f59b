"""Strict reading of TOML: msgspec checks each value, and all mistakes of a file are found at once.

No value is ever defaulted, coerced or ignored. Nothing that a file describes is smaller than
`SMALLEST` and different from 0: a quotient by such a number has no meaning, so it is refused in
each key. So is what no key can hold: a number that is not finite, an integer of more than 64 bits,
and the character 0, which no name of a file or machine has.
"""

import difflib
import hashlib
import math
import re
import tomllib
from functools import cache
from itertools import repeat
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Final, NamedTuple, TypeVar, Union, cast, get_args, get_origin

import msgspec

from gaitd_toml.error import MISSING, ConfigError, PlainText

T = TypeVar("T")
_Fault = tuple[str, object, str]
"""Key, value, what is allowed."""

SMALLEST: Final = 1e-9
"""Size of the smallest number that a file may hold, apart from 0."""
_INTEGER_END: Final = 2**63
_TYPES: Final = {
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
    "string": "text",
    "path": "the name of a file or folder",
    "array": "a list",
    "object": "a table",
}
_BOUNDS: Final = {
    "exclusiveMinimum": "> {:g}",
    "minimum": ">= {:g}",
    "exclusiveMaximum": "< {:g}",
    "maximum": "<= {:g}",
    "pattern": "that matches {}",
    "minLength": "with {} or more characters",
    "maxLength": "with {} or fewer characters",
    "minItems": "with {} or more entries",
    "maxItems": "with {} or fewer entries",
}


class Document(NamedTuple):
    """One TOML file as it was read: hashed and decoded from the same bytes."""

    path: Path
    sha256: str
    table: dict[str, Any]


def load_toml(path: Path, kind: type[T]) -> T:
    """Read one TOML file into a msgspec struct.

    Raises:
        ConfigError: as `read_toml` and `decoded`.
    """
    return decoded(read_toml(path), kind)


def read_toml(path: Path) -> Document:
    """Read, hash and parse one file.

    Raises:
        ConfigError: there is no such file, or as `parse_toml`.
    """
    return parse_toml(path, read_bytes(path, "TOML file"))


def read_bytes(path: Path, kind: str) -> bytes:
    """Read a file that is described as `kind` in an error.

    Raises:
        ConfigError: it is not there, or cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        reason = (error.strerror or "cannot be read").lower()
        raise ConfigError(path, "", "", f"{reason}; a readable {kind} is needed") from error


def parse_toml(path: Path, data: bytes) -> Document:
    """Hash and parse the content of a file.

    Raises:
        ConfigError: it is not UTF-8, or its syntax is wrong (line, column).
    """
    try:
        return Document(path, hashlib.sha256(data).hexdigest(), tomllib.loads(data.decode()))
    except UnicodeDecodeError as error:
        line, value = data.count(b"\n", 0, error.start) + 1, PlainText("(not UTF-8)")
        raise ConfigError(path, f"line {line}", value, "a TOML file is UTF-8 text") from error
    except (ValueError, RecursionError) as error:  # also of an integer of thousands of digits
        reason, _, place = str(error).partition(" (at ")
        number = re.match(r"line (\d+)", place)
        line = (data.decode().splitlines() or [""])[int(number[1]) - 1 if number else -1]
        value, allowed = PlainText(f"`{line.strip()}`"), f"TOML syntax: {reason}"
        raise ConfigError(path, place.rstrip(")"), value, allowed) from error


def decoded(document: Document, kind: type[T]) -> T:
    """Convert a document into a struct; a `Path` in it is relative to the file's folder.

    Raises:
        ConfigError: unknown or missing key, wrong type, out of range, not a finite number.
    """
    if errors := errors_in(document, kind):
        raise ConfigError.combined(errors)

    def path(kind: type, value: object) -> Path:
        return document.path.parent / _path(kind, value)

    return msgspec.convert(document.table, kind, dec_hook=path)


def errors_in(document: Document, kind: type) -> list[ConfigError]:
    """All mistakes of a document in place of a struct that forbids unknown keys, in its order."""
    if _converts(document.table, kind) and _is_holdable(document.table):
        return []  # as nearly always; the search for mistakes takes a hundred times as long
    return [ConfigError(document.path, *fault) for fault in _faults(document.table, kind, "")]


def _is_holdable(value: object) -> bool:
    if isinstance(value, dict):
        return all(map(_is_holdable, cast("dict[str, object]", value).values()))
    if isinstance(value, list):
        return all(map(_is_holdable, cast("list[object]", value)))
    return _unholdable(value) is None


def _faults(value: object, kind: object, key: str) -> list[_Fault]:
    """What `kind` does not allow of the parts of a value; if they are sound, of the value."""
    faults: list[_Fault] = []
    for option in _options(kind):
        if isinstance(value, dict) and isinstance(option, type) and _is_table(value, option):
            faults = _faults_of_fields(cast("dict[str, object]", value), option, key)
        elif isinstance(value, dict) and get_origin(option) is dict:
            for name, item in cast("dict[str, object]", value).items():
                faults += _faults(item, get_args(option)[1], _dotted(key, name))
        elif isinstance(value, list) and get_origin(option) is tuple:
            first, *others = get_args(option)
            kinds = repeat(first) if others == [...] else (first, *others)
            items = zip(cast("list[object]", value), kinds, strict=False)
            for index, (item, one) in enumerate(items):
                faults += _faults(item, one, f"{key}[{index}]")
    if not faults and (allowed := _refusal(value, kind)):
        faults = [(key, value, allowed)]
    return faults


def _options(kind: object) -> list[object]:
    """The types of a union, or the one, without their bounds."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _options(arguments[0])
    if origin in (Union, UnionType):
        return [option for argument in arguments for option in _options(argument)]
    return [kind]


def _is_table(value: dict[Any, Any], kind: type) -> bool:
    """True if a struct is of this kind: the one that its tag names, if there are several."""
    if not issubclass(kind, msgspec.Struct):
        return False
    tag = kind.__struct_config__
    return tag.tag_field is None or value.get(tag.tag_field) == tag.tag


def _faults_of_fields(table: dict[str, object], kind: type, key: str) -> list[_Fault]:
    fields = _fields(kind)
    faults: list[_Fault] = []
    seen = {*table}
    for name, value in table.items():
        if name in fields:
            faults += _faults(value, fields[name].type, _dotted(key, name))
        elif name != cast("Any", kind).__struct_config__.tag_field:
            near = difflib.get_close_matches(name, fields, n=1)
            seen.update(near)
            hint = f" Did you mean `{near[0]}`?" if near else ""
            allowed = f"unknown key.{hint} Known: {', '.join(fields)}"
            faults.append((_dotted(key, name), value, allowed))
    return faults + [
        (_dotted(key, name), MISSING, _described(field.type))
        for name, field in fields.items()
        if field.required and name not in seen
    ]


@cache
def _fields(kind: type) -> dict[str, msgspec.structs.FieldInfo]:
    # msgspec resolves all annotations at each call, and a file has hundreds of tables.
    return {field.encode_name: field for field in msgspec.structs.fields(cast("Any", kind))}


def _refusal(value: object, kind: object) -> str:
    """What is allowed in place of a value; empty if the value is."""
    also = _unholdable(value)
    if also is None and _converts(value, kind):
        return ""
    return _described(kind) + (also or "")


def _unholdable(value: object) -> str | None:
    """What is asked of a value beside its type that no key can hold; None of any other."""
    match value:
        # msgspec lets NaN pass a range, because no comparison with it is true.
        case float() if not math.isfinite(value):
            return ", and finite"
        case float() if abs(value) < SMALLEST and repr(value) != "0.0":
            return f", and 0 without a sign or at least {SMALLEST:g} in size"
        case int() if not -_INTEGER_END <= value < _INTEGER_END:
            return ""
        case str() if "\0" in value:
            return ", without the character 0"
        case _:
            return None


def _converts(value: object, kind: object) -> bool:
    try:
        msgspec.convert(value, kind, dec_hook=_path)
    except msgspec.ValidationError:
        return False
    return True


def _path(_: type, value: object) -> Path:
    if not isinstance(value, str) or not value:
        raise ValueError("the name of a file or folder is needed")
    return Path(value)


def _dotted(key: str, name: str) -> str:
    return f"{key}.{name}" if key else name


def _described(kind: object) -> str:
    """The allowed values of a type in words, for example `a number > 0 and <= 120`."""
    (schema,), named = msgspec.json.schema_components(
        (kind,), schema_hook=lambda _: {"type": "path"}
    )
    return _words(schema, named)


def _words(schema: dict[str, Any], named: dict[str, Any]) -> str:
    if "$ref" in schema:
        return _words(named[schema["$ref"].rpartition("/")[2]], named)
    if "anyOf" in schema:
        options = (one for one in schema["anyOf"] if one != {"type": "null"})
        return " or ".join(_words(one, named) for one in options)
    if "enum" in schema:
        return f"one of {', '.join(msgspec.json.encode(one).decode() for one in schema['enum'])}"
    if "properties" in schema:
        return f"a table with {', '.join(schema['properties'])}"
    if "prefixItems" in schema:
        items = ", ".join(_words(one, named) for one in schema["prefixItems"])
        return f"a list of {len(schema['prefixItems'])}: {items}"
    bounds = " and ".join(text.format(schema[x]) for x, text in _BOUNDS.items() if x in schema)
    words = f"{_TYPES[schema['type']]} {bounds}".rstrip()
    each = schema.get("items") or schema.get("additionalProperties")
    return f"{words}, each {_words(each, named)}" if each else words
