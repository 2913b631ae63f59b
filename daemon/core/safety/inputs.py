"""What safety looks at in one cycle: all that is known of each axis, each leg, and the service."""

from dataclasses import dataclass

from daemon.core.safety.effort_monitor import EffortWatch
from daemon.core.safety.limits import AxisLimits
from daemon.core.steps.joints import Joint
from drives.signals import DriveFeedback


@dataclass(frozen=True, slots=True)
class AxisSituation:
    """All that is known of one axis when it is judged."""

    name: str
    feedback: DriveFeedback
    joint: Joint
    limits: AxisLimits
    referenced: bool
    preparing: bool
    """One axis of the empty machine is homed or tested: none needs to be referenced for that."""
    homing: bool
    """The drive moves this axis by itself, up to a mechanical stop, and sets its origin anew."""
    tracking_si: float
    """Distance to the reference; 0 where nothing is tracked."""
    wanted_velocity_si: float
    """Of the reference; 0 where nothing is guided."""
    counts_sign: int
    """1 where the drive's own direction is the joint's, else -1."""
    loop_distance_si: float
    """Between the joint and where the drive's own loops hold it; infinite where they hold nothing
    and effort is what we command."""
    enable_wanted: bool
    reached_enabled: bool
    """It has been enabled, in its mode and following, since it was asked to."""
    unready_cycles: int
    """Cycles in a row in which it should be that and was not."""
    unasked_cycles: int
    """Cycles in a row in which it had power, or may have had, and nobody here had asked for it."""
    seen_off: bool
    """It has been off since power was last asked for: power that it shows now is another's."""
    reaction_cycles: int
    """So long its fault reaction may last."""
    mode_wanted: int
    new_emergency: bool
    """An EMCY that asks for a stop has come, and was not judged yet."""
    watch: EffortWatch
    """Whether its drive gives the effort that it is asked for."""
    stride_energy_j: float
    """Net, into the leg, over the last stride."""
    stride_drift_si: float
    """Mean effort over the last stride that nothing explains; 0 while no whole stride is known."""
    stopping_end_si: float
    """Where the axis comes to rest if it brakes now."""
    spasm_cycles: int
    """How long the patient has been working against the motion; 0: not at all."""
    spasm_rise_si: float
    error_found: str = ""
    """What the drive said of the fault in which bring-up found it."""


@dataclass(frozen=True, slots=True)
class LegSituation:
    """All that is known of one leg when it is judged."""

    name: str
    singularity_ratio: float
    """|sin| of the angle between shank and shoe; 0 where the mechanism does not close."""
    stopping_ratio: float
    """The smallest singularity ratio on the way to rest of both axes."""
    observer_bad_cycles: int
    """Cycles in a row for which the observer has been of no use while it should be."""


@dataclass(frozen=True, slots=True)
class ServiceSituation:
    """All that is known of the bus, the gateway and ourselves when a cycle is judged."""

    stop_requested: bool
    shutdown_requested: bool
    gateway_age_cycles: int
    overruns_in_a_row: int
    bus_off: bool
    bus_error: str
    tx_dropped_in_a_row: int
