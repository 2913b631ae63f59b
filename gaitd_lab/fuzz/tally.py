"""Counts of events in the sessions."""

from collections import Counter
from dataclasses import dataclass, field, fields

from gaitd_lab.fuzz.invariants import Violation


@dataclass(frozen=True, slots=True)
class Broken:
    """A violation with the data needed to reproduce it."""

    violation: Violation
    seed: int
    variant: str
    session_s: float
    trace: tuple[str, ...]
    """The last seconds, oldest first."""


@dataclass
class Tally:
    """Counts over one session, or all."""

    session_count: int = 0
    simulated_s: float = 0.0
    cycle_count: int = 0
    stolen_count: int = 0
    modes: Counter[str] = field(default_factory=Counter)
    """Number of cycles by mode."""
    stops: Counter[str] = field(default_factory=Counter)
    """Number of latched verdicts by category and cause."""
    requests: Counter[str] = field(default_factory=Counter)
    """Number of requests by kind and outcome."""
    events: Counter[str] = field(default_factory=Counter)
    """Number of other actions by kind."""
    faults: Counter[str] = field(default_factory=Counter)
    setpoints: Counter[str] = field(default_factory=Counter)
    """Number of setpoints by what was wrong with them."""
    checked: Counter[str] = field(default_factory=Counter)
    """Number of checks of each invariant."""
    broken: list[Broken] = field(default_factory=list)

    def add(self, other: "Tally") -> None:
        """Add the counts of another tally."""
        for one in fields(self):
            setattr(self, one.name, getattr(self, one.name) + getattr(other, one.name))
