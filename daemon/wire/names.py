"""Names of enums on the wire, and enums of observer and drives once more.

The gateway imports neither observer nor drives, and clients do not import the gateway: `StatusBit`,
`Validity`, `PowerState` and `NmtState` are the numbers that records hold, which
`tests/daemon/test_wire.py` compares. `gaitd_client.wire.names` has the names that clients
receive, which `tests/clients/python/test_distribution.py` compares.
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


class PowerState(IntEnum):
    """CiA 402 power state of a drive; UNKNOWN until its first statusword."""

    UNKNOWN = 0
    NOT_READY_TO_SWITCH_ON = 1
    SWITCH_ON_DISABLED = 2
    READY_TO_SWITCH_ON = 3
    SWITCHED_ON = 4
    OPERATION_ENABLED = 5
    QUICK_STOP_ACTIVE = 6
    FAULT_REACTION_ACTIVE = 7
    FAULT = 8


class NmtState(IntEnum):
    """CiA 301 NMT state of a drive; UNKNOWN until its first heartbeat."""

    BOOT_UP = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F
    UNKNOWN = 0xFF


def name_of(member: Enum) -> str:
    """The name of a mode, cause, outcome or status bit on the wire."""
    return member.name.lower()


def printable(text: str) -> str:
    """The text with line breaks and control characters as escapes, for one line of output."""
    return "".join(one if one.isprintable() else ascii(one)[1:-1] for one in text)
