"""The objects of a drive as findings: which drive it is, what bring-up has written or checks."""

from collections.abc import Generator
from typing import Final

from analysis.acceptance.record import (
    Finding,
    FindingCode,
    Judgement,
    Reason,
    ReasonCode,
    Section,
)
from drives.bringup.plan import DrivePlan
from drives.bringup.port import DrivePort
from drives.canopen.objects import Object
from drives.service.compare import Compared, read_with_plan
from drives.service.dump import read_objects, variable_at
from drives.service.eds import load_eds
from drives.service.scan import Progress
from gaitd.commissioning.messages import PASSED_OR_FAILED

NOTED: Final = (
    (Object.DEVICE_NAME, 0, "device_name"),
    (Object.HARDWARE_VERSION, 0, "hardware_version"),
    (Object.SOFTWARE_VERSION, 0, "firmware"),
    (Object.IDENTITY, 4, "serial_number"),
)
"""What says which drive it was, where its EDS has it; an axis file may leave its serial number out.

The firmware of an EPOS4 is its revision, 1018h:03, which bring-up checks."""
COMMANDS: Final = frozenset(
    (Object.CONTROLWORD, Object.MODE, Object.TARGET_TORQUE, Object.TARGET_POSITION)
)
"""Objects that the service commands all the time."""
OPTION_CODES: Final = frozenset((0x1029, 0x6007, 0x605A, 0x605B, 0x605C, 0x605D, 0x605E))
IDENTITY: Final = frozenset((0x1000, 0x1018, 0x6502))
FIXED: Final = frozenset((Section.IDENTITY, Section.TORQUE_BASE))
"""Sections that bring-up only checks."""
PDOS: Final = range(0x1400, 0x1C00)


def read_findings(
    plan: DrivePlan, port: DrivePort, *, is_set_up: bool
) -> Generator[Progress, None, tuple[Finding, ...]]:
    """Read all of them; each object is a finding.

    Raises:
        SdoTimeout: several objects in a row were not answered.
        DescriptionError: its EDS cannot be used.
        BusError: the bus is down.
    """
    description = plan.description
    sheet = load_eds(description.eds, description.node_id)
    noted = [one for one in NOTED if sheet.get(*one[:2]) is not None]
    texts = [variable_at(sheet, index, sub, 32) for index, sub, _ in noted]
    entries = yield from read_objects(description.node_id, texts, port)
    compared = yield from read_with_plan(plan, sheet, port)
    bases = {(base.ref.index, base.ref.sub) for base in description.torque_bases}
    findings = [
        Finding(
            description.name,
            Section.IDENTITY,
            FindingCode.NOTED_OBJECT,
            Judgement.NOTED,
            {"noted": name, "place": one.place, "found": one.trouble or str(one.value)},
        )
        for (*_, name), one in zip(noted, entries, strict=True)
    ]
    for one in compared:
        if one.index in COMMANDS:
            continue
        section = _section(one, bases)
        code, judged = FindingCode.OBJECT, PASSED_OR_FAILED[one.same]
        if not (is_set_up or section in FIXED):
            code, judged = FindingCode.OBJECT_BEFORE, Judgement.NOTED
        values = {"place": one.place, "name": one.name, "why": one.why}
        values |= {"found": one.found, "wanted": one.wanted}
        findings.append(Finding(description.name, section, code, judged, values))
    return tuple(findings)


def unread(drive: str, why: str) -> tuple[Finding, ...]:
    """The finding of a drive whose objects could not be read."""
    reason = Reason(ReasonCode.UNREAD, drive, {"said": why})
    judged = Judgement.NOT_MEASURED
    return (Finding(drive, Section.IDENTITY, FindingCode.STEP, judged, reason=reason),)


def _section(one: Compared, bases: set[tuple[int, int]]) -> Section:
    if one.index in IDENTITY:
        return Section.IDENTITY
    if (one.index, one.sub) in bases:
        return Section.TORQUE_BASE
    if one.index in OPTION_CODES:
        return Section.OPTION_CODES
    return Section.PDOS if one.index in PDOS else Section.SETTINGS
