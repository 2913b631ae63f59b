"""The gateway's log: one event per line, with its known properties as fields.

Under systemd the lines go into the journal with their fields (`daemon/system/journal.py`), else to
stderr as logfmt: `level="warning" text="..." kind="stop" cause="drive_silent" drive="right/hip"`.
"""

import json
import logging
from typing import Final, TextIO

from daemon.system.journal import Journal

_PRIORITY: Final = {logging.ERROR: 3, logging.WARNING: 4, logging.INFO: 6, logging.DEBUG: 7}
"""Priorities of syslog(3) by logging level."""
_FIELDS: Final = {
    "kind": "GAITD_EVENT",
    "code": "GAITD_CODE",
    "priority": "GAITD_PRIORITY",
    "id": "GAITD_EVENT_ID",
    "mode": "GAITD_MODE",
    "cause": "GAITD_CAUSE",
    "drive": "GAITD_DRIVE",
    "cycle": "GAITD_CYCLE",
}
"""Journal field names by logfmt names."""


def known(record: logging.LogRecord) -> dict[str, str]:
    """Fields of a log record beside its text, by logfmt name; empty if the record is no event."""
    event = getattr(record, "event", None)
    if event is None:
        return {}
    fields = {
        "kind": event.kind,
        "code": event.code,
        "priority": event.priority,
        "id": event.id,
        "mode": getattr(record, "mode", None),
        "cause": event.cause,
        "drive": event.subject,
        "cycle": event.cycle,
    }
    return {name: str(value) for name, value in fields.items() if value is not None}


class Logfmt(logging.Formatter):
    """Formats a log record as level, text and fields, each as key="value"."""

    def format(self, record: logging.LogRecord) -> str:
        """Format the record as one line, with line breaks escaped."""
        return " ".join(
            f"{key}={json.dumps(value, ensure_ascii=False)}"
            for key, value in _fields(record).items()
        )


class JsonLine(logging.Formatter):
    """Formats a log record as one JSON object, with the fields of logfmt."""

    def format(self, record: logging.LogRecord) -> str:
        """Format the record as one line."""
        return json.dumps({"event": "log", **_fields(record)}, ensure_ascii=False)


class JournalHandler(logging.Handler):
    """Logging handler for the journal, which drops and counts lines that it has no room for."""

    def __init__(self, journal: Journal) -> None:
        super().__init__()
        self._journal = journal

    def emit(self, record: logging.LogRecord) -> None:
        """Send one log record to the journal; never blocks."""
        priority = _PRIORITY.get(record.levelno, _PRIORITY[logging.INFO])
        fields = {_FIELDS[name]: value for name, value in known(record).items()}
        self._journal.write(_text(record), priority, fields)


def _fields(record: logging.LogRecord) -> dict[str, str]:
    return {"level": record.levelname.lower(), "text": _text(record), **known(record)}


def _text(record: logging.LogRecord) -> str:
    """The message, followed by the traceback if there is one."""
    if not record.exc_info:
        return record.getMessage()
    return f"{record.getMessage()}\n{logging.Formatter().formatException(record.exc_info)}"


def begin(journal: Journal, level: str, json_out: TextIO | None = None) -> None:
    """Configure logging: the journal if it is open, else stderr; `level` is a lower-case name.

    With `json_out` each line goes there, too, as a JSON object.
    """
    if journal.is_open:
        handler: logging.Handler = JournalHandler(journal)
    else:
        handler = logging.StreamHandler()
        handler.setFormatter(Logfmt())
    handlers = [handler]
    if json_out is not None:
        handlers.append(logging.StreamHandler(json_out))
        handlers[-1].setFormatter(JsonLine())
    logging.basicConfig(level=level.upper(), handlers=handlers, force=True)


def set_level(level: str) -> None:
    """Set the lowest level that is logged."""
    logging.getLogger().setLevel(level.upper())
