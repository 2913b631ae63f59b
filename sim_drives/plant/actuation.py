"""Data exchanged between a virtual drive's protocol side and the plant behind it.

The slave converts its object dictionary (counts, rpm, per mille, mA) into joint SI with its own
personality and passes an `AxisActuation` to the plant. The plant closes the drive's own loops on
the simulated motor, and returns an `AxisSample` and `AxisFlag`s. Everything here is at the joint:
rad and N·m for the hip, m and N for the slide, with the joint's sign. Only the motor current is
the motor's, still with the joint's sign.
"""

from enum import IntEnum
from typing import NamedTuple


class Actuation(IntEnum):
    """Operating mode of the drive's power stage and loops."""

    COAST = 0
    """Power stage off: no torque."""
    TORQUE = 1
    """Cyclic synchronous torque: the current loop follows `target_effort_si`."""
    POSITION = 2
    """Cyclic synchronous position: the drive's position, velocity and current loops follow
    `target_position_si`, reached from the previous target over `interpolation_s`."""
    RAMP = 3
    """Decelerate with `deceleration_si` at the drive's velocity loop, then hold position;
    STANDSTILL when reached."""
    HOLD = 4
    """Hold the position that the axis has when the order arrives."""
    VELOCITY = 5
    """Homing: the velocity loop follows `target_velocity_si`, reached with `deceleration_si`."""


class AxisFlag(IntEnum):
    """Bits of what the plant detects; a newly raised one ends `Trainer.advance` early.

    No IntFlag, whose operators are slow: the bits are read some thirty times in a cycle.
    """

    NONE = 0
    STANDSTILL = 1
    """RAMP or HOLD: the axis has come to rest."""
    FOLLOWING_ERROR = 2
    """POSITION: the error has exceeded `following_error_si` for `following_error_time_s`."""
    END_STOP_NEGATIVE = 4
    END_STOP_POSITIVE = 8
    """The joint touches its mechanical end stop."""
    TARGET_CLIPPED = 16
    """The position target lies outside [position_min_si, position_max_si] and is clipped."""
    SPEED_LIMITED = 32
    """The speed limit acts on the torque or position order."""


class AxisActuation(NamedTuple):
    """One axis's order: the drive's mode and the limits in force, joint SI (rad, N·m; m, N)."""

    actuation: Actuation
    target_effort_si: float
    target_position_si: float
    target_velocity_si: float
    deceleration_si: float
    """Magnitude, > 0, joint unit per s^2; for VELOCITY also the acceleration."""
    interpolation_s: float
    effort_limit_si: float
    """Bound on |effort| in every actuation, >= 0."""
    velocity_limit_si: float
    """Bound on |velocity|, > 0."""
    following_error_si: float
    """Window of the position error; infinity disables the check."""
    following_error_time_s: float
    position_min_si: float
    position_max_si: float
    """Software limits of the position target; -infinity and infinity when there are none."""


class AxisSample(NamedTuple):
    """Values of the drive's sensors at this instant, before quantisation to counts and mA."""

    position_si: float
    """True encoder angle or travel with latch jitter and noise, joint sign."""
    velocity_si: float
    current_a: float
    """Motor current with noise, joint sign: effort = k_t * current * gear (* 2 pi / lead)."""
    temperature_degc: float
