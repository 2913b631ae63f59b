"""Named deadlines of one node: at most one per name; no clock is read."""

from collections.abc import Callable, Hashable
from typing import Final, NamedTuple

NEVER: Final = 2**63 - 1
MILLISECOND: Final = 1_000_000
"""A time in nanoseconds."""


class _Deadline(NamedTuple):
    at_ns: int
    order: int
    action: Callable[[], None]


class Timers:
    """Named deadlines; equal times run in the order in which they were started."""

    def __init__(self) -> None:
        self._deadlines: dict[Hashable, _Deadline] = {}
        self._order = 0
        self.next_ns = NEVER
        """Time of the earliest deadline, or NEVER; asked for some thirty times in a cycle."""

    def start(self, name: Hashable, at_ns: int, action: Callable[[], None]) -> None:
        """Run `action` at `at_ns`; replaces a deadline of the same name."""
        self.cancel(name)
        self._order += 1
        self._deadlines[name] = _Deadline(at_ns, self._order, action)
        self.next_ns = min(at_ns, self.next_ns)

    def cancel(self, name: Hashable) -> None:
        """Cancel a deadline; one that is not running is no error."""
        if name in self._deadlines:
            self._remove(name)

    def cancel_all(self) -> None:
        """Cancel all deadlines: the node has lost its power."""
        self._deadlines.clear()
        self.next_ns = NEVER

    def running(self, name: Hashable) -> bool:
        """Return whether the deadline is pending."""
        return name in self._deadlines

    def run_due(self, now_ns: int) -> None:
        """Run every deadline up to `now_ns`, earliest first, including those an action starts."""
        while self.next_ns <= now_ns:
            name = min(self._deadlines, key=self._deadlines.__getitem__)
            self._remove(name).action()

    def _remove(self, name: Hashable) -> _Deadline:
        removed = self._deadlines.pop(name)
        if removed.at_ns == self.next_ns:
            self.next_ns = min((one.at_ns for one in self._deadlines.values()), default=NEVER)
        return removed
