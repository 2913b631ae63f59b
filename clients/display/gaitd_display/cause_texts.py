"""What has stopped the machine and what to do now, for the person in it, in two languages.

The words are for a layperson who lies in the machine, alone or not, and reads from the chair: a
heading of at most `HEADING_MAX` characters, a last line of at most `LAST_LINE_MAX`, and what this
person can do as a card. A whole sentence is beside the heading, for a screen reader. `Situation`
follows the first instruction of the service's own text for the cause; a test compares both. The
service's remedies, with commands, are for terminals; the therapist's page has `stop_texts.py`.
"""

from collections.abc import Mapping
from enum import StrEnum, auto
from typing import Final, NamedTuple

from gaitd_client import Cause
from gaitd_session import Text

HEADING_MAX: Final = 21
LAST_LINE_MAX: Final = 39


class Situation(StrEnum):
    """State of the leg after a stop."""

    HELD = auto()
    """The drives hold the leg."""
    LOOSE = auto()
    """The leg may not be held."""
    DANGER = auto()
    """A drive cannot be commanded any more, or cannot be trusted."""
    AT_REST = auto()
    """The machine was not moving, and does not start."""


LAST_LINES: Final[Mapping[Situation, Text]] = {
    Situation.HELD: Text("Lie still. Your leg is held.", "Ruhig liegen. Das Bein wird gehalten."),
    Situation.LOOSE: Text(
        "Hands off the slide. Leg may move.", "Hände vom Schlitten. Bein evtl. lose."
    ),
    Situation.DANGER: Text(
        "Hands off the slide. Leg not held.", "Hände weg vom Schlitten. Bein ist lose."
    ),
    Situation.AT_REST: Text(
        "Lie still. It does not move your leg.", "Ruhig liegen. Das Bein bleibt in Ruhe."
    ),
}
"""What to know about the leg."""


class PatientText(NamedTuple):
    """Text of one cause."""

    situation: Situation
    heading: Text
    happened: Text
    """The whole sentence."""
    advice: Text | None = None
    """What this person can do; None: nothing but to wait for help."""


_RELAX = Text("Relax your leg", "Bein locker lassen")
_RESISTED = Text("Is something caught?", "Klemmt etwas?")
_DEFECT = (
    Text("Machine fault", "Gerät gestört"),
    Text("A part of the machine has failed.", "Ein Teil des Geräts ist ausgefallen."),
)
_PROGRAM = (
    Text("Computer fault", "Rechner gestört"),
    Text("The control computer had a fault.", "Der Steuerrechner hatte eine Störung."),
)
_TOO_FAST = (
    Text("Leg was too fast", "Bein war zu schnell"),
    Text("Your leg was too fast.", "Ihr Bein war zu schnell."),
)

CAUSE_TEXTS: Final[Mapping[Cause, PatientText]] = {
    Cause.STOP_REQUESTED: PatientText(
        Situation.HELD,
        Text("STOP was pressed", "STOPP gedrückt"),
        Text("STOP was pressed.", "STOPP wurde gedrückt."),
    ),
    Cause.SHUTDOWN: PatientText(
        Situation.LOOSE,
        Text("Machine switched off", "Gerät ausgeschaltet"),
        Text("The machine was switched off.", "Das Gerät wurde ausgeschaltet."),
    ),
    Cause.GATEWAY_SILENT: PatientText(Situation.HELD, *_PROGRAM),
    Cause.CYCLE_OVERRUN: PatientText(Situation.HELD, *_PROGRAM),
    Cause.COMMAND_NOT_FINITE: PatientText(Situation.HELD, *_PROGRAM),
    Cause.LAST_END_UNKNOWN: PatientText(
        Situation.LOOSE,
        Text("Machine was off", "Gerät war aus"),
        Text(
            "The machine had no power, or ended unexpectedly.",
            "Das Gerät hatte keinen Strom oder endete unerwartet.",
        ),
    ),
    Cause.HAND_SWITCH_OPEN: PatientText(
        Situation.HELD,
        Text("You let go: stopped", "Losgelassen: Halt"),
        Text("The hand switch was released.", "Der Handschalter wurde losgelassen."),
        Text("Hold the switch again", "Schalter wieder halten"),
    ),
    Cause.STO_ACTIVE: PatientText(
        Situation.LOOSE,
        Text("Emergency stop", "Not-Halt gedrückt"),
        Text("The emergency stop was pressed.", "Der Not-Halt wurde gedrückt."),
    ),
    Cause.INPUTS_IMPOSSIBLE: PatientText(Situation.HELD, *_DEFECT),
    Cause.BUS_DOWN: PatientText(Situation.DANGER, *_DEFECT),
    Cause.DRIVE_SILENT: PatientText(Situation.DANGER, *_DEFECT),
    Cause.HEARTBEAT_LOST: PatientText(Situation.DANGER, *_DEFECT),
    Cause.DRIVE_REBOOTED: PatientText(Situation.DANGER, *_DEFECT),
    Cause.DRIVE_NOT_OPERATIONAL: PatientText(Situation.DANGER, *_DEFECT),
    Cause.DRIVE_FAULT: PatientText(Situation.HELD, *_DEFECT),
    Cause.EMERGENCY: PatientText(Situation.HELD, *_DEFECT),
    Cause.DRIVE_LEFT_ENABLED: PatientText(Situation.LOOSE, *_DEFECT),
    Cause.MODE_NOT_SHOWN: PatientText(Situation.HELD, *_DEFECT),
    Cause.NOT_FOLLOWING: PatientText(Situation.HELD, *_DEFECT),
    Cause.BRING_UP_FAILED: PatientText(
        Situation.AT_REST,
        Text("It does not start", "Gerät startet nicht"),
        Text("The machine cannot be started.", "Das Gerät lässt sich nicht starten."),
    ),
    Cause.BUS_OFF: PatientText(Situation.DANGER, *_DEFECT),
    Cause.TRANSMIT_QUEUE_FULL: PatientText(Situation.DANGER, *_DEFECT),
    Cause.DRIVE_POWERED: PatientText(
        Situation.HELD,
        Text("Computer restarted", "Rechner neu gestartet"),
        Text("The control computer has started again.", "Der Steuerrechner ist neu gestartet."),
    ),
    Cause.UNEXPECTED_ENABLE: PatientText(Situation.DANGER, *_DEFECT),
    Cause.ENCODER_FROZEN: PatientText(
        Situation.LOOSE,
        Text("Is your leg blocked?", "Bein blockiert?"),
        Text(
            "Your leg is blocked, or a sensor has failed.",
            "Ihr Bein ist blockiert, oder ein Sensor ist ausgefallen.",
        ),
    ),
    Cause.ENCODER_JUMP: PatientText(Situation.LOOSE, *_DEFECT),
    Cause.UNREFERENCED: PatientText(
        Situation.LOOSE,
        Text("Position not known", "Stellung unbekannt"),
        Text("The machine does not know its position.", "Das Gerät kennt seine Stellung nicht."),
    ),
    Cause.SIGN_WRONG: PatientText(Situation.DANGER, *_DEFECT),
    Cause.EFFORT_DEVIATION: PatientText(Situation.HELD, *_DEFECT),
    Cause.MOVED_AGAINST_DRIVE: PatientText(
        Situation.HELD,
        Text("Too much force", "Zu viel Kraft"),
        Text(
            "Your leg moved with more force than the machine can guide.",
            "Ihr Bein bewegte sich mit mehr Kraft, als das Gerät führen kann.",
        ),
        Text("Slower is easier", "Langsamer geht es leichter"),
    ),
    Cause.POSITION_LIMIT: PatientText(
        Situation.HELD,
        Text("Leg went too far", "Bein kam zu weit"),
        Text("Your leg went too far.", "Ihr Bein kam zu weit."),
        _RELAX,
    ),
    Cause.VELOCITY_LIMIT: PatientText(Situation.HELD, *_TOO_FAST, _RELAX),
    Cause.EFFORT_LIMIT: PatientText(
        Situation.HELD,
        Text("Force was too high", "Kraft war zu groß"),
        Text("The force was too high.", "Die Kraft war zu groß."),
        _RESISTED,
    ),
    Cause.POWER_LIMIT: PatientText(
        Situation.HELD,
        Text("It pushed too hard", "Zu stark geschoben"),
        Text("The machine pushed too hard.", "Das Gerät schob zu stark."),
        _RELAX,
    ),
    Cause.TRACKING_LIMIT: PatientText(
        Situation.HELD,
        Text("Leg did not follow", "Bein folgte nicht"),
        Text("Your leg did not follow the movement.", "Ihr Bein folgte der Bewegung nicht."),
        _RESISTED,
    ),
    Cause.TEMPERATURE_LIMIT: PatientText(
        Situation.HELD,
        Text("Machine is too hot", "Gerät ist zu heiß"),
        Text("The machine is too hot.", "Das Gerät ist zu heiß."),
        Text("Do not touch motors", "Motoren nicht berühren"),
    ),
    Cause.SINGULARITY: PatientText(
        Situation.HELD,
        Text("Leg almost stretched", "Bein fast gestreckt"),
        Text("Your leg was almost stretched.", "Ihr Bein war fast gestreckt."),
        _RELAX,
    ),
    Cause.LIMIT_SWITCH: PatientText(
        Situation.HELD,
        Text("Machine at its end", "Gerät am Anschlag"),
        Text("The machine reached its end.", "Das Gerät kam an sein Ende."),
    ),
    Cause.ENERGY_LIMIT: PatientText(
        Situation.HELD,
        Text("Step was too hard", "Schritt war zu schwer"),
        Text("The step was too hard.", "Der Schritt war zu schwer."),
        _RELAX,
    ),
    Cause.STOPPING_PATH: PatientText(Situation.HELD, *_TOO_FAST, _RELAX),
    Cause.OBSERVER_INVALID: PatientText(
        Situation.HELD,
        Text("Strength not known", "Kraft unbekannt"),
        Text(
            "The machine cannot tell your strength any more.",
            "Das Gerät erkennt Ihre Kraft nicht mehr.",
        ),
    ),
    Cause.STATIC_LOAD_WRONG: PatientText(
        Situation.HELD,
        Text("Leg's weight is wrong", "Beingewicht falsch"),
        Text(
            "The weight of the leg is not as set up.",
            "Das Gewicht des Beins ist nicht wie eingestellt.",
        ),
    ),
    Cause.SPASM: PatientText(
        Situation.HELD,
        Text("Your leg got stiff", "Ihr Bein wurde steif"),
        Text("Your leg became stiff.", "Ihr Bein wurde steif."),
        Text("Wait until it is loose", "Warten, bis es locker ist"),
    ),
    Cause.SELF_TEST_FAILED: PatientText(
        Situation.HELD,
        Text("Self-test failed", "Test nicht bestanden"),
        Text("The machine test has failed.", "Der Gerätetest ist fehlgeschlagen."),
    ),
    Cause.CLONUS: PatientText(
        Situation.HELD,
        Text("Your leg twitched", "Ihr Bein hat gezuckt"),
        Text("Your leg was twitching.", "Ihr Bein hat gezuckt."),
        Text("Wait until it is quiet", "Warten, bis es ruhig ist"),
    ),
    Cause.STOP_NOT_OBEYED: PatientText(Situation.DANGER, *_DEFECT),
}
"""Text of every cause but NONE."""

UNKNOWN_CAUSE: Final = PatientText(Situation.DANGER, *_DEFECT)
"""For a cause of a later version of the service."""


def known(cause: str) -> str:
    """Return the cause, or `unknown` for one that this version does not know."""
    return cause if cause in CAUSE_TEXTS else "unknown"


def patient_text(cause: str) -> PatientText:
    """Return the text of a cause, also of one that this version does not know."""
    return CAUSE_TEXTS[Cause(cause)] if cause in CAUSE_TEXTS else UNKNOWN_CAUSE


def cause_texts() -> dict[str, Text]:
    """Return all texts of this file by the keys that pages name."""
    texts = {f"last.{situation}": text for situation, text in LAST_LINES.items()}
    for cause, told in {**CAUSE_TEXTS, "unknown": UNKNOWN_CAUSE}.items():
        texts |= {f"stop.{cause}": told.heading, f"happened.{cause}": told.happened}
        if told.advice is not None:
            texts[f"advise.{cause}"] = told.advice
    return texts
