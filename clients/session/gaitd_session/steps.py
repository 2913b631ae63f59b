"""Steps as a patient sees them: each is judged by the last three strides of its leg.

One odd stride must not change what a patient is told, and a change that lasts must be told soon: so
a step has the median of the known shares among the last three strides. Everything that is shown or
counted follows from that one number. A stride whose share is not known is told as such at once.
"""

from collections.abc import Iterable, Sequence
from enum import StrEnum, auto
from statistics import median
from typing import Final, NamedTuple

from gaitd_client import Stride

from gaitd_session.goals import Band

WINDOW: Final = 3
"""Strides that judge a step."""


class Result(StrEnum):
    """A step against the target."""

    UNKNOWN = auto()
    """The share is not known."""
    UNJUDGED = auto()
    """There is no target."""
    AGAINST = auto()
    """The patient has worked more against the motion than with it."""
    BELOW = auto()
    WITHIN = auto()
    ABOVE = auto()


class StrideShare(NamedTuple):
    """A stride that has ended."""

    leg: str
    share_ratio: float | None
    """None: not valid for a goal."""
    is_against: bool = False
    """See `works_against`."""


class Step(NamedTuple):
    """A stride as it is shown and counted."""

    leg: str
    share_ratio: float | None
    """Median of the known shares among the last strides; None: that of this one is not known."""
    result: Result


def works_against(stride: Stride) -> bool:
    """Return whether the patient has surely worked more against the motion than with it.

    A low share is not that: it says that the patient did little.
    """
    along_j, against_j = stride.work_positive_j, stride.work_negative_j
    if along_j is None or against_j is None:
        return False
    std_j = (stride.work_positive_j_std or 0.0) + (stride.work_negative_j_std or 0.0)
    return along_j + against_j + std_j < 0


def step_of(strides: Sequence[StrideShare], band: Band | None) -> Step:
    """Judge the newest of a leg's strides.

    Args:
        strides: of one leg and block, oldest first; not empty.
        band: the target; None: there is none.
    """
    newest = strides[-1]
    if newest.share_ratio is None:
        return Step(newest.leg, None, Result.UNKNOWN)
    known = [
        (one.share_ratio, one.is_against)
        for one in strides[-WINDOW:]
        if one.share_ratio is not None
    ]
    share = median(share for share, _ in known)
    is_against = 2 * sum(is_against for _, is_against in known) > len(known)
    return Step(newest.leg, share, _result(share, band, is_against=is_against))


def _result(share: float, band: Band | None, *, is_against: bool) -> Result:
    if band is None:
        return Result.UNJUDGED
    if is_against:
        return Result.AGAINST
    if share < band.low_ratio:
        return Result.BELOW
    return Result.ABOVE if share > band.high_ratio else Result.WITHIN


def rows_of(steps: Iterable[Step]) -> tuple[int, int]:
    """Return how many steps in a row are in the target now, and in the longest row.

    A step whose share is not known is no step beside the target: the row goes on behind it.
    """
    now = best = 0
    for step in steps:
        if step.result is Result.WITHIN:
            now += 1
        elif step.result is not Result.UNKNOWN:
            now = 0
        best = max(best, now)
    return now, best
