"""Every word of the pages, in English and German.

Causes of a stop are in `cause_texts.py`, what the therapist reads in `therapist_texts.py` and
`stop_texts.py`. A page gets both languages, so that its button changes the language without a
reload.
"""

from collections.abc import Mapping
from enum import StrEnum, auto
from typing import Final

from gaitd_session import Text

from gaitd_display.cause_texts import cause_texts
from gaitd_display.stop_texts import stop_labels
from gaitd_display.therapist_texts import THERAPIST_LABELS


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


WORDS: Final[Mapping[Word, Text]] = {
    Word.NO_CONNECTION: Text("No connection", "Keine Verbindung"),
    Word.TOO_MANY_PAGES: Text("Too many pages", "Zu viele Seiten"),
    Word.NO_SIGNAL: Text("No signal", "Kein Signal"),
    Word.STOPPED: Text("Stopped", "Angehalten"),
    Word.STOPPING: Text("Stopping", "Hält an"),
    Word.WAIT: Text("Please wait", "Bitte warten"),
    Word.WAY_OUT: Text("The way out", "Aussteigen"),
    Word.START: Text("Ready for today?", "Bereit für heute?"),
    Word.NEXT: Text("Part {number} of {count}", "Teil {number} von {count}"),
    Word.PAUSED: Text("Paused", "Unterbrochen"),
    Word.REST: Text("Rest", "Pause"),
    Word.FINISHED: Text("Well done!", "Gut gemacht!"),
    Word.DAILY_TEST: Text("Daily test", "Test für heute"),
    Word.RELEASE: Text("Emergency stop is in", "Not-Halt ist gedrückt"),
    Word.LET_GO: Text("Test the switch", "Schalter testen"),
    Word.FAILED: Text("It did not start", "Das ging nicht"),
    Word.USED: Text("Machine is in use", "Gerät ist belegt"),
    Word.READY: Text("Ready", "Bereit"),
    Word.HELD: Text("Lie still", "Ruhig liegen"),
    Word.SOON: Text("Your leg will move", "Gleich geht es los"),
    Word.TO_START: Text("To the start", "Zum Start"),
    Word.SELF_TEST: Text("Self-test", "Selbsttest"),
    Word.GO_ON: Text("Go along", "Mitgehen"),
    Word.MORE: Text("A bit more", "Etwas mehr"),
    Word.GOOD: Text("Good", "Gut so"),
    Word.GENTLY: Text("Gently", "Sanfter"),
    Word.RELAX: Text("Relax", "Locker"),
    Word.ENDING: Text("Ending", "Es endet"),
    Word.GUIDE: Text("Move your leg", "Bein bewegen"),
    Word.SERVICE: Text("Service", "Wartung"),
}
"""Headings by word; a stop has that of its cause, a step of the way out its own."""

LINES: Final[Mapping[str, Text]] = {
    Word.TOO_MANY_PAGES: Text("Close another one. STOP works.", "Eine schließen. STOPP wirkt."),
    Word.STOPPING: Text("Lie still.", "Ruhig liegen bleiben."),
    Word.WAIT: Text("Your leg may not be held.", "Das Bein ist vielleicht lose."),
    Word.REST: Text("You may let go.", "Sie dürfen loslassen."),
    Word.DAILY_TEST: Text("Once a day.", "Einmal am Tag."),
    Word.FAILED: Text("Again? Call your therapist.", "Wieder? Therapie anrufen."),
    Word.USED: Text("Pause switches it off.", "Pause schaltet es aus."),
    Word.READY: Text("Your leg is not held.", "Das Bein wird nicht gehalten."),
    Word.HELD: Text("Your leg is held.", "Das Bein wird gehalten."),
    Word.SOON: Text("Keep holding the switch.", "Schalter weiter halten."),
    Word.TO_START: Text("Your leg moves slowly.", "Das Bein bewegt sich langsam."),
    Word.SELF_TEST: Text("Relax your leg.", "Bein locker lassen."),
    Word.ENDING: Text("Keep holding the switch.", "Schalter weiter halten."),
    Word.GUIDE: Text("Hold the switch.", "Schalter halten."),
    Word.SERVICE: Text("Not for training.", "Kein Training."),
}
"""The line below the heading, where there is one."""

SCENE_TEXTS: Final[Mapping[str, Text]] = {
    "plan_minutes": Text("{count} parts, {minutes} minutes", "{count} Teile, {minutes} Minuten"),
    "plan_seconds": Text("{count} parts, {seconds} seconds", "{count} Teile, {seconds} Sekunden"),
    "hold": Text("Hold the switch", "Schalter halten"),
    "hold_again": Text("Hold it again", "Wieder halten"),
    "keep": Text("Keep holding", "Schalter halten"),
    "let_go": Text("Let go", "Loslassen"),
    "press_reset": Text("Let leg go", "Bein lösen"),
    "press_start": Text("Press Start", "Start drücken"),
    "danger": Text("In danger", "Bei Gefahr"),
    "end_here": Text("Enough for today?", "Genug für heute?"),
    "press_stop": Text("Press the emergency stop", "Not-Halt drücken"),
    "release_stop": Text("Release it: turn or pull", "Wieder lösen: drehen oder ziehen"),
    "help": Text("Call for help", "Hilfe rufen"),
    "help_line": Text("Help: {help}", "Hilfe: {help}"),
    "to_stop": Text("To stop: let go", "Anhalten: loslassen"),
    "or_stop": Text("Or: emergency stop", "Oder: Not-Halt"),
    "straps_behind": Text("Straps: first the emergency stop.", "Gurte: erst Not-Halt drücken."),
    "not_held": Text("Your leg is not held.", "Das Bein wird nicht gehalten."),
    "reason": Text("{reason}", "{reason}"),
    "then_loose": Text("Then your leg is loose", "Danach ist das Bein lose"),
    "is_loose": Text("Your leg is loose: it can move", "Das Bein ist lose, kann sich bewegen"),
    "is_held": Text("Your leg is held", "Das Bein wird gehalten"),
    "by_hand": Text("Move it until you can get out", "Bewegen, bis Sie aussteigen können"),
    "way.switch": Text("Hold the switch", "Schalter halten"),
    "way.wait": WORDS[Word.WAIT],
    "way.enable": Text("2 of 4: hold the leg", "2 von 4: Bein halten"),
    "way.guide": Text("3 of 4: by hand", "3 von 4: von Hand"),
    "way.guiding": Text("4 of 4: hold it here", "4 von 4: hier halten"),
    "why_short.no_signal": Text("No signal for a moment.", "Kurz kein Signal."),
    "why_short.late_here": Text("This computer was too slow.", "Dieser Rechner war zu langsam."),
    "why_short.restarted": Text("The machine started again.", "Das Gerät ist neu gestartet."),
    "why_short.hand_switch": Text("The switch was open.", "Der Schalter war offen."),
    "why_short.late": Text("It was not ready in time.", "Es war nicht rechtzeitig bereit."),
    "why_short.ended_elsewhere": Text("The machine has ended it.", "Das Gerät hat es beendet."),
}
"""Cards and lines of the patient's page; what stands in braces is filled in."""

UNBROKEN: Final = "Not\u2060-\u2060Halt"
"""The name of the emergency stop, which no line ends within."""

LABELS: Final[Mapping[str, Text]] = {
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
    "quiet": Text("Alarm off", "Alarm aus"),
    "sound_off": Text("Allow sound", "Ton erlauben"),
    "refused": Text("The trainer has refused", "Der Trainer hat abgelehnt"),
    "no_answer": Text("The trainer did not answer", "Der Trainer hat nicht geantwortet"),
    "target": Text("Target", "Ziel"),
    "letter.right": Text("R", "R"),
    "letter.left": Text("L", "L"),
    "not_known": Text("not known", "nicht bekannt"),
    "in_target": Text("in target", "im Ziel"),
    "in_row": Text("in a row", "in Folge"),
    "minutes": Text("min", "min"),
    "seconds": Text("s", "s"),
    "block_left": Text(
        "Part {number} of {count}: {left} left", "Teil {number} von {count}: noch {left}"
    ),
    "of_steps": Text("of {count} steps in target", "von {count} Schritten im Ziel"),
    "no_steps": Text("The steps were not measured", "Die Schritte wurden nicht gemessen"),
    "next_part": Text("Next: part {number} of {count}", "Gleich: Teil {number} von {count}"),
    "walked": Text("walked", "gegangen"),
    "best_row": Text("best in a row", "beste Folge"),
    "your_share": Text("Your share: {share}", "Ihr Anteil: {share}"),
    "shares_before": Text("Last {last}, best {best}", "Zuletzt {last}, bester {best}"),
    "first_time": Text("The first time", "Das erste Mal"),
    "today": Text("today", "heute"),
    "not_kept": Text("not recorded", "nicht gespeichert"),
    "no_stop_now": Text("does not work now", "wirkt jetzt nicht"),
    "act.reset": Text("Let leg go", "Bein lösen"),
    "act.enable": Text("Hold leg", "Bein halten"),
    "act.hand_guiding": Text("By hand", "Von Hand"),
    "act.hold": Text("Hold here", "Hier halten"),
    "press.start": Text("Start", "Start"),
    "press.pause": Text("Pause", "Pause"),
    "press.end": Text("End", "Ende"),
}
"""All other texts, by the key that pages name in `data-text`."""


def page_texts() -> dict[str, dict[str, str]]:
    """All texts by language and key."""
    keyed = {
        **LABELS,
        **THERAPIST_LABELS,
        **stop_labels(),
        **SCENE_TEXTS,
        **cause_texts(),
        **{f"word.{word}": text for word, text in WORDS.items()},
        **{f"line.{word}": text for word, text in LINES.items()},
    }
    return {
        "en": {key: text.en for key, text in keyed.items()},
        "de": {key: text.de.replace("Not-Halt", UNBROKEN) for key, text in keyed.items()},
    }
