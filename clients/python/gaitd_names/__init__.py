"""Names of the service: the enums of its records and its messages, each defined once.

Reading order: `modes.py` (modes, stages, and what changes a mode), `stops.py` (categories and
causes of stops), `requests.py` (requests, roles, refusals), `events.py` (events),
`measured.py` (drives and estimates), `joints.py` (joints and their units), `exit_codes.py` (how a
program has ended).

A member is the string that recordings and messages hold. In a message that a client receives the
field is a plain string, because a later version of the service may send a name that this version
does not know. So compare (`estimate.mode == Mode.TORQUE`), and expect other names. Names have no
order and are all true, `none` too.
"""

from gaitd_names.events import CyclePart, EventCode, Kind, Priority
from gaitd_names.exit_codes import ExitCode
from gaitd_names.measured import NMT_STATES, POWER_STATES, Doubt, StatusBit, Validity
from gaitd_names.modes import AxisStep, Failure, Mode, MotionPhase, ProgressCode, Stage, Trigger
from gaitd_names.requests import (
    Lapse,
    Outcome,
    RefusalCode,
    RequestKind,
    Role,
    SelfTestDue,
    SetpointRefusal,
    Untested,
)
from gaitd_names.stops import Cause, Finding, StopCategory

__all__ = [
    "NMT_STATES",
    "POWER_STATES",
    "AxisStep",
    "Cause",
    "CyclePart",
    "Doubt",
    "EventCode",
    "ExitCode",
    "Failure",
    "Finding",
    "Kind",
    "Lapse",
    "Mode",
    "MotionPhase",
    "Outcome",
    "Priority",
    "ProgressCode",
    "RefusalCode",
    "RequestKind",
    "Role",
    "SelfTestDue",
    "SetpointRefusal",
    "Stage",
    "StatusBit",
    "StopCategory",
    "Trigger",
    "Untested",
    "Validity",
]
