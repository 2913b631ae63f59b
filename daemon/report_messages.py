"""Events, refusals, verdicts and progress of records as messages.

The record has values in the order of `wire/report_fields.py`, a message has them by name.
"""

import math

from gaitd_client import wire
from gaitd_names import RefusalCode, StopCategory

from daemon.ipc.record import Verdict
from daemon.ipc.report import Event, Progress, Refusal
from daemon.wire.report_fields import (
    PROGRESS_FIELDS,
    REFUSAL_FIELDS,
    VERDICT_FIELDS,
    named_values,
    values_of,
)


def judgement(verdict: Verdict) -> wire.Judgement:
    """The verdict as published; value and limit are null where nothing stops."""
    stops = verdict.category is not StopCategory.NONE
    return wire.Judgement(
        category=verdict.category,
        cause=verdict.cause,
        drive=verdict.drive or None,
        value=_finite(verdict.value) if stops else None,
        limit=_finite(verdict.limit) if stops else None,
        finding=verdict.finding,
        said=verdict.said,
    )


def event_values(event: Event) -> wire.Values:
    """The values of a core's event by name; those of a refusal with its code."""
    return _with_null(values_of(event))


def verdict_values(verdict: Verdict) -> wire.Values:
    """The values of an event that reports a verdict."""
    return _with_null(named_values(VERDICT_FIELDS, verdict.values))


def refusal_message(refusal: Refusal) -> wire.Refusal:
    """A refusal of the core."""
    return wire.Refusal(
        code=refusal.code,
        subject=refusal.subject or None,
        values=_with_null(named_values(REFUSAL_FIELDS[refusal.code], refusal.values)),
        said=refusal.said,
    )


def refused(code: RefusalCode, said: str = "", **values: float | str | None) -> wire.Refusal:
    """A refusal of the gateway."""
    return wire.Refusal(code=code, subject=None, values=values, said=said)


def progress_message(progress: Progress | None) -> wire.Progress | None:
    """What the machine does now."""
    if progress is None:
        return None
    return wire.Progress(
        code=progress.code,
        subject=progress.subject or None,
        values=_with_null(named_values(PROGRESS_FIELDS[progress.code], progress.values)),
    )


def _with_null(values: dict[str, float | str]) -> wire.Values:
    return {
        name: value if isinstance(value, str) else _finite(value) for name, value in values.items()
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
