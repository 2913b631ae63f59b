"""Stops: category, cause, and what a verdict was found by."""

from enum import StrEnum, auto
from typing import Final


class StopCategory(StrEnum):
    """Way of stopping, in rising severity."""

    NONE = "none"
    S2 = "S2"
    """Assist fades; brake and hold position with the drives enabled."""
    S1 = "S1"
    """Quick stop of both axes, held in quick stop active (or brake, then off)."""
    S0 = "S0"
    """Disable voltage."""

    @property
    def severity(self) -> int:
        """0 for none, up to 3 for S0: names have no order."""
        return _RISING.index(self)


_RISING: Final = (StopCategory.NONE, StopCategory.S2, StopCategory.S1, StopCategory.S0)


class Cause(StrEnum):
    """Cause of a stop or of a refused start. `daemon/wire/causes.py` has the fixed categories."""

    NONE = auto()
    # requested
    STOP_REQUESTED = auto()
    SHUTDOWN = auto()
    # the gateway and the core
    GATEWAY_SILENT = auto()
    CYCLE_OVERRUN = auto()
    COMMAND_NOT_FINITE = auto()
    LAST_END_UNKNOWN = auto()
    # the emergency means of the patient and of a person nearby
    HAND_SWITCH_OPEN = auto()
    STO_ACTIVE = auto()
    INPUTS_IMPOSSIBLE = auto()
    # a drive and its bus
    BUS_DOWN = auto()
    DRIVE_SILENT = auto()
    HEARTBEAT_LOST = auto()
    DRIVE_REBOOTED = auto()
    DRIVE_NOT_OPERATIONAL = auto()
    DRIVE_FAULT = auto()
    EMERGENCY = auto()
    DRIVE_LEFT_ENABLED = auto()
    MODE_NOT_SHOWN = auto()
    NOT_FOLLOWING = auto()
    BRING_UP_FAILED = auto()
    BUS_OFF = auto()
    TRANSMIT_QUEUE_FULL = auto()
    DRIVE_POWERED = auto()
    UNEXPECTED_ENABLE = auto()
    # a drive's report about the joint
    ENCODER_FROZEN = auto()
    ENCODER_JUMP = auto()
    UNREFERENCED = auto()
    SIGN_WRONG = auto()
    EFFORT_DEVIATION = auto()
    MOVED_AGAINST_DRIVE = auto()
    # limits at the joint, from raw drive values
    POSITION_LIMIT = auto()
    VELOCITY_LIMIT = auto()
    EFFORT_LIMIT = auto()
    POWER_LIMIT = auto()
    TRACKING_LIMIT = auto()
    TEMPERATURE_LIMIT = auto()
    SINGULARITY = auto()
    LIMIT_SWITCH = auto()
    ENERGY_LIMIT = auto()
    STOPPING_PATH = auto()
    # the estimate: it may add stops, never remove one
    OBSERVER_INVALID = auto()
    STATIC_LOAD_WRONG = auto()
    SPASM = auto()
    SELF_TEST_FAILED = auto()
    CLONUS = auto()
    # escalation
    STOP_NOT_OBEYED = auto()


class Finding(StrEnum):
    """What a verdict was found by, where its cause, value and limit do not tell."""

    NONE = auto()
    # what value and limit are
    CYCLES = auto()
    MISSED_CYCLES = auto()
    CYCLES_WITHOUT_SAMPLE = auto()
    CYCLES_NOT_ALL_SENT = auto()
    CYCLES_WITHOUT_ESTIMATE = auto()
    HEARTBEAT_AGE_MS = auto()
    TEMPERATURE_DEGC = auto()
    STRIDE_ENERGY_J = auto()
    MODE_DISPLAY = auto()
    """Modes of operation: shown and commanded."""
    NMT_STATE = auto()
    """The value is the drive's NMT state (CiA 301)."""
    POWER_STATE = auto()
    """The value is the drive's power state (`drives.signals.PowerState`)."""
    NEVER_ENABLED = auto()
    """The drive has not become enabled; the value is its power state."""
    EMCY = auto()
    """The value is the code of the drive's message."""
    ERROR_CODE = auto()
    """The value is 603Fh of a drive that sent no message with a code."""
    ANGLE_OF_SHOE = auto()
    """Sine of the angle between shank and shoe."""
    ANGLE_ON_WAY_TO_REST = auto()
    # drives and bus
    NO_EMCY = auto()
    BOOT_UP_MESSAGE = auto()
    NOT_FOLLOWING_BIT = auto()
    HELD_AWAY = auto()
    IMPOSSIBLE_BITS = auto()
    NEGATIVE_SWITCH = auto()
    POSITIVE_SWITCH = auto()
    CONTROLLER_OFF = auto()
    # encoders and efforts
    POSITION_NOT_FINITE = auto()
    EFFORT_NOT_FINITE = auto()
    EFFORT_IMPOSSIBLE = auto()
    STEP_BETWEEN_SAMPLES = auto()
    SPEED_LOST = auto()
    EFFORT_WITHOUT_MOTION = auto()
    EFFORT_WITHOUT_POWER = auto()
    EFFORT_NOT_AS_SENT = auto()
    EFFORT_UNCHANGED = auto()
    EFFORT_AGAINST_MOTION = auto()
    PUSHED_BACK = auto()
    MEAN_OF_STRIDE = auto()
    RISE_AGAINST_MOTION = auto()
    SWINGS = auto()
    NOT_MEASURED = auto()
    # places
    BELOW = auto()
    ABOVE = auto()
    RESTS_BELOW = auto()
    RESTS_ABOVE = auto()
    # the self-test of an axis
    NOT_MOVED_FORTH = auto()
    NOT_MOVED_BACK = auto()
    ACTS_AGAINST_MOTION = auto()
    LOAD_OF_ANOTHER_LEG = auto()
    FRICTION_LESS = auto()
    FRICTION_MORE = auto()
    NO_SAMPLE = auto()
    NOT_BEGUN = auto()
    # the minute with a passive patient
    FEW_STRIDES = auto()
    FEW_SAMPLES = auto()
    NOT_PASSIVE = auto()
    IMPLAUSIBLE = auto()
    # an earlier run of the service
    ENDED_WHILE_ENABLED = auto()
    NOTES_UNREADABLE = auto()
    NOTES_TORN = auto()
    NOTES_OF_OTHER_VERSION = auto()
    # a stop that is not obeyed
    NOT_HELD = auto()
    NOT_STOPPED = auto()
    """Quick stop without effect."""
    NOT_DISABLED = auto()
    NOT_STOPPED_BY_NMT = auto()
