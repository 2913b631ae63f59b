"""What a controller may do to one leg: which setpoints count, and what of them is in force.

Rules:
1. A setpoint counts if it is of the lease that the newest level names, newer than the last one
   that counted, answers a cycle that is not long past, is finite and inside its limits, and if the
   mode takes it. What does not count is refused with a reason, once, and changes nothing.
2. Modes that take no assist take a neutral setpoint, which asks for nothing: so a controller can
   show that it lives before its mode begins.
3. Assist in force follows what is wanted inside limit, rate and power (`bounds.bound_assist`).
4. Without a setpoint that counts and is fresh, in a mode that takes it, assist fades to nothing
   within `stop.assist_fade_ms`, whatever it was, and stiffness is full again as soon. The leg is
   then braked from where it is (`plans.hold_from`): nothing pulls it back to a reference.
5. Assist lapses when what is in force has lost its lease or has grown stale; mode TORQUE lapses
   also when nothing has come to begin with. The age counts in our own cycles, from `for_cycle`.

Pairs are hip and slide: N·m and N.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

from daemon.core.safety import bounds
from daemon.core.safety.limits import AxisLimits
from daemon.ipc.record import Mode, Setpoint
from daemon.wire.refusals import SetpointRefusal

Pair = tuple[float, float]

ASSISTED = frozenset({Mode.TORQUE, Mode.GAIT})
"""Modes that take assist."""
FULL_STIFFNESS = 1.0


class AssistRules(NamedTuple):
    """From limits.toml, [assist] and [stop]."""

    age_max_cycles: int
    start_cycles: int
    """Mode TORQUE waits so long for its first setpoint."""
    fade_cycles: int
    stiffness_step_ratio: float
    """Per cycle."""


class Desk(NamedTuple):
    """What a setpoint is judged by in this cycle."""

    lease: int
    """That is held by the newest level; 0: none."""
    cycle: int
    mode: Mode
    by_position: bool
    """Guidance is by the drives' own position loops."""


@dataclass(frozen=True, slots=True)
class LegAssist:
    """What a controller has asked of one leg, and what of it is in force."""

    lease: int = 0
    """That `seq` and `accepted` belong to."""
    seq: int = -1
    """Of the newest setpoint that counted."""
    judged: tuple[int, int, int] | None = None
    """Lease, seq and for_cycle of the newest that was judged; it comes again with every level."""
    accepted: Setpoint | None = None
    """What is wanted, as long as it is fresh."""
    effort_si: Pair = (0.0, 0.0)
    """In force."""
    fade_si: Pair | None = None
    """By so much it falls in each cycle while it fades."""
    stiffness_ratio: float = FULL_STIFFNESS
    """In force."""


def judge(
    setpoint: Setpoint,
    last_seq: int,
    limits: tuple[AxisLimits, AxisLimits],
    desk: Desk,
    rules: AssistRules,
) -> SetpointRefusal:
    """Whether a setpoint counts; NONE if it does.

    Args:
        setpoint: as the gateway forwards it.
        last_seq: of the last one of this leg and lease that counted; -1: none has.
        limits: of hip and slide.
        desk: what is so in this cycle.
        rules: of limits.toml.
    """
    return _by_sender(setpoint, last_seq, desk, rules) or _by_content(setpoint, limits, desk)


def _by_sender(
    setpoint: Setpoint, last_seq: int, desk: Desk, rules: AssistRules
) -> SetpointRefusal:
    if desk.lease == 0:
        return SetpointRefusal.UNLEASED
    if setpoint.lease != desk.lease:
        return SetpointRefusal.WRONG_LEASE
    if setpoint.seq == last_seq:
        return SetpointRefusal.REPEATED
    if setpoint.seq < last_seq:
        return SetpointRefusal.REORDERED
    if setpoint.for_cycle > desk.cycle:
        return SetpointRefusal.AHEAD
    return SetpointRefusal.NONE if is_fresh(setpoint, desk.cycle, rules) else SetpointRefusal.STALE


def _by_content(
    setpoint: Setpoint, limits: tuple[AxisLimits, AxisLimits], desk: Desk
) -> SetpointRefusal:
    wanted = wanted_si(setpoint)
    if not all(map(math.isfinite, (*wanted, setpoint.stiffness_ratio))):
        return SetpointRefusal.NON_FINITE
    inside = all(abs(one) <= of.assist_max_si for one, of in zip(wanted, limits, strict=True))
    if not inside or not 0.0 <= setpoint.stiffness_ratio <= FULL_STIFFNESS:
        return SetpointRefusal.OUT_OF_RANGE
    if desk.by_position:
        return SetpointRefusal.GUIDANCE_IS_POSITION
    if desk.mode not in ASSISTED and not is_neutral(setpoint):
        return SetpointRefusal.WRONG_MODE
    return SetpointRefusal.NONE


def is_fresh(setpoint: Setpoint, cycle: int, rules: AssistRules) -> bool:
    """Whether the cycle that it answers is not too long ago."""
    return cycle - setpoint.for_cycle <= rules.age_max_cycles


def is_neutral(setpoint: Setpoint) -> bool:
    """Whether it asks for nothing: no assist, full stiffness."""
    return wanted_si(setpoint) == (0.0, 0.0) and setpoint.stiffness_ratio == FULL_STIFFNESS


def wanted_si(setpoint: Setpoint) -> Pair:
    """Its assist of hip and slide."""
    return setpoint.hip_assist_nm, setpoint.slide_assist_n


def is_in_force(assist: LegAssist) -> bool:
    """Whether a controller moves the leg or has it guided less; not what still fades after it."""
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
) -> LegAssist | None:
    """One cycle on.

    Args:
        assist: of the cycle before.
        wanted: the setpoint that counts, is fresh and taken by the mode; None: fade.
        limits: of hip and slide.
        velocity_si: of the joints, from raw encoders: rad/s, m/s.
        rules: of limits.toml.
        dt_s: nominal time between two commands.

    Returns:
        What is in force now; None if a number is not finite: then the machine stops.
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
        return None
    return replace(
        assist, effort_si=(hip_si, slide_si), fade_si=None, stiffness_ratio=stiffness_ratio
    )


def _faded(assist: LegAssist, rules: AssistRules) -> LegAssist:
    """Assist a cycle closer to nothing, where it is within the time of the fade."""
    hip_si, slide_si = assist.effort_si
    fade_si = assist.fade_si or (abs(hip_si) / rules.fade_cycles, abs(slide_si) / rules.fade_cycles)
    effort_si = (_shrunk(hip_si, fade_si[0]), _shrunk(slide_si, fade_si[1]))
    stiffness_ratio = _towards(assist.stiffness_ratio, FULL_STIFFNESS, 1 / rules.fade_cycles)
    return replace(assist, effort_si=effort_si, fade_si=fade_si, stiffness_ratio=stiffness_ratio)


def _shrunk(effort_si: float, step_si: float) -> float:
    # What rounding leaves after the last step is less than a step, and gone as well.
    left_si = abs(effort_si) - step_si
    return math.copysign(left_si, effort_si) if left_si > NEGLIGIBLE_RATIO * step_si else 0.0


NEGLIGIBLE_RATIO = 1e-6


def _towards(value: float, aim: float, step: float) -> float:
    return min(max(aim, value - step), value + step)
