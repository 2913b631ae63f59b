"""Shared part of `commission` and `reference`: run a mode on one axis of the empty machine.

Exit codes as in `remote.py`; 1 also if the axis was not homed, or does not move as it should.
"""

import sys
import time
from typing import Any, Final, NamedTuple

from daemon import wire
from gaitd.remote import EXIT_DONE, EXIT_NO_ANSWER, EXIT_REFUSED, Target, ask, request

POLL_S: Final = 0.25
PATIENCE_S: Final = 360.0
"""Longer than any homing may take."""
CALM_POLLS: Final = 2
"""Polls in a calm mode before the end counts: between bring-ups the service passes `ready`."""
OVER_MODES: Final = frozenset({"ready", "fault"})


class Ending(NamedTuple):
    """Result of `prepare`."""

    good: bool
    text: str
    """Event text of the service about the axis; if the axis stopped before its end, the reason."""


def prepare(target: Target, mode: str, axis: str, good: str, *, as_json: bool) -> Ending | int:
    """Request the mode and wait for its end; the exit code if it was refused or not answered.

    Args:
        target: the service.
        mode: `reference` or `commission`.
        axis: LEG/AXIS.
        good: beginning of the service's event text about the axis in case of success.
        as_json: print the replies as one JSON object a line, and nothing else.
    """
    before = _status(target)
    if before is None:
        return _nobody(mode)
    last_id = before.events[-1].id if before.events else ""
    payload: dict[str, Any] = {"mode": mode, "axis": axis}
    code = request(target, "mode", payload, as_json=as_json)
    return _follow(target, axis, good, last_id, quiet=as_json) if code == EXIT_DONE else code


def _follow(target: Target, axis: str, good: str, last_id: str, *, quiet: bool) -> Ending | int:
    calm, shown = 0, ""
    for _ in range(round(PATIENCE_S / POLL_S)):
        time.sleep(POLL_S)
        status = _status(target)
        if status is None or not status.safety.valid:
            return _nobody(axis)
        safety = status.safety
        if safety.progress != shown and not quiet:
            print(f"  {safety.progress}", file=sys.stderr)
        shown = safety.progress or ""
        calm = calm + 1 if safety.mode in OVER_MODES else 0
        if calm > CALM_POLLS:
            return _ending(status, axis, good, last_id)
    print(f"{axis}: it did not end within {PATIENCE_S:g} s", file=sys.stderr)
    return EXIT_NO_ANSWER


def _ending(status: wire.Status, axis: str, good: str, last_id: str) -> Ending:
    texts = [event.text for event in _since(status.events, last_id)]
    about = [text for text in texts if text.startswith(f"{axis}: ")]
    for text in reversed(about):
        if text.startswith((f"{axis}: {good}", f"{axis}: failed")):
            return Ending(text.startswith(f"{axis}: {good}"), text)
    verdict = status.safety.verdict
    why = f"{verdict.text}: {verdict.remedy}" if verdict and verdict.category != "none" else ""
    return Ending(False, f"{axis}: stopped before its end. {why}".strip())


def _since(events: tuple[wire.Event, ...], last_id: str) -> tuple[wire.Event, ...]:
    ids = [event.id for event in events]
    return events[ids.index(last_id) + 1 :] if last_id in ids else events


def _status(target: Target) -> wire.Status | None:
    return ask(target, "status", {"client": "gaitd"}).decode(wire.Status)


def _nobody(what: str) -> int:
    print(f"{what}: the service does not answer; look at it before you go on", file=sys.stderr)
    return EXIT_NO_ANSWER


def exit_code(ending: Ending) -> int:
    """Exit code: 0 for success, else 1."""
    return EXIT_DONE if ending.good else EXIT_REFUSED
