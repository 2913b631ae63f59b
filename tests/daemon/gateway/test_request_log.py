"""The request log: what is noted, and what a power cut or a bad disk does."""

import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from unittest import mock

import msgspec
import pytest
from gaitd_client import wire
from gaitd_names import Cause, EventCode, Mode, RefusalCode, StopCategory
from power_cuts import check
from traced_calls import mark

from daemon.ipc.record import Verdict
from daemon.recorder import audit_file
from daemon.recorder.audit_file import (
    NAME,
    RequestFile,
    fields_of,
    files_of,
    lines_of,
)
from daemon.recorder.audit_log import LINES_PER_MINUTE, RequestLog, unexpected_end
from daemon.recorder.disk import Disk
from daemon.recorder.ring_follower import header_of
from daemon.report_messages import refused as refused_by_gateway

MS = 1_000_000
UTC_NS = 1_760_000_000_123_456_789


@dataclass
class Ask:
    name: str
    payload: bytes = b""
    identity: str = ""
    replies: list = field(default_factory=list)

    def answer(self, message, *, failed=False):
        self.replies.append((message, failed))


def reply(name: str, outcome: str = "done", refused: str = "") -> wire.Reply:
    return wire.Reply(
        seq=1,
        core_boot_id="boot-a",
        cycle=1,
        sample_time_ns=1,
        request=name,
        outcome=outcome,
        refusal=refused_by_gateway(RefusalCode(refused)) if refused else None,
        mode="hold",
    )


class Book:
    """A log on a real folder."""

    def __init__(self, folder: Path, **limits) -> None:
        self.folder = folder
        self.disk = Disk()
        self.file = RequestFile(folder, **limits)
        self.log = RequestLog(self.file, self.disk, UTC_NS, "0.1.0")
        self.now_ns = 0

    def turn(self, after_ms: int = 10) -> None:
        self.now_ns += after_ms * MS
        self.log.turn(self.now_ns, UTC_NS + self.now_ns)

    def ask(self, name: str, payload: bytes = b"{}", outcome: str = "done", refused: str = ""):
        (watched,) = self.log.wrap([Ask(name, payload)], UTC_NS + self.now_ns)
        watched.answer(reply(name, outcome, refused))

    def end(self) -> None:
        self.log.close()
        self.disk.close()
        self.file.close()

    def lines(self) -> list[dict]:
        self.turn()
        self.disk.settle()
        return [json.loads(line) for line in lines_of(self.folder)]


@pytest.fixture
def book(tmp_path):
    made = Book(tmp_path)
    yield made
    made.end()


def test_a_request_is_noted_with_who_what_and_what_became_of_it(book):
    book.ask("enable", b'{"client": "display"}', "refused", "hand_switch_open")

    line = book.lines()[-1]

    assert (line["kind"], line["name"], line["client"]) == ("answered", "enable", "display")
    refusal = {"code": "hand_switch_open", "subject": None, "values": {}, "said": ""}
    assert (line["outcome"], line["refusal"]) == ("refused", refusal)
    assert line["payload"] == {"client": "display"}
    assert line["utc"] == "2025-10-09T08:53:20.123456Z"


def test_a_request_that_is_answered_later_has_a_line_of_its_own_before_its_answer(book):
    (watched,) = book.log.wrap([Ask("mode", b'{"mode": "gait", "client": "a"}')], UTC_NS)
    book.turn()
    book.turn()
    watched.answer(reply("mode"))

    asked, answered = book.lines()[-2:]

    assert (asked["kind"], asked["payload"]["mode"]) == ("asked", "gait")
    assert (answered["kind"], answered["ticket"]) == ("answered", asked["ticket"])


def test_the_answer_goes_out_before_the_line_is_made(book):
    ask = Ask("stop")
    (watched,) = book.log.wrap([ask], UTC_NS)
    full = mock.patch.object(RequestFile, "add", side_effect=AssertionError)
    with full, pytest.raises(AssertionError):
        watched.answer(reply("stop"))

    assert len(ask.replies) == 1


def test_what_only_asks_for_knowledge_is_not_noted(book):
    before = len(book.lines())

    for name in ("status", "config", "schema"):
        ask = Ask(name)
        assert book.log.wrap([ask], UTC_NS) == [ask]

    assert len(book.lines()) == before


@pytest.mark.parametrize(
    ("payload", "shown"),
    [
        (b"no json", "no json"),
        (b"\xff\x00", "\\xff\x00"),
        (b"[" * 4000, "[" * 4000),
        (b'{"client": {"a": 1}}', '{"client": {"a": 1}}'),
        (b'{"a": ' + b"9" * 40 + b"}", '{"a": ' + "9" * 40 + "}"),
        (b'{"client": 7}', {"client": 7}),
    ],
)
def test_a_malformed_query_is_noted_as_it_came(book, payload, shown):
    book.ask("enable", payload, "refused", "bad_payload")

    assert book.lines()[-1]["payload"] == shown
    assert book.lines()[-1]["client"] is None


def test_the_number_of_a_lease_is_not_noted(book):
    book.ask("release", b'{"client": "controller", "lease": 123456789}')

    book.lines()
    assert b"123456789" not in (book.folder / NAME).read_bytes()


def test_mode_and_verdict_follow_as_they_change_and_not_as_they_stay(book, make_record):
    def hear(seq, **changes):
        made = make_record(seq, **changes)
        book.log.record(header_of(msgspec.msgpack.encode(made)))

    opened = Verdict(StopCategory.S1, Cause.HAND_SWITCH_OPEN, "right/hip", said="x")
    book.log.core("boot-a", True)
    hear(1, mode=Mode.GAIT)
    hear(2, mode=Mode.GAIT)
    hear(3, mode=Mode.STOPPING, verdict=opened)
    hear(4, mode=Mode.STOPPING, verdict=msgspec.structs.replace(opened, value=1.0))
    hear(5, mode=Mode.READY)

    said = [
        (line["kind"], line["cycle"], line.get("mode") or line.get("cause"))
        for line in book.lines()
        if line["kind"] in {"mode", "verdict"}
    ]

    assert said == [
        ("mode", 1, "gait"),
        ("mode", 3, "stopping"),
        ("verdict", 3, "hand_switch_open"),
        ("mode", 5, "ready"),
        ("verdict", 5, "none"),
    ]
    assert {line["core_boot_id"] for line in book.lines()} == {None, "boot-a"}


def test_a_flood_of_refusals_is_counted_and_summed_up_and_a_request_among_them_is_not_lost(book):
    for _ in range(500):
        book.ask("enable", b'{"client": "flood"}', "refused", "busy")
    book.ask("enable", b'{"client": "display"}', "done")
    book.turn(60_000)

    lines = book.lines()

    single = [line for line in lines if line.get("client") == "flood" and line["kind"] != "summed"]
    assert len(single) == LINES_PER_MINUTE
    assert [line["count"] for line in lines if line["kind"] == "summed"] == [500 - LINES_PER_MINUTE]
    assert any(line.get("client") == "display" and line["outcome"] == "done" for line in lines)


def test_clients_without_end_are_summed_up_as_others(book):
    for number in range(500):
        book.ask("enable", b'{"client": "c%d"}' % number, "refused", "busy")
    book.turn(60_000)

    summed = [line for line in book.lines() if line["kind"] == "summed"]

    assert len(summed) <= 21
    assert sum(line["count"] for line in summed) == 500 - LINES_PER_MINUTE


def test_every_line_is_there_after_restarts_and_over_files(tmp_path):
    for _ in range(3):
        book = Book(tmp_path, bytes_max=4000)
        for number in range(40):
            book.ask("enable", b'{"client": "c%d"}' % number)
            book.turn()
            book.disk.settle()
        book.end()

    lines = [json.loads(line) for line in lines_of(tmp_path)]

    one = ["start", *["answered"] * 40, "end"]
    assert [line["kind"] for line in lines] == one * 3
    assert [line["client"] for line in lines[1:41]] == [f"c{number}" for number in range(40)]
    assert len(files_of(tmp_path)) > 2


def test_old_files_are_removed_and_the_newest_lines_stay(tmp_path):
    book = Book(tmp_path, bytes_max=2000, files_max=3)
    for number in range(60):
        book.ask("enable", b'{"client": "c%d"}' % number)
        book.turn()
        book.disk.settle()
    book.end()

    clients = [json.loads(line).get("client") for line in lines_of(tmp_path)]

    assert len(files_of(tmp_path)) == 3
    assert clients[:-1] == [f"c{number}" for number in range(61 - len(clients), 60)]


@pytest.mark.parametrize("cut", [1, 2, 40, 100])
def test_a_torn_last_line_is_left_and_the_next_gateway_begins_a_new_one(tmp_path, cut):
    book = Book(tmp_path)
    book.ask("enable", b'{"client": "display"}')
    book.end()
    path = tmp_path / NAME
    torn = path.read_bytes()[:-cut]
    path.write_bytes(torn)

    Book(tmp_path).end()

    assert path.read_bytes().startswith(torn + b"\n")
    found = [fields_of(line) for line in lines_of(tmp_path)]
    assert [one and one["kind"] for one in found[-2:]] == ["start", "end"]
    assert found.count(None) == (cut > 1)


def test_a_disk_that_is_full_loses_nothing_when_it_has_room_again(book):
    real = os.write

    def half(file, data):
        if len(data) < 100:
            raise OSError(28, "No space left on device")
        return real(file, data[: len(data) // 2])

    with mock.patch.object(os, "write", half):
        for _ in range(20):
            book.ask("enable", b'{"client": "display"}')
            book.turn()
            book.disk.settle()
        assert [one.what for one in book.disk.errors()] == ["request log"]
        # Not more often than once a second.
        assert book.disk.failed_count == 1
    book.turn(2000)
    book.turn(2000)

    assert len([line for line in book.lines() if line["kind"] == "answered"]) == 20


def test_lines_for_which_there_is_no_room_are_counted(tmp_path, monkeypatch):
    monkeypatch.setattr(audit_file, "LINES_WAITING_MAX", 200)
    book = Book(tmp_path)
    with mock.patch.object(os, "write", side_effect=OSError(28, "No space left on device")):
        for _ in range(300):
            book.ask("enable")
        book.turn()
        book.disk.settle()
    assert book.log.lost_count > 0
    lost = book.log.lost_count
    book.turn(2000)
    book.turn(2000)
    book.disk.settle()
    book.ask("enable")

    lines = book.lines()
    book.end()

    assert [line["count"] for line in lines if line["kind"] == "lost"] == [lost]


def test_a_log_that_was_moved_away_is_begun_anew_and_goes_on(book):
    book.ask("enable")
    book.lines()
    (book.folder / NAME).rename(book.folder / "moved")
    book.ask("disable")
    book.lines()
    (book.folder / "moved").unlink()
    book.ask("reset")

    assert [line["name"] for line in book.lines()][-1] == "reset"


def test_that_a_lease_was_renewed_is_no_news_and_that_it_was_not_is(book):
    book.ask("acquire", b'{"client": "controller"}')
    for _ in range(5):
        book.ask("acquire", b'{"client": "controller", "lease": 7}')
    book.ask("acquire", b'{"client": "controller", "lease": 8}', "refused", "lease_taken")

    outcomes = [line["outcome"] for line in book.lines() if line.get("name") == "acquire"]

    assert outcomes == ["done", "refused"]


def test_after_a_power_cut_all_lines_that_were_written_are_there_and_the_next_ones_too(tmp_path):
    folder = tmp_path / "state"

    def scenario():
        file = RequestFile(folder, bytes_max=1500, files_max=9)
        for number in range(12):
            file.add(b'{"kind":"asked","number":%d,"filled":"%s"}' % (number, b"x" * 600))
            if number % 3:
                file.flush()
                mark(str(number))

    def recover(marks):
        file = RequestFile(folder, bytes_max=1500, files_max=9)
        file.add(b'{"kind":"asked","number":99}')
        file.flush()
        file.close()
        found = [fields["number"] for fields in map(fields_of, lines_of(folder)) if fields]
        assert found == sorted(found)
        assert {*range(int(marks[-1]) + 1 if marks else 0), 99} <= set(found)

    check(tmp_path, scenario, recover)


def test_a_log_without_an_end_says_whether_the_power_failed(tmp_path):
    def run(computer_boot_id, *, is_ended):
        said = unexpected_end(tmp_path, computer_boot_id)
        disk, file = Disk(), RequestFile(tmp_path)
        log = RequestLog(file, disk, UTC_NS, "0.1.0", False, computer_boot_id)
        if is_ended:
            log.close()
        disk.settle()
        file.flush()
        file.close()
        return said

    assert run("monday", is_ended=True) is None
    assert run("monday", is_ended=False) is None
    full = RequestFile(tmp_path, bytes_max=1)  # the last start is in an older file after this
    full.add(b'{"kind":"answer","utc":"2025-10-09T08:53:20.123456Z"}')
    full.flush()
    full.close()
    assert b"start" not in (tmp_path / NAME).read_bytes()
    last_utc = "2025-10-09T08:53:20.123456Z"
    assert run("monday", is_ended=False) == (EventCode.GATEWAY_KILLED, last_utc)
    assert run("tuesday", is_ended=True) == (EventCode.POWER_FAILED, last_utc)
    with (tmp_path / NAME).open("ab") as file:
        file.write(b'{"kind":"e\0\0')
    assert run("wednesday", is_ended=True) == (EventCode.POWER_FAILED, last_utc)
    assert run("thursday", is_ended=True) is None
