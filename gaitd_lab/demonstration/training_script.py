"""The act of a training: a patient who does as the page says, from the daily test to the end.

As in `script.py`, it uses no clock, socket or process. The patient sees the page alone. What the
service says is looked at until it is ready, and in the text of an error.
"""

from typing import Final

from gaitd_lab.demonstration.script import (
    READY_WITHIN_S,
    Act,
    Action,
    EmergencyStop,
    HandSwitch,
    Kind,
    Patient,
    Playing,
    Press,
    Release,
    Scene,
    Situation,
    Training,
    asked,
    check_word,
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
PASSIVE, ACTIVE = "passive", "active"
"""Programmes of the scripted patient."""
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


def training_act(blocks: int, *, hands_on: str = "") -> Act:
    """A session of a patient who is alone, from bringing up the trainer to its summary.

    Args:
        blocks: number of blocks of the plan.
        hands_on: address of the patient's page, if a person presses its buttons.
    """
    yield Scene("trainer and patient are brought up", Kind.INTERLUDE)
    yield from until(_is_ready, "ready", READY_WITHIN_S, powered=False)
    yield Scene("the therapist logs in, and releases the plan", Kind.INTERLUDE)
    yield from asked(Release(), "the plan's release")
    yield from _daily_test(hands_on)
    yield from _session(blocks, hands_on)


def _is_ready(now: Situation) -> bool:
    return now.mode == "ready" and now.seen.training is not None


def _daily_test(hands_on: str) -> Playing:
    """Hand switch and emergency stop act once, at rest; START requests RESET afterwards."""
    yield Scene("daily test: the hand switch is let go, and held", Kind.INTERLUDE)
    yield HandSwitch(is_held=False)
    yield from _pause(INPUT_S)
    yield HandSwitch(is_held=True)
    yield from _pause(INPUT_S)
    yield Scene("daily test: the emergency stop is pressed, and released", Kind.INTERLUDE)
    yield EmergencyStop(is_pressed=True)
    yield from _pause(INPUT_S)
    yield EmergencyStop(is_pressed=False)
    title = PRESS_IT.format(address=hands_on) if hands_on else "START resets the trainer"
    yield Scene(title, Kind.INTERLUDE)
    now = yield from _look(None)
    began_s, pressed_s = now.now_s, 0.0
    while now.mode != "ready":
        action: Action = None
        if not hands_on:
            _refuse_longer(now, began_s, PHASE_WITHIN_S, "reset")
            if START in _training(now).buttons and now.now_s - pressed_s > AGAIN_S:
                pressed_s, action = now.now_s, Press(START)
        now = yield from _look(action)
    return now


def _session(blocks: int, hands_on: str) -> Playing:
    """Do what the page says until the session is over."""
    is_held, programme, phase, title, block = True, PASSIVE, "", "", 0
    now = yield from _look(None)
    since_s, good_s, pressed_s = now.now_s, now.now_s, 0.0
    while (training := _training(now)).phase != FINISHED:
        if training.phase != phase:
            phase, since_s, pressed_s = training.phase, now.now_s, 0.0
            block += phase == WALKING
        is_asked = START in training.buttons
        words = PRESS_IT if is_asked and hands_on else TITLES.get(phase, phase)
        if words != title:
            title = words
            told = title.format(block=block, blocks=blocks, address=hands_on)
            yield Scene(told, Kind.INTERLUDE)
        if not hands_on:
            good_s = good_s if training.advice in LOST else now.now_s
            _refuse_loss(now, good_s, training)
            _refuse_longer(now, since_s, PHASE_WITHIN_S, f"end of {phase}")
        wanted = ACTIVE if phase == WALKING else PASSIVE
        holds = training.advice not in LETS_GO and (is_held or training.advice in HOLDS)
        action: Action = None
        if holds != is_held:
            is_held, action = holds, HandSwitch(holds)
        elif wanted != programme:
            programme, action = wanted, Patient(wanted)
        elif is_asked and not hands_on and now.now_s - pressed_s > AGAIN_S:
            pressed_s, action = now.now_s, Press(START)
        now = yield from _look(action)
    yield Scene("the session is over", Kind.INTERLUDE)
    yield HandSwitch(is_held=False)
    yield Patient(PASSIVE)
    return (yield from _pause(SUMMARY_S))


def _training(now: Situation) -> Training:
    """Return what the page shows; without a page there is nothing to do."""
    return now.seen.training or Training(phase="no_signal", advice="")


def _look(action: Action) -> Playing:
    now = yield action
    check_word(now)
    return now


def _pause(duration_s: float) -> Playing:
    now = yield from _look(None)
    end_s = now.now_s + duration_s
    while now.now_s < end_s:
        now = yield from _look(None)
    return now


def _refuse_longer(now: Situation, since_s: float, within_s: float, what: str) -> None:
    if now.now_s - since_s > within_s:
        raise ServiceError(f"no {what} within {within_s:g} s; {now.mode}, {now.verdict}")


def _refuse_loss(now: Situation, good_s: float, training: Training) -> None:
    if now.now_s - good_s > BEHIND_S:
        raise ServiceError(f"the page says {training.advice}: {training.reason or now.verdict}")
