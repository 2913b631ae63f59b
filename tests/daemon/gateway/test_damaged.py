"""What is damaged, hostile or a bug of ours costs what it is in, and nothing else."""

import contextlib
import logging
from pathlib import Path
from unittest import mock

import msgspec
import pytest
from gaitd_names import EventCode, RequestKind
from msgspec.structs import replace
from records import HEADER, cut_out, record

from daemon.gateway import requests
from daemon.ipc import transport
from daemon.ipc.ring_clip import FOLDER, clip_file, clip_files, trimmed
from daemon.recorder.clip_store import ClipStore
from daemon.recorder.recorder import DiskRecorder


def spoil(bench, seq, data=b"\xff" * 40):
    """Bytes in the middle of a record of the core's ring."""
    with (bench.runtime / transport.RING_NAME).open("r+b") as file:
        file.seek(transport.HEADER_SIZE + seq % transport.SLOT_COUNT * transport.SLOT_SIZE + 12)
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
    told = [event.values for event in bench.outlet.events if event.code == EventCode.RECORDS_UNREAD]
    assert said == [1, 2, *range(4, 105)]
    assert told == [{"unread_count": 1}]
    assert bench.outlet.on("health")[-1].record_missed_count == 1


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
    assert not [event for event in bench.outlet.events if event.code == "query_failed"]


def broken(*_args, **_kwargs):
    raise ZeroDivisionError("ours")


@pytest.mark.parametrize(("name", "where"), [("enable", "read_ask"), ("stop", "answer")])
def test_a_bug_in_one_query_fails_that_query_alone_and_is_told(
    bench, ask, monkeypatch, caplog, name, where
):
    asked, other = ask(name, b'{"client": "display"}'), ask("status")
    bench.cycle()
    with monkeypatch.context() as patch, caplog.at_level(logging.ERROR):
        if where == "read_ask":
            patch.setattr(requests, "decode_payload", broken)
        else:
            patch.setattr(asked, "answer", broken)
        bench.cycle(asked)
        bench.cycle(stop_count=bench.levels[-1].stop_count)
        for _ in range(9):
            bench.write(stop_count=bench.levels[-1].stop_count)
            bench.turn(after_ms=1000)

    bench.cycle(other)

    assert len(other.replies) == 1
    assert [reply.outcome for reply in asked.replies] == ["refused"] * (where == "read_ask")
    assert bench.levels[-1].stop_count == (name == "stop")
    assert bench.levels[-1].request.kind is RequestKind.NONE
    told = [event for event in bench.outlet.events if event.code == "query_failed"]
    assert [(event.values, event.said) for event in told] == [
        ({"failed_count": 1}, "ZeroDivisionError: ours")
    ]
    assert "ZeroDivisionError" in caplog.text


def test_names_that_strangers_think_of_take_no_memory(bench, ask):
    bench.cycle()
    for number in range(50):
        bench.turn(ask(f"name{number}"))

    assert len(bench.outlet.seqs) < 30


class Clock:
    ns = 1_000_000_000

    def now_ns(self):
        return self.ns

    def utc_ns(self):
        return 1_760_000_000_000_000_000 + self.ns


@pytest.fixture
def kept_rings(tmp_path):
    """Three files of the black box, by name, oldest first."""
    folder = tmp_path / "state" / FOLDER
    folder.mkdir(parents=True)
    for number in (1, 2, 3):
        kept = transport.Kept("emergency", "", 5, number * 10**18, 1, 5, False)
        header = replace(HEADER, kept=kept, core_boot_id=f"boot-{number}")
        with contextlib.closing(cut_out(map(record, range(1, 6)))) as cutting:
            (folder / f"{number}.ring").write_bytes(b"".join(trimmed(header, cutting)))
    return folder


def turn(tmp_path):
    """A gateway's keeper from start to end; the events that it made."""
    keeper = DiskRecorder(tmp_path / "state", tmp_path, Clock(), "0.1.0")
    made = [(one.code, one.said) for one in keeper.turn(None, Clock.ns)]
    keeper.close()
    return made


@pytest.mark.parametrize("at_byte", range(0, 200, 33))
def test_one_damaged_byte_in_a_kept_ring_costs_that_ring_and_the_gateway_starts(
    kept_rings, tmp_path, at_byte
):
    path = kept_rings / "2.ring"
    image = bytearray(path.read_bytes())
    image[at_byte] = 0xFF
    path.write_bytes(image)
    damaged = bool(clip_file(path).trouble)

    told = turn(tmp_path)

    names = sorted(one.name for one in kept_rings.iterdir())
    assert names == ["1.ring", "2.ring.damaged" if damaged else "2.ring", "3.ring"]
    assert len(told) == damaged
    assert not damaged or told[0][0] == EventCode.RECORDING_DAMAGED
    assert not damaged or told[0][1].startswith("2.ring ")
    assert turn(tmp_path) == []
    files = clip_files(kept_rings)
    assert [file.path.name for file in files] == names
    assert [file.core_boot_id for file in (files[0], files[2])] == ["boot-1", "boot-3"]
    assert ClipStore(kept_rings).covers("boot-1", 3)
    assert ClipStore(kept_rings).covers("boot-3", 3)


def test_a_damaged_ring_that_cannot_be_set_aside_is_told_at_each_start(kept_rings, tmp_path):
    (kept_rings / "2.ring").write_bytes(b"\xff" * 20_000)
    with mock.patch.object(Path, "rename", side_effect=PermissionError(13, "no access")):
        told = turn(tmp_path)

    ((code, said),) = told
    assert code == EventCode.RECORDING_DAMAGED
    assert said.endswith("it cannot be set aside: no access")
    assert (kept_rings / "2.ring").exists()


def test_an_unreadable_ring_that_a_core_left_is_told(tmp_path):
    (tmp_path / transport.PREVIOUS_RING_NAME).write_bytes(b"\xff" * 20_000)

    ((code, said),) = turn(tmp_path)

    assert code == EventCode.RECORDING_DAMAGED
    assert said.startswith("the ring of the previous core cannot be read: ")


BAD_NAMES = ("two\nlines", "end\n", "\x1b[2J", "nul\0", "\x85", "\u2028", "left\u202eright", "\x7f")


@pytest.mark.parametrize("client", BAD_NAMES)
@pytest.mark.parametrize("name", ["enable", "acquire", "mode", "release", "stop"])
def test_a_client_whose_name_is_no_line_of_text_is_refused(bench, ask, name, client):
    query = ask(name, msgspec.json.encode({"client": client, "lease": 1, "mode": "hold"}))
    bench.cycle()

    bench.cycle(query)

    assert bench.levels[-1].request.kind is RequestKind.NONE
    assert bench.levels[-1].stop_count == (name == "stop")
    assert client not in [event.values.get("client") for event in bench.outlet.events]
    assert not bench.gateway.lease_control.lease


@pytest.mark.parametrize("client", ["display", "Anzeige für Zuhause", "пульт", "画面 2"])
def test_a_name_in_any_language_is_taken(bench, ask, client):
    bench.cycle()

    bench.cycle(ask("enable", msgspec.json.encode({"client": client})))

    assert bench.levels[-1].request.kind is RequestKind.ENABLE
    assert bench.outlet.events[-1].values == {"request": "enable", "client": client}


def test_what_is_wrong_with_a_name_is_said_in_words(bench, ask):
    query = ask("enable", b'{"client": "two\\nlines"}')
    bench.cycle()

    bench.cycle(query)

    refusal = query.replies[0].refusal
    assert refusal.code == "bad_payload"
    assert "Expected `str` without control characters - at `$.client`" in refusal.said


def test_a_flood_of_requests_does_not_displace_the_history_of_events(bench, ask):
    bench.cycle()
    bench.turn(after_ms=10_000)
    for _ in range(10):
        bench.cycle(*(ask("acquire", b'{"client": "flood"}') for _ in range(60)))
    before = len(bench.outlet.events)
    bench.turn(after_ms=10_000)
    bench.cycle(ask("acquire", b'{"client": "next"}'))

    assert before < 30
    told = {event.code: event.values for event in bench.outlet.events[before:]}
    assert told["requests_left_out"] == {"left_out_count": 580, "window_s": 10}
    assert told["request_answered"]["client"] == "next"
