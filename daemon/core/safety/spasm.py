"""A spasm: the patient's estimated effort rises fast against the motion; guidance yields, or stops.

The estimate is the observer's, so this may only add: less stiffness, and a stop. Voluntary effort
rises slower than the window asks. The motion is that of the joint when the window began, and the
one that guidance wants: a hard contraction has turned a slow leg around before it is seen. Where
there is no motion, as at a turn of the gait, no effort is with it. A joint that gives no count at
all is stuck, or its encoder is, and says nothing of a patient. Once begun, a spasm lasts until half
of its rise is gone, whichever way the leg moves meanwhile.
"""

from collections import deque
from typing import NamedTuple

END_RATIO = 0.5
"""Of the rise that counts as a spasm: below, it is over."""
STILL_CYCLES = 3
"""A joint that turns round under a spasm gives counts again after less."""


class SpasmRules(NamedTuple):
    """[spasm] of limits.toml in cycles."""

    window_cycles: int
    stiffness_ratio: float
    softening_ratio: float
    """Of full stiffness, in one cycle."""
    recovery_ratio: float


class SpasmWatch:
    """One axis."""

    def __init__(self, window_cycles: int) -> None:
        self._lately: deque[tuple[float, float]] = deque(maxlen=window_cycles + 1)
        """Effort and speed, the oldest first."""
        self._before_si = 0.0
        self.rise_si = 0.0
        """Signed: of the newest window, or since the begin of the spasm."""
        self.cycles = 0
        """How long it has lasted; 0: there is none."""

    def forget(self) -> None:
        """Nothing is known of the patient: no estimate to be used, or nothing is driven."""
        self._lately.clear()
        self.rise_si, self.cycles = 0.0, 0

    def take(
        self,
        effort_si: float,
        speed_si: float,
        wanted_speed_si: float,
        still_cycles: int,
        rise_max_si: float,
        rest_si: float,
    ) -> None:
        """One cycle.

        Args:
            effort_si: of the patient, as the observer has it: N·m or N.
            speed_si: raw; rad/s or m/s.
            wanted_speed_si: of guidance; 0 where nothing is guided.
            still_cycles: for how long the joint has given no count.
            rise_max_si: from where it is a spasm.
            rest_si: speed below which there is no motion to work with.
        """
        self._lately.append((effort_si, speed_si))
        before_si, speed_before_si = self._lately[0]
        if self.cycles > 0:
            risen_si = effort_si - self._before_si
            lasting = risen_si * self.rise_si > 0 and abs(risen_si) > END_RATIO * rise_max_si
            self.cycles = self.cycles + 1 if lasting else 0
            return
        self.rise_si = effort_si - before_si
        grows = self.rise_si * effort_si > 0 and abs(self.rise_si) > rise_max_si
        with_motion = any(
            abs(speed) > rest_si and self.rise_si * speed > 0
            for speed in (speed_before_si, wanted_speed_si)
        )
        if grows and not with_motion and still_cycles < STILL_CYCLES:
            self._before_si = before_si
            self.cycles = 1


def softened(ratio: float, rules: SpasmRules, *, in_spasm: bool) -> float:
    """The share of stiffness after one cycle: down fast, up slowly, never in a step."""
    if in_spasm:
        return min(ratio, max(ratio - rules.softening_ratio, rules.stiffness_ratio))
    return min(ratio + rules.recovery_ratio, 1.0)
