"""Every word of the pages, in English and German.

Causes of a stop are in `cause_texts.py`, what the therapist reads in `therapist_texts.py` and
`stop_texts.py`; what a session advises is in `gaitd_session`. The page gets
both languages, so that its button changes the language without a reload.
"""

from collections.abc import Mapping
from enum import StrEnum, auto
from typing import Final

from gaitd_session import ADVICE, WHY, Advice, Text

from gaitd_display.stop_texts import stop_labels
from gaitd_display.therapist_texts import THERAPIST_LABELS


class Word(StrEnum):
    """The large word of the patient's page."""

    NO_CONNECTION = auto()
    TOO_MANY_PAGES = auto()
    NO_SIGNAL = auto()
    STOPPED = auto()
    STOPPING = auto()
    WAIT = auto()
    READY = auto()
    REST = auto()
    SOON = auto()
    TO_START = auto()
    GO_ON = auto()
    STRONGER = auto()
    GOOD = auto()
    GENTLY = auto()
    ENDING = auto()
    GUIDE = auto()
    SELF_TEST = auto()
    SERVICE = auto()


WORDS: Final[Mapping[Word, Text]] = {
    Word.NO_CONNECTION: Text("No connection", "Keine Verbindung"),
    Word.TOO_MANY_PAGES: Text("Too many pages", "Zu viele Seiten"),
    Word.NO_SIGNAL: Text("No signal", "Kein Signal"),
    Word.STOPPED: Text("Stopped", "Angehalten"),
    Word.STOPPING: Text("Stopping", "Hält an"),
    Word.WAIT: Text("Please wait", "Bitte warten"),
    Word.READY: Text("Ready", "Bereit"),
    Word.REST: Text("Rest", "Pause"),
    Word.SOON: Text("Moving soon", "Gleich los"),
    Word.TO_START: Text("To the start", "Zum Start"),
    Word.GO_ON: Text("Go along", "Mitgehen"),
    Word.STRONGER: Text("Stronger", "Stärker"),
    Word.GOOD: Text("Good", "Gut"),
    Word.GENTLY: Text("Gently", "Sanfter"),
    Word.ENDING: Text("Ending", "Endet"),
    Word.GUIDE: Text("Move your leg", "Bein bewegen"),
    Word.SELF_TEST: Text("Self-test", "Selbsttest"),
    Word.SERVICE: Text("Service", "Wartung"),
}
"""Texts by word."""

EXPLAINED: Final[Mapping[Word, Text]] = {
    Word.NO_CONNECTION: Text(
        "This screen has lost its computer. STOP on this screen does not work now. "
        "To stop: release the hand switch, or press the emergency stop.",
        "Dieser Bildschirm hat keinen Kontakt zu seinem Rechner. STOPP auf diesem Bildschirm wirkt "
        "jetzt nicht. Zum Anhalten: Handschalter loslassen oder Not-Halt drücken.",
    ),
    Word.TOO_MANY_PAGES: Text(
        "Too many pages are open. Close one of the others. STOP works.",
        "Es sind zu viele Seiten offen. Eine der anderen schließen. STOPP wirkt.",
    ),
    Word.NO_SIGNAL: Text(
        "The trainer sends nothing. To stop: release the hand switch, or press the emergency stop.",
        "Der Trainer sendet nichts. Zum Anhalten: Handschalter loslassen oder Not-Halt drücken.",
    ),
    Word.STOPPING: Text("Lie still.", "Ruhig liegen bleiben."),
    Word.WAIT: Text(
        "The machine gets ready. Your leg may not be held.",
        "Die Maschine macht sich bereit. Ihr Bein wird vielleicht nicht gehalten.",
    ),
    Word.READY: Text(
        "The drives are off. Your leg is not held.",
        "Die Antriebe sind aus. Ihr Bein wird nicht gehalten.",
    ),
    Word.REST: Text("Your leg is held.", "Ihr Bein wird gehalten."),
    Word.SOON: Text(
        "Hold the hand switch. Your leg will move in a moment.",
        "Handschalter halten. Ihr Bein bewegt sich gleich.",
    ),
    Word.TO_START: Text(
        "Your leg moves slowly to its first position.",
        "Ihr Bein fährt langsam in die Anfangsstellung.",
    ),
    Word.GO_ON: Text("Move with the machine.", "Mit der Maschine mitgehen."),
    Word.STRONGER: Text("Help a little more.", "Etwas mehr mithelfen."),
    Word.GOOD: Text("Just right.", "Genau richtig."),
    Word.GENTLY: Text("Use a little less strength.", "Etwas weniger Kraft."),
    Word.ENDING: Text("The movement ends.", "Die Bewegung endet."),
    Word.GUIDE: Text(
        "You can move the leg by hand. Hold the hand switch.",
        "Das Bein lässt sich von Hand bewegen. Handschalter halten.",
    ),
    Word.SELF_TEST: Text("Stay relaxed.", "Locker bleiben."),
    Word.SERVICE: Text("Not for training.", "Kein Training."),
}
"""The line below the word; STOPPED has the text of its cause instead."""

LABELS: Final[Mapping[str, Text]] = {
    "patient_title": Text("Your training", "Ihr Training"),
    "language": Text("Deutsch", "English"),
    "stop": Text("STOP", "STOPP"),
    "stop_note": Text("Not the emergency stop", "Kein Not-Halt"),
    "stop_sent": Text("Stop requested", "Halt angefordert"),
    "stop_done": Text("STOP has arrived.", "STOPP ist angekommen."),
    "stop_failed": Text(
        "STOP did not arrive. Release the hand switch, or press the emergency stop.",
        "STOPP kam nicht an. Handschalter loslassen oder Not-Halt drücken.",
    ),
    "right": Text("Right", "Rechts"),
    "left": Text("Left", "Links"),
    "target": Text("Target", "Ziel"),
    "not_known": Text("not known", "nicht bekannt"),
    "strides": Text("Your share of each step", "Ihr Anteil an jedem Schritt"),
    "all": Text("all", "ganz"),
    "none": Text("none", "nichts"),
    "bigger": Text("A bigger dot: more work", "Größerer Punkt: mehr Arbeit"),
    "help": Text("Call for help", "Hilfe rufen"),
    "emergency_stop_first": Text(
        "First press the emergency stop. Then your leg is not held.",
        "Zuerst Not-Halt drücken. Dann wird Ihr Bein nicht gehalten.",
    ),
    "unstrap": Text("To get out of the straps", "Aus den Gurten kommen"),
    "quiet": Text("Alarm off", "Alarm aus"),
    "sound_off": Text("Touch here to allow sound", "Hier tippen: Ton erlauben"),
    "refused": Text("The trainer has refused", "Der Trainer hat abgelehnt"),
    "no_answer": Text("The trainer did not answer", "Der Trainer hat nicht geantwortet"),
    "way.switch": Text(
        "To get out: press the hand switch and keep it pressed.",
        "Um herauszukommen: Handschalter drücken und gedrückt halten.",
    ),
    "way.reset": Text(
        "Keep the hand switch pressed. After step 1 the drives do not hold your leg.",
        "Handschalter gedrückt halten. Nach Schritt 1 halten die Antriebe Ihr Bein nicht.",
    ),
    "way.wait": Text(
        "Please wait. The drives let go of your leg: it can move.",
        "Bitte warten. Die Antriebe lassen Ihr Bein los: es kann sich bewegen.",
    ),
    "way.enable": Text(
        "Keep the hand switch pressed. With step 2 the drives hold your leg again.",
        "Handschalter gedrückt halten. Mit Schritt 2 halten die Antriebe Ihr Bein wieder.",
    ),
    "way.guide": Text(
        "Your leg is held. With step 3 you can move it by hand.",
        "Ihr Bein wird gehalten. Mit Schritt 3 lässt es sich von Hand bewegen.",
    ),
    "way.guiding": Text(
        "Move your leg to where you can get out. Then press step 4.",
        "Das Bein dorthin bewegen, wo Sie herauskommen. Dann Schritt 4 drücken.",
    ),
    "act.reset": Text("1 Let go", "1 Loslassen"),
    "act.enable": Text("2 Hold the leg", "2 Bein halten"),
    "act.hand_guiding": Text("3 Move by hand", "3 Von Hand bewegen"),
    "act.hold": Text("4 Hold here", "4 Hier halten"),
    "walked": Text("Walked: {minutes} min", "Gegangen: {minutes} min"),
    "reached": Text(
        "Target reached in {reached} of {all} steps", "Ziel erreicht: {reached} von {all} Schritten"
    ),
    "not_kept": Text("not recorded", "nicht gespeichert"),
    "time_left": Text("Minutes left", "Minuten übrig"),
    "press.start": Text("Start", "Start"),
    "press.pause": Text("Pause", "Pause"),
    "press.end": Text("End", "Ende"),
    "no_connection": WORDS[Word.NO_CONNECTION],
    "too_many_pages": WORDS[Word.TOO_MANY_PAGES],
    "no_signal": WORDS[Word.NO_SIGNAL],
}
"""All other texts, by the key that pages name in `data-text`."""


def page_texts() -> dict[str, dict[str, str]]:
    """All texts by language and key; words are `word.NAME`, their lines `line.NAME`."""
    keyed = {
        **LABELS,
        **THERAPIST_LABELS,
        **stop_labels(),
        **{f"word.{word}": text for word, text in WORDS.items()},
        **{f"line.{word}": text for word, text in EXPLAINED.items()},
        **{f"advice.{advice}": text for advice, text in ADVICE.items()},
        **{f"why.{why}": text for why, text in WHY.items()},
        "way.start": ADVICE[Advice.PRESS_START_TO_RESET],
    }
    return {
        "en": {key: text.en for key, text in keyed.items()},
        "de": {key: text.de for key, text in keyed.items()},
    }
