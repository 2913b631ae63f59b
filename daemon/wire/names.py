"""Names of enums on the wire, and the observer's enums once more.

The gateway does not import the observer, and clients do not import the gateway: `StatusBit` and
`Validity` are the observer's numbers as records hold them, which `tests/daemon/test_wire.py`
compares. `gaitd_client.wire.names` has the names that clients receive, which
`tests/clients/python/test_distribution.py` compares.
"""

from enum import Enum, IntEnum, IntFlag


class StatusBit(IntFlag):
    """Status bits of the observer's estimate: `status` in each message that holds an estimate."""

    VALID = 1 << 0
    WARM_UP = 1 << 1
    PREDICT_ONLY = 1 << 2
    GATED = 1 << 3
    STANDSTILL_HIP = 1 << 4
    STANDSTILL_SLIDE = 1 << 5
    NEAR_SINGULAR = 1 << 6
    OUT_OF_WORKSPACE = 1 << 7
    LATE = 1 << 8
    INCONSISTENT = 1 << 9
    UNREFERENCED = 1 << 10
    ARTIFICIAL = 1 << 11
    INPUT_SATURATED = 1 << 12
    NEAR_LIMIT = 1 << 13
    UNCALIBRATED = 1 << 14


class Validity(IntEnum):
    """Validity of one axis' estimate."""

    OK = 0
    SPLIT_UNOBSERVABLE = 1
    """At rest only patient minus friction is observable: both are null, the net value is given."""
    BAD = 2
    """All values of the axis are null."""


def name_of(member: Enum) -> str:
    """The name of a mode, cause, outcome or status bit on the wire."""
    return member.name.lower()


def printable(text: str) -> str:
    """The text with line breaks and control characters as escapes, for one line of output."""
    return "".join(one if one.isprintable() else ascii(one)[1:-1] for one in text)
