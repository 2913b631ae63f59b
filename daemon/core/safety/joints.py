"""Joint position, speed, effort and standstill, from raw drive values only.

The safety checks of motion use these values, not the observer's estimate.
"""

from typing import NamedTuple

from daemon.core.safety.limits import AxisLimits, Thresholds
from drives.cia402.units import AxisScaling, to_joint
from drives.signals import DriveFeedback


class Joint(NamedTuple):
    """One joint at its newest complete sample; SI units at the joint."""

    known: bool = False
    """A sample has been received since bring-up."""
    fresh: bool = False
    """The sample is of this cycle."""
    position_si: float = 0.0
    velocity_si: float = 0.0
    """Difference of the last two samples divided by the measured time between them."""
    effort_si: float = 0.0
    step_si: float = 0.0
    """Distance between the last two samples."""
    elapsed_s: float = 0.0
    """Time between the last two samples; 0 until there are two."""
    sample_ns: int = 0
    counts: int = 0
    still_cycles: int = 0
    """Samples in a row within `still_counts_max` of `still_counts`."""
    still_counts: int = 0
    """Encoder counts at which the joint began to stand still."""
    speed_before_still_si: float = 0.0
    """Speed before standstill; a loss of speed that is impossible in one cycle is a fault."""


def jump_reach_si(joint: Joint, limits: AxisLimits, thresholds: Thresholds) -> float:
    """Largest possible step between the last two samples; a larger one is an encoder fault."""
    return thresholds.encoder_jump_ratio * limits.velocity_max_si * joint.elapsed_s


def is_at_rest(joint: Joint, limits: AxisLimits) -> bool:
    """True if the joint is slower than the limit of standstill, at its newest sample."""
    return abs(joint.velocity_si) < limits.standstill_si_per_s


STILL_COUNTS = 3
"""Noise of an encoder at rest; a joint that moves leaves this within a few samples."""
STILL_S = 0.003
"""The way of this time at the limit of standstill is standstill, however fine the encoder is: a leg
that is held is never as still as the counts of a fine one."""


def still_counts_max(scaling: AxisScaling, limits: AxisLimits) -> int:
    """Encoder counts within which a joint stands still."""
    way_si = STILL_S * limits.standstill_si_per_s
    return max(STILL_COUNTS, int(way_si * abs(scaling.counts_per_si)))


def measure(
    previous: Joint,
    feedback: DriveFeedback,
    scaling: AxisScaling,
    limits: AxisLimits,
    sync_ns: int,
) -> Joint:
    """The joint after this cycle's window; without a new sample the last one stays, not fresh."""
    if not feedback.fresh:
        return previous._replace(fresh=False)
    sample = to_joint(feedback, scaling)
    if not previous.known:
        return Joint(
            known=True,
            fresh=True,
            position_si=sample.position_si,
            effort_si=sample.effort_si,
            sample_ns=sync_ns,
            counts=feedback.position_counts,
            still_counts=feedback.position_counts,
        )
    elapsed_s = (sync_ns - previous.sample_ns) * 1e-9
    step_si = sample.position_si - previous.position_si
    way_counts = abs(feedback.position_counts - previous.still_counts)
    still = way_counts <= still_counts_max(scaling, limits)
    began = still and previous.still_cycles == 0
    return Joint(
        known=True,
        fresh=True,
        position_si=sample.position_si,
        velocity_si=step_si / elapsed_s,
        effort_si=sample.effort_si,
        step_si=step_si,
        elapsed_s=elapsed_s,
        sample_ns=sync_ns,
        counts=feedback.position_counts,
        still_cycles=previous.still_cycles + 1 if still else 0,
        still_counts=previous.still_counts if still else feedback.position_counts,
        speed_before_still_si=(
            abs(previous.velocity_si) if began else previous.speed_before_still_si
        ),
    )
