"""Rights of a client's role to a request, checked in the core (table: `daemon/wire/roles.py`)."""

import math

from gaitd_names import Mode, RefusalCode, RequestKind

from daemon.core.exercises.guards import GuardInputs
from daemon.ipc.record import Plan, Request
from daemon.ipc.report import Refusal
from daemon.wire.roles import ROLES


def refusal(request: Request, now: GuardInputs) -> Refusal | None:
    """The reason why the client's role may not make this request now; None if it may."""
    rules, role = ROLES[request.role], request.role
    if request.kind not in rules.kinds:
        return Refusal(RefusalCode.ROLE_MAY_NOT, values=(role, request.kind))
    by_mode = request.kind is RequestKind.MODE
    mode = request.mode.mode
    if by_mode and mode not in rules.modes:
        return Refusal(RefusalCode.ROLE_MAY_NOT_MODE, values=(role, mode))
    needs_hand = request.kind is RequestKind.RESET or (by_mode and mode is Mode.HAND_GUIDING)
    if rules.hand_switch and needs_hand and not now.hand_switch_known:
        return Refusal(RefusalCode.HAND_SWITCH_UNKNOWN)
    if rules.hand_switch and needs_hand and not now.hand_switch_closed:
        return Refusal(RefusalCode.HAND_SWITCH_OPEN)
    if rules.within_plan and by_mode and mode is Mode.GAIT:
        return _beyond(request, request.plan)
    return None


def _beyond(request: Request, plan: Plan | None) -> Refusal | None:
    if plan is None:
        return Refusal(RefusalCode.NO_PLAN)
    wanted = request.mode
    for code, value, limit in (
        (RefusalCode.CADENCE_ABOVE_PLAN, wanted.cadence_hz, plan.cadence_max_hz),
        (RefusalCode.AMPLITUDE_ABOVE_PLAN, wanted.amplitude_ratio, plan.amplitude_max_ratio),
        (RefusalCode.DURATION_ABOVE_PLAN, wanted.duration_s, plan.duration_max_s),
    ):
        # A comparison with NaN is false: only a value within the limit passes.
        if not value <= limit:
            return Refusal(code, values=(value, limit))
    return None


def assist_cap_si(request: Request) -> tuple[float, float]:
    """Return the plan's cap of assist in the requested mode, hip and slide: N·m, N.

    Infinite without a cap: the limits of the configuration hold in any case.
    """
    plan = request.plan
    if plan is None or request.mode.mode is not Mode.GAIT or not ROLES[request.role].within_plan:
        return math.inf, math.inf
    hip_nm, slide_n = plan.hip.assist_max, plan.slide.assist_max
    return (math.inf if hip_nm is None else hip_nm, math.inf if slide_n is None else slide_n)
