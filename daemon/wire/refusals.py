"""Reasons for refusing a setpoint: one table for gateway and core, which both refuse and count.

A refused setpoint changes nothing: the one before it stays in force until it is stale. Each reason
is counted in `health`; the first of each under a lease is an event.
"""

from enum import IntEnum
from typing import Final, NamedTuple


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


class RefusalText(NamedTuple):
    """Meaning and remedy of a refusal, for the developer of a client."""

    meaning: str
    remedy: str


REFUSAL_TEXT: Final[dict[SetpointRefusal, RefusalText]] = {
    SetpointRefusal.TOO_LARGE: RefusalText(
        "its payload is longer than 1024 bytes", "send the fields of the schema, nothing else"
    ),
    SetpointRefusal.MALFORMED: RefusalText(
        "it is not the JSON of `gaitd.setpoint.v2`: a field is missing, unknown or of another type",
        "compare it with `control/schema`",
    ),
    SetpointRefusal.UNKNOWN_LEG: RefusalText(
        "its key names a leg that this trainer does not have", "see `leg_names` of `control/config`"
    ),
    SetpointRefusal.UNLEASED: RefusalText(
        "nobody holds the lease: it was never acquired, it lapsed, or a stop ended it",
        "acquire it, with what the machine does now in view",
    ),
    SetpointRefusal.WRONG_LEASE: RefusalText(
        "its lease is not the one that is held",
        "take the number that `acquire` gave; `safety` names the holder",
    ),
    SetpointRefusal.REPEATED: RefusalText(
        "its `seq` has been accepted before", "count `seq` up with each message of a leg"
    ),
    SetpointRefusal.REORDERED: RefusalText(
        "a setpoint with a higher `seq` has come before it",
        "send the setpoints of a leg from one place, in order",
    ),
    SetpointRefusal.STALE: RefusalText(
        "`for_cycle` is further back than `setpoint_age_max_cycles`",
        "answer each estimate at once, with its own `cycle`",
    ),
    SetpointRefusal.AHEAD: RefusalText(
        "`for_cycle` is a cycle that has not been yet",
        "take `cycle` of the newest estimate; after a restart of the core it begins anew",
    ),
    SetpointRefusal.NON_FINITE: RefusalText(
        "one of its numbers is not finite", "look for the NaN in the controller"
    ),
    SetpointRefusal.OUT_OF_RANGE: RefusalText(
        "assist is beyond `assist_max_nm` or `assist_max_n`, or `stiffness_ratio` is not in 0..1",
        "bound it to the limits that `safety` shows; it is refused and not cut off",
    ),
    SetpointRefusal.GUIDANCE_IS_POSITION: RefusalText(
        "with guidance 'position' the drives give the torque, and nothing can be added",
        "ask the operator for guidance 'impedance'",
    ),
    SetpointRefusal.WRONG_MODE: RefusalText(
        "the mode is neither torque nor gait, and it asks for more than nothing",
        "send zero assist and full stiffness until `mode` of the estimate is torque or gait",
    ),
    SetpointRefusal.FLOOD: RefusalText(
        "more came than are looked at; the newest of who holds the lease are",
        "send at most one setpoint for each estimate",
    ),
}
"""Texts by reason."""
