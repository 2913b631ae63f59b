"""Decoding of bytes from outside into structs: one class, with one exception for all failures.

Gateway states, setpoints, queries, rings and recordings, the state file and the configuration come
from another process, a network or a disk. For invalid bytes a library raises more than its own
error: text that is not UTF-8 is a UnicodeDecodeError, nesting without end a RecursionError, an
integer of thousands of digits a ValueError. An exception that is not caught would end the process,
so all decoding is done here.
"""

from collections.abc import Callable
from typing import Annotated, Final, Generic, TypeVar

from msgspec import Meta

T = TypeVar("T")

INTEGER_MAX: Final = 2**63 - 1
Count = Annotated[int, Meta(ge=0, le=INTEGER_MAX)]
"""A count or a time in ns, limited to what msgpack and dates can represent."""
Name = Annotated[str, Meta(max_length=64)]
"""Name of a leg, an axis, a scenario or a core."""

_FAILURES: Final = (ValueError, RecursionError, OverflowError)
"""Errors of msgspec, tomllib and UTF-8 are ValueErrors, as are those of integers in text."""


class RefusedError(Exception):
    """The bytes are invalid; the message gives the reason, the library's own error is the cause."""


class Decoder(Generic[T]):
    """Decodes one kind of bytes, and counts what it has refused."""

    def __init__(self, decode: Callable[[bytes], T]) -> None:
        """`decode` must be the library's function: a bug of ours would look like invalid bytes."""
        self._decode = decode
        self.refused_count = 0

    def decode(self, data: bytes) -> T:
        """Decode the bytes into a struct.

        Raises:
            RefusedError: the bytes are not a valid struct of this kind.
        """
        try:
            return self._decode(data)
        except _FAILURES as error:
            self.refused_count += 1
            raise RefusedError(str(error) or type(error).__name__) from error
