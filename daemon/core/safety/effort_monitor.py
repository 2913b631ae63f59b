"""Whether a drive gives the effort that it is asked for, in the direction it is asked for.

Three questions, each of raw values alone, each asked of one axis in every cycle:

`gap`        In torque mode, is the effort that the drive measures the one that was sent? A target
             leaves in one cycle, acts from the next SYNC and is sampled at the one after, so it is
             compared with all that was sent lately. Finds a drive that does not give its torque.
`opposed`    Beyond the load, does the drive push one way while the joint accelerates, against its
             friction, the other way? Then motor or encoder are the wrong way round, or a patient is
             twice as strong as the limit.
`drift`      Over a whole stride of gait, is the mean effort what motion, load and friction ask for?
             A current sensor that shows too much closes its drive's own loop on a wrong value: the
             gap is nil, the leg gets too little, and only this mean can tell. A patient who pushes
             steadily through a whole stride looks the same, and nobody could tell the two apart: a
             drive that seems to give that much too little is not to be trusted with a leg.

Without power a drive's effort is nil, whatever its target: there `gap` is what its sensor shows.
"""

from typing import NamedTuple

from daemon.core.safety.inverse_dynamics import Balance
from daemon.core.safety.limits import AxisLimits
from daemon.core.steps.joints import Joint

SENT_COUNT = 3
"""A measured effort may be that of so many commands: two cycles of delay, and one late sample."""
HELD_RATIO = 0.3
"""Weight of the newest sample in a mean of the last few."""
HELD_CYCLES = 5
"""Standing still for so long, a joint has left what braked it behind."""
SETTLE_CYCLES = 10
"""After a drive has lost its power its current is gone; before that it is no fault."""


class EffortWatch(NamedTuple):
    """What one axis's efforts have been like lately; N·m or N."""

    sent_si: tuple[float, ...] = ()
    """The newest last, in torque mode without a break."""
    unpowered_cycles: int = 0
    gap_si: float = 0.0
    gap_cycles: int = 0
    """In a row beyond the limit."""
    sign_mismatch_si: float = 0.0
    """The smaller one of push and motion, where they are opposed."""
    sign_mismatch_cycles: int = 0
    held_si: float = 0.0
    """What friction and patient hold, if the joint stands still: a mean of a few samples."""
    held_before_still_si: float = 0.0
    """The same when the joint began to stand still."""
    effort_before_still_si: float = 0.0
    """What the drive gave then."""


def note_sent(watch: EffortWatch, effort_si: float, *, in_force: bool) -> EffortWatch:
    """The watch after a command; `in_force`: the drive is enabled and shows torque mode."""
    if not in_force:
        return watch._replace(sent_si=())
    return watch._replace(sent_si=(*watch.sent_si, effort_si)[-SENT_COUNT:])


def look(
    watch: EffortWatch,
    joint: Joint,
    balance: Balance,
    axis: int,
    limits: AxisLimits,
    *,
    powered: bool,
    free: bool,
    placed: bool,
) -> EffortWatch:
    """The watch after this cycle's sample; without a sample nothing is known, and nothing counts.

    Args:
        watch: of the cycle before.
        joint: of this cycle.
        balance: of its leg.
        axis: 0 hip, 1 slide.
        limits: of this axis.
        powered: the drive's power stage may be on.
        free: no end stop pushes the joint; one that bounces off is no sign.
        placed: both axes of the leg know where they are; else the balance says nothing.
    """
    if not joint.fresh:
        return watch
    unpowered_cycles = 0 if powered else watch.unpowered_cycles + 1
    ratio = HELD_RATIO if placed else 0.0
    held_si = watch.held_si + ratio * (balance.held(axis) - watch.held_si)
    gap_si = _gap(watch, joint.effort_si, unpowered_cycles)
    sign_mismatch_si = _opposed(balance, axis) if powered and free and placed else 0.0
    return watch._replace(
        unpowered_cycles=unpowered_cycles,
        gap_si=gap_si,
        gap_cycles=watch.gap_cycles + 1 if gap_si > limits.effort_deviation_max_si else 0,
        sign_mismatch_si=sign_mismatch_si,
        sign_mismatch_cycles=(
            watch.sign_mismatch_cycles + 1
            if sign_mismatch_si > limits.sign_mismatch_effort_min_si
            else 0
        ),
        held_si=held_si,
        effort_before_still_si=(
            watch.effort_before_still_si if joint.still_cycles > 1 else joint.effort_si
        ),
        held_before_still_si=(
            watch.held_before_still_si if joint.still_cycles > HELD_CYCLES else held_si
        ),
    )


def _gap(watch: EffortWatch, measured_si: float, unpowered_cycles: int) -> float:
    if unpowered_cycles > SETTLE_CYCLES:
        return abs(measured_si)
    if len(watch.sent_si) < SENT_COUNT:
        return 0.0
    return max(min(watch.sent_si) - measured_si, measured_si - max(watch.sent_si), 0.0)


def _opposed(balance: Balance, axis: int) -> float:
    if not balance.known:
        return 0.0
    push_si = balance.effort[axis] - balance.load[axis]
    motion_si = balance.inertia[axis] + balance.friction[axis]
    return min(abs(push_si), abs(motion_si)) if push_si * motion_si < 0 else 0.0
