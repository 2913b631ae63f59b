"""Stiffness of the guidance, adapted once a stride: it fades as the patient keeps to the gait.

    s <- clip(f s + g max(n - 1, 0), floor, 1),  n = rms error of the stride / dead band

n is that of the worse axis. Without an error outside of the dead band the stiffness is forgotten by
f each stride, so that a patient's own variability is not corrected; with one it grows.
Source: Emken, Benitez, Reinkensmeyer, "Human-robot cooperative movement training: learning a novel
sensory motor transformation during walking with robotic assistance-as-needed", J. NeuroEng.
Rehabil. 4:8 (2007): robot law R' = f R - g e with f < 1, and error weighting. Differs from it: one
stiffness for the whole stride and both axes; a floor.
"""

import math
from dataclasses import dataclass
from typing import Final

from gaitd_client import Assist

from gaitd_assist.law import Pair, Sample

LEARNED_MIN_RATIO: Final = 0.5
"""Least share of a stride in which an axis was learned from; below, the axis has no error."""
FULL: Final = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class GuidanceRules:
    """Constants of the law."""

    dead_band: Pair
    """rad, m."""
    forgetting_ratio: float
    """f: share of the stiffness that is kept each stride."""
    gain_ratio: float
    """g: stiffness gained by an error of two dead bands."""
    floor_ratio: float
    """The stiffness never falls below."""


class Guidance:
    """The law for one leg."""

    def __init__(self, rules: GuidanceRules) -> None:
        """Begin with full stiffness."""
        self._rules = rules
        self.begin_gait()

    def begin_gait(self) -> None:
        """See `Law`: full stiffness."""
        self.stiffness_ratio = FULL
        self._clear()

    def answer(self, sample: Sample, setpoint: Assist) -> Assist:
        """See `Law`: scale the stiffness while a gait plays, and sum up its errors."""
        if sample.phase_ratio is None:
            return setpoint
        self._stride_s += sample.dt_s
        for axis, learns in enumerate(sample.learns):
            if learns:
                self._learned_s[axis] += sample.dt_s
                self._squares[axis] += sample.dt_s * sample.error[axis] ** 2
        return setpoint._replace(stiffness_ratio=self.stiffness_ratio)

    def end_stride(self) -> None:
        """See `Law`: unchanged after a stride that was not known well enough."""
        rules, errors = self._rules, self.errors
        ratios = [
            error / dead_band
            for error, dead_band in zip(errors, rules.dead_band, strict=True)
            if error is not None
        ]
        self._clear()
        if ratios:
            excess_ratio = max(*ratios, FULL) - FULL
            wanted = rules.forgetting_ratio * self.stiffness_ratio + rules.gain_ratio * excess_ratio
            self.stiffness_ratio = min(max(wanted, rules.floor_ratio), FULL)

    @property
    def errors(self) -> tuple[float | None, float | None]:
        """Rms error of this stride so far: rad, m; None: too little of it was known."""
        hip, slide = (
            math.sqrt(square / learned_s)
            if learned_s > LEARNED_MIN_RATIO * self._stride_s
            else None
            for square, learned_s in zip(self._squares, self._learned_s, strict=True)
        )
        return hip, slide

    def state(self) -> dict[str, float | list[float]]:
        """See `Law`."""
        return {"stiffness_ratio": self.stiffness_ratio}

    def _clear(self) -> None:
        self._stride_s = 0.0
        self._learned_s, self._squares = [0.0, 0.0], [0.0, 0.0]
