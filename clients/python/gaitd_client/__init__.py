"""Client of gaitd, the drive service of a home gait trainer.

Reading order: `trainer.py` (messages and requests), `stream.py` (what a stream yields, silence),
`subscriptions.py` (its Zenoh subscriber), `lease.py` (assist under a lease), `aio.py` (asyncio),
`wire/` (the messages), `texts/` (their sentences), `connection.py` and `credentials.py` (the Zenoh
session), `signals.py` (the end of a program), `clock.py`, `errors.py`.
"""

from gaitd_names import (
    Cause,
    EventCode,
    Kind,
    Mode,
    Outcome,
    Priority,
    RefusalCode,
    SetpointRefusal,
    Stage,
    StatusBit,
    StopCategory,
    Validity,
)

from gaitd_client import wire
from gaitd_client.aio import AsyncLease, AsyncTrainer
from gaitd_client.clock import Clock, MonotonicClock
from gaitd_client.connection import Target
from gaitd_client.credentials import Credentials, read_credentials
from gaitd_client.errors import (
    ClientError,
    CredentialsError,
    EndpointError,
    NoAnswerError,
    NoServiceError,
    NotReturnedError,
    RequestRefusedError,
)
from gaitd_client.lease import Assist, Law, Lease, Refusal
from gaitd_client.stream import NotValid, Stream, Trouble
from gaitd_client.trainer import Trainer
from gaitd_client.wire import (
    Activity,
    AxisPlan,
    Configuration,
    DriveState,
    Estimate,
    Event,
    Friction,
    Health,
    PlanLimits,
    Reply,
    Safety,
    Status,
    Stride,
)

__all__ = [
    "Activity",
    "Assist",
    "AsyncLease",
    "AsyncTrainer",
    "AxisPlan",
    "Cause",
    "ClientError",
    "Clock",
    "Configuration",
    "Credentials",
    "CredentialsError",
    "DriveState",
    "EndpointError",
    "Estimate",
    "Event",
    "EventCode",
    "Friction",
    "Health",
    "Kind",
    "Law",
    "Lease",
    "Mode",
    "MonotonicClock",
    "NoAnswerError",
    "NoServiceError",
    "NotReturnedError",
    "NotValid",
    "Outcome",
    "PlanLimits",
    "Priority",
    "Refusal",
    "RefusalCode",
    "Reply",
    "RequestRefusedError",
    "Safety",
    "SetpointRefusal",
    "Stage",
    "Status",
    "StatusBit",
    "StopCategory",
    "Stream",
    "Stride",
    "Target",
    "Trainer",
    "Trouble",
    "Validity",
    "read_credentials",
    "wire",
]
