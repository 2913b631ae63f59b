"""Events and refusals of the service in plain words, in two languages.

The service speaks English sentences, which may hold names of modes and states. Where a sentence is
known here its meaning is said in both languages; else None, and the page shows the sentence itself,
marked as English. Nothing is decided by these words.
"""

import re
from collections.abc import Callable, Mapping
from typing import Final

from gaitd_client import Event
from gaitd_session import Text

from gaitd_display.stop_texts import STOP_TEXTS, stop_labels
from gaitd_display.therapist_texts import THERAPIST_LABELS

Spoken = dict[str, str]
"""A text as a page gets it, by language."""
Say = Callable[[re.Match[str]], Text | None]
_STOPS: Final = stop_labels()


def spoken(text: Text | None) -> Spoken | None:
    """Return a text as a page gets it; None: there is none."""
    return None if text is None else text._asdict()


def _said(key: str) -> Text | None:
    return THERAPIST_LABELS.get(key)


def _word(group: str, name: str) -> Say:
    """Say the text of a key, whose name is a group of the match."""
    return lambda found: _said(f"{group}.{found[name].replace(' ', '_')}")


def _only(en: str, de: str) -> Say:
    return lambda _: Text(en, de)


def subject_text(subject: str | None) -> Text | None:
    """Return leg and axis in words; None: there is none, or another one than of this trainer.

    Args:
        subject: LEG/AXIS or LEG.
    """
    leg, _, axis = (subject or "").partition("/")
    side, joint = _said(f"side.{leg}"), _said(f"axis.{axis}")
    if side is None:
        return None
    return side if joint is None else Text(f"{side.en}, {joint.en}", f"{side.de}, {joint.de}")


def _about(subject: str, text: Text | None) -> Text | None:
    """Return a text with the leg or drive that it is about."""
    about = subject_text(subject)
    if text is None or about is None:
        return text
    return Text(f"{about.en}: {text.en}", f"{about.de}: {text.de}")


def _first_match(rules: Mapping[str, Say], text: str) -> Text | None:
    for pattern, say in rules.items():
        if (found := re.match(pattern, text)) is not None and (said := say(found)) is not None:
            return said
    return None


# --- refusals ----------------------------------------------------------------------------------


def _not_in(found: re.Match[str]) -> Text | None:
    now = _said(f"mode.{found['mode']}")
    return now and Text(f"Not possible now: {now.en}.", f"Jetzt nicht möglich: {now.de}.")


REFUSALS: Final[Mapping[str, Say]] = {
    "the hand switch is open|no drive shows the hand switch": _only(
        "The hand switch is not held.", "Der Handschalter wird nicht gehalten."
    ),
    "safe torque off is active": _only(
        "The emergency stop is pressed. Release it.", "Der Not-Halt ist gedrückt. Ihn lösen."
    ),
    "the leg is moving": _only(
        "The leg still moves. Wait until it is at rest.",
        "Das Bein bewegt sich noch. Warten, bis es ruht.",
    ),
    "not referenced": _only(
        "The position of an axis is not known. It has to be referenced.",
        "Die Lage einer Achse ist nicht bekannt. Sie muss referenziert werden.",
    ),
    "the sign is not proven": _only(
        "An axis has not passed its first check. It has to be commissioned.",
        "Eine Achse hat ihre erste Prüfung nicht bestanden. Sie muss in Betrieb genommen werden.",
    ),
    "not seen to act today": _only(
        "The daily test is due: let go of the hand switch, press the emergency stop, release it, "
        "and hold the switch again.",
        "Die tägliche Prüfung steht an: Handschalter loslassen, Not-Halt drücken und lösen, den "
        "Schalter wieder halten.",
    ),
    "outside its range": _only(
        "The leg is outside its range. Move it back by hand.",
        "Das Bein ist außerhalb seines Bereichs. Es von Hand zurückführen.",
    ),
    "the core has restarted": _only(
        "The control program has started again. Press again.",
        "Das Steuerprogramm ist neu gestartet. Noch einmal drücken.",
    ),
    "the gateway is not alive|no records arrive|the core": _only(
        "The control program does not answer.", "Das Steuerprogramm antwortet nicht."
    ),
    "no sample of this cycle|the drives are not holding yet|made for cycle": _only(
        "The drives were not ready in this moment. Press again.",
        "Die Antriebe waren in diesem Augenblick nicht bereit. Noch einmal drücken.",
    ),
    "no self-test|the last self-test|(.*): `gaitd self-test`": _only(
        "A self-test has to be passed first.", "Zuerst muss ein Selbsttest bestanden werden."
    ),
    "busy|another request": _only(
        "Another request has no answer yet. Wait a moment.",
        "Eine andere Anforderung ist noch offen. Kurz warten.",
    ),
    "a stop was requested": _only(
        "A stop was requested at the same time.", "Zugleich wurde ein Halt angefordert."
    ),
    "the role": _only(
        "The keys of this page do not allow it.", "Die Schlüssel dieser Seite erlauben es nicht."
    ),
    "'.*' is not possible in mode (?P<mode>\\w+)": _not_in,
}
"""What is said of a refusal, by a pattern for the begin of its reason."""


def refusal_text(reason: str) -> Text | None:
    """Return what is said of a refusal; None: its reason is not known here."""
    return _first_match(REFUSALS, reason)


# --- events ------------------------------------------------------------------------------------


def _now(found: re.Match[str]) -> Text | None:
    now = _said(f"mode.{found['mode']}")
    return now and Text(f"Now: {now.en}", f"Jetzt: {now.de}")


def _stage(found: re.Match[str]) -> Text | None:
    mode, stage = _said(f"mode.{found['mode']}"), _said(f"stage.{found['stage']}")
    if mode is None or stage is None:
        return None
    return Text(f"{mode.en}, {stage.en}", f"{mode.de}, {stage.de}")


def _asked(found: re.Match[str], outcome: str) -> Text | None:
    name, said = _said(f"request.{found['name']}"), _said(f"outcome.{outcome}")
    if name is None or said is None:
        return None
    by = found.groupdict().get("by")
    whose = Text(f" ({by})", f" ({by})") if by else Text("", "")
    return Text(f"{name.en}: {said.en}{whose.en}", f"{name.de}: {said.de}{whose.de}")


def _refused(found: re.Match[str]) -> Text | None:
    name, why = _said(f"request.{found['name']}"), refusal_text(found["why"])
    if name is None or why is None:
        return None
    return Text(f"{name.en}: refused. {why.en}", f"{name.de}: abgelehnt. {why.de}")


_AXIS: Final = "(?P<subject>(right|left)/(hip|slide)): "
_NAMED: Final = "(?P<name>enable|disable|reset|stop|plan|mode|acquire|release|restart)"
EVENTS: Final[Mapping[str, Say]] = {
    "mode \\w+ (→|->) (?P<mode>\\w+)": _now,
    "core is running, mode (?P<mode>\\w+)": _now,
    "no record from the core": _only(
        "The control program has fallen silent. Nothing that was shown is valid.",
        "Das Steuerprogramm antwortet nicht. Nichts Gezeigtes gilt mehr.",
    ),
    "records from the core arrive again": _only(
        "The control program answers again.", "Das Steuerprogramm antwortet wieder."
    ),
    "bring-up begun": _only("The drives are set up.", "Die Antriebe werden eingerichtet."),
    "drives are up$": _only("The drives are set up and ready.", "Die Antriebe sind bereit."),
    "the verdict is cleared": _only("The stop was ended.", "Der Halt wurde beendet."),
    "(right|left): (?P<mode>\\w+) (?P<stage>\\w+)$": _stage,
    f"{_AXIS}hand switch (?P<state>open|closed)": _word("switch", "state"),
    f"{_AXIS}safe torque off (?P<state>active|released)": _word("sto", "state"),
    f"{_AXIS}NMT state (?P<state>\\w+)": _word("nmt", "state"),
    f"{_AXIS}(?P<state>[a-z ]+)$": _word("power", "state"),
    f"{_AXIS}knows its position": _only("position is known", "Lage ist bekannt"),
    f"{_AXIS}does not know its position": _only("position is lost", "Lage ist verloren"),
    f"{_AXIS}EMCY cleared": _only("error message is over", "Fehlermeldung ist vorbei"),
    f"{_AXIS}self-test passed": _only("self-test passed", "Selbsttest bestanden"),
    f"{_AXIS}clonus": _only(
        "the leg twitches, guidance is softer", "das Bein zuckt, Führung ist weicher"
    ),
    f"{_NAMED}, asked by (?P<by>.+?): refused: (?P<why>.*)": _refused,
    f"{_NAMED}, asked by (?P<by>.+?): done": lambda found: _asked(found, "done"),
    f"{_NAMED}, asked by (?P<by>[^:]+)$": lambda found: _asked(found, "requested"),
    f"{_NAMED}( \\w+)? refused: (?P<why>.*)": _refused,
    "mode (?P<mode>\\w+) requested": _word("mode", "mode"),
    f"{_NAMED} requested$": lambda found: _asked(found, "requested"),
    f"{_NAMED}( \\w+)? done": lambda found: _asked(found, "done"),
}
"""What is said of an event, by a pattern for the begin of its text."""


def event_text(event: Event) -> Text | None:
    """Return what is said of an event; None: its text is not known here."""
    if event.cause in STOP_TEXTS:
        return _about(event.subject or "", _STOPS[f"stopped.{event.cause}"])
    said = _first_match(EVENTS, event.text)
    return _about(event.subject, said) if event.subject else said


def event_remedy(event: Event) -> Text | None:
    """Return what is to be done after a stop; None: the event's own remedy holds."""
    return _STOPS[f"then.{event.cause}"] if event.cause in STOP_TEXTS else None
