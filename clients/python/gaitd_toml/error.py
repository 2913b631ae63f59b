"""The error of a file that cannot be used: it names file, key, value and what is allowed."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, cast

_VALUE_LENGTH_MAX: Final = 60


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


def _value_text(value: object) -> str:
    """A value as TOML would write it, cut to a readable length."""
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            text = f'"{value}"'
        case dict():
            text = "{" + ", ".join(cast("dict[str, object]", value)) + "}"
        case Path():
            return str(value)
        case _:
            try:
                text = repr(value)
            except ValueError:  # Python converts no integer of thousands of digits
                text = "(an integer of thousands of digits)"
    return text if len(text) <= _VALUE_LENGTH_MAX else text[: _VALUE_LENGTH_MAX - 1] + "…"
