"""Who gets the machine walking again: reset, enable, gait, one request at a time.

As a person would, it looks at the mode, and asks again after a while if it was refused. Where an
axis is not referenced, it resets once more: a drive that came up with an error of its encoder is
looked at again. It knows no clock and no socket.
"""

from collections import Counter
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from daemon.ipc.record import Mode
from gaitd_lab.demonstration.script import Ask

REST_S: Final = 0.7
"""A person looks before the next request."""
AGAIN_S: Final = 1.0
"""After a refusal, a leg that still moves for example."""

UNREFERENCED: Final = "not referenced"
"""In a refusal."""


class Situation(NamedTuple):
    """What the operator sees."""

    now_s: float
    mode: Mode | None
    """None: nobody knows."""
    clear: bool
    """Whatever went wrong has gone."""
    outcome: str | None
    """Of the newest request; None while it is outstanding."""
    reason: str = ""


class Operator:
    """Asks for what is next."""

    def __init__(self, walk: Callable[[], dict[str, Any]]) -> None:
        """Draw each exercise by `walk`."""
        self._walk = walk
        self._asked: str | None = None
        self._not_before_s = 0.0
        self._mode: Mode | None = None
        self._unreferenced = False
        self.outcomes: Counter[str] = Counter()
        """Of requests, by name, outcome and reason."""

    def next(self, now: Situation) -> Ask | None:
        """What is asked now, if anything."""
        if self._asked is not None:
            if now.outcome is None:
                return None
            self._note(now)
        if now.mode != self._mode:
            self._mode, self._not_before_s = now.mode, now.now_s + REST_S
        if now.now_s < self._not_before_s or not now.clear:
            return None
        wanted = self._wanted(now.mode)
        self._asked = wanted.name if wanted else None
        return wanted

    def _note(self, now: Situation) -> None:
        reason = f": {now.reason}" if now.outcome != "done" and now.reason else ""
        self.outcomes[f"{self._asked} {now.outcome}{reason}"] += 1
        self._unreferenced = UNREFERENCED in reason
        self._asked = None
        self._not_before_s = now.now_s + (REST_S if now.outcome == "done" else AGAIN_S)

    def _wanted(self, mode: Mode | None) -> Ask | None:
        if mode == Mode.FAULT or (mode == Mode.READY and self._unreferenced):
            return Ask("reset", {})
        if mode == Mode.READY:
            return Ask("enable", {})
        if mode == Mode.HOLD:
            return Ask("mode", self._walk())
        return None
