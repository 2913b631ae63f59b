"""Shared fields of the messages: states of the drives, and the types and heads of messages.

The descriptions here are part of the JSON Schemas of `messages.py`.
"""

from typing import Annotated, Final

import msgspec
from gaitd_names import (
    Cause,
    Kind,
    Mode,
    Outcome,
    Priority,
    Stage,
    StatusBit,
    StopCategory,
    Validity,
)
from gaitd_names.joints import open_names
from msgspec import Meta

ModeName = Annotated[
    str, Meta(description="Mode of the service.", extra_json_schema=open_names(Mode))
]
StageName = Annotated[
    str,
    Meta(
        description="How far the exercise of the mode is: preparing and announcing, nothing moves;"
        " approaching its pose; playing what was requested; ending; over.",
        extra_json_schema=open_names(Stage),
    ),
]
CauseName = Annotated[
    str,
    Meta(
        description="Cause of a stop, `none` if there is none.", extra_json_schema=open_names(Cause)
    ),
]
CategoryName = Annotated[
    str,
    Meta(
        description="Stop category: S2 brake and hold, S1 quick stop, S0 voltage off, or none.",
        extra_json_schema=open_names(StopCategory),
    ),
]
OutcomeName = Annotated[
    str,
    Meta(
        description="done, refused, or pending: not answered in time, the result is unknown.",
        extra_json_schema=open_names(Outcome),
    ),
]
ValidityName = Annotated[
    str,
    Meta(
        description="ok; split_unobservable: at rest patient and friction cannot be separated, "
        "both are null and the net value is given; bad: all values of the axis are null.",
        extra_json_schema=open_names(Validity),
    ),
]
PriorityName = Annotated[
    str,
    Meta(
        description="As in IEC 60601-1-8: high, medium, low; info is no alarm.",
        extra_json_schema=open_names(Priority),
    ),
]
KindName = Annotated[
    str, Meta(description="What sort of event.", extra_json_schema=open_names(Kind))
]
Flags = Annotated[
    tuple[Annotated[str, Meta(extra_json_schema=open_names(StatusBit))], ...],
    Meta(description="What the observer says about this estimate, by name."),
]
FlagBits = Annotated[str, Meta(description="The same as hexadecimal bits, as in recordings.")]
Phase = Annotated[
    float | None, Meta(description="Phase 0..1 of this leg's stride; null when no gait plays.")
]


QUANTITY: Final = "x-quantity"
"""Keyword of the schema of a field whose unit is the joint's: it names a field of `Joint`."""
POSITION: Final = "position"
VELOCITY: Final = "velocity"
EFFORT: Final = "effort"


def of_joint(quantity: str, description: str) -> Meta:
    """Description of a field of an axis: its unit is that of the joint's position, for example."""
    return Meta(description=description, extra_json_schema={QUANTITY: quantity})


DEVIATION: Final = "Standard deviation of the field of the same name; null where that is null."
Std = Annotated[float | None, Meta(description=DEVIATION)]
PositionStd = Annotated[float | None, of_joint(POSITION, DEVIATION)]
VelocityStd = Annotated[float | None, of_joint(VELOCITY, DEVIATION)]
EffortStd = Annotated[float | None, of_joint(EFFORT, DEVIATION)]
Patient = Annotated[
    float | None, of_joint(EFFORT, "Patient's effort; positive drives the position up.")
]
FrictionEffort = Annotated[
    float | None, of_joint(EFFORT, "Friction; positive opposes positive velocity.")
]
Net = Annotated[
    float | None, of_joint(EFFORT, "Patient minus friction: observable also at standstill.")
]


class Stated(msgspec.Struct, frozen=True, kw_only=True):
    """Head of messages that are also sent without a record of the core, with three fields null."""

    seq: Annotated[int, Meta(description="Counts the messages of this key; a gap is a loss.")]
    core_boot_id: Annotated[str | None, Meta(description="Changes when the core restarts.")]
    cycle: Annotated[int | None, Meta(description="Cycle of the 10 ms grid since core start.")]
    sample_time_ns: Annotated[
        int | None, Meta(description="UTC of that cycle's SYNC in ns since 1970; for records only.")
    ]


class Sampled(Stated, frozen=True, kw_only=True):
    """Head of messages made from one record of the core."""

    core_boot_id: Annotated[str, Meta(description="Changes when the core restarts.")]
    cycle: Annotated[int, Meta(description="Cycle of the 10 ms grid since core start.")]
    sample_time_ns: Annotated[
        int, Meta(description="UTC of that cycle's SYNC in ns since 1970; for records only.")
    ]


class Estimated(Sampled, frozen=True, kw_only=True):
    """Head of messages that hold an estimate of one leg."""

    leg: Annotated[str, Meta(description="right or left")]
    mode: ModeName
    status: Flags
    status_bits: FlagBits
