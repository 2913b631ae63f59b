"""Levels as a gateway should not send them: none ends the core, moves a leg or hides a stop."""

import msgspec
import pytest
from gaitd_names import EventCode, Mode, Outcome, RefusalCode, RequestKind
from msgspec.structs import replace
from records import HEADER
from sessions import reported

from daemon.ipc.record import TEXT_BYTES_MAX, ModeRequest
from daemon.ipc.report import Refusal
from daemon.ipc.transport import RingWriter

LONG = ("\N{GRINNING FACE}" * 1800, "\x00\x1b[2J" * 450)


@pytest.mark.parametrize("name", LONG, ids=["four bytes each", "control characters"])
def test_names_of_the_client_and_in_its_refusal_fit_the_slot_of_its_record(
    warm_hold, tmp_path, name
):
    scenarios = warm_hold.core.config.excite
    scenarios[name] = scenarios["open_loop"]
    wanted = ModeRequest(Mode.EXCITE, duration_s=10.0, scenario=name[1:])

    answer = warm_hold.request(RequestKind.MODE, wanted)

    writer = RingWriter(tmp_path / "some.ring", HEADER)
    for record in warm_hold.records[-3:]:
        writer.write(record)
    writer.close()
    assert answer.outcome == Outcome.REFUSED
    assert answer.refusal.code is RefusalCode.NO_SUCH_SCENARIO
    assert 0 < len(answer.refusal.said.encode()) <= TEXT_BYTES_MAX
    assert writer.shortened_count == 0
    assert msgspec.msgpack.encode(warm_hold.record)


def heard(session):
    """The levels that the core is sent from now on."""
    sent, send = [], session.gateway.receive

    def levels():
        sent.extend(send())
        return sent[-1:]

    session.gateway.receive = levels
    return sent


def test_an_executed_enable_that_arrives_again_after_disable_enables_nothing(warm_ready):
    session, gateway = warm_ready, warm_ready.gateway
    sent = heard(session)
    assert session.request(RequestKind.ENABLE).outcome == Outcome.DONE
    enabling = next(level for level in sent if level.request.kind == RequestKind.ENABLE)
    assert session.request(RequestKind.DISABLE).outcome == Outcome.DONE
    # As young as can be: the id, or the number of the level, alone has to be enough.
    young = replace(enabling.request, for_cycle=session.record.cycle)
    again, send = replace(enabling, request=young), gateway.receive
    begun = len(session.records)

    for place in (slice(None), slice(None, None, -1)):
        gateway.receive = lambda place=place: [*send(), again][place]
        session.run(0.3)
    gateway.receive = lambda: [again]
    session.run(0.3)

    assert {record.mode for record in session.records[begun:]} == {Mode.READY}


def test_a_request_for_a_cycle_that_has_not_been_is_refused(warm_ready):
    sent = warm_ready.gateway.receive

    def ahead():
        return [
            replace(one, request=replace(one.request, for_cycle=one.for_cycle + 1000))
            for one in sent()
        ]

    warm_ready.gateway.receive = ahead

    assert warm_ready.request(RequestKind.ENABLE).outcome == Outcome.REFUSED
    assert warm_ready.record.mode == Mode.READY


def test_an_enable_that_comes_with_a_stop_is_refused(warm_ready):
    warm_ready.gateway.stop()

    answer = warm_ready.request(RequestKind.ENABLE)

    assert answer.outcome == Outcome.REFUSED
    assert answer.refusal == Refusal(RefusalCode.STOP_REQUESTED)
    assert warm_ready.record.mode == Mode.READY


def test_what_a_lost_drive_said_last_of_its_inputs_holds_up_no_reset(warm_hold):
    session = warm_hold
    session.command("hand_switch_open right/hip")
    session.run_until(lambda record: record.mode == Mode.FAULT, within_s=5)
    is_open = Refusal(RefusalCode.HAND_SWITCH_OPEN)
    assert session.request(RequestKind.RESET).refusal == is_open

    session.command("unplugged right/hip")
    session.run(1.0)
    answer = session.request(RequestKind.RESET, within_s=20)

    assert answer.refusal != is_open
    received = reported(session.records, EventCode.REQUEST_RECEIVED)
    assert received[-1].values[0] == RequestKind.RESET


def test_the_outcome_of_a_request_that_was_overtaken_is_not_told_as_the_newest(warm_ready):
    session, gateway = warm_ready, warm_ready.gateway
    gateway.request(RequestKind.ENABLE)
    session.run(0.05)
    gateway.request(RequestKind.RESET)  # a gateway that knows nothing of the first
    begun = len(session.records)

    session.run_until(lambda record: reported([record], EventCode.REQUEST_DONE), within_s=5)

    ids = [record.request.id for record in session.records[begun:]]
    assert ids == sorted(ids)
    assert gateway.outcome().refusal == Refusal(RefusalCode.BUSY, values=(RequestKind.ENABLE,))
