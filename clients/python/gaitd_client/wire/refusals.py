"""Reasons for refusing a setpoint; `gaitd_client.texts` has their meaning and what to do.

A refused setpoint changes nothing: the one before it stays in force until it is stale. Each reason
is counted in `health`; the first of each under a lease is an event.
"""

from enum import StrEnum, auto


class SetpointRefusal(StrEnum):
    """Reason for refusing a setpoint."""

    TOO_LARGE = auto()
    MALFORMED = auto()
    UNKNOWN_LEG = auto()
    UNLEASED = auto()
    WRONG_LEASE = auto()
    REPEATED = auto()
    REORDERED = auto()
    STALE = auto()
    AHEAD = auto()
    NON_FINITE = auto()
    OUT_OF_RANGE = auto()
    GUIDANCE_IS_POSITION = auto()
    WRONG_MODE = auto()
    FLOOD = auto()
