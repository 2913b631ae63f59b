"""Steps and gauge of the patient's page: heights on a bent scale, and the word that follows.

The target is always the middle of the gauge, however narrow it is in per cent: below it the scale
ends at nothing, above it at all. Gauge, path, word, symbol and background say the same, because all
of them follow from the newest step of each leg.
"""

from collections import deque
from collections.abc import Iterable, Mapping
from typing import Final

import msgspec
from gaitd_client import Stride
from gaitd_session import Band, Result, Step, StrideShare, step_of, works_against
from gaitd_session.goals import valid_share
from gaitd_session.steps import WINDOW
from gaitd_session.view import STEPS_SHOWN

from gaitd_display.words import Word

LOW_RATIO: Final = 0.31
HIGH_RATIO: Final = 0.69
"""The target's place on the gauge."""
WORST_FIRST: Final[Mapping[Result, Word]] = {
    Result.AGAINST: Word.RELAX,
    Result.BELOW: Word.MORE,
    Result.ABOVE: Word.GENTLY,
    Result.WITHIN: Word.GOOD,
}
"""With two legs the first of these that a leg has gives the word."""


class StepView(msgspec.Struct, frozen=True):
    """One step of the path; the newest of a leg is its gauge."""

    leg: str
    share_ratio: float | None
    """None: not known, a dashed ring."""
    height_ratio: float | None
    """On the gauge."""
    result: Result


def height_of(share: float, band: Band | None) -> float:
    """Return the height of a share on the gauge, 0..1; without a target it is the share."""
    if band is None:
        return share
    low, high = band
    if share < low:
        return LOW_RATIO * share / low
    if share > high:
        return HIGH_RATIO + (1 - HIGH_RATIO) * min((share - high) / (1 - high), 1)
    return LOW_RATIO + (HIGH_RATIO - LOW_RATIO) * (share - low) / (high - low)


def step_view(step: Step, band: Band | None) -> StepView:
    """Return what the page paints of a step."""
    share = step.share_ratio
    if share is None:
        return StepView(step.leg, None, None, step.result)
    return StepView(step.leg, round(share, 3), round(height_of(share, band), 3), step.result)


def word_of(steps: Iterable[Step]) -> Word:
    """Return the word of the newest step of each leg."""
    newest = {step.leg: step.result for step in steps}
    return next(
        (word for result, word in WORST_FIRST.items() if result in newest.values()), Word.GO_ON
    )


class OwnSteps:
    """The steps of a gait that another program has started."""

    def __init__(self, band: Band | None) -> None:
        """Start without a step; the band is the same for each leg."""
        self.band = band
        self._strides: dict[str, deque[StrideShare]] = {}
        self._steps: deque[Step] = deque(maxlen=STEPS_SHOWN)

    @property
    def steps(self) -> tuple[Step, ...]:
        """The newest ones, oldest first."""
        return tuple(self._steps)

    def take(self, stride: Stride) -> None:
        """Take a stride that has ended."""
        strides = self._strides.setdefault(stride.leg, deque(maxlen=WINDOW))
        strides.append(StrideShare(stride.leg, valid_share(stride), works_against(stride)))
        self._steps.append(step_of(tuple(strides), self.band))

    def forget(self) -> None:
        """No gait plays."""
        self._strides.clear()
        self._steps.clear()
