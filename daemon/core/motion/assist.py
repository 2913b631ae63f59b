"""Assist of a controller for one leg: which setpoints are accepted, and the assist in force.

Rules:
1. A setpoint is accepted if it belongs to the lease of the newest gateway state, is newer than the
   last accepted one, refers to a recent cycle, is finite and inside its limits and the cap of the
   released plan, and if the mode takes assist. Any other setpoint is refused with a reason, once,
   and changes nothing.
2. Modes without assist accept a neutral setpoint, which has no effect: so a controller can show
   that it is alive before its mode begins.
3. Assist in force follows the setpoint within limit, rate and power (`bounds.bound_assist`).
4. Without an accepted and fresh setpoint, in a mode with assist, assist fades to zero within
   `stop.assist_fade_ms` from any value, and stiffness returns to full in the same time. The leg is
   then braked from where it is (`steps/exercises.py`): it is not pulled back to a reference.
5. Assist lapses when the setpoint in force has lost its lease or is stale; mode TORQUE lapses also
   when no first setpoint is received. The age is counted in cycles of the core, from `for_cycle`.

Pairs are hip and slide: N·m and N.
"""

import math
from typing import NamedTuple

from gaitd_names import SetpointRefusal
from msgspec.structs import replace

from daemon.core.motion.gait_shape import Pair
from daemon.core.safety import bounds
from daemon.core.safety.limits import AxisLimits
from daemon.core.slices import LegAssist
from daemon.ipc.record import Setpoint

FULL_STIFFNESS = 1.0


class AssistRules(NamedTuple):
    """Settings of [assist] and [stop] in limits.toml."""

    age_max_cycles: int
    start_cycles: int
    """Time for which mode TORQUE waits for its first setpoint."""
    fade_cycles: int
    stiffness_step_ratio: float
    """Largest change of the stiffness share per cycle."""


class SetpointContext(NamedTuple):
    """State of the core in this cycle against which a setpoint is checked."""

    lease: int
    """The lease held according to the newest gateway state; 0: none."""
    cycle: int
    takes_assist: bool
    by_position: bool
    """Guidance is by the drives' own position loops."""
    cap_si: Pair = (math.inf, math.inf)
    """Cap by the released plan of a session's gait: hip and slide."""


def check_setpoint(
    setpoint: Setpoint,
    last_seq: int,
    limits: tuple[AxisLimits, AxisLimits],
    context: SetpointContext,
    rules: AssistRules,
) -> SetpointRefusal | None:
    """Check a setpoint; NONE if it is accepted, else the reason to refuse it.

    Args:
        setpoint: as the gateway forwards it.
        last_seq: `seq` of the last accepted one of this leg and lease; -1: there is none.
        limits: limits of hip and slide.
        context: state of the core in this cycle.
        rules: settings of limits.toml.
    """
    refusal = _by_sender(setpoint, last_seq, context, rules)
    if refusal is not None:
        return refusal
    return _by_content(setpoint, limits, context)


def _by_sender(
    setpoint: Setpoint, last_seq: int, context: SetpointContext, rules: AssistRules
) -> SetpointRefusal | None:
    if context.lease == 0:
        return SetpointRefusal.UNLEASED
    if setpoint.lease != context.lease:
        return SetpointRefusal.WRONG_LEASE
    if setpoint.seq == last_seq:
        return SetpointRefusal.REPEATED
    if setpoint.seq < last_seq:
        return SetpointRefusal.REORDERED
    if setpoint.for_cycle > context.cycle:
        return SetpointRefusal.AHEAD
    return None if is_fresh(setpoint, context.cycle, rules) else SetpointRefusal.STALE


def _by_content(
    setpoint: Setpoint, limits: tuple[AxisLimits, AxisLimits], context: SetpointContext
) -> SetpointRefusal | None:
    wanted = wanted_si(setpoint)
    if not all(map(math.isfinite, (*wanted, setpoint.stiffness_ratio))):
        return SetpointRefusal.NON_FINITE
    # A comparison with NaN is false: a cap that is not a number refuses all.
    inside = all(
        abs(one) <= of.assist_max_si and abs(one) <= cap
        for one, of, cap in zip(wanted, limits, context.cap_si, strict=True)
    )
    if not inside or not 0.0 <= setpoint.stiffness_ratio <= FULL_STIFFNESS:
        return SetpointRefusal.OUT_OF_RANGE
    if context.by_position:
        return SetpointRefusal.GUIDANCE_IS_POSITION
    if not context.takes_assist and not is_neutral(setpoint):
        return SetpointRefusal.WRONG_MODE
    return None


def is_fresh(setpoint: Setpoint, cycle: int, rules: AssistRules) -> bool:
    """True if the setpoint refers to a recent enough cycle."""
    return cycle - setpoint.for_cycle <= rules.age_max_cycles


def is_neutral(setpoint: Setpoint) -> bool:
    """True if the setpoint has no effect: no assist, full stiffness."""
    return wanted_si(setpoint) == (0.0, 0.0) and setpoint.stiffness_ratio == FULL_STIFFNESS


def wanted_si(setpoint: Setpoint) -> Pair:
    """The assist of a setpoint for hip and slide: N·m, N."""
    return setpoint.hip.assist, setpoint.slide.assist


def is_active(assist: LegAssist) -> bool:
    """True if a controller adds assist or reduces stiffness; False while assist only fades."""
    asked = assist.accepted is not None and not is_neutral(assist.accepted)
    left = assist.effort_si != (0.0, 0.0) or assist.stiffness_ratio != FULL_STIFFNESS
    return asked or (left and assist.fade_si is None)


def advance(
    assist: LegAssist,
    wanted: Setpoint | None,
    limits: tuple[AxisLimits, AxisLimits],
    velocity_si: Pair,
    rules: AssistRules,
    dt_s: float,
) -> LegAssist:
    """Advance the assist in force by one cycle.

    Args:
        assist: assist of the previous cycle.
        wanted: the accepted and fresh setpoint in a mode with assist; None: fade.
        limits: limits of hip and slide.
        velocity_si: joint speeds from raw encoders: rad/s, m/s.
        rules: settings of limits.toml.
        dt_s: nominal time between two commands.

    Returns:
        The assist in force now. If a number is not finite, no further assist is added.
    """
    if wanted is None:
        return _faded(assist, rules)
    stiffness_ratio = _towards(
        assist.stiffness_ratio, wanted.stiffness_ratio, rules.stiffness_step_ratio
    )
    asked = zip(wanted_si(wanted), assist.effort_si, limits, velocity_si, strict=True)
    hip_si, slide_si = (
        bounds.bound_assist(aim_si, last_si, of, speed_si, dt_s)
        for aim_si, last_si, of, speed_si in asked
    )
    if hip_si is None or slide_si is None:
        return replace(assist, accepted=None, effort_si=(0.0, 0.0), fade_si=None, is_finite=False)
    return replace(
        assist,
        effort_si=(hip_si, slide_si),
        fade_si=None,
        stiffness_ratio=stiffness_ratio,
        is_finite=True,
    )


def _faded(assist: LegAssist, rules: AssistRules) -> LegAssist:
    """Assist after one cycle of the fade, which ends at zero within `fade_cycles`."""
    if (assist.effort_si, assist.fade_si, assist.stiffness_ratio) == FADED:
        return assist
    hip_si, slide_si = assist.effort_si
    fade_si = assist.fade_si or (abs(hip_si) / rules.fade_cycles, abs(slide_si) / rules.fade_cycles)
    effort_si = (_reduced(hip_si, fade_si[0]), _reduced(slide_si, fade_si[1]))
    stiffness_ratio = _towards(assist.stiffness_ratio, FULL_STIFFNESS, 1 / rules.fade_cycles)
    return replace(
        assist,
        effort_si=effort_si,
        fade_si=fade_si,
        stiffness_ratio=stiffness_ratio,
        is_finite=True,
    )


def _reduced(effort_si: float, step_si: float) -> float:
    # A remainder from rounding after the last step is set to zero.
    left_si = abs(effort_si) - step_si
    return math.copysign(left_si, effort_si) if left_si > NEGLIGIBLE_RATIO * step_si else 0.0


NEGLIGIBLE_RATIO = 1e-6
FADED = ((0.0, 0.0), (0.0, 0.0), FULL_STIFFNESS)
"""Effort, its decrease and stiffness once nothing is left to fade."""


def _towards(value: float, aim: float, step: float) -> float:
    return min(max(aim, value - step), value + step)
