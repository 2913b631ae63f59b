"""Part of a cycle's record about controllers: assist requested and in force (`record.py`)."""

import msgspec


class LegAssistRecord(msgspec.Struct, frozen=True, array_like=True):
    """Assist in force on one leg in one cycle."""

    seq: int
    """`seq` of the newest accepted setpoint under the current lease; -1: none."""
    wanted: tuple[float, float]
    """Assist of the setpoint that is followed, or was until it became stale: N·m, N."""
    assist: tuple[float, float]
    """Assist in force, inside limit, rate and power: N·m, N."""
    stiffness_ratio: float
    """Stiffness in force, as a ratio of the configured stiffness of guidance."""


class AssistRecord(msgspec.Struct, frozen=True, array_like=True):
    """Setpoints and assist in one cycle, without the lease number; counts since core start."""

    legs: tuple[LegAssistRecord, ...] = ()
    """In the order of `CycleRecord.legs`."""
    accepted_count: int = 0
    refused_count: tuple[int, ...] = ()
    """Setpoints refused by the core, in the order of `daemon.wire.refusals.SetpointRefusal`."""
    lapse_count: int = 0
    """Times that assist ended because the lease ended or setpoints were stale."""
    lapse_reason: str = ""
    """Reason of the newest lapse."""
