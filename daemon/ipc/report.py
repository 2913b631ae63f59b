"""What the core reports: events as codes with a subject and numbers.

Rules:
1. A program reads code, subject and values; `daemon/wire/report_fields.py` names the values of
   each code. A sentence is made where a person reads it (`gaitd_texts`).
2. `said` is the only free text: what a drive, the kernel or a library has said. Nothing is decided
   by it.
"""

from typing import Final

import msgspec
from gaitd_names import EventCode, ProgressCode, RefusalCode

EVENTS_MAX: Final = 8
"""Most events of one record; the others are put into the next one."""
SAID_BYTES_MAX: Final = 160
"""Maximum size of `said`: the slot of a record has a fixed size."""


class Progress(msgspec.Struct, frozen=True, array_like=True):
    """The present step of a bring-up or an exercise."""

    code: ProgressCode
    subject: str = ""
    values: tuple[float | str, ...] = ()
    """As in an event."""


class Refusal(msgspec.Struct, frozen=True, array_like=True):
    """Why a request is refused."""

    code: RefusalCode
    subject: str = ""
    """The leg or the axis it is about, the first of several; empty if none."""
    values: tuple[float | str, ...] = ()
    """As in an event."""
    said: str = ""
    """A name that the client has sent, or what the configuration knows in its place."""


class Event(msgspec.Struct, frozen=True, array_like=True):
    """One event of the core."""

    code: EventCode
    subject: str = ""
    """The leg or the axis it is about, `right` or `right/hip`; empty if none."""
    values: tuple[float | str, ...] = ()
    """Numbers in SI units, and names of `gaitd_names`; their order belongs to the code."""
    said: str = ""
