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
    """Status bits of the observer's estimate: `status` in each message that holds an estimate."""

    VALID = auto()
    WARM_UP = auto()
    PREDICT_ONLY = auto()
    GATED = auto()
    STANDSTILL_HIP = auto()
    STANDSTILL_SLIDE = auto()
    NEAR_SINGULAR = auto()
    OUT_OF_WORKSPACE = auto()
    LATE = auto()
    INCONSISTENT = auto()
    UNREFERENCED = auto()
    ARTIFICIAL = auto()
    INPUT_SATURATED = auto()
    NEAR_LIMIT = auto()
    UNCALIBRATED = auto()
    BASELINE = auto()
    """A passive baseline is taken off: values are relative to the minute with a passive patient."""


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
