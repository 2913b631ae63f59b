"""The part of a cycle's record about controllers (`record.py`): what they asked, what is done."""

import msgspec


class LegAssistRecord(msgspec.Struct, frozen=True, array_like=True):
    """What a controller has in force on one leg in one cycle."""

    seq: int
    """Of the newest setpoint that counted; -1: none has, under the lease that is held."""
    wanted: tuple[float, float]
    """Of the setpoint that is followed, or was before it grew stale: N·m, N."""
    assist: tuple[float, float]
    """In force, inside limit, rate and power: N·m, N."""
    stiffness_ratio: float
    """In force, of what guidance is configured with."""


class AssistRecord(msgspec.Struct, frozen=True, array_like=True):
    """Setpoints and assist in one cycle; counts since the core's start. The lease is a secret."""

    legs: tuple[LegAssistRecord, ...] = ()
    """In the order of `CycleRecord.legs`."""
    accepted_count: int = 0
    refused_count: tuple[int, ...] = ()
    """By the core, in the order of `daemon.wire.refusals.SetpointRefusal`."""
    lapse_count: int = 0
    """Times that assist ended because of its lease or of stale setpoints."""
    lapse_reason: str = ""
    """Of the newest."""
