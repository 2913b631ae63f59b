"""What has stopped the machine and what to do now, for the therapist, in two languages.

The service's own remedies name commands of a terminal; here they name the buttons of the page. The
first step follows the state of the leg (`Situation` of `cause_texts.py`); a test compares who is to
be called with the service's own text of each cause.
"""

from collections.abc import Mapping
from enum import Enum
from typing import Final, NamedTuple

from gaitd_client import Cause
from gaitd_session import Text

from gaitd_display.cause_texts import Situation

FIRST: Final[Mapping[Situation, Text]] = {
    Situation.HELD: Text(
        "The leg is held. Support it before you end the stop: it then sinks until the drives are "
        "switched on.",
        "Das Bein wird gehalten. Es stützen, bevor der Halt beendet wird: danach sinkt es, bis "
        "die Antriebe eingeschaltet sind.",
    ),
    Situation.LOOSE: Text(
        "Keep hands off the slide. Support the leg: it may not be held.",
        "Hände weg vom Schlitten. Das Bein stützen: es wird vielleicht nicht gehalten.",
    ),
    Situation.DANGER: Text(
        "Press the emergency stop. Support the leg: it is not held any more.",
        "Not-Halt drücken. Das Bein stützen: es wird nicht mehr gehalten.",
    ),
    Situation.AT_REST: Text(
        "Nothing moves. Help the person out by hand.",
        "Nichts bewegt sich. Der Person von Hand heraushelfen.",
    ),
}
"""At once, before anything else."""


class Again(Enum):
    """If the stop comes back."""

    TECHNICIAN = Text(
        "do not use the machine, and call the technician.",
        "das Gerät nicht benutzen und die Technik rufen.",
    )
    SUPPORT = Text(
        "keep the recording, and call the software support.",
        "die Aufzeichnung aufheben und die Software-Betreuung rufen.",
    )
    OPERATOR = Text(
        "call the person who has set up the machine for this patient.",
        "die Person rufen, die das Gerät für diesen Menschen eingerichtet hat.",
    )
    PHYSICIAN = Text(
        "end the session, and call the physician who has prescribed it.",
        "das Training beenden und die verordnende Ärztin oder den Arzt rufen.",
    )
    WHO_STOPS = Text(
        "find out who requests the stops, and why.",
        "herausfinden, wer die Halte auslöst, und warum.",
    )
    HAND_SWITCH = Text(
        "have the hand switch and its cable checked.",
        "den Handschalter und sein Kabel prüfen lassen.",
    )
    EMERGENCY_STOP = Text(
        "have the emergency stop and its wires checked.",
        "den Not-Halt und seine Leitungen prüfen lassen.",
    )
    CURRENT = Text(
        "have the current measurement of the drive checked.",
        "die Strommessung des Antriebs prüfen lassen.",
    )
    REFERENCE = Text(
        "have reference and end stops of the axis checked.",
        "Referenz und Anschläge der Achse prüfen lassen.",
    )


class GoOn(Enum):
    """How to continue after the step of the cause."""

    ON = Text(
        "Hold the hand switch, end the stop, switch on. To get out: move by hand.",
        "Handschalter halten, Halt beenden, einschalten. Zum Herauskommen: von Hand führen.",
    )
    SLOWER = Text(
        "Hold the hand switch, end the stop, switch on, and walk slower.",
        "Handschalter halten, Halt beenden, einschalten und langsamer gehen.",
    )
    OUT = Text(
        "End the stop, switch on, and lead the leg out by hand. Do not go on with the training.",
        "Halt beenden, einschalten und das Bein von Hand herausführen. Das Training nicht "
        "fortsetzen.",
    )
    ONLY = None
    """The step of the cause says all."""


class StopText(NamedTuple):
    """Text of one cause."""

    happened: Text
    step: Text | None
    """What this cause needs before the machine is used again; None: nothing."""
    go_on: GoOn
    again: Again

    @property
    def then(self) -> Text:
        """How to continue, as one text."""
        parts = [part for part in (self.step, self.go_on.value) if part is not None]
        return Text(" ".join(part.en for part in parts), " ".join(part.de for part in parts))


def _text(
    happened: tuple[str, str],
    step: tuple[str, str] | None = None,
    go_on: GoOn = GoOn.ON,
    again: Again = Again.TECHNICIAN,
) -> StopText:
    return StopText(Text(*happened), None if step is None else Text(*step), go_on, again)


_SUPPLY_AND_CABLE = (
    "Check the supply of the drive, and its CAN cable.",
    "Die Versorgung des Antriebs und sein CAN-Kabel prüfen.",
)
_NAMED_BY_DRIVE = (
    "Remove what the message of the drive names, in the events.",
    "Beheben, was die Meldung des Antriebs in den Ereignissen nennt.",
)
_RELAXED = (
    "Wait until the leg is relaxed, and look whether something is caught.",
    "Warten, bis das Bein locker ist; nachsehen, ob etwas klemmt.",
)
_RESISTS = (
    "Find out what resists the motion, also the person.",
    "Herausfinden, was der Bewegung widersteht, auch die Person.",
)
_OTHER_MASTER = (
    "Find the other controller on the bus, and disconnect it.",
    "Die andere Steuerung am Bus finden und trennen.",
)

STOP_TEXTS: Final[Mapping[Cause, StopText]] = {
    Cause.STOP_REQUESTED: _text(
        ("STOP was pressed", "STOPP wurde gedrückt"),
        ("Find out why.", "Herausfinden, warum."),
        again=Again.WHO_STOPS,
    ),
    Cause.SHUTDOWN: _text(
        ("The control program was shut down", "Das Steuerprogramm wurde beendet"),
        ("Start the control program again.", "Das Steuerprogramm neu starten."),
        GoOn.ONLY,
        Again.OPERATOR,
    ),
    Cause.GATEWAY_SILENT: _text(
        (
            "A part of the control program has fallen silent",
            "Ein Teil des Steuerprogramms antwortet nicht",
        ),
        (
            "Wait until this page shows values again.",
            "Warten, bis diese Seite wieder Werte zeigt.",
        ),
        again=Again.SUPPORT,
    ),
    Cause.CYCLE_OVERRUN: _text(
        (
            "The control program was not finished in time",
            "Das Steuerprogramm wurde nicht rechtzeitig fertig",
        ),
        (
            "Find out what else uses the computer.",
            "Herausfinden, was den Rechner sonst beschäftigt.",
        ),
        again=Again.SUPPORT,
    ),
    Cause.COMMAND_NOT_FINITE: _text(
        ("The control program made an error", "Das Steuerprogramm hat sich verrechnet"),
        ("Keep the recording.", "Die Aufzeichnung aufheben."),
        GoOn.OUT,
        Again.SUPPORT,
    ),
    Cause.LAST_END_UNKNOWN: _text(
        (
            "It is not known how the last use ended",
            "Es ist nicht bekannt, wie die letzte Nutzung endete",
        ),
        ("Check the person and the machine.", "Person und Gerät prüfen."),
        again=Again.SUPPORT,
    ),
    Cause.HAND_SWITCH_OPEN: _text(
        ("The hand switch was let go", "Der Handschalter wurde losgelassen"),
        again=Again.HAND_SWITCH,
    ),
    Cause.STO_ACTIVE: _text(
        ("The emergency stop was pressed", "Der Not-Halt wurde gedrückt"),
        (
            "Find out why it was pressed, and release it.",
            "Herausfinden, warum er gedrückt wurde, und ihn lösen.",
        ),
        again=Again.EMERGENCY_STOP,
    ),
    Cause.INPUTS_IMPOSSIBLE: _text(
        (
            "A drive reports inputs that cannot be",
            "Ein Antrieb meldet Eingänge, die es nicht geben kann",
        ),
        ("Switch the drive off and on.", "Den Antrieb aus- und einschalten."),
    ),
    Cause.BUS_DOWN: _text(
        (
            "The connection to the drives is missing",
            "Die Verbindung zu den Antrieben fehlt",
        ),
        (
            "Check the CAN adapter and its cable.",
            "Den CAN-Adapter und sein Kabel prüfen.",
        ),
    ),
    Cause.DRIVE_SILENT: _text(
        ("A drive does not answer", "Ein Antrieb antwortet nicht"), _SUPPLY_AND_CABLE
    ),
    Cause.HEARTBEAT_LOST: _text(
        ("A drive has fallen silent", "Ein Antrieb meldet sich nicht mehr"), _SUPPLY_AND_CABLE
    ),
    Cause.DRIVE_REBOOTED: _text(
        ("A drive has started again", "Ein Antrieb ist neu gestartet"),
        ("Check the supply of the drive.", "Die Versorgung des Antriebs prüfen."),
    ),
    Cause.DRIVE_NOT_OPERATIONAL: _text(
        (
            "A drive has left its operation on the bus",
            "Ein Antrieb hat den Betrieb am Bus verlassen",
        ),
        _OTHER_MASTER,
    ),
    Cause.DRIVE_FAULT: _text(
        ("A drive has a fault", "Ein Antrieb hat eine Störung"), _NAMED_BY_DRIVE
    ),
    Cause.EMERGENCY: _text(
        ("A drive has reported an error", "Ein Antrieb hat einen Fehler gemeldet"), _NAMED_BY_DRIVE
    ),
    Cause.DRIVE_LEFT_ENABLED: _text(
        (
            "A drive has switched itself off",
            "Ein Antrieb hat sich selbst ausgeschaltet",
        ),
        (
            "Read the messages of the drive in the events.",
            "Die Meldungen des Antriebs in den Ereignissen lesen.",
        ),
    ),
    Cause.MODE_NOT_SHOWN: _text(
        (
            "A drive did not change its way of working",
            "Ein Antrieb hat seine Arbeitsweise nicht gewechselt",
        ),
    ),
    Cause.NOT_FOLLOWING: _text(
        (
            "A drive does not follow its target",
            "Ein Antrieb folgt seinem Sollwert nicht",
        ),
        (
            "Check the limits and inputs of the drive.",
            "Grenzen und Eingänge des Antriebs prüfen.",
        ),
    ),
    Cause.BRING_UP_FAILED: _text(
        (
            "A drive refused its settings, or is another drive",
            "Ein Antrieb nimmt seine Einstellungen nicht an oder ist ein anderer",
        ),
        (
            "Have the drive compared with its file.",
            "Den Antrieb mit seiner Datei vergleichen lassen.",
        ),
        GoOn.ONLY,
        Again.OPERATOR,
    ),
    Cause.BUS_OFF: _text(
        (
            "The connection to the drives was cut by errors",
            "Die Verbindung zu den Antrieben brach durch Fehler ab",
        ),
        (
            "Check the CAN cable and its termination.",
            "CAN-Kabel und Abschluss prüfen.",
        ),
    ),
    Cause.TRANSMIT_QUEUE_FULL: _text(
        (
            "Commands could not be sent to the drives",
            "Befehle kamen nicht zu den Antrieben",
        ),
        (
            "Check the CAN cable, and that the drives have power.",
            "CAN-Kabel prüfen und ob die Antriebe Strom haben.",
        ),
    ),
    Cause.DRIVE_POWERED: _text(
        (
            "A drive was already switched on at the start",
            "Ein Antrieb war beim Start schon eingeschaltet",
        ),
        (
            "End the stop: this switches the drives off.",
            "Halt beenden: das schaltet die Antriebe aus.",
        ),
        GoOn.ONLY,
        Again.SUPPORT,
    ),
    Cause.UNEXPECTED_ENABLE: _text(
        (
            "A drive was switched on by another controller",
            "Ein Antrieb wurde von einer anderen Steuerung eingeschaltet",
        ),
        _OTHER_MASTER,
    ),
    Cause.ENCODER_FROZEN: _text(
        (
            "A joint is blocked, or its sensor is stuck",
            "Ein Gelenk ist blockiert, oder sein Sensor steht",
        ),
        ("Free the joint, and have its sensor checked.", "Das Gelenk lösen, den Sensor prüfen."),
    ),
    Cause.ENCODER_JUMP: _text(
        ("A position sensor has jumped", "Ein Positionssensor ist gesprungen"),
        (
            "Help the person out by hand. Have the sensor checked, and the axis referenced again.",
            "Der Person von Hand heraushelfen. Den Sensor prüfen und die Achse neu referenzieren "
            "lassen.",
        ),
        GoOn.ONLY,
    ),
    Cause.UNREFERENCED: _text(
        ("The position of an axis is not known", "Die Lage einer Achse ist nicht bekannt"),
        (
            "Help the person out by hand. Have the axis referenced, with the machine empty.",
            "Der Person von Hand heraushelfen. Die Achse bei leerem Gerät referenzieren lassen.",
        ),
        GoOn.ONLY,
        Again.OPERATOR,
    ),
    Cause.SIGN_WRONG: _text(
        (
            "A joint moves against its drive",
            "Ein Gelenk bewegt sich verkehrt zu seinem Antrieb",
        ),
        (
            "Help the person out by hand. Have the wiring of motor and sensor checked.",
            "Der Person von Hand heraushelfen. Die Leitungen von Motor und Sensor prüfen lassen.",
        ),
        GoOn.ONLY,
    ),
    Cause.EFFORT_DEVIATION: _text(
        (
            "A drive gives another torque than commanded",
            "Ein Antrieb gibt eine andere Kraft als befohlen",
        ),
        again=Again.CURRENT,
    ),
    Cause.MOVED_AGAINST_DRIVE: _text(
        (
            "The leg moved with more force than the drive can guide",
            "Das Bein bewegte sich mit mehr Kraft, als der Antrieb führen kann",
        ),
        go_on=GoOn.SLOWER,
        again=Again.OPERATOR,
    ),
    Cause.POSITION_LIMIT: _text(
        ("A joint left its range", "Ein Gelenk hat seinen Bereich verlassen"),
        (
            "After the stop is ended move the leg back by hand.",
            "Nach dem Beenden des Halts das Bein von Hand zurückführen.",
        ),
        again=Again.REFERENCE,
    ),
    Cause.VELOCITY_LIMIT: _text(
        ("The leg was too fast", "Das Bein war zu schnell"),
        _RELAXED,
        GoOn.SLOWER,
        Again.OPERATOR,
    ),
    Cause.EFFORT_LIMIT: _text(
        ("The force of a drive was too high", "Die Kraft eines Antriebs war zu groß"), _RESISTS
    ),
    Cause.POWER_LIMIT: _text(
        ("The drives pushed too hard", "Die Antriebe schoben zu stark"),
        go_on=GoOn.SLOWER,
        again=Again.OPERATOR,
    ),
    Cause.TRACKING_LIMIT: _text(
        (
            "The leg did not follow the movement",
            "Das Bein folgte der Bewegung nicht",
        ),
        _RESISTS,
        again=Again.OPERATOR,
    ),
    Cause.TEMPERATURE_LIMIT: _text(
        ("A drive is too hot", "Ein Antrieb ist zu heiß"),
        ("Let it cool for half an hour.", "Ihn eine halbe Stunde abkühlen lassen."),
        GoOn.OUT,
    ),
    Cause.SINGULARITY: _text(
        ("The leg was almost stretched", "Das Bein war fast gestreckt"),
        (
            "After the stop is ended bend the knee by hand.",
            "Nach dem Beenden des Halts das Knie von Hand beugen.",
        ),
        again=Again.OPERATOR,
    ),
    Cause.LIMIT_SWITCH: _text(
        ("A joint reached its limit switch", "Ein Gelenk kam an seinen Endschalter"),
        (
            "End the stop, switch on, and move away from it. Have the reference checked.",
            "Halt beenden, einschalten und davon wegführen. Die Referenz prüfen lassen.",
        ),
        GoOn.ONLY,
    ),
    Cause.ENERGY_LIMIT: _text(
        ("The step took too much force", "Der Schritt brauchte zu viel Kraft"),
        _RESISTS,
        again=Again.OPERATOR,
    ),
    Cause.STOPPING_PATH: _text(
        (
            "The leg was too fast to stop within its range",
            "Das Bein war zu schnell, um rechtzeitig zu halten",
        ),
        go_on=GoOn.SLOWER,
        again=Again.OPERATOR,
    ),
    Cause.OBSERVER_INVALID: _text(
        (
            "The patient's effort cannot be estimated any more",
            "Die Kraft des Patienten ist nicht mehr bestimmbar",
        ),
        ("Read the events.", "Die Ereignisse lesen."),
        again=Again.SUPPORT,
    ),
    Cause.STATIC_LOAD_WRONG: _text(
        (
            "The weight of the leg is not as set up",
            "Das Gewicht des Beins ist nicht wie eingerichtet",
        ),
        (
            "End the stop. Check patient data, straps and springs, then switch on.",
            "Halt beenden. Patientendaten, Gurte und Federn prüfen, dann einschalten.",
        ),
        GoOn.ONLY,
        Again.OPERATOR,
    ),
    Cause.SPASM: _text(
        ("The patient's leg became stiff", "Das Bein des Patienten wurde steif"),
        _RELAXED,
        again=Again.PHYSICIAN,
    ),
    Cause.SELF_TEST_FAILED: _text(
        ("The self-test was not passed", "Der Selbsttest wurde nicht bestanden"),
        (
            "Read its line in the events. End the stop, switch on, and repeat the self-test with "
            "the person relaxed.",
            "Seine Zeile in den Ereignissen lesen. Halt beenden, einschalten und den Selbsttest "
            "bei lockerem Bein wiederholen.",
        ),
        GoOn.ONLY,
    ),
    Cause.CLONUS: _text(
        ("The patient's leg was twitching", "Das Bein des Patienten hat gezuckt"),
        ("Wait until the leg is quiet.", "Warten, bis das Bein ruhig ist."),
        again=Again.PHYSICIAN,
    ),
    Cause.STOP_NOT_OBEYED: _text(
        ("A drive did not obey a stop", "Ein Antrieb hat einen Halt nicht befolgt"),
        (
            "Help the person out by hand. Do not use the machine before it was serviced.",
            "Der Person von Hand heraushelfen. Das Gerät erst nach einer Wartung benutzen.",
        ),
        GoOn.ONLY,
    ),
}
"""Text of every cause but NONE."""

UNKNOWN: Final = "unknown"
"""Key of a cause of a later version."""
_UNKNOWN_TEXT: Final = _text(
    ("The machine has stopped", "Das Gerät hat angehalten"),
    ("Read the events.", "Die Ereignisse lesen."),
    GoOn.ONLY,
)


def stop_key(cause: str) -> str:
    """Return the key of a cause's texts; `UNKNOWN` for one that this version does not know."""
    known: frozenset[str] = frozenset(STOP_TEXTS)
    return cause if cause in known else UNKNOWN


def stop_labels() -> dict[str, Text]:
    """Return all texts by key: `stopped.CAUSE`, `then.CAUSE`, `again.CAUSE`, `first.SITUATION`."""
    labels = {f"first.{situation}": text for situation, text in FIRST.items()}
    for cause, text in {**STOP_TEXTS, UNKNOWN: _UNKNOWN_TEXT}.items():
        labels[f"stopped.{cause}"] = text.happened
        labels[f"then.{cause}"] = text.then
        labels[f"again.{cause}"] = text.again.value
    return labels
