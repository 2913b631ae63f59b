"""What a session advises, and why it went wrong; the sentences are in `gaitd_texts`."""

from enum import StrEnum, auto

from gaitd_client.wire import Refusal


class Advice(StrEnum):
    """What to do now."""

    WAIT = auto()
    HOLD_HAND_SWITCH = auto()
    PRESS_START = auto()
    PRESS_START_TO_RESET = auto()
    LIE_STILL = auto()
    WALK = auto()
    RELAX = auto()
    """The leg is moved, and nothing else is to be done."""
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


class Failure(StrEnum):
    """Codes of refusals that the session itself reports; the others are the service's."""

    NO_ANSWER = auto()
    TEST_WITHOUT_RESULT = auto()
    """Another program has ended the self-test."""


def refusal_of(failure: Failure, said: str = "") -> Refusal:
    """Return a refusal of the session."""
    return Refusal(code=failure, subject=None, values={}, said=said)
