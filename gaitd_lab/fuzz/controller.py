"""A random controller: mostly valid setpoints, some of each invalid kind, and it may die."""

import math
import random
from collections import Counter
from collections.abc import Callable, Sequence
from enum import Enum
from typing import Final

from msgspec.structs import replace

from daemon.ipc.record import CycleRecord, Mode, Setpoint

GOOD_RATIO: Final = 0.9
NEUTRAL_RATIO: Final = 0.2
CHANGES_PER_CYCLE: Final = 0.02
"""Rate of new random targets: about one every half second."""
ASSISTED: Final = frozenset({Mode.TORQUE, Mode.GAIT})


class Wrong(Enum):
    """Kinds of invalid setpoint."""

    STALE = "stale"
    REORDERED = "reordered"
    REPEATED = "repeated"
    AHEAD = "ahead of time"
    NOT_FINITE = "not finite"
    OUT_OF_RANGE = "out of range"
    OTHER_LEASE = "of another lease"
    OTHER_LEG = "of another leg"
    WRONG_MODE = "not neutral in any mode"


_CHANGED: Final[dict[Wrong, Callable[[Setpoint], Setpoint]]] = {
    Wrong.STALE: lambda s: replace(s, for_cycle=s.for_cycle - 30),
    Wrong.REORDERED: lambda s: replace(s, seq=s.seq - 5),
    Wrong.REPEATED: lambda s: replace(s, seq=s.seq - 1),
    Wrong.AHEAD: lambda s: replace(s, for_cycle=s.for_cycle + 1000),
    Wrong.OTHER_LEASE: lambda s: replace(s, lease=s.lease + 7),
    Wrong.OTHER_LEG: lambda s: replace(s, leg="middle"),
    Wrong.WRONG_MODE: lambda s: replace(s, hip_assist_nm=1.0),
}


class RandomController:
    """Answers each record with a setpoint for each leg, until it dies."""

    def __init__(
        self,
        rng: random.Random,
        legs: Sequence[str],
        most_si: tuple[float, float],
        sent: Counter[str],
    ) -> None:
        self.lease = 0
        self.dead_since_ns: int | None = None
        """Time of its death; the gateway forwards its last setpoint until the lease is over."""
        self._sent = sent
        self._rng = rng
        self._legs = tuple(legs)
        self._most_si = most_si
        self._assist = self._draw_assist()
        self._seq = 0
        self._sent_setpoints: tuple[Setpoint, ...] = ()

    def __call__(self, record: CycleRecord) -> tuple[Setpoint, ...]:
        """Return the newest setpoint of each leg, which the gateway forwards."""
        if self.dead_since_ns is None:
            self._seq += 1
            if self._rng.random() < CHANGES_PER_CYCLE:
                self._assist = self._draw_assist()
            self._sent_setpoints = tuple(self._setpoint(record, leg) for leg in self._legs)
        return self._sent_setpoints

    def _draw_assist(self) -> tuple[float, float, float]:
        rng = self._rng
        if rng.random() < NEUTRAL_RATIO:
            return 0.0, 0.0, 1.0
        # Mostly small values, sometimes the whole allowed range.
        hip_nm, slide_n = (most * rng.uniform(-1.0, 1.0) ** 3 for most in self._most_si)
        return hip_nm, slide_n, rng.choice((1.0, 1.0, rng.random()))

    def _setpoint(self, record: CycleRecord, leg: str) -> Setpoint:
        hip_nm, slide_n, stiffness_ratio = (
            self._assist if record.mode in ASSISTED else (0.0, 0.0, 1.0)
        )
        good = Setpoint(self.lease, self._seq, record.cycle, hip_nm, slide_n, leg, stiffness_ratio)
        if self._rng.random() < GOOD_RATIO:
            self._sent["good"] += 1
            return good
        wrong = self._rng.choice(tuple(Wrong))
        self._sent[wrong.value] += 1
        return self._falsified(good, wrong)

    def _falsified(self, good: Setpoint, wrong: Wrong) -> Setpoint:
        rng = self._rng
        if wrong is Wrong.NOT_FINITE:
            odd = rng.choice((math.nan, math.inf, -math.inf))
            which = rng.choice(("hip_assist_nm", "slide_assist_n", "stiffness_ratio"))
            return replace(good, **{which: odd})
        if wrong is Wrong.OUT_OF_RANGE:
            hip_nm = rng.choice((-1, 1)) * self._most_si[0] * rng.choice((1.001, 3.0, 1e300))
            beyond = rng.choice(({"hip_assist_nm": hip_nm}, {"stiffness_ratio": 1.5}))
            return replace(good, **beyond)
        return _CHANGED[wrong](good)
