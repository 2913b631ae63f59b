"""Known and observed state of one drive, and the record of a violation."""

from dataclasses import dataclass
from typing import NamedTuple

from sim_drives.cia402.power_state import PowerState
from sim_drives.node import Node


class AxisRules(NamedTuple):
    """Constants of one drive from the files of the plant and the limits; joint SI."""

    name: str
    node_id: int
    axis: int
    """0 hip, 1 slide."""
    leg: str
    low_si: float
    high_si: float
    effort_per_count_si: float
    """Joint effort per count of 6071h, absolute."""
    rate_si_per_s: float
    damping_si: float
    """Damping of the core's hold: N·m·s/rad, N·s/m."""


class Violation(NamedTuple):
    """A violated rule."""

    at_s: float
    rule: str
    what: str

    def __str__(self) -> str:
        return f"{self.at_s:.3f} s: {self.rule}: {self.what}"


@dataclass
class WatchedDrive:
    """Observed state of one drive."""

    rules: AxisRules
    node: Node
    commanded_enable: bool = False
    begins: bool = False
    """True if enabling has just been commanded: the next torque is the first one."""
    commanded_mode: int = 0
    commanded_torque: int | None = None
    """6071h, while the drive is commanded to enable in cyclic torque."""
    load_si: float = 0.0
    """Effort that would hold the joint still at its last pose; N·m, N."""
    damper_si: float = 0.0
    """What the damper of the hold adds at its last speed, absolute; N·m, N."""
    commanded_ns: int = 0
    commanded_until_ns: int = -(10**18)
    """End of the last enable command."""
    state: PowerState = PowerState.NOT_READY_TO_SWITCH_ON
    unpowered_ns: int = 0
    """Time at which the drive was last seen without its power stage."""
    blinded_ns: int = -(10**18)
    """End of the effect of a fault of BLINDING, BEFORE_S included."""
    delayed_ns: int = -(10**18)
    was_off: bool = True
    late_disable_reported: bool = False
    """True if a failure to leave operation enabled was already reported."""
    led_outside_si: float = 0.0
    """Distance that the joint was moved out in a way that no drive could have prevented."""
