"""Monitor of friction against its calibration. Pure: checked in motion, for record and advice."""

from typing import Final

from observer.drift import Drift, Sample, updated
from observer.filter.leg_observer import LegEstimate
from observer.filter.status import Status, Validity
from observer.mechanism.friction import FrictionParameters

DOUBTFUL: Final = Status.ARTIFICIAL | Status.NEAR_LIMIT | Status.INPUT_SATURATED
"""Status flags under which the estimate shows neither friction nor patient."""


def update(
    drift: Drift, law: FrictionParameters, estimate: LegEstimate, index: int, dt_s: float
) -> Drift | None:
    """The drift of one axis with this cycle's estimate; None where the estimate is doubtful.

    `index`: 0 for the hip, 1 for the slide.
    """
    if estimate.status & DOUBTFUL or estimate.validity[index] is not Validity.OK:
        return None
    state, std = estimate.state, estimate.std
    sample = Sample(state[index], state[2 + index], state[6 + index], std[6 + index])
    return updated(drift, law, sample, dt_s)
