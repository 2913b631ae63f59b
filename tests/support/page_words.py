"""Words of the German pages: none is English but a few names that a German reader uses too."""

import re
import string
from collections.abc import Iterable

from gaitd_texts import Catalogue, Reader, catalogue

WORD = re.compile(r"[A-Za-zÄÖÜäöüß]+")
QUOTED = re.compile(r"`[^`]*`")
"""A command, or a key of a file or of a message, as it is written there."""
FOREIGN = frozenset(
    word
    for line in (
        # of the machine: CAN, CANopen, programs
        "adapter bit bits boot bus bytes can codes controller dh emcy error fdh fh firmware gaitd",
        "gateway hardware heartbeat json nan nmt off option passive pdos",
        "register restart ring server session software sto sync up",
        # of both languages, with the same meaning
        "alarm amplitude installation motor name neutral patient pause person plan position robot",
        "hz minus sensor signal start stopp test training tremor version",
    )
    for word in line.split()
)
"""Names of CAN, of CANopen, of programs; and words of both languages that mean the same in both."""
GERMAN = frozenset(
    word
    for line in (
        "an in so was last fast hand min minute not",
        "c h j l m mm ms n r s sin",
    )
    for word in line.split()
)
"""Written as an English word, or as a unit, with a meaning of its own."""


def words(texts: Iterable[str]) -> set[str]:
    """All words of some texts, without what is quoted."""
    return {word.lower() for text in texts for word in WORD.findall(QUOTED.sub("", text))}


def words_of(texts: Catalogue) -> set[str]:
    """All words of a catalogue, without the names of values."""
    parts = (string.Formatter().parse(text) for text in texts.texts.values())
    return words("".join(part for part, *_ in one) for one in parts)


def english_in(texts: Iterable[str], names: Iterable[str] = ()) -> set[str]:
    """Words that no German text has: of an English one, or a code.

    Args:
        texts: as they are shown.
        names: what a test has named itself, a client or a patient.
    """
    german = set().union(*(words_of(catalogue(reader, "de")) for reader in Reader))
    return words(texts) - german - FOREIGN - GERMAN - words(names)
