"""What the watch knows and remembers of one drive, and what a violation says."""

from dataclasses import dataclass
from typing import NamedTuple

from sim_drives.canopen.node import Node
from sim_drives.cia402.power_state import PowerState


class AxisRules(NamedTuple):
    """What is known of one drive from the files of the plant and the limits; joint SI."""

    name: str
    node_id: int
    axis: int
    """0 hip, 1 slide."""
    leg: str
    low_si: float
    high_si: float
    effort_per_count_si: float
    """Of 6071h, absolute."""
    rate_si_per_s: float


class Violation(NamedTuple):
    """A rule that was broken."""

    at_s: float
    rule: str
    what: str

    def __str__(self) -> str:
        return f"{self.at_s:.3f} s: {self.rule}: {self.what}"


@dataclass
class WatchedDrive:
    """What the watch remembers of one drive."""

    rules: AxisRules
    node: Node
    told_to_enable: bool = False
    begins: bool = False
    """It has just been told to enable: the next torque is the first one."""
    mode_told: int = 0
    torque_told: int | None = None
    """6071h, while it is told to enable in cyclic torque."""
    load_si: float = 0.0
    """What would hold the joint still where it was last seen; N·m, N."""
    told_ns: int = 0
    told_until_ns: int = -(10**18)
    """When it was last told to enable no more."""
    state: PowerState = PowerState.NOT_READY_TO_SWITCH_ON
    unpowered_ns: int = 0
    """When it was last seen without its power stage."""
    blinded_ns: int = -(10**18)
    """Until when a fault of BLINDING counts, and BEFORE_S after it."""
    delayed_ns: int = -(10**18)
    was_off: bool = True
    enabled_still_told: bool = False
    """That it has not obeyed its last word is known already."""
    led_beyond_si: float = 0.0
    """How far out something led the joint that no drive could have held."""
