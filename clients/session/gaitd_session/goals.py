"""The target band of a block, from the strides of the block before.

Pure numerics of one leg; the therapist's bounds are those of `[goal]` in the profile.
"""

import math
from collections.abc import Sequence
from statistics import median
from typing import Final, NamedTuple

from gaitd_client import Mode, StatusBit, Stride

from gaitd_session.profile import Goal

STRIDES_MIN: Final = 5
"""With fewer valid strides the median says little, and the band stays."""
UNUSABLE: Final = frozenset({StatusBit.ARTIFICIAL, StatusBit.UNCALIBRATED, StatusBit.UNREFERENCED})
"""A stride with one of these has no share that a goal may follow. Samples that were not valid are
left out by the service, and a stride with too few others has no share."""


class Band(NamedTuple):
    """A target band for the patient's share of a stride's work."""

    low_ratio: float
    high_ratio: float

    @property
    def middle_ratio(self) -> float:
        """Middle of the band."""
        return (self.low_ratio + self.high_ratio) / 2


def band_about(middle_ratio: float, goal: Goal) -> Band:
    """Return the band about a middle, which is first brought within the therapist's bounds."""
    middle = min(max(middle_ratio, goal.share_min_ratio), goal.share_max_ratio)
    half = goal.band_width_ratio / 2
    return Band(max(middle - half, 0.0), min(middle + half, 1.0))


def next_middle(
    middle_ratio: float, shares: Sequence[float], goal: Goal, *, is_first: bool
) -> float:
    """Return the middle of the band for the next block.

        m' = clip(m + clip(median(s) + c - m, -d, d), m_min, m_max)                    # eq. (1)

    The median makes single strides without weight: a cough or a spasm changes nothing. The band
    follows the patient also downwards, so that a bad day has goals that can be reached. The first
    block of a session proposes the band of the day: d does not count for it.

    Args:
        middle_ratio: m, middle of the present band.
        shares: s, `Stride.share_ratio` of the block's valid strides, 0..1, in any order.
        goal: c = `challenge_ratio`, d = `step_max_ratio`, m_min and m_max = `share_min_ratio`,
            `share_max_ratio`.
        is_first: no block of the session before had enough strides.

    Returns: m', within the bounds; m within the bounds where there are fewer than `STRIDES_MIN`.
    """
    step = 0.0
    if len(shares) >= STRIDES_MIN:
        step_max = math.inf if is_first else goal.step_max_ratio
        step = median(shares) + goal.challenge_ratio - middle_ratio
        step = min(max(step, -step_max), step_max)
    return min(max(middle_ratio + step, goal.share_min_ratio), goal.share_max_ratio)  # eq. (1)


def valid_share(stride: Stride) -> float | None:
    """Return the patient's share of a stride, 0..1; None if a goal may not follow it."""
    share = stride.share_ratio
    if share is None or not math.isfinite(share) or not 0 <= share <= 1:
        return None
    usable = stride.mode == Mode.GAIT and UNUSABLE.isdisjoint(stride.status)
    return share if usable else None
