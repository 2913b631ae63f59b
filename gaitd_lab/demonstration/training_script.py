"""The act of a training: a patient who does as the page says, from the daily test to the end.

As in `script.py`, it uses no clock, socket or process. The patient sees the page alone. What the
service says is looked at until it is ready, and in the text of an error.
"""

from typing import Final, Protocol

import msgspec

from gaitd_lab.demonstration.script import (
    ACTIVE,
    PASSIVE,
    READY_WITHIN_S,
    Player,
    Scene,
    Situation,
    heard_turn,
    until,
)
from gaitd_lab.processes import ServiceError

INPUT_S: Final = 0.5
"""So long the hand switch is open, and the emergency stop pressed, in the daily test."""
PHASE_WITHIN_S: Final = 120.0
"""Longest phase of the session, of the act's time."""
SUMMARY_S: Final = 5.0
"""So long the page's summary is shown at the end."""
AGAIN_S: Final = 2.0
"""Time after a press until the button is pressed again, if it is still offered."""
START: Final = "start"
FINISHED, WALKING = "finished", "walking"
LETS_GO: Final = frozenset({"rest", "done"})
"""Advices after which the patient lets go of the hand switch."""
HOLDS: Final = frozenset({"hold_hand_switch", "press_start", "press_start_to_reset"})
"""Advices for which it is held."""
LOST: Final = frozenset(
    {
        "call_for_help",
        "press_emergency_stop_and_release_it",
        "release_emergency_stop",
        "let_go_and_hold_hand_switch",
        "trainer_is_used",
        "try_again_or_call_therapist",
    }
)
"""Advices that a patient does not get if all goes well."""
TITLES: Final = {
    "waiting": "the patient begins the session",
    "enabling": "START: the drives hold the leg",
    "announced": "motion is announced",
    "starting": "the trainer prepares the motion",
    "self_test": "self-test: the patient relaxes",
    WALKING: "block {block} of {blocks}: the patient walks",
    "rest": "rest: the patient lets go of the hand switch",
    "paused": "the session is interrupted",
    "stopped": "the trainer has stopped",
    "no_signal": "the page has no signal",
}
BEHIND_S: Final = 1.0
"""So long a page may still show the stop that START has just reset."""
PRESS_IT: Final = "press START on the patient's page: {address}"
LET_GO, HOLD = "hand_switch_open *", "clear hand_switch_open *"
PRESS_STOP, RELEASE_STOP = "sto_open *", "clear sto_open *"
"""Commands of the virtual drives for the hand switch and the emergency stop."""


class Training(msgspec.Struct, frozen=True):
    """What a patient's page shows of the session."""

    phase: str
    advice: str
    buttons: tuple[str, ...] = ()
    reason: dict[str, str] | None = None
    """Why the last START was refused, by language; None: it was not."""


class Seen(msgspec.Struct, frozen=True):
    """What a patient sees."""

    mode: str | None = None
    training: Training | None = None


class AtPages(Protocol):
    """Patient and therapist at their pages."""

    @property
    def seen(self) -> Seen:
        """What the patient sees now."""
        ...

    def press(self, button: str) -> None:
        """Let the patient press a button."""
        ...

    def release(self) -> None:
        """Let the therapist log in, and release the plan."""
        ...

    def outcome(self) -> tuple[str | None, str]:
        """Return outcome and reason of what was done last; None while it is pending."""
        ...


def training_act(player: Player, people: AtPages, blocks: int, *, hands_on: str = "") -> None:
    """Play a session of a patient who is alone, from bringing up the trainer to its summary.

    Args:
        player: lets time pass.
        people: at their pages.
        blocks: number of blocks of the plan.
        hands_on: address of the patient's page, if a person presses its buttons.
    """
    player.begin(Scene("trainer and patient are brought up"))

    def is_ready(now: Situation) -> bool:
        return now.mode == "ready" and people.seen.training is not None

    until(player, is_ready, "ready", READY_WITHIN_S)
    player.begin(Scene("the therapist logs in, and releases the plan"))
    people.release()
    while people.outcome()[0] is None:
        heard_turn(player)
    outcome, reason = people.outcome()
    if outcome != "done":
        raise ServiceError(f"the plan's release {outcome}: {reason}")
    _daily_test(player, people, hands_on)
    _session(player, people, blocks, hands_on)


def _daily_test(player: Player, people: AtPages, hands_on: str) -> None:
    """Hand switch and emergency stop act once, at rest; START requests RESET afterwards."""
    for title, first, then in (
        ("daily test: the hand switch is let go, and held", LET_GO, HOLD),
        ("daily test: the emergency stop is pressed, and released", PRESS_STOP, RELEASE_STOP),
    ):
        player.begin(Scene(title))
        for command in (first, then):
            player.drives(command)
            now = _pause(player, INPUT_S)
    title = PRESS_IT.format(address=hands_on) if hands_on else "START resets the trainer"
    player.begin(Scene(title))
    began_s, pressed_s = now.now_s, 0.0
    while now.mode != "ready":
        if not hands_on:
            _refuse_longer(now, began_s, "reset")
            if START in _seen(people).buttons and now.now_s - pressed_s > AGAIN_S:
                pressed_s = now.now_s
                people.press(START)
        now = heard_turn(player)


def _session(player: Player, people: AtPages, blocks: int, hands_on: str) -> None:
    """Do what the page says until the session is over."""
    is_held, programme, phase, title, block = True, PASSIVE, "", "", 0
    now = heard_turn(player)
    since_s, good_s, pressed_s = now.now_s, now.now_s, 0.0
    while (training := _seen(people)).phase != FINISHED:
        if training.phase != phase:
            phase, since_s, pressed_s = training.phase, now.now_s, 0.0
            block += phase == WALKING
        is_asked = START in training.buttons
        words = PRESS_IT if is_asked and hands_on else TITLES.get(phase, phase)
        if words != title:
            title = words
            player.begin(Scene(title.format(block=block, blocks=blocks, address=hands_on)))
            now = heard_turn(player)  # a person takes a moment to read
        if not hands_on:
            good_s = good_s if training.advice in LOST else now.now_s
            if now.now_s - good_s > BEHIND_S:
                why = training.reason["en"] if training.reason else now.verdict
                raise ServiceError(f"the page says {training.advice}: {why}")
            _refuse_longer(now, since_s, f"end of {phase}")
        holds = training.advice not in LETS_GO and (is_held or training.advice in HOLDS)
        wanted = ACTIVE if phase == WALKING else PASSIVE
        if holds != is_held:
            is_held = holds
            player.drives(HOLD if holds else LET_GO)
        elif wanted != programme:
            programme = wanted
            player.drives(programme)
        elif is_asked and not hands_on and now.now_s - pressed_s > AGAIN_S:
            pressed_s = now.now_s
            people.press(START)
        now = heard_turn(player)
    player.begin(Scene("the session is over"))
    player.drives(LET_GO)
    player.drives(PASSIVE)
    _pause(player, SUMMARY_S)


def _seen(people: AtPages) -> Training:
    """Return what the page shows; without a page there is nothing to do."""
    return people.seen.training or Training(phase="no_signal", advice="")


def _pause(player: Player, duration_s: float) -> Situation:
    now = heard_turn(player)
    end_s = now.now_s + duration_s
    while now.now_s < end_s:
        now = heard_turn(player)
    return now


def _refuse_longer(now: Situation, since_s: float, what: str) -> None:
    if now.now_s - since_s > PHASE_WITHIN_S:
        raise ServiceError(f"no {what} within {PHASE_WITHIN_S:g} s; {now.mode}, {now.verdict}")
