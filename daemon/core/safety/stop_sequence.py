"""How a latched verdict becomes what each drive is told, and what happens if it does not obey.

Rules:
1. The verdict's category says how: S2 keeps the drives enabled and the core brakes and
   holds; S1 is a quick stop of every drive, held there, or off after standstill where the axis
   has a brake; S0 is disable voltage.
2. Doubtful feedback of an axis is S0 for it and S1 for all others: no axis is asked to hold by an
   encoder that cannot be trusted. A lost drive gets NMT stop and a quick stop, the others S1.
3. Obedience is judged each cycle from statusword and encoder, never from what was sent. A drive
   that does not show the state in time, or whose speed does not fall along the ramp, is taken one
   step further: quick stop, disable voltage, NMT stop, silence of the master (no SYNC, no
   heartbeat), so that the drives' own detection acts.
4. A drive that is not enabled yet is not enabled in order to hold: it gets a quick stop, which
   takes it back to switch on disabled.
5. Nothing here ever goes back a step; only a reset begins anew.
6. What a statusword proves, after the cycles that a drive has to obey:

    shown                      hold            quick stop      disable voltage and further
    ------------------------   -------------   -------------   ---------------------------
    a state without torque     nothing to do   obeyed          obeyed
    operation enabled          its ramp        not obeyed      not obeyed
    quick stop active          its ramp        its ramp        not obeyed
    fault reaction active      obeyed for as long as the drive's profile says that one may last
    unknown                    obeyed for the same cycles once more

   "Its ramp": as long as its speed falls as that asks, and what has come to rest is held.
"""

from enum import IntEnum
from typing import NamedTuple

from daemon.core.safety.limits import AxisLimits
from daemon.core.steps.joints import Joint
from daemon.ipc.record import StopCategory, Verdict
from daemon.wire.causes import DOUBTFUL_FEEDBACK, LOST_DRIVE
from drives.cia402.power_state import TORQUE_FREE
from drives.signals import DriveFeedback, PowerRequest, PowerState


class Step(IntEnum):
    """How far one drive has been taken, milder first."""

    HOLD = 0
    """S2: enabled, braked and held by the core."""
    QUICK_STOP = 1
    DISABLE = 2
    NMT_STOP = 3
    SILENCE = 4
    """No SYNC and no heartbeat any more: the drives' own detection stops them."""


class DriveStop(NamedTuple):
    """One drive on its way to rest."""

    step: Step
    since_cycle: int
    """When this step was first commanded."""
    start_speed_si: float
    """Speed at that moment: the ramp begins here."""
    at_rest_cycles: int = 0
    has_rested: bool = False
    """It has come to rest in this step: from now on it is held, and no longer on a ramp."""
    disobeyed: bool = False
    """It had to be taken further than its verdict asked."""
    unproven_cycles: int = 0
    """Cycles in a row in which its state proved neither torque nor that there is none."""


class StopRules(NamedTuple):
    """From limits.toml, [stop]."""

    obey_cycles: int
    standstill_cycles: int
    ramp_margin_ratio: float
    period_s: float
    reaction_cycles: int
    """From the drive's profile: so long a fault reaction may last."""


HELD_SPEED_RATIO = 10.0
"""A drive at rest counts as loose when pushed this many times faster than standstill."""
RAMP_FLOOR_RATIO = 3.0
"""Around zero the ramp's bound is this many times standstill: encoder noise is no motion. While the
core's own hold still settles it is that of a joint at rest: one that stood, at a reversal of the
gait, is pushed by the other one's braking."""

HOLD_GRACE_CYCLES = 30
"""The core's hold is softer than a drive's ramp: a spring, a damper, and friction in the way."""

_BY_CATEGORY = {
    StopCategory.NONE: Step.HOLD,
    StopCategory.S2: Step.HOLD,
    StopCategory.S1: Step.QUICK_STOP,
    StopCategory.S0: Step.DISABLE,
}

_UNPROVEN = frozenset({PowerState.UNKNOWN, PowerState.FAULT_REACTION_ACTIVE})


def first_step(verdict: Verdict, drive: str) -> Step:
    """Where the stop of one drive begins, for a verdict that may be about another one."""
    about_this = verdict.drive == drive
    if verdict.cause in DOUBTFUL_FEEDBACK and not about_this:
        return Step.QUICK_STOP
    if verdict.cause in LOST_DRIVE and about_this:
        return Step.NMT_STOP
    return _BY_CATEGORY[verdict.category]


def possible(step: Step, feedback: DriveFeedback | None) -> Step:
    """The step, or a quick stop in place of a hold where the drive has no power to hold with."""
    enabled = feedback is not None and feedback.power_state == PowerState.OPERATION_ENABLED
    return Step.QUICK_STOP if step == Step.HOLD and not enabled else step


def begin(step: Step, joint: Joint, cycle: int, *, disobeyed: bool = False) -> DriveStop:
    """The stop of one drive as it starts, or restarts one step further."""
    return DriveStop(step, cycle, abs(joint.velocity_si), disobeyed=disobeyed)


def harsher(stop: DriveStop, step: Step, joint: Joint, cycle: int) -> DriveStop:
    """The stop taken to `step` if that is further than it is."""
    return _further(stop, step, joint, cycle) if step > stop.step else stop


def _further(stop: DriveStop, step: Step, joint: Joint, cycle: int) -> DriveStop:
    """The next step begins; how long its drive has been proving nothing is not forgotten."""
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
    """The stop after this cycle: further if it was not obeyed, at rest if it was."""
    if joint.fresh:  # of a joint that is not seen nobody knows whether it rests
        at_rest = abs(joint.velocity_si) < limits.standstill_si_per_s
        stop = stop._replace(at_rest_cycles=stop.at_rest_cycles + 1 if at_rest else 0)
    unproven = feedback.power_state in _UNPROVEN
    stop = stop._replace(
        has_rested=stop.has_rested or is_at_rest(stop, rules),
        unproven_cycles=stop.unproven_cycles + 1 if unproven else 0,
    )
    if feedback.fresh and not _obeyed(stop, feedback, joint, limits, rules, cycle):
        step = Step(min(stop.step + 1, Step.SILENCE))
        return _further(stop._replace(disobeyed=True), step, joint, cycle)
    if stop.step == Step.QUICK_STOP and limits.brake and is_at_rest(stop, rules):
        return _further(stop, Step.DISABLE, joint, cycle)
    return stop


def is_at_rest(stop: DriveStop, rules: StopRules) -> bool:
    """Standing still for long enough to be called at rest."""
    return stop.at_rest_cycles >= rules.standstill_cycles


def request(step: Step) -> PowerRequest:
    """What the drive is told in this step."""
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
    if elapsed_cycles <= rules.obey_cycles or state in TORQUE_FREE:
        # Without power there is no ramp to follow: gravity, springs and the patient move the leg.
        return True
    if state in _UNPROVEN:
        reacting = state == PowerState.FAULT_REACTION_ACTIVE
        patience_cycles = rules.reaction_cycles if reacting else rules.obey_cycles
        return stop.unproven_cycles <= patience_cycles
    if stop.step >= Step.DISABLE:
        return False
    if stop.step == Step.QUICK_STOP and state == PowerState.OPERATION_ENABLED:
        return False
    return abs(joint.velocity_si) <= _allowed_speed_si(stop, limits, rules, elapsed_cycles)


def _allowed_speed_si(
    stop: DriveStop, limits: AxisLimits, rules: StopRules, elapsed_cycles: int
) -> float:
    floor_si = limits.standstill_si_per_s
    if stop.has_rested:
        return HELD_SPEED_RATIO * floor_si
    grace_cycles = HOLD_GRACE_CYCLES if stop.step == Step.HOLD else 0
    ramp_cycles = elapsed_cycles - rules.obey_cycles - grace_cycles
    ramp_s = max(ramp_cycles, 0) * rules.period_s
    on_ramp_si = stop.start_speed_si - limits.quick_stop_deceleration_si_per_s2 * ramp_s
    yields = stop.step == Step.HOLD and ramp_cycles <= 0
    floor_ratio = HELD_SPEED_RATIO if yields else RAMP_FLOOR_RATIO
    return rules.ramp_margin_ratio * max(on_ramp_si, 0.0) + floor_ratio * floor_si
