"""Feedback of one leg: the bar, the peak of the present stride, and what the last one was.

The bar is `patient_power_w` of the newest message, not smoothed; a value that is not valid has no
bar. Within a stride the power falls to zero at each reversal of the motion, so a word that followed
the bar would change several times a second. The word follows the highest power of the last whole
stride instead: the target band says how far up the bar is to go in each stride.
"""

from enum import StrEnum, auto
from typing import Final

import msgspec
from gaitd_client import Activity, NotValid

from gaitd_display.settings import Bar

KNOWN_MIN_RATIO: Final = 0.5
"""A stride whose power was known for less of its messages has no result."""
WRAP_RATIO: Final = 0.5
"""The phase falls by more than this where a new stride begins."""
LOWEST_RATIO: Final = -0.25
"""Lower end of the bar, in parts of `full_w`: effort against the motion."""


class Result(StrEnum):
    """The last whole stride against the target band."""

    UNKNOWN = auto()
    BELOW = auto()
    WITHIN = auto()
    ABOVE = auto()


class BarView(msgspec.Struct, frozen=True):
    """What the page paints for one leg. Ratios are of the bar above its zero line."""

    leg: str
    value_ratio: float | None
    """-0.25..1; None: not valid, a dash and a hatched bar."""
    peak_ratio: float | None
    """Highest value of the present stride."""
    target_low_ratio: float
    target_high_ratio: float
    result: Result
    sample_time_ms: float | None
    """UTC of the sample, ms since 1970: its age when painted is measured by the page."""


class LegFeedback:
    """State of one leg; `take` gets each newest message."""

    def __init__(self, bar: Bar) -> None:
        """Start without a stride."""
        self._bar = bar
        self._cycle: int | None = None
        self._phase: float | None = None
        self._peak_w: float | None = None
        self._seen_count = self._known_count = 0
        self._is_whole = False
        self._value_w: float | None = None
        self._sample_time_ms: float | None = None
        self.result = Result.UNKNOWN

    def take(self, activity: Activity | NotValid) -> None:
        """Take the newest message, or its absence."""
        if isinstance(activity, NotValid):
            self._value_w = self._sample_time_ms = None
            self._leave()
            return
        self._value_w = activity.patient_power_w
        self._sample_time_ms = activity.sample_time_ns / 1e6
        if activity.cycle == self._cycle:
            return
        self._cycle = activity.cycle
        phase = activity.gait_phase_ratio
        if phase is None:
            self._leave()
            return
        if self._phase is not None and self._phase - phase > WRAP_RATIO:
            self._end_stride()
        self._phase = phase
        self._seen_count += 1
        if self._value_w is not None:
            self._known_count += 1
            self._peak_w = max(self._value_w, self._peak_w or 0.0)

    def view(self) -> BarView:
        """Return what the page paints."""
        return BarView(
            leg=self._bar.leg,
            value_ratio=self._ratio(self._value_w),
            peak_ratio=self._ratio(self._peak_w),
            target_low_ratio=self._bar.target_low_w / self._bar.full_w,
            target_high_ratio=self._bar.target_high_w / self._bar.full_w,
            result=self.result,
            sample_time_ms=self._sample_time_ms,
        )

    def _ratio(self, power_w: float | None) -> float | None:
        if power_w is None:
            return None
        return round(min(1.0, max(LOWEST_RATIO, power_w / self._bar.full_w)), 3)

    def _leave(self) -> None:
        """No gait plays, or nothing is known: there is no stride, and no result of one."""
        self._phase, self._is_whole, self.result = None, False, Result.UNKNOWN
        self._begin_stride()

    def _end_stride(self) -> None:
        if self._is_whole:
            self.result = self._judge()
        self._is_whole = True
        self._begin_stride()

    def _begin_stride(self) -> None:
        self._peak_w, self._seen_count, self._known_count = None, 0, 0

    def _judge(self) -> Result:
        if self._peak_w is None or self._known_count < KNOWN_MIN_RATIO * self._seen_count:
            return Result.UNKNOWN
        if self._peak_w < self._bar.target_low_w:
            return Result.BELOW
        return Result.ABOVE if self._peak_w > self._bar.target_high_w else Result.WITHIN
