"""Bytes from outside into structs: the one place that decodes, and it refuses instead of raising.

Levels, setpoints, queries, rings and recordings, the state file and the configuration come from
another process, a network or a disk. What a library raises for bytes that are not what they should
be is not its own error alone: text that is no UTF-8 is a UnicodeDecodeError, nesting without end a
RecursionError, an integer of thousands of digits a ValueError. Whoever decodes elsewhere forgets
one of them, and the process ends by bytes.
"""

from collections.abc import Callable
from typing import Annotated, Final, Generic, TypeVar

from msgspec import Meta

T = TypeVar("T")

INTEGER_MAX: Final = 2**63 - 1
Count = Annotated[int, Meta(ge=0, le=INTEGER_MAX)]
"""What counts or is a time in ns: msgpack has room for it, and it is a date."""
Name = Annotated[str, Meta(max_length=64)]
"""Of a leg, an axis, a scenario, a core."""

_FAILURES: Final = (ValueError, RecursionError, OverflowError)
"""Errors of msgspec, tomllib and UTF-8 are ValueErrors, as are those of integers in text."""


class RefusedError(Exception):
    """Bytes are not what they should be: says why; the library's own error is its cause."""


class Decoder(Generic[T]):
    """Decodes one kind of bytes, and counts what it has refused."""

    def __init__(self, decode: Callable[[bytes], T]) -> None:
        """`decode` is the library's: a bug of ours in it would look like bad bytes."""
        self._decode = decode
        self.refused_count = 0

    def decode(self, data: bytes) -> T:
        """The struct.

        Raises:
            RefusedError: the bytes are no such struct.
        """
        try:
            return self._decode(data)
        except _FAILURES as error:
            self.refused_count += 1
            raise RefusedError(str(error) or type(error).__name__) from error
