"""The journal's native protocol, read by a socket that stands where journald's would be."""

import os
import socket

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from journald import Journald, parsed

from daemon.system.journal import LENGTH_MAX, Journal, encoded, is_journal, to_stderr

NAMES = st.from_regex(r"[A-Z][A-Z0-9_]{0,30}", fullmatch=True)
VALUES = st.text(st.characters(exclude_categories=["Cs"]), max_size=200)


@pytest.fixture
def journald(tmp_path):
    with Journald(tmp_path / "socket") as server:
        yield server


@settings(max_examples=25)
@given(st.dictionaries(NAMES, VALUES, max_size=4))
def test_what_is_encoded_is_read_back_whatever_the_text_is(fields):
    assert parsed(encoded(fields)) == fields


def test_a_line_has_its_text_priority_identifier_and_fields(journald):
    journal = Journal("gaitd-core", journald.path)

    journal.write("right/hip is silent", 3, {"GAITD_CAUSE": "drive_silent"})

    assert journald.entries() == [
        {
            "MESSAGE": "right/hip is silent",
            "PRIORITY": "3",
            "SYSLOG_IDENTIFIER": "gaitd-core",
            "GAITD_CAUSE": "drive_silent",
        }
    ]


def test_a_journal_that_takes_nothing_costs_a_line_and_never_waits(journald):
    journal = Journal("gaitd-core", journald.path)
    sent = 0
    while journal.dropped_count == 0:
        journal.write("x" * 1000, 6, {})
        sent += 1

    journal.write("another", 6, {})
    kept = journald.entries()
    journal.write("room again", 6, {})

    assert len(kept) == sent - 1
    assert journal.dropped_count == 2
    assert journald.entries()[0]["GAITD_DROPPED"] == "2"
    journal.write("and on", 6, {})
    assert "GAITD_DROPPED" not in journald.entries()[0]


def test_a_journal_that_is_started_anew_gets_the_next_line(tmp_path):
    path = tmp_path / "socket"
    with Journald(path) as first:
        journal = Journal("gaitd-core", path)
        journal.write("one", 6, {})
        assert len(first.entries()) == 1
    journal.write("no reader", 6, {})
    with Journald(path) as second:
        journal.write("two", 6, {})

        assert [entry["MESSAGE"] for entry in second.entries()] == ["two"]
    assert journal.dropped_count == 1


def test_a_text_that_is_too_long_for_a_datagram_is_cut(journald):
    journal = Journal("gaitd-core", journald.path)

    journal.write("x" * 10_000_000, 3, {})

    assert len(journald.entries()[0]["MESSAGE"]) == LENGTH_MAX


def test_without_a_journal_nothing_is_sent_and_nothing_is_counted():
    journal = Journal("gaitd-core", None)

    journal.write("text", 6, {})

    assert not journal.is_open
    assert journal.dropped_count == 0


def test_stderr_is_the_journal_only_if_journal_stream_names_its_device_and_inode():
    ours, theirs = socket.socketpair()
    with ours, theirs:
        status = os.fstat(ours.fileno())
        named = f"{status.st_dev}:{status.st_ino}"

        assert is_journal(named, ours.fileno())
        assert not is_journal(named, theirs.fileno())
        for nothing in (None, "", "8", "a:b", f"{status.st_dev}:"):
            assert not is_journal(nothing, ours.fileno())


def test_no_stderr_at_all_is_no_journal():
    reader, writer = os.pipe()
    os.close(reader)
    os.close(writer)

    assert not is_journal("1:2", writer)


def test_a_file_name_that_is_no_text_is_written_to_standard_error_all_the_same(capfd):
    to_stderr("no such file: \udcff.toml")

    assert capfd.readouterr().err == "no such file: \\udcff.toml\n"
