"""Sentences that tell a person to touch the machine are approved word for word.

`approved_texts.toml` has them: of the patient's texts each one with a word of `TOUCH`, of the
operator's those about a stop and a commissioning, and what has to be done first in any case. A
person reviews a change of that file, as one of a limit; no native clinician has reviewed the German
yet.
"""

import re
import tomllib
from pathlib import Path

from gaitd_texts import CAUTIOUS, Reader, catalogue

APPROVED = tomllib.loads(
    (Path(__file__).parent / "approved_texts.toml").read_text(encoding="utf-8")
)
TOUCH = {
    "en": re.compile(
        r"\b(press|releas|hold|let go|let leg go|turn|pull|push|mov|lift|bend|lead|support|strap"
        r"|hands?\b|touch|relax|lie\b|free\b|help|open|clos|walk|caught)",
        re.IGNORECASE,
    ),
    "de": re.compile(
        r"(drücken|gedrückt|lösen|halten\b|loslassen|losgelassen|locker|drehen|ziehen|schieben"
        r"|beweg|heben\b|beugen|führen|stützen|gurt|\bhände\b|berühr|anfassen|liegen|helfen|hilfe"
        r"|von hand|öffnen|schließen|gehen\b|steigen|freimachen|klemmt)",
        re.IGNORECASE,
    ),
}
"""Words of what a person does with hands or body at the machine, and of what such a sentence
reports; too many rather than too few."""
OF_AN_ACT = {"first", "go_on", "stop_step", "loss", "instruction", "when_fast"}
"""Groups of the operator's texts that say what to do at the machine."""


def instructions(reader):
    """Keys of the texts that must be approved."""
    for language, words in TOUCH.items():
        for key, text in catalogue(reader, language).texts.items():
            group = key.partition(".")[0]
            is_told = reader is Reader.PATIENT or group in OF_AN_ACT
            if group == "first" or (is_told and words.search(text)):
                yield key


def test_each_sentence_that_tells_a_person_to_touch_the_machine_is_approved_word_for_word():
    for reader in Reader:
        approved = {
            language: {key: both[at] for key, both in APPROVED[reader].items()}
            for at, language in enumerate(TOUCH)
        }
        for language, texts in approved.items():
            catalogued = catalogue(reader, language).texts
            assert texts == {key: catalogued.get(key) for key in texts}, language


def test_no_such_sentence_is_missing_in_the_approved_ones():
    for reader in Reader:
        found = set(instructions(reader))
        assert len(found) > 20
        assert found - APPROVED[reader].keys() == set()


def test_the_most_cautious_sentence_is_the_approved_one():
    assert CAUTIOUS == {
        "en": "Press the emergency stop. Call for help.",
        "de": "Not-Halt drücken. Hilfe rufen.",
    }
