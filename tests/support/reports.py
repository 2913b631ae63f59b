"""Verdicts and refusals that the core's events report."""

from gaitd_names import Cause, Finding, RefusalCode, StopCategory

from daemon.ipc.record import Verdict
from daemon.ipc.report import Event, Refusal


def verdict_of(report: Event | Refusal) -> Verdict:
    """The verdict that an event of `VERDICTS` or a refusal STOPPED has reported."""
    category, cause, value, limit, finding = report.values[:5]
    return Verdict(
        StopCategory(category),
        Cause(cause),
        report.subject,
        value,
        limit,
        Finding(finding),
        report.said,
    )


def refusal_of(event: Event) -> Refusal:
    """The refusal that an event REQUEST_REFUSED has reported."""
    _, _, code, *values = event.values
    return Refusal(RefusalCode(code), event.subject, tuple(values), event.said)
