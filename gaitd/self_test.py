"""`gaitd self-test`: the daily test, step by step, with the operator in front of the machine.

The steps follow from the service's refusals: until the service has seen hand switch and emergency
stop act, it refuses to enable and names the inputs that it has not seen. This command requests
enable, but never reset: a latched stop is shown with its remedy, and the test ends.

Exit codes as in `remote.py`; 1 also if the test failed, or a step was not done in time.
"""

import json
import sys
import time
from collections.abc import Callable
from typing import Any, Final

import typer

from daemon import wire
from gaitd.remote import (
    EXIT_DONE,
    EXIT_NO_ANSWER,
    EXIT_REFUSED,
    ConfigOption,
    EndpointOption,
    JsonOption,
    Message,
    Target,
    TrainerOption,
    ask,
    find_target,
)

POLL_S: Final = 0.5
PATIENCE_S: Final = 120.0
"""Time for each step that the operator does."""
CLIENT: Final = "gaitd self-test"
PASSED: Final = "self-test passed"
FOUND: Final = ": self-test "
UNSEEN: Final = "not seen to act today: "

PROMPTS: Final = (
    ("pressed", "Press the emergency stop, and release it again."),
    ("released", "Release the emergency stop."),
    ("switch open", "Let go of the hand switch, then hold it again."),
    ("switch closed", "Hold the hand switch."),
    ("hand switch is open", "Hold the hand switch."),
    ("safe torque off", "Release the emergency stop."),
    ("moving", "Keep the leg still."),
)
"""Prompt for the operator, by a part of the reason with which the service refuses to enable."""

Say = Callable[[str], None]


class NoAnswerError(Exception):
    """The service does not answer."""


def command(
    config: ConfigOption = None,
    endpoint: EndpointOption = None,
    trainer: TrainerOption = None,
    as_json: JsonOption = False,
) -> None:
    """Run the daily test: hand switch, emergency stop, then each axis moves a little by itself."""
    target = find_target(config, endpoint, trainer)

    def say(text: str) -> None:
        print(text, file=sys.stderr if as_json else sys.stdout, flush=True)

    try:
        passed, lines = run(target, say)
    except NoAnswerError as error:
        print(f"self-test: {error}", file=sys.stderr)
        raise typer.Exit(EXIT_NO_ANSWER) from error
    if as_json:
        print(json.dumps({"passed": passed, "findings": lines}, ensure_ascii=False))
    else:
        print("The self-test is passed." if passed else "The self-test is NOT passed.")
    raise typer.Exit(EXIT_DONE if passed else EXIT_REFUSED)


def run(target: Target, say: Say) -> tuple[bool, list[str]]:
    """Run all steps; return whether the test passed, and the service's event texts about it.

    Raises:
        NoAnswerError: the service does not answer.
    """
    trouble = "" if _status(target).safety.mode == "hold" else _enable(target, say)
    if trouble:
        say(trouble)
        return False, [trouble]
    say("Now each axis moves a little, forth and back. Lie relaxed, and hold the hand switch.")
    before = _ids(_status(target))
    reply = _request(target, "mode", {"mode": "self_test"})
    if reply.outcome != "done":
        say(f"refused: {reply.reason}")
        return False, [reply.reason]
    return _followed(target, before, say)


def _enable(target: Target, say: Say) -> str:
    """Request enable until nothing is missing; prompt the operator for the missing steps.

    Returns: the reason why it is not enabled; empty if it is.
    """
    said = ""
    for _ in range(round(PATIENCE_S / POLL_S)):
        safety = _status(target).safety
        if safety.mode != "ready":
            # Another client's request, or a stop: an enable request now would be outside this test.
            return stop_text(safety) or f"not possible in mode {safety.mode}"
        reply = _request(target, "enable", {})
        if reply.outcome == "done":
            return ""
        text = prompt(reply.reason)
        if text != said:
            said = text
            say(text)
        time.sleep(POLL_S)
    return f"not done within {PATIENCE_S:g} s"


def stop_text(safety: wire.Safety) -> str:
    """Text and remedy of the stop that is in force; empty if there is none."""
    verdict = safety.verdict
    if verdict is None or verdict.category == "none":
        return ""
    where = f"{verdict.drive}: " if verdict.drive else ""
    detail = f" ({verdict.detail})" if verdict.detail else ""
    return f"{where}{verdict.text}{detail}: {verdict.remedy}"


def prompt(reason: str) -> str:
    """Prompt for the operator after a refusal; the service's reason if no prompt matches."""
    missing = reason.removeprefix(UNSEEN).split(", ") if reason.startswith(UNSEEN) else [reason]
    for key, text in PROMPTS:
        if any(key in one for one in missing):
            return text
    return f"waiting: {reason}"


def _followed(target: Target, before: set[str], say: Say) -> tuple[bool, list[str]]:
    shown = ""
    for _ in range(round(PATIENCE_S / POLL_S)):
        time.sleep(POLL_S)
        status = _status(target)
        if status.safety.progress != shown:
            shown = status.safety.progress or ""
            say(f"  {shown}")
        if status.safety.mode != "self_test":
            return _ending(status, before, say)
    return False, []


def _ending(status: wire.Status, before: set[str], say: Say) -> tuple[bool, list[str]]:
    new = [event.text for event in status.events if event.id not in before]
    lines = [text for text in new if FOUND in text]
    for line in lines:
        say(line)
    stopped = stop_text(status.safety)
    if stopped:
        say(stopped)
    return bool(lines) and all(PASSED in line for line in lines), lines


def _ids(status: wire.Status) -> set[str]:
    return {event.id for event in status.events}


def _status(target: Target) -> wire.Status:
    status = _answer(target, "status", {}, wire.Status)
    if not status.safety.valid:
        raise NoAnswerError("no records arrive from the core; look at the machine")
    return status


def _request(target: Target, name: str, payload: dict[str, Any]) -> wire.Reply:
    return _answer(target, name, payload, wire.Reply)


def _answer(target: Target, name: str, payload: dict[str, Any], kind: type[Message]) -> Message:
    answer = ask(target, name, {"client": CLIENT, **payload})
    message = answer.decode(kind)
    if message is None:
        raise NoAnswerError(answer.trouble)
    return message
