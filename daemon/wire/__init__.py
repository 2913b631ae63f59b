"""The wire contract: every message on Zenoh, its types, and the JSON Schemas made from it.

Reading order: `fields.py` (enums as names, types and heads that messages share), `messages.py` (all
messages, keys and schemas), `leg_messages.py`, `health_messages.py`, `causes.py` with
`cause_texts.py` (category and text of each stop cause), `refusals.py` (why a setpoint is refused).
"""

from daemon.wire.fields import Stated
from daemon.wire.health_messages import Health
from daemon.wire.leg_messages import Activity, Estimate, Friction, Stride
from daemon.wire.messages import (
    ALIVE,
    CONTROL,
    EVENTS,
    HEALTH,
    MESSAGES,
    ONE_LINE,
    SAFETY,
    SETPOINT,
    UNNAMED_CLIENT,
    AcquireAsk,
    Ask,
    Configuration,
    DriveState,
    Emergency,
    Event,
    Judgement,
    ModeAsk,
    ReleaseAsk,
    Reply,
    Safety,
    Schemas,
    SetpointMessage,
    Status,
    encoding,
    key,
    schema,
    schemas,
)

__all__ = [
    "ALIVE",
    "CONTROL",
    "EVENTS",
    "HEALTH",
    "MESSAGES",
    "ONE_LINE",
    "SAFETY",
    "SETPOINT",
    "UNNAMED_CLIENT",
    "AcquireAsk",
    "Activity",
    "Ask",
    "Configuration",
    "DriveState",
    "Emergency",
    "Estimate",
    "Event",
    "Friction",
    "Health",
    "Judgement",
    "ModeAsk",
    "ReleaseAsk",
    "Reply",
    "Safety",
    "Schemas",
    "SetpointMessage",
    "Stated",
    "Status",
    "Stride",
    "encoding",
    "key",
    "schema",
    "schemas",
]
