"""Strict decoding of TOML into structs, with errors that name place, value and allowed range.

msgspec checks the values; this module finds those that were refused and describes their place and
their range. No value is ever defaulted, coerced or ignored. In place of a table that was refused
stands `UNREAD`, so that checks which do not need that table still run.

Nothing that a file describes is smaller than `SMALLEST` and different from 0. A number in between
is a mistake, and a quotient by it has no meaning: it is refused in each key.
"""

import difflib
import hashlib
import math
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import (
    Annotated,
    Any,
    Final,
    NamedTuple,
    Never,
    TypeVar,
    cast,
    get_args,
    get_origin,
)

import msgspec
from msgspec import inspect

from daemon.ipc.decoding import Decoder, RefusedError

T = TypeVar("T")

_VALUE_LENGTH_MAX: Final = 60
_INTEGER_END: Final = 2**63
SMALLEST: Final = 1e-9
"""Size of the smallest number that a file may hold, apart from 0."""


class PlainText(str):
    """Text in place of a value, shown without quotes: `(missing)`."""

    __slots__ = ()


MISSING: Final = PlainText("(missing)")
COMMAND_LINE: Final = "command line"
"""In place of a file, where an option is refused."""


class ConfigError(Exception):
    """The configuration is refused, and the operator has to correct it.

    `file`, `key` (dotted), `value` (as it stands in the file) and `allowed` are what is needed to
    correct it; `key` is empty when the file as a whole is meant. `more` holds the errors that were
    found together with this one. `following` is the command to give next: None for `gaitd check`,
    which reports the same error; empty where no command helps.
    """

    more: tuple["ConfigError", ...] = ()

    def __init__(
        self,
        file: Path | str,
        key: str,
        value: object,
        allowed: str,
        *,
        following: str | None = None,
    ) -> None:
        self.file = str(file)
        self.following = following
        self.key = key
        self.value = value if isinstance(value, PlainText) else PlainText(_value_text(value))
        self.allowed = allowed
        place = f"{self.file}: {key} = {self.value}" if key else self.file
        super().__init__(f"{place}: {allowed}")

    @classmethod
    def combined(cls, errors: Sequence["ConfigError"]) -> "ConfigError":
        """The first of several errors, with the others in `more`."""
        first, *more = errors
        first.more = tuple(more)
        return first

    @property
    def lines(self) -> str:
        """One line for each error, for stderr, the same in every command."""
        return "\n".join(f"configuration error: {error}" for error in (self, *self.more))


Errors = Iterator[ConfigError]
"""What a check finds."""


class UnreadError(Exception):
    """A value was needed of a table or file that was refused; that refusal has its own error."""


class _Unread:
    """In place of a table or file that was refused."""

    def _refuse(self, *_: object) -> Never:
        raise UnreadError

    __getattr__ = __iter__ = __len__ = __bool__ = __getitem__ = __fspath__ = _refuse


UNREAD: Final[Any] = _Unread()
"""Any use of it raises `UnreadError`."""


def is_read(table: msgspec.Struct) -> bool:
    """True if the whole table was decoded."""
    return table is not UNREAD and all(
        value is not UNREAD for value in msgspec.structs.astuple(table)
    )


def unless_unread(compute: Callable[[], T]) -> T:
    """A value, or `UNREAD` if it would need one."""
    try:
        return compute()
    except UnreadError:
        return UNREAD


class Document(NamedTuple):
    """One TOML file as it was read: hashed and decoded from the same bytes."""

    path: Path
    sha256: str
    table: dict[str, Any]


class _Fault(NamedTuple):
    key: str
    value: object
    allowed: str


class _Part(NamedTuple):
    value: object
    kind: object
    key: str


def read_toml(path: Path) -> Document:
    """Read, hash and parse one file.

    Raises:
        ConfigError: there is no such file, it is not UTF-8, or its syntax is wrong (line, column).
    """
    data = read_bytes(path, "TOML file")
    return Document(path, hashlib.sha256(data).hexdigest(), _parsed(path, data))


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


def load_toml(path: Path, kind: type[T]) -> T:
    """Read one TOML file into a msgspec struct.

    Raises:
        ConfigError: as `read_toml` and `decoded`.
    """
    return decoded(read_toml(path), kind)


def decoded(document: Document, kind: type[T]) -> T:
    """Convert a document into a struct.

    Raises:
        ConfigError: unknown or missing key, wrong type, out of range, not a finite number.
    """
    table, errors = decoded_in_part(document, kind)
    if errors:
        raise ConfigError.combined(errors)
    return table


def decoded_in_part(document: Document, kind: type[T]) -> tuple[T, list[ConfigError]]:
    """Convert what can be converted of a document into a struct.

    Returns: the struct with `UNREAD` in place of each refused key or table of the top level, and
        all errors.
    """
    faults = list(_faults(document.table, kind, ""))
    if not faults:
        return msgspec.convert(document.table, kind), []
    refused = {re.split(r"[.\[]", fault.key)[0] for fault in faults}
    values = {
        field.name: msgspec.convert(document.table[field.encode_name], field.type)
        if field.encode_name in document.table and field.encode_name not in refused
        else UNREAD
        for field in msgspec.structs.fields(cast("Any", kind))
        if field.required or field.encode_name in document.table
    }
    return kind(**values), [ConfigError(document.path, *fault) for fault in faults]


def described(kind: object) -> str:
    """The allowed values of a type in words, for example `a number > 0 and <= 120`."""
    return _type_text(inspect.type_info(kind))


def _parsed(path: Path, data: bytes) -> dict[str, Any]:
    try:
        return _TOML.decode(data)
    except RefusedError as error:
        bad = error.__cause__
        if isinstance(bad, UnicodeDecodeError):
            line = data.count(b"\n", 0, bad.start) + 1
            allowed = "a TOML file is UTF-8 text"
            raise ConfigError(path, f"line {line}", PlainText("(not UTF-8)"), allowed) from error
        raise _syntax_error(path, data.decode(), str(error)) from error


def _table(data: bytes) -> dict[str, Any]:
    table = tomllib.loads(data.decode())
    _check_integers(table)
    return table


def _check_integers(value: object) -> None:
    """Check that integers have 64 bits, as TOML requires; tomllib accepts any size.

    Raises:
        ValueError: an integer is larger.
    """
    if isinstance(value, dict | list):
        inner = value.values() if isinstance(value, dict) else value
        for one in cast("Iterable[object]", inner):
            _check_integers(one)
    elif isinstance(value, int) and not -_INTEGER_END <= value < _INTEGER_END:
        raise ValueError("an integer has more than 64 bits")


_TOML: Final = Decoder(_table)


def _syntax_error(path: Path, text: str, message: str) -> ConfigError:
    place = re.search(r" \(at (?:line (\d+), column (\d+)|end of document)\)$", message)
    if place is None:
        return ConfigError(path, "", "", f"TOML syntax: {message}")
    lines = text.splitlines() or [""]
    line = int(place[1]) if place[1] else len(lines)
    content = lines[min(line, len(lines)) - 1]
    column = int(place[2]) if place[2] else len(content) + 1
    reason = message[: place.start()]
    where = f"line {line}, column {column}"
    return ConfigError(path, where, PlainText(f"`{content.strip()}`"), f"TOML syntax: {reason}")


def _faults(value: object, kind: object, key: str) -> Iterator[_Fault]:
    """All values below `key` that `kind` does not allow, depth first, in the file's order."""
    sound = True
    for inner in _inside(value, _bare(kind), key):
        for fault in (inner,) if isinstance(inner, _Fault) else _faults(*inner):
            sound = False
            yield fault
    if sound and not _allowed(value, kind):
        yield _Fault(key, value, described(kind) + _as_well(value))


def _inside(value: object, kind: object, key: str) -> Iterator[_Part | _Fault]:
    """The parts of a value one level deeper, with their types and keys."""
    if isinstance(value, dict):
        kind = _tagged(cast("dict[str, object]", value), kind)
    origin, arguments = get_origin(kind), get_args(kind)
    if isinstance(value, dict) and isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        yield from _fields(cast("dict[str, object]", value), kind, key)
    elif isinstance(value, dict) and origin is dict:
        for name, item in cast("dict[str, object]", value).items():
            yield _Part(item, arguments[1], _dotted(key, name))
    elif isinstance(value, list) and origin in (tuple, list):
        items = cast("list[object]", value)
        same = len(arguments) == 1 or arguments[1:] == (...,)
        kinds = (arguments[0],) * len(items) if same else arguments
        for index, (item, item_kind) in enumerate(zip(items, kinds, strict=False)):
            yield _Part(item, item_kind, f"{key}[{index}]")


def _tagged(table: dict[str, object], kind: object) -> object:
    """The one of several kinds of table that the table's tag names; without one, `kind` itself."""
    for option in get_args(kind):
        if isinstance(option, type) and issubclass(option, msgspec.Struct):
            tag = option.__struct_config__
            if tag.tag_field is not None and table.get(tag.tag_field) == tag.tag:
                return option
    return kind


def _fields(
    table: dict[str, object], kind: type[msgspec.Struct], key: str
) -> Iterator[_Part | _Fault]:
    fields = {field.encode_name: field for field in msgspec.structs.fields(kind)}
    meant: list[str] = []
    for name, value in table.items():
        if name in fields:
            yield _Part(value, fields[name].type, _dotted(key, name))
        else:
            if name == kind.__struct_config__.tag_field:
                continue
            near = difflib.get_close_matches(name, list(fields), n=1)
            meant += near
            hint = f" Did you mean `{near[0]}`?" if near else ""
            allowed = f"unknown key.{hint} Known: {', '.join(fields)}"
            yield _Fault(_dotted(key, name), value, allowed)
    for name, field in fields.items():
        if field.required and name not in table and name not in meant:
            yield _Fault(_dotted(key, name), MISSING, described(field.type))


def _allowed(value: object, kind: object) -> bool:
    # msgspec lets NaN pass a range, because no comparison with it is true.
    if _as_well(value) or (isinstance(value, float) and not math.isfinite(value)):
        return False
    try:
        msgspec.convert(value, kind)
    except msgspec.ValidationError:
        return False
    return True


def _as_well(value: object) -> str:
    """What no type of a key says of a value, and is refused in each; empty if it is allowed."""
    if isinstance(value, float) and abs(value) < SMALLEST and repr(value) != "0.0":
        return f", and 0 without a sign or at least {SMALLEST:g} in size"
    return ", without the character 0" if isinstance(value, str) and "\0" in value else ""


def _bare(kind: object) -> object:
    """The type without `Annotated`, and without the None of an optional table."""
    if get_origin(kind) is Annotated:
        return _bare(get_args(kind)[0])
    options = [option for option in get_args(kind) if option is not type(None)]
    if type(None) in get_args(kind) and len(options) == 1:
        return _bare(options[0])
    return kind


def _dotted(key: str, name: str) -> str:
    return f"{key}.{name}" if key else name


def _value_text(value: object) -> str:
    """A value as TOML would write it, cut to a readable length."""
    match value:
        case None:
            text = str(MISSING)
        case bool():
            return "true" if value else "false"
        case str():
            text = f'"{value}"'
        case dict():
            text = "{" + ", ".join(cast("dict[str, object]", value)) + "}"
        case Path():
            return str(value)
        case _:
            text = repr(value)
    return text if len(text) <= _VALUE_LENGTH_MAX else text[: _VALUE_LENGTH_MAX - 1] + "…"


def _type_text(info: inspect.Type) -> str:
    match info:
        case inspect.FloatType():
            return "a finite number" if not _range(info) else f"a number {_range(info)}"
        case inspect.IntType():
            return f"a whole number {_range(info)}".rstrip()
        case inspect.StrType():
            return _text_type(info)
        case inspect.BoolType():
            return "true or false"
        case inspect.LiteralType(values=values):
            return "one of " + ", ".join(_value_text(value) for value in values)
        case inspect.EnumType(cls=cls):
            return "one of " + ", ".join(_value_text(member.value) for member in cls)
        case inspect.UnionType(types=types):
            known = (kind for kind in types if not isinstance(kind, inspect.NoneType))
            return " or ".join(_type_text(kind) for kind in known)
        case inspect.CollectionType() | inspect.TupleType():
            return _list_type(info)
        case inspect.DictType(value_type=value_type):
            return f"a table of names, each with {_type_text(value_type)}"
        case inspect.StructType(fields=fields):
            return "a table with " + ", ".join(field.encode_name for field in fields)
        case _:
            return type(info).__name__.removesuffix("Type").lower()


def _range(info: inspect.FloatType | inspect.IntType) -> str:
    bounds = ((">", info.gt), (">=", info.ge), ("<", info.lt), ("<=", info.le))
    return " and ".join(f"{sign} {bound:g}" for sign, bound in bounds if bound is not None)


def _text_type(info: inspect.StrType) -> str:
    if info.pattern is not None:
        return f"text that matches {info.pattern}"
    if info.min_length is not None and info.min_length > 1:
        return f"text of at least {info.min_length} characters"
    return "text" if info.min_length is None else "text that is not empty"


def _list_type(info: inspect.CollectionType | inspect.TupleType) -> str:
    if isinstance(info, inspect.TupleType):
        return f"a list of {len(info.item_types)}: {', '.join(map(_type_text, info.item_types))}"
    least, most = info.min_length, info.max_length
    count = {
        (False, False): "a list",
        (True, False): f"a list of at least {least}",
        (False, True): f"a list of at most {most}",
        (True, True): f"a list of {least} to {most}",
    }[least is not None, most is not None]
    return f"{count}, each {_type_text(info.item_type)}"
