"""The gateway's log: one event per line, with what is known of it as fields.

Under systemd the lines go into the journal with their fields (`daemon/system/journal.py`), else to
stderr as logfmt: `level="warning" text="..." kind="stop" cause="drive_silent" drive="right/hip"`.
"""

import json
import logging
from typing import Final

from daemon.system.journal import Journal

_PRIORITY: Final = {logging.ERROR: 3, logging.WARNING: 4, logging.INFO: 6, logging.DEBUG: 7}
"""Of syslog(3), by level."""
_FIELDS: Final = {
    "kind": "GAITD_EVENT",
    "priority": "GAITD_PRIORITY",
    "id": "GAITD_EVENT_ID",
    "mode": "GAITD_MODE",
    "cause": "GAITD_CAUSE",
    "drive": "GAITD_DRIVE",
    "cycle": "GAITD_CYCLE",
}
"""Names of the journal, by those of logfmt."""


def known(record: logging.LogRecord) -> dict[str, str]:
    """What a line knows beside its text, by the names of logfmt; empty for one of no event."""
    event = getattr(record, "event", None)
    if event is None:
        return {}
    fields = {
        "kind": event.kind,
        "priority": event.priority,
        "id": event.id,
        "mode": getattr(record, "mode", None),
        "cause": event.cause,
        "drive": event.subject,
        "cycle": event.cycle,
    }
    return {name: str(value) for name, value in fields.items() if value is not None}


class Logfmt(logging.Formatter):
    """Level, text, and what is known as key="value"."""

    def format(self, record: logging.LogRecord) -> str:
        """One line, whatever the text is."""
        fields = {"level": record.levelname.lower(), "text": _text(record), **known(record)}
        return " ".join(
            f"{key}={json.dumps(value, ensure_ascii=False)}" for key, value in fields.items()
        )


class JournalHandler(logging.Handler):
    """Into the journal; a line that it has no room for is dropped and counted there."""

    def __init__(self, journal: Journal) -> None:
        super().__init__()
        self._journal = journal

    def emit(self, record: logging.LogRecord) -> None:
        """Never waits, never raises."""
        priority = _PRIORITY.get(record.levelno, _PRIORITY[logging.INFO])
        fields = {_FIELDS[name]: value for name, value in known(record).items()}
        self._journal.tell(_text(record), priority, fields)


def _text(record: logging.LogRecord) -> str:
    """With the traceback, where there is one."""
    if record.exc_info is None:
        return record.getMessage()
    return f"{record.getMessage()}\n{logging.Formatter().formatException(record.exc_info)}"


def begin(journal: Journal, level: str) -> None:
    """Send what is logged to its place; `level` is a name of logging, in small letters."""
    if journal.is_open:
        handler: logging.Handler = JournalHandler(journal)
    else:
        handler = logging.StreamHandler()
        handler.setFormatter(Logfmt())
    logging.basicConfig(level=level.upper(), handlers=[handler], force=True)


def set_level(level: str) -> None:
    """From now on only what is at least so important."""
    logging.getLogger().setLevel(level.upper())
