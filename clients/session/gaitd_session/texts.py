"""What a session advises, in English and German: the one source of these sentences."""

from collections.abc import Mapping
from enum import StrEnum, auto
from typing import Final, NamedTuple


class Text(NamedTuple):
    """One text in both languages."""

    en: str
    de: str


class Advice(StrEnum):
    """What to do now."""

    WAIT = auto()
    HOLD_HAND_SWITCH = auto()
    PRESS_START = auto()
    PRESS_START_TO_RESET = auto()
    LIE_STILL = auto()
    WALK = auto()
    REST = auto()
    CALL_FOR_HELP = auto()
    CHECK_CONNECTION = auto()
    PRESS_EMERGENCY_STOP_AND_RELEASE_IT = auto()
    RELEASE_EMERGENCY_STOP = auto()
    LET_GO_AND_HOLD_HAND_SWITCH = auto()
    TRAINER_IS_USED = auto()
    TRY_AGAIN_OR_CALL_THERAPIST = auto()
    DONE = auto()


class Why(StrEnum):
    """What has ended a START early, where no stop and no refusal says it."""

    NO_SIGNAL = auto()
    """The trainer sent nothing, and its cycles have not gone on."""
    LATE_HERE = auto()
    """Nothing came, but the trainer's cycles have gone on."""
    RESTARTED = auto()
    HAND_SWITCH = auto()
    LATE = auto()
    ENDED_ELSEWHERE = auto()


WHY: Final[Mapping[Why, Text]] = {
    Why.NO_SIGNAL: Text(
        "Interrupted: the trainer sent nothing for a moment.",
        "Unterbrochen: Der Trainer hat kurz nichts gesendet.",
    ),
    Why.LATE_HERE: Text(
        "Interrupted: this computer, or its connection, was too slow. The trainer went on.",
        "Unterbrochen: Dieser Rechner oder seine Verbindung war zu langsam. Der Trainer lief "
        "weiter.",
    ),
    Why.RESTARTED: Text(
        "Interrupted: the trainer has started again.",
        "Unterbrochen: Der Trainer ist neu gestartet.",
    ),
    Why.HAND_SWITCH: Text(
        "Interrupted: the hand switch was open.",
        "Unterbrochen: Der Handschalter war offen.",
    ),
    Why.LATE: Text(
        "Interrupted: the trainer was not ready in time.",
        "Unterbrochen: Der Trainer war nicht rechtzeitig bereit.",
    ),
    Why.ENDED_ELSEWHERE: Text(
        "Interrupted: the trainer, or another program, has ended the movement.",
        "Unterbrochen: Der Trainer oder ein anderes Programm hat die Bewegung beendet.",
    ),
}

ADVICE: Final[Mapping[Advice, Text]] = {
    Advice.WAIT: Text("Please wait.", "Bitte warten."),
    Advice.HOLD_HAND_SWITCH: Text("Hold the hand switch.", "Handschalter halten."),
    Advice.PRESS_START: Text(
        "Hold the hand switch, and press Start.", "Handschalter halten und Start drücken."
    ),
    Advice.PRESS_START_TO_RESET: Text(
        "The drives are off. Release the emergency stop if it is pressed. Hold the hand switch, "
        "and press Start: this ends the stop, and the machine moves nothing.",
        "Die Antriebe sind aus. Not-Halt lösen, falls gedrückt. Handschalter halten und Start "
        "drücken: Das beendet den Halt, die Maschine bewegt nichts.",
    ),
    Advice.LIE_STILL: Text(
        "Your leg is about to move. Hold the hand switch, and lie still.",
        "Ihr Bein bewegt sich gleich. Handschalter halten und ruhig liegen.",
    ),
    Advice.WALK: Text("Walk along.", "Mitgehen."),
    Advice.REST: Text(
        "Rest. You may let go of the hand switch.",
        "Pause. Sie dürfen den Handschalter loslassen.",
    ),
    Advice.CALL_FOR_HELP: Text("Lie still. Call for help.", "Ruhig liegen. Hilfe rufen."),
    Advice.CHECK_CONNECTION: Text(
        "No signal from the trainer. To stop it, let go of the hand switch.",
        "Kein Signal vom Trainer. Zum Anhalten den Handschalter loslassen.",
    ),
    Advice.PRESS_EMERGENCY_STOP_AND_RELEASE_IT: Text(
        "Press the emergency stop, and release it again. Then press Start.",
        "Not-Halt drücken und wieder lösen. Dann Start drücken.",
    ),
    Advice.RELEASE_EMERGENCY_STOP: Text(
        "Release the emergency stop. Then press Start.",
        "Not-Halt lösen. Dann Start drücken.",
    ),
    Advice.LET_GO_AND_HOLD_HAND_SWITCH: Text(
        "Let go of the hand switch, hold it again, and press Start.",
        "Handschalter loslassen, wieder halten, Start drücken.",
    ),
    Advice.TRAINER_IS_USED: Text(
        "Another program has switched the trainer on. Pause switches it off.",
        "Ein anderes Programm hat den Trainer eingeschaltet. Pause schaltet ihn aus.",
    ),
    Advice.TRY_AGAIN_OR_CALL_THERAPIST: Text(
        "That did not work. Hold the hand switch, and press Start again. If it fails again, call "
        "your therapist.",
        "Das ging nicht. Handschalter halten und noch einmal Start drücken. Geht es wieder nicht: "
        "Therapie anrufen.",
    ),
    Advice.DONE: Text("The training is over.", "Das Training ist zu Ende."),
}
