"""Spasm detection: the patient's estimated effort rises fast against the motion.

Guidance then softens, and the machine stops if the spasm lasts. The estimate is the observer's, so
this check may only reduce stiffness or add a stop. The motion is that of the joint when the window
began, and that of the reference: a hard contraction can reverse a slow leg before it is detected.
Without motion, as at a turn of the gait, any effort counts as against it. A joint without a single
count is stuck, or its encoder is, and shows nothing about the patient. A spasm lasts until half of
its rise is gone, in whichever direction the leg moves meanwhile.

Effort against the motion can be work: a leg is braked before each turn, and a patient who does so
is as fast as the gait. What such a patient gives is a share of what the reference needs. The share
is learned from the time before the window, so that a spasm does not teach it; a passive patient's
is 0. The effort must exceed this share of the need by as much as it must rise.
"""

import math
from collections import deque
from typing import NamedTuple

END_RATIO = 0.5
"""Share of the spasm threshold below which a spasm is over."""
STILL_CYCLES = 3
"""Cycles without a count after which a joint is stuck; a reversal takes less."""
SHARE_GAIN = 0.01
"""Weight of a cycle in the patient's share of the need: the last second counts."""
SHARE_MAX = 1.5
"""No patient is known to give more of the need; beyond it is no work."""
NEED_FLOOR_RATIO = 0.1
"""Need, as a ratio of the threshold, below which it teaches no share."""


class SpasmRules(NamedTuple):
    """Settings of [spasm] in limits.toml, in cycles."""

    window_cycles: int
    stiffness_ratio: float
    softening_ratio: float
    """Decrease of stiffness per cycle as a share of full stiffness."""
    recovery_ratio: float


class SpasmWatch:
    """Spasm detector of one axis."""

    def __init__(self, window_cycles: int) -> None:
        self._lately: deque[tuple[float, float, float]] = deque(maxlen=window_cycles + 1)
        """Effort, speed, and share of the need until then, the oldest first."""
        self._work_si2 = self._need_si2 = 0.0
        """Means of effort times need, and of the squared need."""
        self._before_si = 0.0
        self.rise_si = 0.0
        """Signed rise of effort in the newest window, or at the begin of the spasm."""
        self.cycles = 0
        """Duration of the spasm in cycles; 0: there is none."""

    def reset(self) -> None:
        """Reset the detector: there is no usable estimate, or no guided motion."""
        self._lately.clear()
        self._work_si2 = self._need_si2 = 0.0
        self.rise_si, self.cycles = 0.0, 0

    def update(
        self,
        effort_si: float,
        speed_si: float,
        wanted_speed_si: float,
        needed_si: float,
        still_cycles: int,
        rise_max_si: float,
        rest_si: float,
    ) -> None:
        """Process one cycle.

        Args:
            effort_si: effort of the patient from the observer: N·m or N.
            speed_si: raw joint speed; rad/s or m/s.
            wanted_speed_si: speed of the reference; 0 where nothing is guided.
            needed_si: effort that the reference's motion needs beyond the load: N·m or N.
            still_cycles: cycles since the joint has moved.
            rise_max_si: threshold for a spasm: of the rise, and of the effort beyond its need.
            rest_si: speed below which the joint counts as at rest.
        """
        share = self._work_si2 / (self._need_si2 + (NEED_FLOOR_RATIO * rise_max_si) ** 2)
        self._lately.append((effort_si, speed_si, min(max(share, 0.0), SHARE_MAX)))
        before_si, speed_before_si, share = self._lately[0]
        if self.cycles > 0:
            risen_si = effort_si - self._before_si
            lasting = risen_si * self.rise_si > 0 and abs(risen_si) > END_RATIO * rise_max_si
            self.cycles = self.cycles + 1 if lasting else 0
            return
        if math.isfinite(effort_si * needed_si):  # else the share would be lost for good
            self._work_si2 += SHARE_GAIN * (effort_si * needed_si - self._work_si2)
            self._need_si2 += SHARE_GAIN * (needed_si * needed_si - self._need_si2)
        self.rise_si = effort_si - before_si
        if still_cycles >= STILL_CYCLES or abs(self.rise_si) <= rise_max_si:
            return
        with_motion = any(
            abs(speed) > rest_si and self.rise_si * speed > 0
            for speed in (speed_before_si, wanted_speed_si)
        )
        sign = math.copysign(1.0, self.rise_si)
        beyond_si = sign * effort_si - max(0.0, sign * share * needed_si)
        if beyond_si > rise_max_si and not with_motion:
            self._before_si = before_si
            self.cycles = 1


def softened(ratio: float, rules: SpasmRules, *, in_spasm: bool) -> float:
    """The share of stiffness after one cycle: it falls fast and rises slowly, without a step."""
    if in_spasm:
        return min(ratio, max(ratio - rules.softening_ratio, rules.stiffness_ratio))
    return min(ratio + rules.recovery_ratio, 1.0)
