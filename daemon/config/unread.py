"""`UNREAD` in place of a table or file that was refused, so that checks that do not need it run."""

import re
from collections.abc import Callable
from typing import Any, Final, Never, TypeVar, cast

import msgspec
from gaitd_toml import ConfigError, Document, decoded, errors_in

T = TypeVar("T")


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


def decoded_in_part(document: Document, kind: type[T]) -> tuple[T, list[ConfigError]]:
    """Convert what can be converted of a document into a struct.

    Returns: the struct with `UNREAD` in place of each refused key or table of the top level, and
        all errors.
    """
    errors = errors_in(document, kind)
    if not errors:
        return decoded(document, kind), []
    refused = {re.split(r"[.\[]", error.key)[0] for error in errors}
    values = {
        field.name: msgspec.convert(document.table[field.encode_name], field.type)
        if field.encode_name in document.table and field.encode_name not in refused
        else UNREAD
        for field in msgspec.structs.fields(cast("Any", kind))
        if field.required or field.encode_name in document.table
    }
    return kind(**values), errors
