"""What the gateway logs: fields in the journal, logfmt elsewhere."""

import logging
import shlex

import pytest
from gaitd_client import wire
from journald import Journald

from daemon.gateway import log
from daemon.system.journal import Journal

EVENT = wire.Event(
    seq=1,
    core_boot_id="b",
    cycle=1234,
    sample_time_ns=5,
    id="b-7-1",
    time_ns=5,
    priority="high",
    kind="stop",
    code="stopped",
    cause="drive_silent",
    subject="right/hip",
    values={},
    said="",
)
TEXT = 'stop S1: "silent"\nright/hip'
EXTRA = {"event": EVENT, "mode": "stopping"}


@pytest.fixture(autouse=True)
def root():
    """Logging as it was before."""
    logger = logging.getLogger()
    handlers, level = logger.handlers, logger.level
    yield logger
    logger.handlers = handlers
    logger.setLevel(level)


def test_an_event_in_the_journal_can_be_found_by_its_fields(tmp_path):
    with Journald(tmp_path / "socket") as journald:
        log.begin(Journal("gaitd-gateway", journald.path), "info")

        logging.getLogger("gaitd.gateway").error("%s", TEXT, extra=EXTRA)

        assert journald.entries() == [
            {
                "MESSAGE": TEXT,
                "PRIORITY": "3",
                "SYSLOG_IDENTIFIER": "gaitd-gateway",
                "GAITD_EVENT": "stop",
                "GAITD_CODE": "stopped",
                "GAITD_PRIORITY": "high",
                "GAITD_EVENT_ID": "b-7-1",
                "GAITD_MODE": "stopping",
                "GAITD_CAUSE": "drive_silent",
                "GAITD_DRIVE": "right/hip",
                "GAITD_CYCLE": "1234",
            }
        ]


def test_what_is_logged_of_no_event_has_no_fields_of_one(tmp_path):
    with Journald(tmp_path / "socket") as journald:
        log.begin(Journal("gaitd-gateway", journald.path), "info")

        logging.getLogger("another").warning("a ring of %s records", 3)

        [entry] = journald.entries()
        assert entry["MESSAGE"] == "a ring of 3 records"
        assert entry["PRIORITY"] == "4"
        assert not [name for name in entry if name.startswith("GAITD_")]


def test_an_exception_brings_its_traceback(tmp_path):
    with Journald(tmp_path / "socket") as journald:
        log.begin(Journal("gaitd-gateway", journald.path), "info")

        try:
            int("ours")
        except ValueError:
            logging.getLogger("gaitd").exception("a callback failed")

        [entry] = journald.entries()
        assert entry["MESSAGE"].startswith("a callback failed\nTraceback")
        assert "ValueError: invalid literal" in entry["MESSAGE"]


def test_elsewhere_an_event_is_one_line_of_logfmt_whatever_its_text(capsys):
    log.begin(Journal("gaitd-gateway", None), "info")

    logging.getLogger("gaitd.gateway").error("%s", TEXT, extra=EXTRA)

    [line] = capsys.readouterr().err.splitlines()
    fields = dict(word.split("=", 1) for word in shlex.split(line))
    assert fields["level"] == "error"
    assert (fields["code"], fields["cause"]) == ("stopped", "drive_silent")
    assert fields["mode"] == "stopping"
    assert fields["drive"] == "right/hip"
    assert fields["cycle"] == "1234"


def test_what_is_less_important_than_the_level_is_not_logged(capsys):
    log.begin(Journal("gaitd-gateway", None), "warning")
    logger = logging.getLogger("gaitd.gateway")

    logger.info("one")
    log.set_level("info")
    logger.info("two")

    assert [line for line in capsys.readouterr().err.splitlines() if "text" in line] == [
        'level="info" text="two"'
    ]
