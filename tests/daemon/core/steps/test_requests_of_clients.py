"""A request of a client: received once at a time, and answered by what the machine has become."""

from dataclasses import fields
from types import SimpleNamespace

import pytest
from gaitd_names import (
    Cause,
    Doubt,
    EventCode,
    Failure,
    Mode,
    Outcome,
    RefusalCode,
    RequestKind,
    Role,
    SelfTestDue,
    Untested,
)
from gaitd_names import StopCategory as Category
from msgspec.structs import replace
from safety_inputs import FEEDBACK, LIMITS, THRESHOLDS
from step_inputs import AT_REST, a_core, a_leg, an_axis, now_shows

from daemon.core.exercises.guards import GuardInputs
from daemon.core.slices import Inputs, Placed
from daemon.core.steps import requests
from daemon.ipc.record import ModeRequest, Request, RequestResult, Verdict
from daemon.ipc.report import Event, Refusal
from drives.signals import Input, PowerState

CYCLE = 140
STALE_CYCLES = 100
WANTED = ModeRequest(Mode.COMMISSION, axis="right/hip")
CLOSED, RELEASED = Input.HAND_SWITCH_CLOSED, Input.STO_RELEASED
UNTESTED = (("right/hip", Untested.HAND_SWITCH_OPEN),)
OFF = FEEDBACK._replace(power_state=PowerState.SWITCH_ON_DISABLED)


def asked(number, kind, wanted=WANTED, *, cycle=CYCLE, role=Role.UNRESTRICTED):
    return Request(number, kind, cycle, wanted, role)


@pytest.fixture
def core():
    """A core in READY that rests at a known pose; its gateway has answered 30 cycles ago."""
    paper, friction = (
        SimpleNamespace(duration_max_s=duration_s, artificial=duration_s == 30.0)
        for duration_s in (30.0, 60.0)
    )
    config = SimpleNamespace(
        thresholds=THRESHOLDS,
        gait=SimpleNamespace(cadence_max_hz=0.5, guidance="impedance"),
        excite={"paper": paper, "friction": friction},
        patient_configured=False,
        signs_must_be_proven=False,
    )
    axes = [an_axis(name, feedback=OFF) for name in ("right/hip", "right/slide")]
    return a_core(
        a_leg(*axes),
        mode=Mode.READY,
        config=config,
        inputs=Inputs(gateway_state_cycle=110, lease=1),
        request=None,
        result=RequestResult(),
        drives="brought up",
        load_checked=False,
        verdict=Verdict(),
        evidence={"right/hip": "shown"},
        inputs_untested=UNTESTED,
        self_test_due=SelfTestDue.NOT_PASSED_TODAY,
    )


def receives(core, **changes):
    core.inputs = replace(core.inputs, **changes)


# --- received -------------------------------------------------------------------------------------


def test_while_one_request_is_under_way_another_is_refused(core):
    core.request = asked(1, RequestKind.ENABLE)

    receives(core, request=asked(2, RequestKind.DISABLE))
    assert requests.receive(core, CYCLE) is None
    busy = Refusal(RefusalCode.BUSY, values=(RequestKind.ENABLE,))
    assert core.result == RequestResult(2, Outcome.REFUSED, busy)
    assert core.request.id == 1
    receives(core, request=None)
    assert requests.receive(core, CYCLE) is None
    assert core.result.id == 2


OF_EXERCISE, OF_AXIS = Refusal(RefusalCode.OUTSIDE_RANGE), Refusal(RefusalCode.NOT_TESTED)
STOP = Refusal(RefusalCode.STOP_REQUESTED)


@pytest.mark.parametrize(
    ("kind", "wanted", "changes", "refused"),
    [
        (RequestKind.RESET, WANTED, {}, None),
        (RequestKind.RESET, WANTED, {"stop": True}, None),
        (RequestKind.RESET, WANTED, {"role": Role.DISPLAY}, RefusalCode.ROLE_MAY_NOT),
        (RequestKind.ENABLE, WANTED, {"stop": True}, STOP),
        (RequestKind.MODE, WANTED, {"stop": True}, STOP),
        (RequestKind.MODE, ModeRequest(Mode.GAIT), {"stop": True}, RefusalCode.NOT_IN_THIS_MODE),
        (RequestKind.DISABLE, WANTED, {"stop": True}, RefusalCode.NOT_IN_THIS_MODE),
        (RequestKind.DISABLE, WANTED, {"stop": True, "mode": Mode.HOLD}, None),
        (RequestKind.MODE, WANTED, {}, OF_AXIS),
        (RequestKind.MODE, WANTED, {"exercise": OF_EXERCISE}, OF_EXERCISE),
        (RequestKind.MODE, WANTED, {"mode": Mode.HOLD}, RefusalCode.NOT_IN_THIS_MODE),
        (
            *(RequestKind.MODE, ModeRequest(Mode.HOLD)),
            *({"mode": Mode.GAIT, "exercise": OF_EXERCISE}, OF_EXERCISE),
        ),
        (RequestKind.MODE, ModeRequest(Mode.HOLD), {"mode": Mode.GAIT}, None),
        (RequestKind.RESET, ModeRequest(Mode.HOLD), {"exercise": OF_EXERCISE}, None),
        (RequestKind.DISABLE, WANTED, {"mode": Mode.GAIT, "exercise": OF_EXERCISE}, None),
        (RequestKind.RESET, WANTED, {"age": STALE_CYCLES}, None),
        (
            *(RequestKind.RESET, WANTED, {"age": STALE_CYCLES + 1}),
            Refusal(RefusalCode.OLD, values=(CYCLE - STALE_CYCLES - 1, CYCLE)),
        ),
        (
            *(RequestKind.RESET, WANTED, {"age": -1}),
            Refusal(RefusalCode.OLD, values=(CYCLE + 1, CYCLE)),
        ),
    ],
)
def test_a_request_is_refused_by_stop_age_mode_role_and_room(
    core, monkeypatch, kind, wanted, changes, refused
):
    monkeypatch.setattr(requests.exercises, "refusal", lambda core, mode: changes.get("exercise"))
    monkeypatch.setattr(requests.single_axis, "refusal", lambda core, mode, cycle: OF_AXIS)
    role, core.mode = changes.get("role", Role.UNRESTRICTED), changes.get("mode", Mode.READY)
    request = asked(3, kind, wanted, cycle=CYCLE - changes.get("age", 0), role=role)
    receives(core, request=request, stop=changes.get("stop", False))

    found = requests.receive(core, CYCLE)

    (event,) = core.events
    if refused is None:
        assert found is core.request is request
        assert core.result == RequestResult(3)
        values = kind, wanted.mode
        assert event == Event(EventCode.REQUEST_RECEIVED, wanted.axis, values)
    else:
        assert (found, core.request) == (None, None)
        assert (core.result.id, core.result.outcome) == (3, Outcome.REFUSED)
        told = core.result.refusal
        assert refused in {told, told.code}
        assert event == Event(
            EventCode.REQUEST_REFUSED, told.subject, (kind, wanted.mode, told.code, *told.values)
        )


@pytest.mark.parametrize(
    ("kind", "mode", "is_one"),
    [
        (RequestKind.MODE, Mode.COMMISSION, True),
        (RequestKind.MODE, Mode.REFERENCE, True),
        (RequestKind.MODE, Mode.GAIT, False),
        (RequestKind.RESET, Mode.COMMISSION, False),
        (RequestKind.ENABLE, Mode.REFERENCE, False),
    ],
)
def test_a_homing_or_sign_test_is_requested_by_its_mode(kind, mode, is_one):
    assert requests.is_of_single_axis(asked(1, kind, ModeRequest(mode))) is is_one


# --- what the guards read -------------------------------------------------------------------------

USUAL = GuardInputs(
    mode=Mode.READY,
    gateway_alive=True,
    at_rest=True,
    hand_switch_closed=True,
    hand_switch_known=True,
    sto_released=True,
    unreferenced=(),
    outside=(),
    drives_powered=False,
    cadence_max_hz=0.5,
    scenarios={"paper": 30.0, "friction": 60.0},
    artificial=frozenset({"paper"}),
    patient_configured=False,
    guidance="impedance",
    inputs_untested=UNTESTED,
    self_test_due=SelfTestDue.NOT_PASSED_TODAY,
    lease_held=True,
)
MOVES = AT_REST._replace(velocity_si=1.0)
BOTH, NAMES = (0, 1), ("right/hip", "right/slide")


def at(position_si):
    return {"joint": AT_REST._replace(position_si=position_si)}


@pytest.mark.parametrize(
    ("shown", "changed"),
    [
        ({}, {}),
        ({0: {"joint": MOVES}}, {"at_rest": False}),
        ({1: {"joint": MOVES._replace(fresh=False)}}, {"unsampled": ("right/slide",)}),
        ({1: {"joint": MOVES, "feedback": None}}, {"lost": frozenset({"right/slide"})}),
        (
            {index: {"feedback": None} for index in BOTH},
            {"lost": frozenset(NAMES), "hand_switch_known": False},
        ),
        (
            {0: {"feedback": OFF._replace(inputs=CLOSED)}},
            {"sto_released": False},
        ),
        ({1: {"feedback": OFF._replace(inputs=RELEASED)}}, {"hand_switch_closed": False}),
        ({1: {"feedback": OFF._replace(inputs=Input.IMPOSSIBLE)}}, {}),
        (
            {0: {"feedback": OFF._replace(inputs=CLOSED, sample_age_cycles=2)}},
            {"sto_released": False},
        ),
        (
            {0: {"feedback": OFF._replace(inputs=CLOSED, sample_age_cycles=3)}},
            {"lost": frozenset({"right/hip"})},
        ),
        (
            {1: {"referenced": False, "doubt": Doubt.REBOOTED}},
            {"unreferenced": (("right/slide", Doubt.REBOOTED),)},
        ),
        ({0: at(LIMITS.position_min_si), 1: at(LIMITS.position_max_si)}, {}),
        ({0: at(LIMITS.position_min_si - 0.01)}, {"outside": ("right/hip",)}),
        ({1: at(LIMITS.position_max_si + 0.01)}, {"outside": ("right/slide",)}),
    ],
)
def test_the_guards_read_what_the_axes_show(core, shown, changed):
    for index, changes in shown.items():
        now_shows(core.axes[index], **changes)

    assert differs(core) == changed


def differs(core, cycle=CYCLE):
    """What the guards read in a cycle, where it is not as usual."""
    found = requests._guard_inputs(core, cycle)
    names = [one.name for one in fields(GuardInputs)]
    return {n: getattr(found, n) for n in names if getattr(found, n) != getattr(USUAL, n)}


@pytest.mark.parametrize(
    ("changes", "changed"),
    [
        ({"inputs": Inputs(gateway_state_cycle=109, lease=1)}, {"gateway_alive": False}),
        ({"inputs": Inputs(gateway_state_cycle=111)}, {"lease_held": False}),
        ({"mode": Mode.FAULT, "load_checked": True}, {"mode": Mode.FAULT, "drives_powered": True}),
        ({"drives": None}, {"lost": frozenset(NAMES)}),
    ],
)
def test_the_guards_read_what_the_core_is(core, changes, changed):
    for name, value in changes.items():
        setattr(core, name, value)

    assert differs(core) == changed


@pytest.mark.parametrize(
    ("proven", "must_be", "unproven"),
    [(True, True, ()), (False, False, ()), (False, True, ("right/hip",))],
)
def test_an_axis_is_unproven_where_its_sign_must_be_and_is_not(core, proven, must_be, unproven):
    core.config.signs_must_be_proven = must_be
    core.axes[0].sign_proven, core.axes[1].sign_proven = proven, True

    assert requests._guard_inputs(core, CYCLE).unproven == unproven


@pytest.mark.parametrize(
    ("ratio", "outside"),
    [(0.15, ()), (0.149, ("right",)), (0.0, ("right",))],
)
def test_a_leg_near_its_singularity_is_outside(core, ratio, outside):
    core.legs[0].placed = Placed(ratio)

    assert requests._guard_inputs(core, CYCLE).outside == outside


def test_a_silent_gateway_is_not_alive_however_early_the_cycle(core):
    receives(core, gateway_state_cycle=9)

    assert differs(core, 40) == {"gateway_alive": False}


# --- answered -------------------------------------------------------------------------------------


def finished(core, request):
    """The outcome of an accepted request after this cycle."""
    core.request, core.result = request, RequestResult(request.id)
    requests.finish(core)
    assert (core.request is None) is (core.result.outcome is not Outcome.PENDING)
    return core.result.outcome


@pytest.mark.parametrize(
    ("mode", "run", "outcome", "why"),
    [
        (Mode.COMMISSION, None, Outcome.DONE, None),
        (Mode.READY, None, Outcome.REFUSED, Failure.NOT_READY),
        (Mode.READY, Failure.DOES_NOT_MOVE, Outcome.REFUSED, Failure.DOES_NOT_MOVE),
        (Mode.READY, Failure.NONE, Outcome.PENDING, None),
        (Mode.BRINGING_UP, Failure.NONE, Outcome.PENDING, None),
    ],
)
def test_a_single_axis_is_begun_when_its_mode_is_there(core, mode, run, outcome, why):
    core.mode = mode
    if run is not None:
        core.single_axis = SimpleNamespace(is_over=run is not Failure.NONE, why=run)

    assert finished(core, asked(1, RequestKind.MODE)) is outcome
    assert core.result.refusal == (why and Refusal(RefusalCode.FAILED, values=(why,)))


def shown_state(state):
    return FEEDBACK._replace(power_state=state)


@pytest.mark.parametrize(
    ("kind", "mode", "state", "changes", "is_done"),
    [
        (RequestKind.ENABLE, Mode.HOLD, PowerState.OPERATION_ENABLED, {"load_checked": True}, True),
        (RequestKind.ENABLE, Mode.HOLD, PowerState.OPERATION_ENABLED, {}, False),
        (RequestKind.DISABLE, Mode.READY, PowerState.SWITCHED_ON, {}, True),
        (RequestKind.DISABLE, Mode.READY, PowerState.OPERATION_ENABLED, {}, False),
        (RequestKind.DISABLE, Mode.READY, PowerState.QUICK_STOP_ACTIVE, {}, True),
        (RequestKind.DISABLE, Mode.STOPPING, PowerState.SWITCHED_ON, {}, False),
        (RequestKind.DISABLE, Mode.FAULT, PowerState.SWITCHED_ON, {}, False),
        (RequestKind.DISABLE, Mode.READY, None, {}, True),
        (RequestKind.RESET, Mode.READY, PowerState.SWITCHED_ON, {}, True),
        (RequestKind.RESET, Mode.READY, PowerState.FAULT, {}, False),
        (RequestKind.RESET, Mode.READY, PowerState.SWITCHED_ON, {"reset_cycles_left": 1}, False),
        (RequestKind.RESET, Mode.STOPPING, PowerState.SWITCHED_ON, {}, False),
        (RequestKind.RESET, Mode.OFF, PowerState.SWITCHED_ON, {}, False),
        (RequestKind.RESET, Mode.READY, None, {}, True),
    ],
)
@pytest.mark.parametrize("index", BOTH)
def test_a_request_is_done_when_the_drives_show_it(
    core, kind, mode, state, changes, is_done, index
):
    core.mode = mode
    for name, value in changes.items():
        setattr(core, name, value)
    now_shows(core.axes[index], feedback=None if state is None else shown_state(state))

    assert finished(core, asked(1, kind)) is (Outcome.DONE if is_done else Outcome.PENDING)
    told = [Event(EventCode.REQUEST_DONE, "right/hip", (kind, Mode.COMMISSION))]
    assert core.events == told * is_done


@pytest.mark.parametrize(
    "wanted", [ModeRequest(Mode.GAIT), replace(WANTED, witnessed=True)], ids=["gait", "witnessed"]
)
def test_a_mode_is_there_at_once(core, wanted):
    assert finished(core, asked(1, RequestKind.MODE, wanted)) is Outcome.DONE


@pytest.mark.parametrize("cause", [Cause.BUS_OFF, Cause.STOP_REQUESTED])
def test_a_verdict_refuses_the_request_under_way_and_a_newer_result_stays(core, cause):
    core.request, core.result = asked(1, RequestKind.ENABLE), RequestResult(2, Outcome.REFUSED)
    core.verdict = Verdict(Category.S1, cause, "right/hip", 1.0, 2.0, said="x")

    for _ in range(2):
        requests.finish(core)

    assert core.result == RequestResult(2, Outcome.REFUSED)
    assert core.request is None
    values = RequestKind.ENABLE, Mode.COMMISSION, RefusalCode.STOPPED, *core.verdict.values
    assert core.events == [Event(EventCode.REQUEST_REFUSED, "right/hip", values, "x")]
    assert finished(core, asked(3, RequestKind.ENABLE)) is Outcome.REFUSED
    stopped = Refusal(RefusalCode.STOPPED, "right/hip", core.verdict.values, "x")
    assert core.result.refusal == stopped
