"""The simulated operator: returns the machine to gait by reset, enable, gait, one at a time.

It reads the mode, and repeats a refused request after a while. If an axis is not referenced, it
resets once more: a drive that started with an encoder error is then checked again. It uses no clock
and no socket.
"""

from collections import Counter
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from daemon.ipc.record import Mode
from gaitd_lab.demonstration.script import Ask

REST_S: Final = 0.7
"""Delay before the next request, like a human operator's."""
AGAIN_S: Final = 1.0
"""Delay after a refusal, for example because a leg still moves."""


class Situation(NamedTuple):
    """Input of the operator."""

    now_s: float
    mode: Mode | None
    """None: unknown."""
    clear: bool
    """True if the fault has ended."""
    outcome: str | None
    """Outcome of the newest request; None while it is pending."""
    reason: str = ""
    referenced: bool = True
    """False if a drive does not know its position."""


class Operator:
    """Decides the next request."""

    def __init__(self, walk: Callable[[], dict[str, Any]]) -> None:
        """`walk` draws the arguments of each exercise."""
        self._walk = walk
        self._requested: str | None = None
        self._not_before_s = 0.0
        self._mode: Mode | None = None
        self._unreferenced = False
        self.outcomes: Counter[str] = Counter()
        """Number of requests, by name, outcome and reason."""

    def next(self, now: Situation) -> Ask | None:
        """Return the next request, if any."""
        if self._requested is not None:
            if now.outcome is None:
                return None
            self._update(now)
        if now.mode != self._mode:
            self._mode, self._not_before_s = now.mode, now.now_s + REST_S
        if now.now_s < self._not_before_s or not now.clear:
            return None
        wanted = self._wanted(now.mode)
        self._requested = wanted.name if wanted else None
        return wanted

    def _update(self, now: Situation) -> None:
        reason = f": {now.reason}" if now.outcome != "done" and now.reason else ""
        self.outcomes[f"{self._requested} {now.outcome}{reason}"] += 1
        self._unreferenced = now.outcome == "refused" and not now.referenced
        self._requested = None
        self._not_before_s = now.now_s + (REST_S if now.outcome == "done" else AGAIN_S)

    def _wanted(self, mode: Mode | None) -> Ask | None:
        if mode == Mode.FAULT or (mode == Mode.READY and self._unreferenced):
            return Ask("reset", {})
        if mode == Mode.READY:
            return Ask("enable", {})
        if mode == Mode.HOLD:
            return Ask("mode", self._walk())
        return None
