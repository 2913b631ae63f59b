"""Reasons for refusing a setpoint, with their meaning and what to do.

A refused setpoint changes nothing: the one before it stays in force until it is stale. Each reason
is counted in `health`; the first of each under a lease is an event.
"""

from collections.abc import Mapping
from enum import StrEnum, auto
from typing import Final, NamedTuple


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


class RefusalText(NamedTuple):
    """Meaning and remedy of a refusal, for the developer of a client."""

    meaning: str
    remedy: str


REFUSAL_TEXT: Final[Mapping[str, RefusalText]] = {
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
        "no client holds the lease: it was never acquired, it expired, or a stop ended it",
        "check the state of the machine, then acquire the lease",
    ),
    SetpointRefusal.WRONG_LEASE: RefusalText(
        "its lease is not the one that is held",
        "use the number from the reply to `acquire`; `safety` names the holder",
    ),
    SetpointRefusal.REPEATED: RefusalText(
        "its `seq` has been accepted before", "increase `seq` with each message of a leg"
    ),
    SetpointRefusal.REORDERED: RefusalText(
        "a setpoint with a higher `seq` was received before it",
        "send the setpoints of a leg from one program, in order",
    ),
    SetpointRefusal.STALE: RefusalText(
        "`for_cycle` is older than `setpoint_age_max_cycles`",
        "answer each estimate at once, with its own `cycle`",
    ),
    SetpointRefusal.AHEAD: RefusalText(
        "`for_cycle` is a cycle in the future",
        "use `cycle` of the newest estimate; it starts at 0 after a restart of the core",
    ),
    SetpointRefusal.NON_FINITE: RefusalText(
        "one of its numbers is not finite", "find the NaN in the controller"
    ),
    SetpointRefusal.OUT_OF_RANGE: RefusalText(
        "assist is beyond `assist_max_nm` or `assist_max_n`, or `stiffness_ratio` is not in 0..1",
        "limit it to `limits` of `safety`, and in a session's gait to the caps of `plan` in"
        " `status`; a larger value is refused, not limited",
    ),
    SetpointRefusal.GUIDANCE_IS_POSITION: RefusalText(
        "with guidance 'position' the drives control the torque, and no assist can be added",
        "have the operator configure guidance 'impedance'",
    ),
    SetpointRefusal.WRONG_MODE: RefusalText(
        "the mode is neither torque nor gait, and the setpoint is not neutral",
        "send zero assist and full stiffness until `mode` of the estimate is torque or gait",
    ),
    SetpointRefusal.FLOOD: RefusalText(
        "more setpoints arrived than are processed; only the newest of the lease holder are",
        "send at most one setpoint for each estimate",
    ),
}
"""Texts by reason."""
