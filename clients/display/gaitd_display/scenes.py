"""What is said on the patient's page in each of its states: heading, line, cards and strips.

A card is one thing to do or to know, with its picture; a strip is one line below the cards. Texts
are named by their keys in the patient's texts, so that the page shows them in any language. After a
stop the help comes first; then the emergency stop; and the straps only where no drive has power, as
`way_out.py` decides.
"""

import math
from collections.abc import Mapping
from enum import StrEnum, auto
from typing import Final, NamedTuple

import msgspec
from gaitd_client import Cause
from gaitd_session import Advice
from gaitd_texts import Situation, key_of

from gaitd_display.training import TrainingView
from gaitd_display.way_out import Step, Unstrap
from gaitd_display.words import Spoken, Word, has_text

SECONDS_MAX: Final = 120.0
"""A shorter plan is told in seconds."""


class Picture(StrEnum):
    """What a card shows; drawn by the page."""

    SWITCH = auto()
    """The hand switch, held."""
    RELEASED = auto()
    """The hand switch, let go."""
    BUTTON = auto()
    """The main button of the page, pressed."""
    EMERGENCY_STOP = auto()
    RELEASED_STOP = auto()
    TELEPHONE = auto()
    STRAP = auto()
    LEG = auto()


class Phrase(msgspec.Struct, frozen=True):
    """A text by its key, and what is filled in."""

    key: str
    values: Mapping[str, int | str] = {}
    said: Spoken | None = None
    """In place of the key: a sentence of the operator's texts."""


class Card(msgspec.Struct, frozen=True):
    """One thing to do or to know."""

    picture: Picture
    title: Phrase
    text: Phrase | None = None
    number: int | None = None
    """Its place in the order of what is to be done; None: it is no part of an order."""
    is_first: bool = False
    """It is to be done now."""


class Strip(msgspec.Struct, frozen=True):
    """One line below the cards."""

    text: Phrase
    picture: Picture | None = None
    is_small: bool = False
    """It is for a helper at the screen, in the operator's words."""


class Scene(msgspec.Struct, frozen=True):
    """All that is said."""

    heading: Phrase
    line: Phrase | None = None
    whole: Phrase | None = None
    """The heading as a whole sentence, for a screen reader."""
    cards: tuple[Card, ...] = ()
    strips: tuple[Strip, ...] = ()


class Now(NamedTuple):
    """What decides the scene."""

    word: Word
    mode: str | None
    cause: str | None = None
    """Cause of the latched stop, or the one that it is named by; None: there is none."""
    situation: Situation | None = None
    """State of the leg after it."""
    step: Step = Step.NONE
    unstrap: Unstrap = Unstrap.NOT_NOW
    is_switch_held: bool = False
    is_stop_pressed: bool = False
    """A drive reads the emergency stop as pressed."""
    training: TrainingView | None = None


HELP_CARD: Final = Card(Picture.TELEPHONE, Phrase("help"), Phrase("page.help"))
HELP_STRIP: Final = Strip(Phrase("help_line"), Picture.TELEPHONE)
STOP_CARD: Final = Card(Picture.EMERGENCY_STOP, Phrase("press_stop"))
HOLD_CARD: Final = Card(Picture.SWITCH, Phrase("hold"))
START_CARD: Final = Card(Picture.BUTTON, Phrase("press_start"))
LOSS_CARDS: Final = (
    Card(Picture.RELEASED, Phrase("to_stop"), is_first=True),
    Card(Picture.EMERGENCY_STOP, Phrase("or_stop")),
)
STRAPS: Final[Mapping[Unstrap, tuple[Strip, ...]]] = {
    Unstrap.NOT_NOW: (),
    Unstrap.BEHIND_EMERGENCY_STOP: (Strip(Phrase("straps_behind"), Picture.EMERGENCY_STOP),),
    Unstrap.NO_POWER: (Strip(Phrase("page.unstrap"), Picture.STRAP),),
}
WAY: Final[Mapping[Step, str]] = {
    Step.SWITCH: "is_loose",
    Step.WAIT: "is_loose",
    Step.ENABLE: "is_loose",
    Step.GUIDE: "is_held",
    Step.GUIDING: "by_hand",
}
"""What a step of the way out says about the leg."""


def scene_of(now: Now) -> Scene:
    """Return what is said in a state."""
    match now.word:
        case Word.STOPPED:
            return _stopped(now)
        case Word.STOPPING if now.cause is not None:
            return Scene(
                _stop_heading(now.cause), Phrase(f"line.{Word.STOPPING}"), _happened(now.cause)
            )
        case Word.WAY_OUT:
            return _way_out(now)
        case Word.NO_SIGNAL | Word.NO_CONNECTION:
            return _plain(now.word, cards=LOSS_CARDS)
        case _ if now.training is not None:
            return _of_training(now, now.training)
        case _:
            return _plain(now.word)


def _plain(
    word: Word,
    line: Phrase | None = None,
    cards: tuple[Card, ...] = (),
    strips: tuple[Strip, ...] = (),
) -> Scene:
    if line is None and has_text(f"line.{word}"):
        line = Phrase(f"line.{word}")
    return Scene(Phrase(f"word.{word}"), line, cards=cards, strips=strips)


def _numbered(*cards: Card, first: int | None = None) -> tuple[Card, ...]:
    """Number cards from 1; the one at `first` is to be done now."""
    return tuple(
        msgspec.structs.replace(card, number=at + 1, is_first=at == first)
        for at, card in enumerate(cards)
    )


# --- a session ----------------------------------------------------------------------------------


def _of_training(now: Now, training: TrainingView) -> Scene:
    held_first = 1 if now.is_switch_held else 0
    to_begin = _numbered(HOLD_CARD, START_CARD, first=held_first)
    match now.word:
        case Word.START:
            danger = Card(Picture.EMERGENCY_STOP, Phrase("danger"))
            return _plain(now.word, _plan(training), (*to_begin, danger))
        case Word.NEXT:
            heading = Phrase("word.next", {"number": training.number, "count": training.count})
            return Scene(heading, cards=to_begin)
        case Word.PAUSED:
            return _plain(now.word, _paused(training), to_begin)
        case Word.DAILY_TEST:
            released = Card(Picture.RELEASED_STOP, Phrase("release_stop"))
            first = 1 if now.is_stop_pressed else 0
            return _plain(now.word, cards=_numbered(STOP_CARD, released, START_CARD, first=first))
        case Word.RELEASE:
            released = Card(Picture.RELEASED_STOP, Phrase("release_stop"))
            return _plain(now.word, cards=_numbered(released, START_CARD, first=0))
        case Word.LET_GO:
            let_go = Card(Picture.RELEASED, Phrase("let_go"))
            again = Card(Picture.SWITCH, Phrase("hold_again"))
            first = 0 if now.is_switch_held else 1
            return _plain(now.word, cards=_numbered(let_go, again, START_CARD, first=first))
        case Word.FAILED:
            told = Strip(Phrase("", said=training.reason), is_small=True)
            return _plain(now.word, cards=to_begin, strips=(told,) if training.reason else ())
        case _:
            return _plain(now.word)


def _plan(training: TrainingView) -> Phrase:
    """Return the plan in plain words, or why the last START ended before anything was walked."""
    if training.why is not None:
        return Phrase(f"why_short.{training.why}")
    if training.plan_s < SECONDS_MAX:
        seconds = round(training.plan_s)
        return Phrase("plan_seconds", {"count": training.count, "seconds": seconds})
    minutes = math.ceil(training.plan_s / 60)
    return Phrase("plan_minutes", {"count": training.count, "minutes": minutes})


def _paused(training: TrainingView) -> Phrase:
    if training.why is not None:
        return Phrase(f"why_short.{training.why}")
    return Phrase("not_held")


REFUSALS: Final[Mapping[Advice, Word]] = {
    Advice.PRESS_EMERGENCY_STOP_AND_RELEASE_IT: Word.DAILY_TEST,
    Advice.RELEASE_EMERGENCY_STOP: Word.RELEASE,
    Advice.LET_GO_AND_HOLD_HAND_SWITCH: Word.LET_GO,
    Advice.TRY_AGAIN_OR_CALL_THERAPIST: Word.FAILED,
}
"""States in which the last START was refused."""


# --- a stop -------------------------------------------------------------------------------------


def _stop_heading(cause: str) -> Phrase:
    return Phrase(f"stop.{key_of(cause)}")


def _happened(cause: str) -> Phrase:
    return Phrase(f"happened.{key_of(cause)}")


def _stopped(now: Now) -> Scene:
    if now.cause is None or now.situation is None:
        return _plain(Word.STOPPED, cards=_numbered(HELP_CARD), strips=STRAPS[now.unstrap])
    heading, happened = _stop_heading(now.cause), _happened(now.cause)
    last = Strip(Phrase(f"last.{now.situation}"))
    match now.step:
        case Step.RESET | Step.SWITCH:
            cards = _numbered(
                Card(Picture.SWITCH, Phrase("hold" if now.step is Step.SWITCH else "keep")),
                Card(Picture.BUTTON, Phrase("press_reset"), Phrase("then_loose")),
                first=1 if now.step is Step.RESET else 0,
            )
            return Scene(heading, None, happened, cards, (last, HELP_STRIP))
        case Step.WAIT:
            return Scene(heading, Phrase("way.wait"), happened, _numbered(HELP_CARD), (last,))
        case Step.START:
            return Scene(heading, None, happened, _cards_to_start(now), _strips_to_start(now))
        case _:
            strips = (last, *STRAPS[now.unstrap])
            return Scene(heading, None, happened, _cards_of_help(now.cause, now), strips)


def _cards_of_help(cause: str, now: Now) -> tuple[Card, ...]:
    if now.situation is Situation.DANGER:
        first, second = _numbered(STOP_CARD, HELP_CARD)
        return tuple(msgspec.structs.replace(card, is_first=True) for card in (first, second))
    cards: list[Card] = []
    if has_text(f"advise.{key_of(cause)}"):
        picture = Picture.SWITCH if cause == Cause.HAND_SWITCH_OPEN else Picture.LEG
        cards.append(Card(picture, Phrase(f"advise.{key_of(cause)}")))
    return _numbered(*cards, HELP_CARD, first=len(cards))


def _cards_to_start(now: Now) -> tuple[Card, ...]:
    """START requests RESET: no drive has power, so it takes nothing from the leg."""
    if now.is_stop_pressed:
        released = Card(Picture.RELEASED_STOP, Phrase("release_stop"))
        return _numbered(released, HELP_CARD, first=0)
    return _numbered(HOLD_CARD, START_CARD, first=1 if now.is_switch_held else 0)


def _strips_to_start(now: Now) -> tuple[Strip, ...]:
    helped = () if now.is_stop_pressed else (HELP_STRIP,)
    return (*helped, *STRAPS[now.unstrap])


def _way_out(now: Now) -> Scene:
    held = Phrase("keep" if now.is_switch_held else "hold")
    cards = (
        Card(Picture.SWITCH, held, is_first=now.step is Step.SWITCH),
        Card(Picture.LEG, Phrase(WAY[now.step]), is_first=now.step is not Step.SWITCH),
    )
    strips = (HELP_STRIP, *STRAPS[now.unstrap])
    return Scene(Phrase(f"way.{now.step}"), cards=cards, strips=strips)
