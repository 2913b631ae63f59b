"""What the core writes into the journal and for `systemctl status`: operator's texts, in English.

The catalogue is read once, when the process starts.
"""

from typing import Final

from gaitd_names import Cause
from gaitd_texts import Reader, catalogue

from daemon.ipc.record import CycleRecord, Verdict
from daemon.ipc.report import Event
from daemon.wire.report_fields import PROGRESS_FIELDS, named_values, values_of

TEXTS: Final = catalogue(Reader.OPERATOR, "en")


def event_text(event: Event) -> str:
    """The sentence of an event."""
    return TEXTS.report(event.code, event.subject, values_of(event), event.said)


def verdict_text(verdict: Verdict) -> str:
    """The sentence of a verdict; empty if nothing stops."""
    return "" if verdict.cause is Cause.NONE else TEXTS.verdict(verdict)


def status_text(record: CycleRecord) -> str:
    """One line: mode, stage and progress, the verdict, and in brackets the codes of messages."""
    stage, progress = record.stage, record.progress
    now = [TEXTS.text(f"mode.{record.mode}")]
    if stage is not None:
        now.append(TEXTS.text(f"stage.{stage}"))
    if progress is not None:
        values = named_values(PROGRESS_FIELDS[progress.code], progress.values)
        now.append(TEXTS.about(f"progress.{progress.code}", progress.subject, values))
    verdict = record.verdict
    stops = verdict.cause is not Cause.NONE
    parts = [", ".join(word for word in now if word), verdict_text(verdict)]
    codes = [record.mode, *((verdict.cause, verdict.drive) if stops else ())]
    text = ": ".join(part for part in parts if part)
    return one_line(f"{text} [{' '.join(code for code in codes if code)}]")


def one_line(text: str) -> str:
    """The text without line breaks, because a line break ends a value in systemd's protocol."""
    return " ".join(text.split())
