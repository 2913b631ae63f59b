"""Texts of codes and of pages, for the operator and the patient, in English and German.

Reading order: `operator.en.toml` and `patient.en.toml`, each beside its German (the sentences),
`stops.py` (what is known of each cause of a stop), `catalogue.py` (sentences from codes).
"""

from gaitd_texts.catalogue import (
    CAUTIOUS,
    COMMANDS,
    LANGUAGES,
    Catalogue,
    Reader,
    catalogue,
    language_of,
    texts_of,
)
from gaitd_texts.stops import (
    HOLDING,
    STOPS,
    Again,
    GoOn,
    Situation,
    Stop,
    key_of,
    situation_of,
    stop_of,
)

__all__ = [
    "CAUTIOUS",
    "COMMANDS",
    "HOLDING",
    "LANGUAGES",
    "STOPS",
    "Again",
    "Catalogue",
    "GoOn",
    "Reader",
    "Situation",
    "Stop",
    "catalogue",
    "key_of",
    "language_of",
    "situation_of",
    "stop_of",
    "texts_of",
]
