"""States of the patient's page, and sentences in all languages.

A page gets each sentence in all languages, so that its button changes the language at once. The
texts are in `gaitd_texts`.
"""

from collections.abc import Callable
from enum import StrEnum, auto
from typing import Final

from gaitd_texts import CAUTIOUS, LANGUAGES, Catalogue, Reader, catalogue, texts_of

Spoken = dict[str, str]
"""A sentence by language."""
UNBROKEN: Final = "Not\u2060-\u2060Halt"
"""The name of the emergency stop, which no line ends within."""


class Word(StrEnum):
    """State of the patient's page; each has its heading."""

    NO_CONNECTION = auto()
    TOO_MANY_PAGES = auto()
    NO_SIGNAL = auto()
    STOPPED = auto()
    STOPPING = auto()
    WAIT = auto()
    WAY_OUT = auto()
    # before, between and after the blocks of a session
    START = auto()
    NEXT = auto()
    PAUSED = auto()
    REST = auto()
    FINISHED = auto()
    DAILY_TEST = auto()
    RELEASE = auto()
    LET_GO = auto()
    FAILED = auto()
    USED = auto()
    # without a session
    READY = auto()
    HELD = auto()
    # motion
    SOON = auto()
    TO_START = auto()
    SELF_TEST = auto()
    GO_ON = auto()
    MORE = auto()
    GOOD = auto()
    GENTLY = auto()
    RELAX = auto()
    ENDING = auto()
    GUIDE = auto()
    SERVICE = auto()


def spoken(sentence: Callable[[Catalogue], str]) -> Spoken:
    """Return what the operator's texts say, in all languages."""
    return {language: sentence(catalogue(Reader.OPERATOR, language)) for language in LANGUAGES}


def has_text(key: str) -> bool:
    """Return whether the patient's texts have a sentence where none is needed."""
    return any(catalogue(Reader.PATIENT, language).has(key) for language in LANGUAGES)


def page_texts() -> dict[str, dict[str, str]]:
    """Return all texts by language and key; under `cautious` what stands for an unknown key."""
    texts = {language: texts_of(language, tuple(Reader)) for language in LANGUAGES}
    texts["cautious"] = CAUTIOUS
    return {
        language: {key: text.replace("Not-Halt", UNBROKEN) for key, text in keyed.items()}
        for language, keyed in texts.items()
    }
