"""The operator's texts in the language of the terminal, which `__main__.py` gives once."""

from collections.abc import Mapping
from contextvars import ContextVar
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from gaitd_texts import Catalogue

_ENVIRONMENT: Final[ContextVar[Mapping[str, str]]] = ContextVar("environment")


def choose(environment: Mapping[str, str]) -> None:
    """Let `texts` be in the language of this environment."""
    _ENVIRONMENT.set(environment)


def texts() -> "Catalogue":
    """Return the operator's texts in the chosen language; English before one is chosen."""
    from gaitd_texts import Reader, catalogue, language_of

    return catalogue(Reader.OPERATOR, language_of(_ENVIRONMENT.get({})))
