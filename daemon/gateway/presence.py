"""Presence of the core: the one check behind `alive` and `safety.valid`."""

from dataclasses import dataclass
from typing import Final

SILENCE_NS: Final = 200_000_000
"""Time without a record after which nothing reported by the core is valid any more."""


@dataclass(slots=True)
class Presence:
    """Tracks the arrival of records."""

    is_present: bool = False
    last_ns: int = 0

    def record_received(self, now_ns: int) -> None:
        """Note that a record has arrived."""
        self.is_present, self.last_ns = True, now_ns

    def falls_silent(self, now_ns: int) -> bool:
        """Check for silence; true once per silence, when it begins."""
        silent = self.is_present and now_ns - self.last_ns > SILENCE_NS
        if silent:
            self.is_present = False
        return silent
