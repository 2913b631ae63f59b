"""Every request in every mode is answered: done, or why not. And a stop stops in every mode."""

from functools import partial

import pytest
from gaitd_names import Cause, EventCode, Mode, Outcome, RefusalCode, RequestKind
from reports import refusal_of
from sessions import elsewhere, new_session, reported

from daemon.core.modes.table import TRANSITIONS, trigger_of
from daemon.ipc.record import ModeRequest
from gaitd_lab.lockstep import LockstepSession
from gaitd_lab.reference.modes import REQUESTS


@pytest.fixture(params=[Mode.READY, Mode.HOLD, Mode.GAIT], ids=str)
def warm_mode(request) -> tuple[Mode, LockstepSession]:
    """A machine without power, one with it and one in motion; all modes have unit tests."""
    return request.param, request.getfixturevalue(f"warm_{request.param.name.lower()}")


def asked(kind: RequestKind, wanted: ModeRequest, session: LockstepSession):
    answer = session.request(kind, wanted, within_s=20)
    return answer, reported(session.records, EventCode.REQUEST_REFUSED)


def test_a_request_is_answered_with_done_or_why_not(warm_mode):
    mode, session = warm_mode
    for name, (kind, wanted) in REQUESTS.items():
        answer, events = elsewhere(session, partial(asked, kind, wanted))

        if (mode, trigger_of(kind, wanted)) not in TRANSITIONS:
            assert answer.outcome == Outcome.REFUSED, name
            assert answer.refusal.code is RefusalCode.NOT_IN_THIS_MODE, name
        if answer.outcome == Outcome.REFUSED:
            assert answer.refusal in map(refusal_of, events), name
        else:
            assert (answer.outcome, answer.refusal) == (Outcome.DONE, None), name


def test_a_request_while_the_drives_are_brought_up_is_refused_there_and_then():
    """Bring-up takes many cycles in one turn of the loop: it hears and answers meanwhile."""
    session = new_session()
    gateway, waiting, answers = session.gateway, list(REQUESTS.values()), []

    def ask_the_next(record):
        if record.mode != Mode.BRINGING_UP:
            return
        if (
            len(waiting) + len(answers) < len(REQUESTS)
            and gateway.outcome().outcome != Outcome.PENDING
        ):
            answers.append(gateway.outcome())
        if waiting and len(waiting) + len(answers) == len(REQUESTS):
            gateway.request(*waiting.pop())

    gateway._on_record = ask_the_next
    session.run_until(lambda record: record.mode == Mode.READY, within_s=10)

    assert len(answers) == len(REQUESTS)
    assert {answer.outcome for answer in answers} == {Outcome.REFUSED}
    assert {answer.refusal.code for answer in answers} == {RefusalCode.NOT_IN_THIS_MODE}
    assert {answer.refusal.values[1] for answer in answers} == {Mode.BRINGING_UP}


def test_a_stop_is_obeyed_in_motion_and_harms_in_no_mode(warm_mode):
    mode, session = warm_mode

    session.gateway.stop()
    session.run(0.4)

    record = session.record
    assert not record.mode.active
    if mode.active:
        assert record.verdict.cause == Cause.STOP_REQUESTED
        assert record.mode == Mode.FAULT
