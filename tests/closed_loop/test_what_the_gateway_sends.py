"""Levels as a gateway should not send them: none ends the core, moves a leg or hides a stop."""

import msgspec
import pytest
from msgspec.structs import replace
from records import HEADER

from daemon.ipc.record import TEXT_BYTES_MAX, Mode, ModeRequest, Outcome, RequestKind
from daemon.ipc.transport import RingWriter

LONG = ("x" * 1800, "\N{GRINNING FACE}" * 1800, "\x00\x1b[2J" * 450)


@pytest.mark.parametrize("name", LONG, ids=["ascii", "four bytes each", "control characters"])
def test_a_name_that_a_refusal_quotes_fits_the_slot_of_its_record(warm_hold, tmp_path, name):
    lockstep = warm_hold.lockstep
    wanted = ModeRequest(Mode.EXCITE, duration_s=10.0, scenario=name)

    answer = lockstep.request(RequestKind.MODE, wanted)

    writer = RingWriter(tmp_path / "some.ring", HEADER)
    for record in lockstep.records[-3:]:
        writer.write(record)
    writer.close()
    assert answer.outcome == Outcome.REFUSED
    assert answer.reason.startswith("scenario = ")
    assert len(answer.reason.encode()) <= TEXT_BYTES_MAX
    assert writer.shortened_count == 0
    assert msgspec.msgpack.encode(lockstep.record)


def heard(lockstep):
    """The levels that the core is sent from now on."""
    sent, send = [], lockstep.gateway.levels

    def levels():
        sent.extend(send())
        return sent[-1:]

    lockstep.gateway.levels = levels
    return sent


def test_an_executed_enable_that_arrives_again_after_disable_enables_nothing(warm_ready):
    lockstep, gateway = warm_ready.lockstep, warm_ready.lockstep.gateway
    sent = heard(lockstep)
    assert lockstep.request(RequestKind.ENABLE).outcome == Outcome.DONE
    enabling = next(level for level in sent if level.request.kind == RequestKind.ENABLE)
    assert lockstep.request(RequestKind.DISABLE).outcome == Outcome.DONE
    # As young as can be: the id, or the number of the level, alone has to be enough.
    young = replace(enabling.request, for_cycle=lockstep.record.cycle)
    again, send = replace(enabling, request=young), gateway.levels
    begun = len(lockstep.records)

    for place in (slice(None), slice(None, None, -1)):
        gateway.levels = lambda place=place: [*send(), again][place]
        lockstep.run(0.3)
    gateway.levels = lambda: [again]
    lockstep.run(0.3)

    assert {record.mode for record in lockstep.records[begun:]} == {Mode.READY}


def test_a_request_for_a_cycle_that_has_not_been_is_refused(warm_ready):
    lockstep = warm_ready.lockstep
    sent = lockstep.gateway.levels

    def ahead():
        return [
            replace(one, request=replace(one.request, for_cycle=one.for_cycle + 1000))
            for one in sent()
        ]

    lockstep.gateway.levels = ahead

    assert lockstep.request(RequestKind.ENABLE).outcome == Outcome.REFUSED
    assert lockstep.record.mode == Mode.READY


def test_an_enable_that_comes_with_a_stop_is_refused(warm_ready):
    lockstep = warm_ready.lockstep
    lockstep.gateway.stop()

    answer = lockstep.request(RequestKind.ENABLE)

    assert answer.outcome == Outcome.REFUSED
    assert answer.reason == "somebody asked to stop at the same time"
    assert lockstep.record.mode == Mode.READY


def test_what_a_lost_drive_said_last_of_its_inputs_holds_up_no_reset(warm_hold):
    session, lockstep = warm_hold, warm_hold.lockstep
    session.machine.command("hand_switch_open right/hip")
    lockstep.run_until(lambda record: record.mode == Mode.FAULT, within_s=5)
    assert lockstep.request(RequestKind.RESET).reason == "the hand switch is open"

    session.machine.command("unplugged right/hip")
    lockstep.run(1.0)
    answer = lockstep.request(RequestKind.RESET, within_s=20)

    assert "hand switch" not in answer.reason
    assert any("reset requested" in text for one in lockstep.records for text in one.events)


def test_the_outcome_of_a_request_that_was_overtaken_is_not_told_as_the_newest(warm_ready):
    lockstep, gateway = warm_ready.lockstep, warm_ready.lockstep.gateway
    gateway.ask(RequestKind.ENABLE)
    lockstep.run(0.05)
    gateway.ask(RequestKind.RESET)  # a gateway that knows nothing of the first
    begun = len(lockstep.records)

    lockstep.run_until(lambda record: "enable done" in record.events, within_s=5)

    ids = [record.request.id for record in lockstep.records[begun:]]
    assert ids == sorted(ids)
    assert gateway.outcome().reason == "another request is outstanding"
