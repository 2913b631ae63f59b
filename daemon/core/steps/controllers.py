"""Setpoints of controllers: checked, put in force, and lapsed.

`assist.py` has the rules for one leg; this file applies them to the state of the core, and reports
to `supervisor.py` when assist has lapsed. It is the only writer of assist in the state.
"""

import math
from dataclasses import replace

import msgspec
from gaitd_names import Lapse, Mode, SetpointRefusal

from daemon.core.modes import roles
from daemon.core.modes.table import rules_of
from daemon.core.motion import assist
from daemon.core.motion.assist import FULL_STIFFNESS, SetpointContext
from daemon.core.state import Core, Leg
from daemon.core.steps import wanted
from daemon.ipc.record import Request, Setpoint


def receive(core: Core, cycle: int) -> None:
    """Check the setpoints of the newest gateway state; each setpoint is checked once."""
    lease, takes_assist = core.inputs.lease, rules_of(core.mode).takes_assist
    context = SetpointContext(
        lease, cycle, takes_assist, core.config.by_position, core.assist_cap_si
    )
    # The assist of one lease holder must lapse before another holder may command.
    handed_over = {
        leg.name for leg in core.legs if leg.assist.lease != lease and assist.is_active(leg.assist)
    }
    for leg in core.legs:
        if leg.assist.lease != lease:
            leg.assist = replace(leg.assist, lease=lease, seq=-1, accepted=None)
        elif not takes_assist:
            leg.assist = replace(leg.assist, accepted=None)
    for setpoint in core.inputs.setpoints:
        if setpoint.leg not in handed_over:
            _receive_one(core, setpoint, context)


def _receive_one(core: Core, setpoint: Setpoint, context: SetpointContext) -> None:
    leg = next((leg for leg in core.legs if leg.name == setpoint.leg), None)
    if leg is None:
        core.setpoint_refused_count[SetpointRefusal.UNKNOWN_LEG] += 1
        return
    key = (setpoint.lease, setpoint.seq, setpoint.for_cycle)
    if key == leg.assist.checked:
        return
    hip, slide = leg.axes
    limits = (hip.limits, slide.limits)
    refusal = assist.check_setpoint(
        setpoint, leg.assist.seq, limits, context, core.config.assist_rules
    )
    leg.assist = replace(leg.assist, checked=key)
    if refusal is None:
        core.setpoint_accepted_count += 1
        leg.assist = replace(leg.assist, seq=setpoint.seq, accepted=setpoint)
    else:
        core.setpoint_refused_count[refusal] += 1


def begin(core: Core, request: Request) -> None:
    """Enter a mode with the cap of its plan; TORQUE without assist, until a first setpoint."""
    core.assist_cap_si = roles.assist_cap_si(request)
    if request.mode.mode != Mode.TORQUE:
        return
    core.torque_lease = core.inputs.lease
    for leg in core.legs:
        leg.assist = replace(leg.assist, accepted=None)


def lapse(core: Core, cycle: int) -> bool:
    """True if assist has lapsed in this cycle; its reason is in the record."""
    reason = Lapse.NONE
    if core.mode == Mode.TORQUE:
        reason = _lapse_of_torque(core, cycle)
    elif core.mode == Mode.GAIT:
        reason = _lapse_of_gait(core, cycle)
    if reason is Lapse.NONE:
        return False
    core.lapse_count += 1
    core.lapse_reason = reason
    return True


def _lapse_of_torque(core: Core, cycle: int) -> Lapse:
    rules = core.config.assist_rules
    if core.inputs.lease != core.torque_lease:
        return Lapse.LEASE_ENDED
    accepted = [leg.assist.accepted for leg in core.legs if leg.assist.accepted is not None]
    if not all(assist.is_fresh(one, cycle, rules) for one in accepted):
        return Lapse.STALE
    if not accepted and _waited_cycles(core) > rules.start_cycles:
        return Lapse.NO_SETPOINT
    return Lapse.NONE


def _lapse_of_gait(core: Core, cycle: int) -> Lapse:
    rules = core.config.assist_rules
    accepted = [leg.assist.accepted for leg in core.legs if assist.is_active(leg.assist)]
    if any(one is None for one in accepted):
        return Lapse.LEASE_ENDED
    fresh = all(one is not None and assist.is_fresh(one, cycle, rules) for one in accepted)
    return Lapse.NONE if fresh else Lapse.STALE


def _waited_cycles(core: Core) -> int:
    exercise = core.legs[0].exercise
    elapsed_s = 0.0 if exercise is None else exercise.elapsed_s
    return round(elapsed_s / core.config.period_s)


def advance(core: Core, cycle: int) -> None:
    """Advance the assist in force of each leg to the newest setpoint, or fade it out."""
    for leg in core.legs:
        _advance_leg(core, leg, cycle)


def _advance_leg(core: Core, leg: Leg, cycle: int) -> None:
    """Assist is zero at once where no drive is to be enabled."""
    if not wanted.enable_wanted_of(core, leg):
        leg.assist = replace(leg.assist, effort_si=(0.0, 0.0), fade_si=None)
    hip, slide = leg.axes
    advanced = assist.advance(
        leg.assist,
        _followed(core, leg, cycle),
        (hip.limits, slide.limits),
        (hip.sensed.joint.velocity_si, slide.sensed.joint.velocity_si),
        core.config.assist_rules,
        core.config.period_s,
    )
    if advanced is None:
        # NaN makes the command check stop the machine; no further assist is added.
        leg.assist_si = (math.nan, math.nan)
        leg.assist = replace(leg.assist, accepted=None, effort_si=(0.0, 0.0), fade_si=None)
        return
    leg.assist, leg.assist_si = advanced, advanced.effort_si
    leg.stiffness_ratio = advanced.stiffness_ratio


def _followed(core: Core, leg: Leg, cycle: int) -> Setpoint | None:
    """The setpoint to follow in this cycle; mode TORQUE ignores its stiffness (no guidance)."""
    newest = leg.assist.accepted
    if newest is None or not rules_of(core.mode).takes_assist:
        return None
    if not assist.is_fresh(newest, cycle, core.config.assist_rules):
        return None
    if core.mode == Mode.TORQUE and newest.stiffness_ratio != FULL_STIFFNESS:
        return msgspec.structs.replace(newest, stiffness_ratio=FULL_STIFFNESS)
    return newest
