"""What is measured and estimated: states of drives, validity and status bits of estimates."""

from enum import StrEnum, auto
from typing import Final


class Doubt(StrEnum):
    """Why the position of an axis is not known."""

    NONE = auto()
    NOT_HOMED = auto()
    REBOOTED = auto()
    ENCODER_ERROR = auto()
    ENCODER_JUMPED = auto()
    NO_POSE_STORED = auto()
    POSE_UNREADABLE = auto()
    LEFT_ELSEWHERE = auto()
    """The encoder does not agree with the pose in which the axis was left."""


class StatusBit(StrEnum):
    """Status bits of the observer's estimate: `status` in each message that holds an estimate.

    The texts say what a display does about a bit. Whether a number may be shown is said by the
    `validity` of its axis alone; a number that may not is null.
    """

    VALID = auto()
    """Show each axis by its validity. Without this bit at least one axis has no number."""
    WARM_UP = auto()
    """Wait: the first values are less certain, as their sigma says."""
    PREDICT_ONLY = auto()
    """Nothing, while it is rare: sigma grows with each cycle."""
    GATED = auto()
    """Nothing, while it is rare. If it stays, have encoder and cable checked."""
    STANDSTILL_HIP = auto()
    """Show net of the hip once its validity is split_unobservable."""
    STANDSTILL_SLIDE = auto()
    """Show net of the slide once its validity is split_unobservable."""
    NEAR_SINGULAR = auto()
    """Show sigma with the value: a small error of the pose is a large one of effort."""
    OUT_OF_WORKSPACE = auto()
    """Show that nothing is known: both axes are bad."""
    LATE = auto()
    """Nothing: the true time step is used. If it stays, see `health`."""
    INCONSISTENT = auto()
    """Show that nothing is known: both axes are bad. If it stays, calibrate."""
    UNREFERENCED = auto()
    """Show that nothing is known, and that the axis must be homed."""
    ARTIFICIAL = auto()
    """Say that this is a test: the estimate holds a disturbance, not only a patient."""
    INPUT_SATURATED = auto()
    """Show the value; do not judge friction by it."""
    NEAR_LIMIT = auto()
    """Do not count the effort as the patient's: it may be the end stop's."""
    UNCALIBRATED = auto()
    """Show that nothing is known, and that the machine must be calibrated."""
    BASELINE = auto()
    """Say that values are relative to the minute with a passive patient."""


COVERAGE_MIN_RATIO: Final = 0.5
"""Below this coverage of a stride an axis has no figures: a part does not stand for the whole."""


class Validity(StrEnum):
    """Validity of one axis' estimate."""

    OK = auto()
    SPLIT_UNOBSERVABLE = auto()
    """At rest only patient minus friction is observable: both are null, the net value is given."""
    BAD = auto()
    """All values of the axis are null."""


POWER_STATES: Final = (
    "unknown",
    "not_ready_to_switch_on",
    "switch_on_disabled",
    "ready_to_switch_on",
    "switched_on",
    "operation_enabled",
    "quick_stop_active",
    "fault_reaction_active",
    "fault",
)
"""CiA 402 power states, in the order of DriveRecord.power_state."""

NMT_STATES: Final = {
    0x00: "boot_up",
    0x04: "stopped",
    0x05: "operational",
    0x7F: "pre_operational",
    0xFF: "unknown",
}
"""CiA 301 NMT states, by the byte of the heartbeat."""
