"""Whether the core is heard: the one judgement behind `alive` and `safety.valid`."""

from dataclasses import dataclass
from typing import Final

SILENCE_NS: Final = 200_000_000
"""Without a record for longer than this, nothing of the core is valid any more."""


@dataclass(slots=True)
class Presence:
    """Follows the arrival of records."""

    heard: bool = False
    last_ns: int = 0

    def hear(self, now_ns: int) -> None:
        """A record has come."""
        self.heard, self.last_ns = True, now_ns

    def falls_silent(self, now_ns: int) -> bool:
        """Judge; true once for each silence, when it begins."""
        silent = self.heard and now_ns - self.last_ns > SILENCE_NS
        if silent:
            self.heard = False
        return silent
