"""Safety inputs of one cycle: raw ones of axes, legs and service, and those of the estimate.

The raw checks get `SafetyInputs`, which have nothing of the observer.
"""

from collections.abc import Sequence

from msgspec import Struct

from daemon.core.safety.effort_monitor import EffortWatch
from daemon.core.safety.joints import Joint
from daemon.core.safety.limits import AxisLimits, Categories, Thresholds
from drives.signals import DriveFeedback


class AxisInputs(Struct, frozen=True):
    """Safety inputs of one axis."""

    name: str
    feedback: DriveFeedback
    joint: Joint
    limits: AxisLimits
    referenced: bool
    preparing: bool
    """One axis of the empty machine is homed or tested: no axis needs to be referenced for that."""
    homing: bool
    """The drive moves this axis by itself, up to a mechanical stop, and sets its origin anew."""
    tracking_si: float
    """Distance to the reference; 0 where nothing is tracked."""
    held: bool
    """Mode HOLD holds its pose, and has settled: a narrower limit of that distance is in force."""
    wanted_velocity_si: float
    """Velocity of the reference; 0 where nothing is guided."""
    counts_sign: int
    """1 where the drive's positive direction is the joint's, else -1."""
    loop_distance_si: float
    """Distance between the joint and where the drive's own loops hold it.

    Infinite where they do not hold it and the core commands the effort.
    """
    enable_wanted: bool
    reached_enabled: bool
    """The drive has been enabled, in its mode and following, since this was requested."""
    unready_cycles: int
    """Cycles in a row in which it should be enabled, in its mode and following, and was not."""
    unexpected_enable_cycles: int
    """Cycles in a row in which it had power, or may have had, without a request by the core."""
    shown_unpowered: bool
    """It has been off since power was last requested: power it shows now has another source."""
    reaction_cycles: int
    """Longest duration of its fault reaction."""
    mode_wanted: int
    new_emergency: bool
    """An EMCY that requires a stop has been received and not checked yet."""
    sign_trusted: bool
    """Its sign is proven for its drive, and nothing since has put it in doubt."""
    watch: EffortWatch
    """Monitor of the drive's effort against the commanded one."""
    stride_energy_j: float
    """Net energy into the leg over the last stride."""
    stride_drift_si: float
    """Mean effort residual over the last stride; 0 while no whole stride is known."""
    stopping_end_si: float
    """Position at which the axis comes to rest if it brakes now."""
    bring_up_error: tuple[int, str] = (0, "")
    """Code and text of the fault that bring-up found in the drive; 0 and empty: none."""


class LegInputs(Struct, frozen=True):
    """Safety inputs of one leg."""

    name: str
    singularity_ratio: float
    """|sin| of the angle between shank and shoe; 0 where the mechanism does not close."""
    stopping_ratio: float
    """The smallest singularity ratio on the way to rest of both axes."""
    seeks_home: bool
    """An axis of this leg is homed and its home is not found yet: the pose is in doubt."""


class ServiceInputs(Struct, frozen=True):
    """Safety inputs of the bus, the gateway and the core itself."""

    stop_requested: bool
    shutdown_requested: bool
    gateway_age_cycles: int
    overruns_in_a_row: int
    bus_off: bool
    bus_error: str
    tx_dropped_in_a_row: int


class SafetyInputs(Struct, frozen=True):
    """All that the raw checks read in one cycle."""

    service: ServiceInputs
    axes: Sequence[AxisInputs]
    """Every axis of every leg."""
    legs: Sequence[LegInputs]
    thresholds: Thresholds
    categories: Categories
    """Stop category of each cause."""
    driving: bool
    """The drives are, or were just, enabled.

    While they are not, only the loss or the fault of a drive counts: there is no motion to stop.
    """


class AxisEstimateInputs(Struct, frozen=True):
    """What the estimate shows of the patient at one axis."""

    name: str
    limits: AxisLimits
    spasm_cycles: int
    """Duration of a spasm, in which the patient works against the motion; 0: none."""
    spasm_rise_si: float
    clonus_cycles: int
    """Duration of clonus within its window."""
    clonus_swing_si: float


class LegEstimateInputs(Struct, frozen=True):
    """What the estimate shows of one leg."""

    name: str
    axes: Sequence[AxisEstimateInputs]
    observer_bad_cycles: int
    """Cycles in a row without a valid estimate while the observer runs."""
    seeks_home: bool
    """See `LegInputs`."""
