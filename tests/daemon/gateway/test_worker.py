"""Threads that wait for a disk go on whatever happens in them, and what happened is told."""

import os
from unittest import mock

import pytest
from gaitd_names import Cause, StopCategory
from msgspec.structs import replace
from records import HEADER, record

from daemon.ipc.record import Verdict
from daemon.ipc.ring_clip import FOLDER, clip_files
from daemon.ipc.transport import CoreChannel, GatewayChannel
from daemon.recorder.audit_file import RequestFile, numbered
from daemon.recorder.black_box import AFTER_NS
from daemon.recorder.disk import Disk, WriteError
from daemon.recorder.recorder import DiskRecorder
from daemon.recorder.state_file_sync import StateFileSync

MS = 1_000_000
OPEN = Verdict(StopCategory.S1, Cause.HAND_SWITCH_OPEN, "right/hip")
FOREIGN = ("requests.2026-11-22.jsonl", "requests.0.jsonl", "requests.9999999999.jsonl")


def broken():
    raise ValueError("invalid literal for int() with base 10: '2026-11-22'")


def test_a_job_that_fails_unexpectedly_is_told_once_and_the_next_ones_are_done():
    disk = Disk()
    done = []

    for _ in range(3):
        disk.submit("request log", broken)
    disk.submit("black box", lambda: done.append("kept"))
    disk.settle()
    told = disk.errors()
    disk.submit("request log", lambda: done.append("written"))
    disk.submit("request log", broken)
    disk.close()

    assert done == ["kept", "written"]
    assert disk.failed_count == 4
    assert [(one.what, one.reason.split(":")[0]) for one in told] == [
        ("request log", "unexpected ValueError")
    ]
    assert disk.errors()[0] == WriteError("request log", "")


@pytest.mark.parametrize("name", FOREIGN)
def test_a_foreign_file_in_the_state_folder_is_no_part_of_the_log(tmp_path, name):
    foreign = tmp_path / name
    foreign.write_text("not ours\n")
    log = RequestFile(tmp_path, bytes_max=100, files_max=3)
    for number in range(20):
        log.add(b"x" * 60 + b"%d" % number)
        log.flush()
    log.close()

    assert foreign.read_text() == "not ours\n"
    assert [path.name for path in numbered(tmp_path)] == [
        "requests.000008.jsonl",
        "requests.000009.jsonl",
    ]


class Clock:
    ns = 1_000 * MS

    def now_ns(self):
        return self.ns

    def utc_ns(self):
        return 1_760_000_000_000_000_000 + self.ns


def test_a_stop_is_kept_after_the_request_log_has_failed_by_an_unforeseen_error(tmp_path):
    clock, state = Clock(), tmp_path / "state"
    keeper = DiskRecorder(state, tmp_path, clock, "0.1.0")
    core, ipc = CoreChannel(tmp_path, HEADER), GatewayChannel(tmp_path)
    told = []

    def cycles(first, count, **changes):
        for seq in range(first, first + count):
            core.publish(replace(record(seq), **changes))
            ipc.records()
            clock.ns += 10 * MS
            told.extend(keeper.turn(ipc.ring, clock.ns))
            if seq % 100 == 0:  # as often as it tries again: the thread must have had its time
                keeper._disk.settle()

    with mock.patch.object(RequestFile, "flush", side_effect=ValueError("unforeseen")):
        cycles(1, 300)
    count = AFTER_NS // (10 * MS) + 200
    cycles(301, count, verdict=OPEN)
    keeper.close()
    core.close()
    ipc.close()

    texts = [(one.code, one.said) for one in told]
    failed = ("file_not_written", "request log: unexpected ValueError: unforeseen")
    assert texts.count(failed) == 1
    assert ("file_written_again", "request log") in texts
    assert next(iter(clip_files(state / FOLDER))).kept.cause == "hand_switch_open"
    assert 1 <= keeper.not_kept_count <= 5


def test_the_notes_are_looked_at_again_after_an_unforeseen_error(tmp_path, caplog):
    path = tmp_path / "axes.json"
    path.write_bytes(b"page")
    fails = [MemoryError("no room")] * 3
    with (
        mock.patch("daemon.recorder.state_file_sync.PERIOD_S", 0.005),
        mock.patch.object(os, "read", side_effect=[*fails, b"page", *[b"page"] * 10_000]),
    ):
        disk = StateFileSync(path)
        while not disk._synced:
            disk._over.wait(0.005)
        disk.close()

    assert disk._synced == b"page"
    assert caplog.text.count("not on the disk: unexpected MemoryError") == 1


def test_the_end_does_not_wait_for_notes_that_fail_to_the_last(tmp_path):
    with mock.patch.object(os, "open", side_effect=ValueError("unforeseen")):
        StateFileSync(tmp_path / "axes.json").close()
