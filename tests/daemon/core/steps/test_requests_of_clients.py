"""A request of a client: received once at a time, and answered by what the machine has become."""

import pytest
from core_bench import Bench
from fresh_core import has_received
from gaitd_names import Cause, EventCode, Failure, Mode, Outcome, RefusalCode, RequestKind, Role
from gaitd_names import StopCategory as Category

from daemon.core.exercises.sign_test import SignTest
from daemon.core.steps import requests
from daemon.ipc.record import ModeRequest, Request, RequestResult, Verdict
from daemon.ipc.report import Refusal

WANTED = ModeRequest(Mode.COMMISSION, axis="right/hip")


def asked(number, kind, wanted=WANTED, *, cycle=100):
    return Request(number, kind, cycle, wanted, Role.UNRESTRICTED)


@pytest.fixture
def core():
    made = Bench().core
    has_received(made, gateway_state_cycle=100)
    return made


def test_while_one_request_is_under_way_another_is_refused(core):
    core.request = asked(1, RequestKind.ENABLE)

    has_received(core, request=asked(2, RequestKind.DISABLE))
    assert requests.receive(core, 100) is None
    busy = Refusal(RefusalCode.BUSY, values=(RequestKind.ENABLE,))
    assert core.result == RequestResult(2, Outcome.REFUSED, busy)
    has_received(core, request=None)
    assert requests.receive(core, 100) is None


@pytest.mark.parametrize(
    ("kind", "wanted", "stop", "code"),
    [
        (RequestKind.ENABLE, WANTED, True, RefusalCode.STOP_REQUESTED),
        (RequestKind.MODE, WANTED, True, RefusalCode.STOP_REQUESTED),
        (RequestKind.DISABLE, WANTED, True, None),
    ],
)
def test_a_stop_in_the_same_cycle_refuses_what_would_move(core, kind, wanted, stop, code):
    has_received(core, request=asked(1, kind, wanted), stop=stop)

    found = requests.receive(core, 100)

    assert (found is None) is (code is not None)
    if code is not None:
        assert core.result == RequestResult(1, Outcome.REFUSED, Refusal(code))
        (event,) = core.events
        assert (event.code, event.values) == (
            EventCode.REQUEST_REFUSED,
            (kind, wanted.mode, code),
        )


@pytest.mark.parametrize(
    ("mode", "run", "outcome", "why"),
    [
        (Mode.COMMISSION, None, Outcome.DONE, None),
        (Mode.READY, None, Outcome.REFUSED, Failure.NOT_READY),
        (Mode.READY, Failure.DOES_NOT_MOVE, Outcome.REFUSED, Failure.DOES_NOT_MOVE),
        (Mode.READY, Failure.NONE, Outcome.PENDING, None),
    ],
)
def test_a_single_axis_is_begun_when_its_mode_is_there(core, mode, run, outcome, why):
    core.mode, core.request = mode, asked(1, RequestKind.MODE)
    core.result = RequestResult(1)
    if run is not None:
        begun = SignTest(axis="right/hip", requested_cycle=0, rules=None, period_s=0.01)
        core.single_axis = begun if run is Failure.NONE else begun.failed(run)

    requests.finish(core)

    refusal = why and Refusal(RefusalCode.FAILED, values=(why,))
    assert core.result == RequestResult(1, outcome, refusal)
    assert (core.request is None) is (outcome is not Outcome.PENDING)


def test_a_verdict_refuses_the_request_under_way_and_a_newer_result_stays(core):
    core.request, core.result = asked(1, RequestKind.ENABLE), RequestResult(2, Outcome.REFUSED)
    core.verdict = Verdict(Category.S1, Cause.BUS_OFF, "right/hip", 1.0, 2.0, said="x")

    requests.finish(core)

    assert core.result == RequestResult(2, Outcome.REFUSED)
    (event,) = core.events
    assert (event.code, event.subject, event.said) == (
        *(EventCode.REQUEST_REFUSED, "right/hip", "x"),
    )
    assert core.request is None
    requests.finish(core)
    assert len(core.events) == 1
