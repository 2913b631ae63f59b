"""Stop sequence of one drive for a latched verdict, and its escalation.

Rules:
1. The verdict's category sets the first step: S2 keeps the drives enabled and the core brakes and
   holds; S1 is a quick stop of every drive, held there, or off after standstill where the axis
   has a brake; S0 is disable voltage.
2. Doubtful feedback of an axis is S0 for it and S1 for all others: no axis is held by an encoder
   that cannot be trusted. A lost drive gets NMT stop and a quick stop, the others S1.
3. Each cycle checks from statusword and encoder, never from the command, that the drive obeys. If
   a drive does not show the state in time, or its speed does not fall along the ramp, its stop
   escalates by one step: quick stop, disable voltage, NMT stop, silence of the master (no SYNC, no
   heartbeat), so that the drives' own detection acts.
4. A drive that is not enabled yet is not enabled in order to hold: it gets a quick stop, which
   takes it back to switch on disabled.
5. A step is never taken back; only a reset begins anew.
6. Result of the check for each statusword, after the cycles that a drive has to obey:

    shown                      hold            quick stop      disable voltage and further
    ------------------------   -------------   -------------   ---------------------------
    a state without torque     nothing to do   obeyed          obeyed
    operation enabled          its ramp        not obeyed      not obeyed
    quick stop active          its ramp        its ramp        not obeyed
    fault reaction active      obeyed for the longest fault reaction in the drive's profile
    unknown                    obeyed for the same cycles once more

   "Its ramp": obeyed as long as the speed falls along the ramp, and a joint at rest stays there.
   The ramp of a quick stop begins at the largest speed of the cycles that a drive has to obey:
   until it obeys, its last target accelerates the joint, in a gait of 0.5 Hz by 0.2 m/s a cycle.
   A joint gains no more than RAMP_GAIN_RATIO times what the ramp takes: one false sample excuses
   no drive for long. From then on the speed falls at least as fast as the ramp over the margin: a
   drive that lets its joint coast, or whose sign is wrong, is found within cycles. The ramp of a
   hold begins at the speed of its first cycle, after its grace.
7. Where a person has moved the joint against its drive, the sign of the drive has been judged by
   the joint's response. A drive whose sign is wrong would drive the joint on: the stop escalates in
   the third cycle unless the speed is below that at its begin.
"""

import math
from enum import IntEnum
from typing import Final, NamedTuple

from gaitd_names import StopCategory

from daemon.core.period import cycles
from daemon.core.safety import joints
from daemon.core.safety.joints import Joint
from daemon.core.safety.limits import AxisLimits
from daemon.ipc.record import Verdict
from daemon.wire.causes import DOUBTFUL_FEEDBACK, LOST_DRIVE
from drives.cia402.power_state import CANNOT_EXERT_TORQUE
from drives.signals import DriveFeedback, PowerRequest, PowerState


class Step(IntEnum):
    """Step of the stop of one drive, the mildest first."""

    HOLD = 0
    """S2: enabled, braked and held by the core."""
    QUICK_STOP = 1
    DISABLE = 2
    NMT_STOP = 3
    SILENCE = 4
    """SYNC and heartbeat are no longer sent: the drives' own detection stops them."""


class DriveStop(NamedTuple):
    """State of the stop of one drive."""

    step: Step
    since_cycle: int
    """When this step was first commanded."""
    ramp_speed_si: float
    """Speed at which the ramp begins: at that cycle; of a quick stop the largest until it had to
    be obeyed."""
    at_rest_cycles: int = 0
    has_rested: bool = False
    """The drive has come to rest in this step: it is held, and no longer on a ramp."""
    disobeyed: bool = False
    """The stop had to be escalated because the drive did not obey."""
    must_slow_below_si: float = math.inf
    """Speed at the begin of a stop that must slow the joint (rule 7)."""
    unproven_cycles: int = 0
    """Cycles in a row in which its state showed neither torque nor the absence of torque."""


class StopRules(NamedTuple):
    """Settings of [stop] in limits.toml."""

    obey_cycles: int
    standstill_cycles: int
    ramp_margin_ratio: float
    period_s: float
    reaction_cycles: int
    """Longest fault reaction of the drive, from its profile."""


HELD_SPEED_RATIO = 10.0
"""Speed, as a multiple of standstill, above which a drive at rest counts as not held."""
SLOWED_CYCLES = 3
"""Cycles after which a drive whose sign was judged must have slowed its joint (rule 7)."""
RAMP_GAIN_RATIO: Final = 2.0
"""Most that a joint gains in a cycle before its drive obeys, over what the ramp takes in one."""
RAMP_FLOOR_RATIO = 3.0
"""Lowest speed bound of the ramp, as a multiple of standstill: encoder noise is no motion.

While the core's own hold still settles, HELD_SPEED_RATIO applies: a joint that stood, at a reversal
of the gait, is pushed by the braking of the other one.
"""

SHOWN_LATE_CYCLES: Final = 1
"""A sample shows the mean speed of the cycle before it: half a cycle, and half for the ramp's."""
HOLD_GRACE_CYCLES: Final = cycles(0.3)
"""Extra time of the core's hold, which is softer than a drive's ramp: spring, damper, friction."""

_BY_CATEGORY = {
    StopCategory.NONE: Step.HOLD,
    StopCategory.S2: Step.HOLD,
    StopCategory.S1: Step.QUICK_STOP,
    StopCategory.S0: Step.DISABLE,
}

_UNPROVEN = frozenset({PowerState.UNKNOWN, PowerState.FAULT_REACTION_ACTIVE})


def first_step(verdict: Verdict, drive: str) -> Step:
    """First step of the stop of one drive, for a verdict that may be about another drive."""
    about_this = verdict.drive == drive
    if verdict.cause in DOUBTFUL_FEEDBACK and not about_this:
        return Step.QUICK_STOP
    if verdict.cause in LOST_DRIVE and about_this:
        return Step.NMT_STOP
    return _BY_CATEGORY[verdict.category]


def possible(step: Step, feedback: DriveFeedback | None) -> Step:
    """The step itself, or a quick stop in place of a hold where the drive is not enabled."""
    enabled = feedback is not None and feedback.power_state == PowerState.OPERATION_ENABLED
    return Step.QUICK_STOP if step == Step.HOLD and not enabled else step


def begin(
    step: Step, joint: Joint, cycle: int, *, disobeyed: bool = False, must_slow: bool = False
) -> DriveStop:
    """Begin the stop of one drive, or its next step."""
    speed_si = abs(joint.velocity_si)
    below_si = speed_si if must_slow else math.inf
    return DriveStop(step, cycle, speed_si, disobeyed=disobeyed, must_slow_below_si=below_si)


def harsher(stop: DriveStop, step: Step, joint: Joint, cycle: int) -> DriveStop:
    """Escalate the stop to `step` if that is harsher than the present step."""
    return _further(stop, step, joint, cycle) if step > stop.step else stop


def _further(stop: DriveStop, step: Step, joint: Joint, cycle: int) -> DriveStop:
    """Begin a harsher step; the count of unproven cycles goes on."""
    begun = begin(step, joint, cycle, disobeyed=stop.disobeyed)
    return begun._replace(unproven_cycles=stop.unproven_cycles)


def advance(
    stop: DriveStop,
    feedback: DriveFeedback,
    joint: Joint,
    limits: AxisLimits,
    rules: StopRules,
    cycle: int,
) -> DriveStop:
    """The stop after this cycle, escalated if the drive has not obeyed."""
    if joint.fresh:  # without a new sample standstill is not known
        at_rest = joints.is_at_rest(joint, limits)
        stop = stop._replace(at_rest_cycles=stop.at_rest_cycles + 1 if at_rest else 0)
        if stop.step == Step.QUICK_STOP and cycle - stop.since_cycle <= rules.obey_cycles:
            gain_si = RAMP_GAIN_RATIO * limits.quick_stop_deceleration_si_per_s2 * rules.period_s
            speed_si = min(abs(joint.velocity_si), stop.ramp_speed_si + gain_si)
            stop = stop._replace(ramp_speed_si=max(stop.ramp_speed_si, speed_si))
    unproven = feedback.power_state in _UNPROVEN
    stop = stop._replace(
        has_rested=stop.has_rested or is_resting(stop, rules),
        unproven_cycles=stop.unproven_cycles + 1 if unproven else 0,
    )
    if feedback.fresh and not _obeyed(stop, feedback, joint, limits, rules, cycle):
        step = Step(min(stop.step + 1, Step.SILENCE))
        return _further(stop._replace(disobeyed=True), step, joint, cycle)
    if stop.step == Step.QUICK_STOP and limits.brake and is_resting(stop, rules):
        return _further(stop, Step.DISABLE, joint, cycle)
    return stop


def is_resting(stop: DriveStop, rules: StopRules) -> bool:
    """True if the drive has stood still for long enough."""
    return stop.at_rest_cycles >= rules.standstill_cycles


def request(step: Step) -> PowerRequest:
    """The power request sent to the drive in this step."""
    if step == Step.HOLD:
        return PowerRequest.ENABLE
    return PowerRequest.QUICK_STOP if step == Step.QUICK_STOP else PowerRequest.DISABLE_VOLTAGE


def _obeyed(
    stop: DriveStop,
    feedback: DriveFeedback,
    joint: Joint,
    limits: AxisLimits,
    rules: StopRules,
    cycle: int,
) -> bool:
    elapsed_cycles, state = cycle - stop.since_cycle, feedback.power_state
    if state not in CANNOT_EXERT_TORQUE and _goes_on(stop, joint, limits, elapsed_cycles):
        return False
    if elapsed_cycles <= rules.obey_cycles or state in CANNOT_EXERT_TORQUE:
        # Without power the drive cannot follow a ramp: gravity, springs and patient move the leg.
        return True
    if state in _UNPROVEN:
        reacting = state == PowerState.FAULT_REACTION_ACTIVE
        timeout_cycles = rules.reaction_cycles if reacting else rules.obey_cycles
        return stop.unproven_cycles <= timeout_cycles
    if stop.step >= Step.DISABLE:
        return False
    if stop.step == Step.QUICK_STOP and state == PowerState.OPERATION_ENABLED:
        return False
    return abs(joint.velocity_si) <= _allowed_speed_si(stop, limits, rules, elapsed_cycles)


def _goes_on(stop: DriveStop, joint: Joint, limits: AxisLimits, elapsed_cycles: int) -> bool:
    """True if the joint moves as fast as at the begin of a stop that must slow it (rule 7)."""
    speed_si = abs(joint.velocity_si)
    judged = not stop.has_rested and elapsed_cycles >= SLOWED_CYCLES
    moves = speed_si > RAMP_FLOOR_RATIO * limits.standstill_si_per_s
    return judged and moves and speed_si >= stop.must_slow_below_si


def _allowed_speed_si(
    stop: DriveStop, limits: AxisLimits, rules: StopRules, elapsed_cycles: int
) -> float:
    floor_si = limits.standstill_si_per_s
    if stop.has_rested:
        return HELD_SPEED_RATIO * floor_si
    grace_cycles = HOLD_GRACE_CYCLES if stop.step == Step.HOLD else SHOWN_LATE_CYCLES
    ramp_cycles = elapsed_cycles - rules.obey_cycles - grace_cycles
    ramp_s = max(ramp_cycles, 0) * rules.period_s
    loss_si = limits.quick_stop_deceleration_si_per_s2 * ramp_s
    yields = stop.step == Step.HOLD and ramp_cycles <= 0
    floor_ratio = HELD_SPEED_RATIO if yields else RAMP_FLOOR_RATIO
    allowed_si = rules.ramp_margin_ratio * (stop.ramp_speed_si - loss_si)
    if stop.step == Step.QUICK_STOP:
        allowed_si = min(allowed_si, stop.ramp_speed_si - loss_si / rules.ramp_margin_ratio)
    return max(allowed_si, 0.0) + floor_ratio * floor_si
