"""What has stopped the machine and what to do now, for the person in it, in two languages.

The words are for a layperson who lies in the machine, alone or not, and reads from three metres:
one sentence on what has happened, then what to do. `Situation` follows the first instruction of the
service's own text for the cause; a test compares both. The service's remedies, with commands, are
for terminals, and the therapist's page has `stop_texts.py`.
"""

from collections.abc import Mapping
from enum import StrEnum, auto
from typing import Final, NamedTuple

from gaitd_client import Cause
from gaitd_session import Text


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


INSTRUCTIONS: Final[Mapping[Situation, tuple[Text, ...]]] = {
    Situation.HELD: (
        Text("Lie still. Your leg is held.", "Ruhig liegen bleiben. Ihr Bein wird gehalten."),
    ),
    Situation.LOOSE: (
        Text(
            "Lie still. Keep your hands off the slide.",
            "Ruhig liegen bleiben. Hände weg vom Schlitten.",
        ),
        Text(
            "Your leg may not be held: it can move.",
            "Ihr Bein wird vielleicht nicht gehalten: es kann sich bewegen.",
        ),
    ),
    Situation.DANGER: (
        Text("Press the emergency stop.", "Not-Halt drücken."),
        Text(
            "Keep your hands off the slide. Your leg is not held any more.",
            "Hände weg vom Schlitten. Ihr Bein wird nicht mehr gehalten.",
        ),
    ),
    Situation.AT_REST: (
        Text(
            "Lie still. The machine does not move your leg.",
            "Ruhig liegen bleiben. Die Maschine bewegt Ihr Bein nicht.",
        ),
    ),
}
"""What to do at once, in this order."""


class PatientText(NamedTuple):
    """Text of one cause."""

    situation: Situation
    happened: Text
    advice: Text | None = None
    """What this person can do about the cause; None: nothing but to wait for help."""


_RELAX = Text("Relax your leg.", "Das Bein locker lassen.")
_DEFECT = Text("A part of the machine has failed.", "Ein Teil der Maschine ist ausgefallen.")
_PROGRAM = Text("The control computer had a fault.", "Der Steuerrechner hatte eine Störung.")
_RESISTED = Text(
    "Look whether a blanket, a strap or a hand is caught.",
    "Nachsehen, ob eine Decke, ein Gurt oder eine Hand eingeklemmt ist.",
)

CAUSE_TEXTS: Final[Mapping[Cause, PatientText]] = {
    Cause.STOP_REQUESTED: PatientText(
        Situation.HELD, Text("STOP was pressed.", "STOPP wurde gedrückt.")
    ),
    Cause.SHUTDOWN: PatientText(
        Situation.LOOSE, Text("The machine was switched off.", "Die Maschine wurde ausgeschaltet.")
    ),
    Cause.GATEWAY_SILENT: PatientText(Situation.HELD, _PROGRAM),
    Cause.CYCLE_OVERRUN: PatientText(Situation.HELD, _PROGRAM),
    Cause.COMMAND_NOT_FINITE: PatientText(Situation.HELD, _PROGRAM),
    Cause.LAST_END_UNKNOWN: PatientText(
        Situation.LOOSE,
        Text(
            "The machine had no power, or ended unexpectedly.",
            "Die Maschine hatte keinen Strom oder endete unerwartet.",
        ),
    ),
    Cause.HAND_SWITCH_OPEN: PatientText(
        Situation.HELD,
        Text("The hand switch was released.", "Der Handschalter wurde losgelassen."),
        Text("Hold the hand switch again.", "Handschalter wieder halten."),
    ),
    Cause.STO_ACTIVE: PatientText(
        Situation.LOOSE, Text("The emergency stop was pressed.", "Der Not-Halt wurde gedrückt.")
    ),
    Cause.INPUTS_IMPOSSIBLE: PatientText(Situation.HELD, _DEFECT),
    Cause.BUS_DOWN: PatientText(Situation.DANGER, _DEFECT),
    Cause.DRIVE_SILENT: PatientText(Situation.DANGER, _DEFECT),
    Cause.HEARTBEAT_LOST: PatientText(Situation.DANGER, _DEFECT),
    Cause.DRIVE_REBOOTED: PatientText(Situation.DANGER, _DEFECT),
    Cause.DRIVE_NOT_OPERATIONAL: PatientText(Situation.DANGER, _DEFECT),
    Cause.DRIVE_FAULT: PatientText(Situation.HELD, _DEFECT),
    Cause.EMERGENCY: PatientText(Situation.HELD, _DEFECT),
    Cause.DRIVE_LEFT_ENABLED: PatientText(Situation.LOOSE, _DEFECT),
    Cause.MODE_NOT_SHOWN: PatientText(Situation.HELD, _DEFECT),
    Cause.NOT_FOLLOWING: PatientText(Situation.HELD, _DEFECT),
    Cause.BRING_UP_FAILED: PatientText(
        Situation.AT_REST,
        Text("The machine cannot be started.", "Die Maschine lässt sich nicht starten."),
    ),
    Cause.BUS_OFF: PatientText(Situation.DANGER, _DEFECT),
    Cause.TRANSMIT_QUEUE_FULL: PatientText(Situation.DANGER, _DEFECT),
    Cause.DRIVE_POWERED: PatientText(
        Situation.HELD,
        Text(
            "The control computer has started again.",
            "Der Steuerrechner ist neu gestartet.",
        ),
    ),
    Cause.UNEXPECTED_ENABLE: PatientText(Situation.DANGER, _DEFECT),
    Cause.ENCODER_FROZEN: PatientText(
        Situation.LOOSE,
        Text(
            "Your leg is blocked, or a sensor has failed.",
            "Ihr Bein ist blockiert, oder ein Sensor ist ausgefallen.",
        ),
    ),
    Cause.ENCODER_JUMP: PatientText(Situation.LOOSE, _DEFECT),
    Cause.UNREFERENCED: PatientText(
        Situation.LOOSE,
        Text("The machine does not know its position.", "Die Maschine kennt ihre Stellung nicht."),
    ),
    Cause.SIGN_WRONG: PatientText(Situation.DANGER, _DEFECT),
    Cause.EFFORT_DEVIATION: PatientText(Situation.HELD, _DEFECT),
    Cause.MOVED_AGAINST_DRIVE: PatientText(
        Situation.HELD,
        Text(
            "Your leg moved with more force than the machine can guide.",
            "Ihr Bein bewegte sich mit mehr Kraft, als die Maschine führen kann.",
        ),
        Text("A slower pace needs less force.", "Langsamer braucht es weniger Kraft."),
    ),
    Cause.POSITION_LIMIT: PatientText(
        Situation.HELD,
        Text("Your leg went too far.", "Ihr Bein kam zu weit."),
        _RELAX,
    ),
    Cause.VELOCITY_LIMIT: PatientText(
        Situation.HELD, Text("Your leg was too fast.", "Ihr Bein war zu schnell."), _RELAX
    ),
    Cause.EFFORT_LIMIT: PatientText(
        Situation.HELD, Text("The force was too high.", "Die Kraft war zu groß."), _RESISTED
    ),
    Cause.POWER_LIMIT: PatientText(
        Situation.HELD, Text("The machine pushed too hard.", "Die Maschine schob zu stark."), _RELAX
    ),
    Cause.TRACKING_LIMIT: PatientText(
        Situation.HELD,
        Text("Your leg did not follow the movement.", "Ihr Bein folgte der Bewegung nicht."),
        _RESISTED,
    ),
    Cause.TEMPERATURE_LIMIT: PatientText(
        Situation.HELD,
        Text("The machine is too hot.", "Die Maschine ist zu heiß."),
        Text("Do not touch the motors.", "Die Motoren nicht berühren."),
    ),
    Cause.SINGULARITY: PatientText(
        Situation.HELD,
        Text("Your leg was almost stretched.", "Ihr Bein war fast gestreckt."),
        _RELAX,
    ),
    Cause.LIMIT_SWITCH: PatientText(
        Situation.HELD,
        Text("The machine reached its end.", "Die Maschine kam an ihr Ende."),
    ),
    Cause.ENERGY_LIMIT: PatientText(
        Situation.HELD, Text("The step was too hard.", "Der Schritt war zu schwer."), _RELAX
    ),
    Cause.STOPPING_PATH: PatientText(
        Situation.HELD, Text("Your leg was too fast.", "Ihr Bein war zu schnell."), _RELAX
    ),
    Cause.OBSERVER_INVALID: PatientText(
        Situation.HELD,
        Text(
            "The machine cannot tell your strength any more.",
            "Die Maschine erkennt Ihre Kraft nicht mehr.",
        ),
    ),
    Cause.STATIC_LOAD_WRONG: PatientText(
        Situation.HELD,
        Text(
            "The weight of the leg is not as set up.",
            "Das Gewicht des Beins ist nicht wie eingestellt.",
        ),
    ),
    Cause.SPASM: PatientText(
        Situation.HELD,
        Text("Your leg became stiff.", "Ihr Bein wurde steif."),
        Text("Wait until it is relaxed.", "Warten, bis es locker ist."),
    ),
    Cause.SELF_TEST_FAILED: PatientText(
        Situation.HELD,
        Text("The machine test has failed.", "Der Maschinentest ist fehlgeschlagen."),
    ),
    Cause.CLONUS: PatientText(
        Situation.HELD,
        Text("Your leg was twitching.", "Ihr Bein hat gezuckt."),
        Text("Wait until it is quiet.", "Warten, bis es ruhig ist."),
    ),
    Cause.STOP_NOT_OBEYED: PatientText(Situation.DANGER, _DEFECT),
}
"""Text of every cause but NONE."""

UNKNOWN_CAUSE: Final = PatientText(Situation.DANGER, _DEFECT)
"""For a cause of a later version of the service."""


def patient_text(cause: str) -> PatientText:
    """Return the text of a cause, also of one that this version does not know."""
    try:
        return CAUSE_TEXTS[Cause(cause)]
    except (ValueError, KeyError):
        return UNKNOWN_CAUSE
