"""Monitor of a drive's effort: does it match the command in size and direction?

Four checks, each from raw values only, for each axis in every cycle:

`gap`        In torque mode, compares the measured effort with the sent one. A target is sent in one
             cycle, acts from the next SYNC and is sampled at the one after, so it is compared with
             the last few commands. Detects a drive that does not give its torque.
`sign_mismatch`
             Beyond the load, the drive pushes one way while the joint accelerates, against its
             friction, the other way. Then motor or encoder are the wrong way round, or a patient is
             twice as strong as the limit: `sign_response.py` tells which.
`drift`      Compares the mean effort over a whole stride of gait with motion, load and friction.
             A current sensor that shows too much closes its drive's own loop on a wrong value: the
             gap is zero, the leg gets too little effort, and only this mean detects it. A patient
             who pushes steadily through a whole stride looks the same, and the two cannot be
             distinguished: the machine stops in both cases.

`unchanged`  Counts the cycles in which a joint moves and the effort stays exactly the same: it is
             not measured any more. While a drive's own loops move the joint there is no gap. In
             torque mode a target that stays the same gives an effort that may, too.

Without power a drive's effort is zero for any target: then `gap` is the reading of its sensor.
"""

from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from daemon.core.period import cycles
from daemon.core.safety import sign_response
from daemon.core.safety.inverse_dynamics import InverseDynamics
from daemon.core.safety.joints import Joint
from daemon.core.safety.limits import AxisLimits

SENT_COUNT = 3
"""Commands that a measured effort may belong to: two cycles of delay, and one late sample."""
HELD_RATIO = 0.3
"""Weight of the newest sample in a mean of the last few."""
HELD_CYCLES = 5
"""Time at standstill after which the braking effort no longer acts on a joint."""
SETTLE_CYCLES: Final = cycles(0.1)
"""Time for the current to decay after a drive has lost its power."""


class EffortWatch(Struct, frozen=True):
    """Recent efforts of one axis and their deviations; N·m or N."""

    sent_si: tuple[float, ...] = ()
    """Last efforts sent in torque mode without a break, the newest last."""
    unpowered_cycles: int = 0
    gap_si: float = 0.0
    gap_cycles: int = 0
    """Cycles in a row in which the gap exceeds its limit."""
    unchanged_cycles: int = 0
    """Cycles in a row in which the joint moved under power and the effort did not change."""
    effort_si: float = 0.0
    """Measured effort of the last sample."""
    sign_mismatch_si: float = 0.0
    """The smaller of push and motion effort, where their signs differ."""
    sign_mismatch_cycles: int = 0
    samples: sign_response.Samples = ()
    """Push and motion of the last cycles in a row."""
    patient_si: float = 0.0
    """Effort of the patient if the drive's sign is right."""
    response_ratio: float = sign_response.WRONG
    """Response of the joint in a mismatch that counts: small where it has the drive's sign."""
    held_si: float = 0.0
    """Effort held by friction and patient at standstill: a mean of a few samples."""
    held_before_still_si: float = 0.0
    """The same when the joint began to stand still."""
    effort_before_still_si: float = 0.0
    """Measured effort when the joint began to stand still."""


def record_sent(watch: EffortWatch, effort_si: float, *, active: bool) -> EffortWatch:
    """The watch after a command; `active`: the drive is enabled and shows torque mode."""
    if not active:
        return replace(watch, sent_si=())
    return replace(watch, sent_si=(*watch.sent_si, effort_si)[-SENT_COUNT:])


def update(
    watch: EffortWatch,
    joint: Joint,
    dynamics: InverseDynamics,
    axis: int,
    limits: AxisLimits,
    *,
    mismatch_cycles: int,
    may_give_torque: bool,
    free: bool,
    pose_known: bool,
) -> EffortWatch:
    """The watch after this cycle's sample; without a sample it is unchanged.

    Args:
        watch: watch of the previous cycle.
        joint: joint of this cycle.
        dynamics: inverse dynamics of its leg.
        axis: 0 hip, 1 slide.
        limits: limits of this axis.
        mismatch_cycles: duration from which a sign mismatch counts.
        may_give_torque: the drive has not shown a state without torque.
        free: the joint is inside its range; a rebound from an end stop behind it would look like
            a sign mismatch.
        pose_known: both axes of the leg are referenced; else the inverse dynamics are not valid.
    """
    if not joint.fresh:
        return watch
    unpowered_cycles = 0 if may_give_torque else watch.unpowered_cycles + 1
    ratio = HELD_RATIO if pose_known else 0.0
    held_si = watch.held_si + ratio * (dynamics.held(axis) - watch.held_si)
    gap_si = _gap(watch, joint.effort_si, unpowered_cycles)
    judged = may_give_torque and free and pose_known and dynamics.known
    push_si = dynamics.effort[axis] - dynamics.load[axis]
    motion_si = dynamics.inertia[axis] + dynamics.friction[axis]
    samples = sign_response.with_sample(watch.samples, push_si, motion_si) if judged else ()
    sign_mismatch_si = (
        min(abs(push_si), abs(motion_si)) if judged and push_si * motion_si < 0 else 0.0
    )
    mismatch_min_si = limits.sign_mismatch_effort_min_si
    sign_mismatch_cycles = (
        watch.sign_mismatch_cycles + 1 if sign_mismatch_si > mismatch_min_si else 0
    )
    return EffortWatch(
        sent_si=watch.sent_si,
        unpowered_cycles=unpowered_cycles,
        gap_si=gap_si,
        gap_cycles=watch.gap_cycles + 1 if gap_si > limits.effort_deviation_max_si else 0,
        unchanged_cycles=(
            watch.unchanged_cycles + 1
            if may_give_torque
            and joint.still_cycles == 0
            and joint.effort_si == watch.effort_si
            and not _is_steady(watch.sent_si)
            else 0
        ),
        effort_si=joint.effort_si,
        sign_mismatch_si=sign_mismatch_si,
        sign_mismatch_cycles=sign_mismatch_cycles,
        samples=samples,
        patient_si=motion_si - push_si if judged else 0.0,
        response_ratio=(
            sign_response.updated(watch.response_ratio, samples, mismatch_min_si)
            if sign_mismatch_cycles >= mismatch_cycles
            else sign_response.WRONG
        ),
        held_si=held_si,
        effort_before_still_si=(
            watch.effort_before_still_si if joint.still_cycles > 1 else joint.effort_si
        ),
        held_before_still_si=(
            watch.held_before_still_si if joint.still_cycles > HELD_CYCLES else held_si
        ),
    )


def _is_steady(sent_si: tuple[float, ...]) -> bool:
    """True if the target torque has not changed; without torque mode there is none."""
    return len(sent_si) > 0 and min(sent_si) == max(sent_si)


def _gap(watch: EffortWatch, measured_si: float, unpowered_cycles: int) -> float:
    if unpowered_cycles > SETTLE_CYCLES:
        return abs(measured_si)
    if len(watch.sent_si) < SENT_COUNT:
        return 0.0
    return max(min(watch.sent_si) - measured_si, measured_si - max(watch.sent_si), 0.0)
