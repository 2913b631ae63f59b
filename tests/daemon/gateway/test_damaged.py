"""What is damaged, hostile or a bug of ours costs what it is in, and nothing else."""

import logging

import pytest

from daemon import seam
from daemon.gateway import control
from daemon.record import RequestKind


def spoil(bench, seq, data=b"\xff" * 40):
    """Bytes in the middle of a record of the core's ring."""
    with (bench.runtime / seam.RING_NAME).open("r+b") as file:
        file.seek(seam.HEADER_SIZE + seq % seam.SLOT_COUNT * seam.SLOT_SIZE + 12)
        file.write(data)


def test_a_record_that_cannot_be_read_is_left_out_counted_and_told(bench):
    bench.cycle()
    for _ in range(3):
        bench.write()
    spoil(bench, 3)

    bench.turn()
    for _ in range(100):
        bench.cycle()

    said = [message.cycle for message in bench.outlet.on("right/activity")]
    told = [event.text for event in bench.outlet.events if "cannot be read" in event.text]
    assert said == [1, 2, *range(4, 105)]
    assert told == ["records of the core cannot be read, 1 so far: damaged, or of another gaitd"]
    assert bench.outlet.on("health")[-1].record_missed_count == 1


def test_a_slot_whose_number_is_lost_does_not_hold_up_the_records_after_it(bench):
    bench.cycle()
    bench.write()
    with (bench.runtime / seam.RING_NAME).open("r+b") as file:
        file.seek(seam.HEADER_SIZE + 2 * seam.SLOT_SIZE)
        file.write(bytes(8))
    bench.write()

    bench.turn()

    assert [message.cycle for message in bench.outlet.on("right/activity")] == [1, 3]


HOSTILE = (
    b'{"for_cycle": 100000000000000000000}',
    b'{"for_cycle": 18446744073709551616}',
    b'{"for_cycle": 9223372036854775808}',
    b'{"for_cycle": -1}',
    b'{"client": "\xff"}',
    b'{"client": ' + b"[" * 4000,
    b"1" * 4096,
)


@pytest.mark.parametrize("payload", HOSTILE)
@pytest.mark.parametrize("name", ["enable", "mode", "acquire", "status", "stop"])
def test_no_payload_ends_the_gateway_and_who_asks_next_is_served(bench, ask, name, payload):
    hostile, status = ask(name, payload), ask("status")
    bench.cycle()

    bench.cycle(hostile)
    bench.cycle(status)

    assert bench.levels[-1].request.kind is RequestKind.NONE
    assert len(status.replies) == 1
    assert bench.levels[-1].stop_count == (name == "stop")
    assert len(hostile.replies) == (name != "stop")
    assert not [event for event in bench.outlet.events if "failed" in event.text]


def broken(*_args, **_kwargs):
    raise ZeroDivisionError("ours")


@pytest.mark.parametrize("name", ["enable", "status", "stop"])
@pytest.mark.parametrize("where", ["read_ask", "answer"])
def test_a_bug_in_one_query_fails_that_query_alone_and_is_told(
    bench, ask, monkeypatch, caplog, name, where
):
    asked, other = ask(name, b'{"client": "display"}'), ask("status")
    bench.cycle()
    with monkeypatch.context() as patch, caplog.at_level(logging.ERROR):
        if where == "read_ask":
            patch.setattr(control, "read_ask", broken)
        else:
            patch.setattr(asked, "answer", broken)
        bench.cycle(asked)
        bench.cycle(stop_count=bench.levels[-1].stop_count)
        for _ in range(900):
            bench.cycle(stop_count=bench.levels[-1].stop_count)

    bench.cycle(other)

    assert len(other.replies) == 1
    assert [reply.outcome for reply in asked.replies] == ["refused"] * (where == "read_ask")
    assert bench.levels[-1].stop_count == (name == "stop")
    assert bench.levels[-1].request.kind is RequestKind.NONE
    told = [event.text for event in bench.outlet.events if "have failed" in event.text]
    assert told == ["queries have failed in the gateway, 1 so far: ZeroDivisionError: ours"]
    assert "ZeroDivisionError" in caplog.text


def test_names_that_strangers_think_of_take_no_memory(bench, ask):
    bench.cycle()
    for number in range(50):
        bench.turn(ask(f"name{number}"))

    assert len(bench.outlet.seqs) < 30
