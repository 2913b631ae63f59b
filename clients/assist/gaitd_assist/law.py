"""The interface of a law: one leg's newest sample in, its part of the setpoint out."""

from typing import NamedTuple, Protocol

import msgspec
from gaitd_client import Assist

Pair = tuple[float, float]
"""Hip and slide: rad, rad/s or N·m; m, m/s or N."""
Known = tuple[float | None, float | None]
"""As `Pair`; None: not known."""


class Sample(NamedTuple):
    """One leg in one cycle, as a law needs it; pairs are hip and slide."""

    dt_s: float
    """Time since the sample before."""
    phase_ratio: float | None
    """Phase 0..1 of the stride; None: no gait plays, for example in mode torque."""
    cadence_hz: float | None
    """Strides per second; None: no gait plays, or this is its first sample after a gap."""
    error: Pair
    """Reference minus estimated pose: rad, m; 0 without a gait."""
    error_rate: Pair
    """Its rate of change: rad/s, m/s."""
    velocity: Pair
    """Estimated velocity: rad/s, m/s."""
    friction: Known
    """Estimated friction, positive against positive velocity: N·m, N. None: at rest, or not ok."""
    learns: tuple[bool, bool]
    """False: a law must not change its memory of this axis now."""
    is_cut: tuple[bool, bool] = (False, False)
    """True: less assist is in force than was asked for, so an error teaches nothing about it."""
    needed: Known = (None, None)
    """Effort that the reference's motion needs beyond the load: N·m, N. None: nothing is guided."""
    patient: Known = (None, None)
    """Estimated effort of the patient: N·m, N. None: at rest, or not ok."""
    patient_std: Known = (None, None)
    """Its standard deviation."""


Values = dict[str, float | list[float] | None]


class Memory(msgspec.Struct, frozen=True, kw_only=True):
    """What a law has learned, with names as in the message `controller`."""

    values: Values = {}
    """Values of the leg, by names that end in their unit."""
    hip: Values = {}
    """Values of the hip; its positions, velocities and efforts have no unit in their name."""
    slide: Values = {}


class Law(Protocol):
    """A law of one leg. Its memory is its own; `LegController` decides when it may learn."""

    def begin_gait(self) -> None:
        """Another gait begins."""
        ...

    def answer(self, sample: Sample, setpoint: Assist) -> Assist:
        """Return the setpoint with this law's part added.

        Args:
            sample: the leg now.
            setpoint: the sum of the laws before this one; the first one gets a neutral setpoint.
        """
        ...

    def end_stride(self) -> None:
        """Learn from the stride that has ended."""
        ...

    def state(self) -> Memory:
        """Return the memory for log and displays."""
        ...


def outside(error: float, dead_band: float) -> float:
    """Return the part of an error outside of the dead band; 0 within."""
    return max(error - dead_band, 0.0) + min(error + dead_band, 0.0)
