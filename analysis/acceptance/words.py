"""The sentences of a record and its procedure, from the operator's catalogue.

Their fields are the values of a code by name, those of `Catalogue.about`, and of an instruction and
a reason `state` and `remedy` (the service's mode, and what to do about its stop) and `refusal`, of
a finding `section` and `report`.
"""

from gaitd_client import StopCategory, wire
from gaitd_texts import Catalogue

from analysis.acceptance.record import Finding, Reason, Service, Values


def sentence(
    texts: Catalogue,
    key: str,
    subject: str,
    values: Values,
    service: Service,
    refusal: wire.Refusal | None,
) -> str:
    """The text of an instruction or a reason."""
    verdict = service.verdict
    fields = {
        **values,
        "state": state_text(texts, service),
        "remedy": "" if verdict is None else texts.remedy(verdict.cause),
        "refusal": "" if refusal is None else texts.refusal(refusal),
    }
    return texts.about(key, subject, fields)


def reason_text(texts: Catalogue, reason: Reason) -> str:
    """Why something was not measured, has failed, or is not tried."""
    key = f"reason.{reason.code}"
    return sentence(texts, key, reason.subject, reason.values, reason.service, reason.refusal)


def finding_texts(texts: Catalogue, finding: Finding) -> tuple[str, str, str]:
    """What was examined, what was measured or why it was not, and what is allowed."""
    values = {**finding.values, "section": finding.section}
    if (one := finding.report) is not None:
        values["report"] = texts.report(one.code, one.subject, one.values, one.said)
    asked, measured, allowed = (
        texts.about(f"{group}.{finding.code}", finding.drive, values)
        for group in ("asked", "measured", "allowed")
    )
    if finding.reason is not None:
        measured = reason_text(texts, finding.reason)
    return asked, measured, allowed


def state_text(texts: Catalogue, service: Service) -> str:
    """Mode and stop of the service."""
    if not service.mode:
        return texts.text("status.no_records")
    mode, verdict = texts.text(f"mode.{service.mode}"), service.verdict
    if verdict is None or verdict.category == StopCategory.NONE:
        return mode
    return f"{mode}: {texts.verdict(verdict)}"
