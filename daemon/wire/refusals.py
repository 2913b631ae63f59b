"""Reasons for refusing a setpoint, for gateway and core, which both refuse and count.

`gaitd_client.wire.refusals` has the same reasons as names, with their texts for clients.
"""

from enum import IntEnum


class SetpointRefusal(IntEnum):
    """Reason for refusing a setpoint; lists of counts are in this order."""

    NONE = 0
    TOO_LARGE = 1
    MALFORMED = 2
    UNKNOWN_LEG = 3
    UNLEASED = 4
    WRONG_LEASE = 5
    REPEATED = 6
    REORDERED = 7
    STALE = 8
    AHEAD = 9
    NON_FINITE = 10
    OUT_OF_RANGE = 11
    GUIDANCE_IS_POSITION = 12
    WRONG_MODE = 13
    FLOOD = 14
