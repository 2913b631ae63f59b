"""The acceptance record of one drive: lines of what was asked, measured and allowed, and a verdict.

What was not measured is a line as well, with the reason in place of the measured value.
"""

from enum import Enum
from pathlib import Path
from typing import Annotated, Final, Literal

import msgspec
from msgspec import Meta

from daemon.ipc.decoding import Decoder, Name, RefusedError

SCHEMA: Final = "gaitd.acceptance.v1"


class Judgement(Enum):
    """Verdict of a line, a section or a record."""

    PASSED = "passed"
    FAILED = "failed"
    NOT_MEASURED = "not measured"
    NOTED = "noted"
    """A value for the record, for which the configuration has no limit."""


class Line(msgspec.Struct, frozen=True):
    """One thing that was examined."""

    asked: str
    measured: str
    """If it was not measured, the reason."""
    allowed: str
    judgement: Judgement


class Section(msgspec.Struct, frozen=True):
    """Lines about one subject."""

    title: str
    lines: tuple[Line, ...]


class StopTrace(msgspec.Struct, frozen=True):
    """One stop of one axis, cycle by cycle, from raw drive values; SI units at the joint."""

    title: str
    position_unit: str
    effort_unit: str
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
    sections: tuple[Section, ...]
    stops: tuple[StopTrace, ...]

    def count(self, judgement: Judgement) -> int:
        """Number of lines with this verdict."""
        return sum(line.judgement is judgement for part in self.sections for line in part.lines)

    @property
    def judgement(self) -> Judgement:
        """FAILED if a line is, else NOT_MEASURED if a line is, else PASSED."""
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
