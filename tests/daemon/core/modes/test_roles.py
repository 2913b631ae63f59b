"""Which role may request what, in the core: the matrix is written here by hand."""

import math
from dataclasses import replace

import pytest
from gaitd_names import Mode, RefusalCode, RequestKind, Role
from safety_inputs import ALL_WELL

from daemon.core.modes.roles import assist_cap_si, refusal
from daemon.ipc.record import AxisPlan, ModeRequest, Plan, Request
from daemon.ipc.report import Refusal

REQUESTABLE = (
    *(Mode.HOLD, Mode.GAIT, Mode.TORQUE, Mode.EXCITE, Mode.HAND_GUIDING, Mode.SELF_TEST),
    *(Mode.REFERENCE, Mode.COMMISSION),
)
SESSION_MODES = {Mode.HOLD, Mode.GAIT, Mode.HAND_GUIDING, Mode.SELF_TEST}
EVERY_KIND = {RequestKind.ENABLE, RequestKind.DISABLE, RequestKind.RESET}
KINDS = {
    Role.UNRESTRICTED: EVERY_KIND,
    Role.DISPLAY: set(),
    Role.CONTROLLER: set(),
    Role.SESSION: EVERY_KIND,
    Role.OPERATOR: EVERY_KIND,
    Role.SERVICE: {RequestKind.DISABLE, RequestKind.RESET},
}
MODES = {
    Role.UNRESTRICTED: set(REQUESTABLE),
    Role.DISPLAY: set(),
    Role.CONTROLLER: set(),
    Role.SESSION: SESSION_MODES,
    Role.OPERATOR: set(REQUESTABLE),
    Role.SERVICE: {Mode.REFERENCE, Mode.COMMISSION},
}
UNCAPPED = (math.inf, math.inf)
PLAN = Plan(cadence_max_hz=0.3, amplitude_max_ratio=0.5, duration_max_s=60.0)
GAIT = ModeRequest(Mode.GAIT, cadence_hz=0.3, amplitude_ratio=0.5, duration_s=60.0)
HAND_OPEN = replace(ALL_WELL, hand_switch_closed=False)
HAND_UNKNOWN = replace(ALL_WELL, hand_switch_known=False)


def gait(role, plan=PLAN, **changes):
    wanted = replace_fields(GAIT, **changes)
    return Request(1, RequestKind.MODE, mode=wanted, role=role, plan=plan)


def replace_fields(struct, **changes):
    return type(struct)(**{**{f: getattr(struct, f) for f in struct.__struct_fields__}, **changes})


@pytest.mark.parametrize("role", Role)
@pytest.mark.parametrize("kind", sorted(EVERY_KIND))
def test_a_role_may_request_what_its_row_names_and_nothing_else(role, kind):
    refused = refusal(Request(1, kind, role=role), ALL_WELL)

    may_not = Refusal(RefusalCode.ROLE_MAY_NOT, values=(role, kind))
    assert refused == (None if kind in KINDS[role] else may_not)


@pytest.mark.parametrize("role", Role)
@pytest.mark.parametrize("mode", REQUESTABLE)
def test_a_role_may_request_the_modes_of_its_row_and_no_other(role, mode):
    request = Request(1, RequestKind.MODE, mode=ModeRequest(mode), role=role, plan=PLAN)

    may_not = Refusal(RefusalCode.ROLE_MAY_NOT_MODE, values=(role, mode))
    if not MODES[role]:
        may_not = Refusal(RefusalCode.ROLE_MAY_NOT, values=(role, RequestKind.MODE))
    assert refusal(request, ALL_WELL) == (None if mode in MODES[role] else may_not)


def requests_of(role, plan=PLAN):
    """Every request that the role may make when nothing is wrong, by what it asks for."""
    kinds = {kind: Request(1, kind, role=role, plan=plan) for kind in KINDS[role]}
    modes = {
        mode: Request(1, RequestKind.MODE, mode=ModeRequest(mode), role=role, plan=plan)
        for mode in MODES[role]
    }
    return kinds | {mode.name: request for mode, request in modes.items()}


@pytest.mark.parametrize("hand", [HAND_OPEN, HAND_UNKNOWN])
@pytest.mark.parametrize("role", Role)
def test_a_session_alone_needs_the_hand_switch_and_only_for_the_way_out(role, hand):
    refused = {what for what, request in requests_of(role).items() if refusal(request, hand)}

    assert refused == ({RequestKind.RESET, "HAND_GUIDING"} if role is Role.SESSION else set())


@pytest.mark.parametrize("role", Role)
def test_a_session_alone_needs_a_plan_and_only_for_a_gait(role):
    requests = requests_of(role, plan=None)
    refused = {what for what, request in requests.items() if refusal(request, ALL_WELL)}

    assert refused == ({"GAIT"} if role is Role.SESSION else set())


ABOVE = {
    "cadence_hz": RefusalCode.CADENCE_ABOVE_PLAN,
    "amplitude_ratio": RefusalCode.AMPLITUDE_ABOVE_PLAN,
    "duration_s": RefusalCode.DURATION_ABOVE_PLAN,
}


@pytest.mark.parametrize("field", ABOVE)
@pytest.mark.parametrize("factor", [1.001, float("nan"), float("inf")])
def test_a_session_stays_within_the_released_plan(field, factor):
    limit = getattr(GAIT, field)
    beyond = {field: limit * factor}

    refused = refusal(gait(Role.SESSION, **beyond), ALL_WELL)

    assert refusal(gait(Role.SESSION), ALL_WELL) is None
    assert refused.code is ABOVE[field]
    assert refused.values == pytest.approx((limit * factor, limit), nan_ok=True)
    assert refusal(gait(Role.OPERATOR, **beyond), ALL_WELL) is None


def test_a_session_is_told_what_it_lacks():
    reset = requests_of(Role.SESSION)[RequestKind.RESET]

    assert refusal(gait(Role.SESSION, plan=None), ALL_WELL) == Refusal(RefusalCode.NO_PLAN)
    assert refusal(reset, HAND_OPEN) == Refusal(RefusalCode.HAND_SWITCH_OPEN)
    assert refusal(reset, HAND_UNKNOWN) == Refusal(RefusalCode.HAND_SWITCH_UNKNOWN)


@pytest.mark.parametrize("role", Role)
def test_the_plan_caps_assist_in_a_gait_of_a_session_alone(role):
    capped = replace_fields(PLAN, hip=AxisPlan(0.0), slide=AxisPlan(80.0))
    is_session = role is Role.SESSION

    assert assist_cap_si(gait(role, capped)) == ((0.0, 80.0) if is_session else UNCAPPED)
    for mode in set(REQUESTABLE) - {Mode.GAIT}:
        assert assist_cap_si(gait(role, capped, mode=mode)) == UNCAPPED
    assert assist_cap_si(gait(role, PLAN)) == UNCAPPED
    assert assist_cap_si(gait(role, None)) == UNCAPPED
