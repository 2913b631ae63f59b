"""Setpoints of controllers: checked, put in force, and lapsed.

`assist.py` has the rules for one leg; this file applies them to all legs, and says when assist has
lapsed. It makes `LegAssist` and `Assisted`.
"""

from collections.abc import Sequence

from gaitd_names import Lapse, Mode, SetpointRefusal
from msgspec.structs import replace

from daemon.core.core_config import CoreConfig
from daemon.core.modes import roles
from daemon.core.modes.table import rules_of
from daemon.core.motion import assist
from daemon.core.motion.assist import FULL_STIFFNESS, AssistRules, SetpointContext
from daemon.core.slices import Assisted, Inputs, LegAssist
from daemon.core.state import Leg
from daemon.ipc.record import Request, Setpoint


def receive(
    legs: Sequence[Leg],
    before: Assisted,
    inputs: Inputs,
    mode: Mode,
    config: CoreConfig,
    cycle: int,
) -> tuple[list[LegAssist], Assisted]:
    """Check the setpoints of the newest gateway state; each setpoint is checked once.

    Args:
        legs: their assist and limits are read.
        before: of the last cycle.
        inputs: of this cycle: setpoints and lease.
        mode: of the machine.
        config: of the core.
        cycle: the number of this cycle.

    Returns:
        The assist of each leg, and what has become of the setpoints.
    """
    lease, takes_assist = inputs.lease, rules_of(mode).takes_assist
    context = SetpointContext(lease, cycle, takes_assist, config.by_position, before.cap_si)
    assists = [_of_lease(leg.assist, lease, takes_assist=takes_assist) for leg in legs]
    if not inputs.setpoints:
        return assists, before
    # The assist of one lease holder must lapse before another holder may command.
    handed_over = {
        leg.name for leg in legs if leg.assist.lease != lease and assist.is_active(leg.assist)
    }
    places = {leg.name: index for index, leg in enumerate(legs)}
    after = before
    for setpoint in inputs.setpoints:
        if setpoint.leg in handed_over:
            continue
        place = places.get(setpoint.leg)
        if place is None:
            after = _counted(after, SetpointRefusal.UNKNOWN_LEG)
            continue
        key = (setpoint.lease, setpoint.seq, setpoint.for_cycle)
        if key == assists[place].checked:
            continue
        hip, slide = legs[place].axes
        refusal = assist.check_setpoint(
            setpoint, assists[place].seq, (hip.limits, slide.limits), context, config.assist_rules
        )
        assists[place] = replace(assists[place], checked=key)
        if refusal is None:
            assists[place] = replace(assists[place], seq=setpoint.seq, accepted=setpoint)
        after = _counted(after, refusal)
    return assists, after


def _of_lease(now: LegAssist, lease: int, *, takes_assist: bool) -> LegAssist:
    """The assist of a leg under this lease, before the setpoints of this cycle."""
    if now.lease != lease:
        return replace(now, lease=lease, seq=-1, accepted=None)
    return now if takes_assist or now.accepted is None else replace(now, accepted=None)


def _counted(assisted: Assisted, refusal: SetpointRefusal | None) -> Assisted:
    if refusal is None:
        return replace(assisted, accepted_count=assisted.accepted_count + 1)
    counts = assisted.refused_count
    return replace(assisted, refused_count={**counts, refusal: counts.get(refusal, 0) + 1})


def begun(
    legs: Sequence[Leg], before: Assisted, request: Request, lease: int
) -> tuple[list[LegAssist], Assisted]:
    """Enter a mode with the cap of its plan; TORQUE without assist, until a first setpoint.

    Args:
        legs: their assist is read.
        before: what controllers may do so far.
        request: the accepted request for the mode.
        lease: the lease that is held now.

    Returns:
        The assist of each leg, and what controllers may do from now on.
    """
    assists = [leg.assist for leg in legs]
    after = replace(before, cap_si=roles.assist_cap_si(request))
    if request.mode.mode != Mode.TORQUE:
        return assists, after
    return [replace(one, accepted=None) for one in assists], replace(after, torque_lease=lease)


def lapse(
    legs: Sequence[Leg], before: Assisted, lease: int, mode: Mode, config: CoreConfig, cycle: int
) -> Assisted | None:
    """What has become of the setpoints where assist has lapsed in this cycle; else None.

    Args:
        legs: assist and exercise are read.
        before: of the last cycle.
        lease: the lease that is held now.
        mode: of the machine.
        config: of the core.
        cycle: the number of this cycle.
    """
    reason = Lapse.NONE
    if mode == Mode.TORQUE:
        reason = _lapse_of_torque(legs, config, cycle, same_lease=lease == before.torque_lease)
    elif mode == Mode.GAIT:
        reason = _lapse_of_gait(legs, config.assist_rules, cycle)
    if reason is Lapse.NONE:
        return None
    return replace(before, lapse_count=before.lapse_count + 1, lapse_reason=reason)


def _lapse_of_torque(
    legs: Sequence[Leg], config: CoreConfig, cycle: int, *, same_lease: bool
) -> Lapse:
    rules = config.assist_rules
    if not same_lease:
        return Lapse.LEASE_ENDED
    accepted = [leg.assist.accepted for leg in legs if leg.assist.accepted is not None]
    if not all(assist.is_fresh(one, cycle, rules) for one in accepted):
        return Lapse.STALE
    if not accepted and _waited_cycles(legs[0], config.period_s) > rules.start_cycles:
        return Lapse.NO_SETPOINT
    return Lapse.NONE


def _lapse_of_gait(legs: Sequence[Leg], rules: AssistRules, cycle: int) -> Lapse:
    accepted = [leg.assist.accepted for leg in legs if assist.is_active(leg.assist)]
    if any(one is None for one in accepted):
        return Lapse.LEASE_ENDED
    fresh = all(one is not None and assist.is_fresh(one, cycle, rules) for one in accepted)
    return Lapse.NONE if fresh else Lapse.STALE


def _waited_cycles(leg: Leg, period_s: float) -> int:
    elapsed_s = 0.0 if leg.exercise is None else leg.exercise.elapsed_s
    return round(elapsed_s / period_s)


def advance(leg: Leg, mode: Mode, config: CoreConfig, cycle: int, *, enabled: bool) -> LegAssist:
    """Advance the assist in force of a leg to the newest setpoint, or fade it out.

    Args:
        leg: its assist, limits and speeds are read.
        mode: of the machine.
        config: of the core.
        cycle: the number of this cycle.
        enabled: one of its drives should have power; without it assist is zero at once.
    """
    before = leg.assist
    if not enabled:
        before = replace(before, effort_si=(0.0, 0.0), fade_si=None)
    hip, slide = leg.axes
    return assist.advance(
        before,
        _followed(before.accepted, mode, config, cycle),
        (hip.limits, slide.limits),
        (hip.sensed.joint.velocity_si, slide.sensed.joint.velocity_si),
        config.assist_rules,
        config.period_s,
    )


def _followed(
    newest: Setpoint | None, mode: Mode, config: CoreConfig, cycle: int
) -> Setpoint | None:
    """The setpoint to follow in this cycle; mode TORQUE ignores its stiffness (no guidance)."""
    if newest is None or not rules_of(mode).takes_assist:
        return None
    if not assist.is_fresh(newest, cycle, config.assist_rules):
        return None
    if mode == Mode.TORQUE and newest.stiffness_ratio != FULL_STIFFNESS:
        return replace(newest, stiffness_ratio=FULL_STIFFNESS)
    return newest
