"""The acceptance record of one drive: what was examined and measured, in codes and numbers.

What was not measured is a finding as well, with the reason. `words.py` has the sentence of each.
"""

from collections.abc import Mapping
from enum import StrEnum, auto
from pathlib import Path
from typing import Annotated, Final, Literal

import msgspec
from gaitd_client import wire
from msgspec import Meta

from daemon.ipc.decoding import Decoder, Name, RefusedError

SCHEMA: Final = "gaitd.acceptance.v1"
Values = Mapping[str, float | str | None]
"""By name, which ends in the unit: `_si` in those of the drive's joint (`wire.JOINTS`)."""
NO_VALUES: Final[Values] = {}


class Judgement(StrEnum):
    """Verdict of a finding, a section or a record."""

    PASSED = auto()
    FAILED = auto()
    NOT_MEASURED = auto()
    NOTED = auto()
    """A value for the record, for which the configuration has no limit."""


class ReasonCode(StrEnum):
    """Why something was not measured, has failed, or is not tried."""

    NO_SERVICE = auto()
    OTHER_FILES = auto()
    INTERRUPTED = auto()
    NOT_CONFIRMED = auto()
    """The operator did not agree to it, do it, or see it."""
    REFUSED = auto()
    NO_MODE = auto()
    """The service is not in the mode that is needed."""
    NOT_IN_TIME = auto()
    STOPPED = auto()
    STO_ACTED = auto()
    """Stopped, where the operator was asked to press the emergency stop."""
    UNREAD = auto()
    FAILED_BEFORE = auto()
    """An earlier step has failed, without which this one is not tried."""
    MOVED_OPPOSITE = auto()
    NO_RESULT = auto()
    NOT_MOVED = auto()
    NO_SAMPLE = auto()
    NO_STOP = auto()
    NOT_OBEYED = auto()


class Section(StrEnum):
    """Parts of the record, in their order."""

    IDENTITY = auto()
    TORQUE_BASE = auto()
    OPTION_CODES = auto()
    SETTINGS = auto()
    PDOS = auto()
    SIGN = auto()
    UNITS = auto()
    POSITION = auto()
    SELF_TEST = auto()
    STOP_BY_REQUEST = auto()
    STOP_BY_HAND_SWITCH = auto()
    STOP_BY_STO = auto()
    REST = auto()
    """What was not done because the procedure was interrupted."""
    LIMITS = auto()


class FindingCode(StrEnum):
    """What was examined."""

    STEP = auto()
    """The whole of a section."""
    OBJECT = auto()
    OBJECT_BEFORE = auto()
    """An object that bring-up has not written."""
    NOTED_OBJECT = auto()
    # an axis
    PUSHED = auto()
    EFFORT = auto()
    OWN_JUDGEMENT = auto()
    DIRECTION = auto()
    UNITS = auto()
    REFERENCED = auto()
    LOAD = auto()
    # a stop
    CATEGORY = auto()
    SPEED = auto()
    REACTION = auto()
    AT_REST = auto()
    """There was no motion whose end could be measured."""
    TIME_TO_REST = auto()
    WAY_TO_REST = auto()
    RAMP = auto()
    EFFORT_AFTER = auto()
    WAY_WITHOUT_POWER = auto()
    # limits
    STOP_ACTS = auto()
    BOUND = auto()
    TORQUE_LIMIT = auto()
    SPEED_LIMIT = auto()
    POSITION_LIMITS = auto()
    FOLLOWING_ERROR = auto()
    HEARTBEAT = auto()


class Service(msgspec.Struct, frozen=True):
    """Mode and verdict of the service."""

    mode: str = ""
    """Name of the mode; empty: there is no record."""
    verdict: wire.Judgement | None = None


class Report(msgspec.Struct, frozen=True):
    """An event of the core."""

    code: str
    subject: str
    values: Values
    said: str
    """What a drive or the operating system has said."""


class Reason(msgspec.Struct, frozen=True):
    """Why something was not measured, has failed, or is not tried."""

    code: ReasonCode
    subject: str = ""
    values: Values = {}
    service: Service = Service()
    refusal: wire.Refusal | None = None


class Finding(msgspec.Struct, frozen=True):
    """One thing that was examined on a drive, with its verdict."""

    drive: str
    """LEG/AXIS."""
    section: Section
    code: FindingCode
    judgement: Judgement
    values: Values = {}
    reason: Reason | None = None
    """In place of the measured value."""
    report: Report | None = None
    """What the core itself has found."""


class StopTrace(msgspec.Struct, frozen=True, kw_only=True):
    """One stop of one axis, cycle by cycle, from raw drive values; SI units at the joint."""

    drive: str
    category: str
    cause: str
    """Cause of the most severe verdict: STO is an EMCY, S1, before a sample shows its contact."""
    is_obeyed: bool
    """The stop had not to be escalated because this axis did not obey."""
    speed_si_per_s: float
    """At the verdict."""
    reaction_s: float | None
    """Until the drive shows that it brakes (S1) or has no torque (S0)."""
    time_s: tuple[float, ...]
    """From the cycle of the verdict."""
    position_si: tuple[float | None, ...]
    velocity_si_per_s: tuple[float | None, ...]
    effort_si: tuple[float | None, ...]
    rest_s: float | None
    """When the axis came to rest; None: not in these records."""
    distance_si: float | None
    """The largest from the position of the verdict, until rest."""


class AcceptanceRecord(msgspec.Struct, frozen=True, kw_only=True):
    """Everything that was asked of one drive and measured on it."""

    schema: Literal["gaitd.acceptance.v1"] = SCHEMA
    drive: Name
    """LEG/AXIS."""
    node_id: Annotated[int, Meta(ge=1, le=127)]
    utc: str
    """Begin, ISO 8601."""
    gaitd_version: str
    core_boot_id: str
    """Empty if there was no record of the core."""
    profile: str
    """Name of the profile's file."""
    profile_verified_on_hardware: bool
    sha256: dict[str, str]
    """Hash of each file of the configuration, by its name."""
    findings: tuple[Finding, ...]
    stops: tuple[StopTrace, ...]

    def count(self, judgement: Judgement) -> int:
        """Number of findings with this verdict."""
        return sum(one.judgement is judgement for one in self.findings)

    @property
    def judgement(self) -> Judgement:
        """FAILED if a finding is, else NOT_MEASURED if one is, else PASSED."""
        for one in (Judgement.FAILED, Judgement.NOT_MEASURED):
            if self.count(one):
                return one
        return Judgement.PASSED


_decoded: Final = Decoder(msgspec.json.Decoder(AcceptanceRecord).decode).decode


def write(record: AcceptanceRecord, path: Path) -> None:
    """Write a record as JSON.

    Raises:
        OSError: the file cannot be written.
    """
    path.write_bytes(msgspec.json.format(msgspec.json.encode(record), indent=1) + b"\n")


def read(path: Path) -> AcceptanceRecord:
    """Read a record.

    Raises:
        RefusedError: the file holds no acceptance record of this version.
        OSError: it cannot be read.
    """
    try:
        return _decoded(path.read_bytes())
    except RefusedError as error:
        raise RefusedError(f"{path}: no record {SCHEMA}: {error}") from error
