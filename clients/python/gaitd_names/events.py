"""Events: codes, kinds and priorities."""

from enum import StrEnum, auto


class EventCode(StrEnum):
    """What has happened; `daemon/wire/report_fields.py` names the values of each."""

    # bring-up
    BRING_UP_BEGUN = auto()
    DRIVES_UP = auto()
    NOT_REFERENCED = auto()
    BRING_UP_FAILED = auto()
    DRIVE_HOLDS = auto()
    """A drive holds the leg already: it is left alone until a reset."""
    FOUND_WITH_ERROR = auto()
    EMCY_IN_BRING_UP = auto()
    BUS_LOAD = auto()
    # modes and stops
    MODE_CHANGED = auto()
    STAGE_CHANGED = auto()
    STOPPED = auto()
    FURTHER_CAUSE = auto()
    """Another cause during a stop."""
    CAUSE_FOUND = auto()
    """A cause without a new stop: at rest, or while a stop is not obeyed."""
    STILL_LATCHED = auto()
    # requests
    REQUEST_RECEIVED = auto()
    REQUEST_REFUSED = auto()
    REQUEST_DONE = auto()
    LEASE_DROPPED = auto()
    RELOAD_REFUSED = auto()
    # axes
    REFERENCE_LOST = auto()
    ERROR_CODE_SHOWN = auto()
    """A drive in fault shows 603Fh, and no EMCY has told this code."""
    TEMPERATURE_OVERDUE = auto()
    TEMPERATURE_BACK = auto()
    CLONUS_BEGUN = auto()
    CALIBRATION_ADVISED = auto()
    OFFSET_FOUND = auto()
    """An empty machine shows an effort that its file does not allow."""
    SLOPE_FOUND = auto()
    """Its friction rises along an axis as its file does not allow."""
    BASELINE_BEGUN = auto()
    """The minute with a passive patient has begun: an earlier baseline is no longer in force."""
    BASELINE_TAKEN = auto()
    BASELINE_REFUSED = auto()
    TESTS_FORGOTTEN = auto()
    """The drive has no serial number: it may be another one than that which was tested."""
    CLOCK_SET_BACK = auto()
    # outcomes of tests
    SELF_TEST_PASSED = auto()
    SELF_TEST_FAILED = auto()
    SIGN_TESTED = auto()
    SIGN_PROVEN = auto()
    HOMED = auto()
    SINGLE_AXIS_BEGUN = auto()
    SINGLE_AXIS_FAILED = auto()
    # the process
    CYCLES_MISSED = auto()
    MEMORY_NOT_LOCKED = auto()
    PROCESSORS_REFUSED = auto()
    PRIORITY_REFUSED = auto()
    STATES_REFUSED = auto()
    RECORDS_SHORTENED = auto()
    STATES_CROWDED = auto()
    # the CAN controller
    CAN_ACTIVE = auto()
    CAN_WARNING = auto()
    CAN_PASSIVE = auto()
    CAN_OFF = auto()
    CAN_ALONE = auto()
    CAN_FRAMES_LOST = auto()
    CAN_FOREIGN_MASTER = auto()
    # of the gateway
    CORE_RUNNING = auto()
    CORE_BACK = auto()
    CORE_SILENT = auto()
    RECORDS_UNREAD = auto()
    QUERY_FAILED = auto()
    REQUEST_SENT = auto()
    REQUEST_ANSWERED = auto()
    REQUESTS_LEFT_OUT = auto()
    VERDICT_CLEARED = auto()
    NMT_STATE_CHANGED = auto()
    POWER_STATE_CHANGED = auto()
    POSITION_KNOWN = auto()
    POSITION_LOST = auto()
    EMCY_RECEIVED = auto()
    EMCY_CLEARED = auto()
    HAND_SWITCH_CLOSED = auto()
    HAND_SWITCH_OPENED = auto()
    STO_ACTIVATED = auto()
    STO_RELEASED = auto()
    LEASE_ENDED = auto()
    SETPOINT_REFUSED = auto()
    ASSIST_LAPSED = auto()
    DESCRIPTORS_USED_UP = auto()
    DESCRIPTORS_FREE = auto()
    PLAN_RELEASED = auto()
    PLAN_WITHDRAWN = auto()
    PLAN_UNREADABLE = auto()
    MARK = auto()
    """A person has written a remark, with this time."""
    CONFIG_REFUSED = auto()
    CONFIG_RELOADED = auto()
    GATEWAY_KILLED = auto()
    POWER_FAILED = auto()
    FILE_NOT_WRITTEN = auto()
    FILE_WRITTEN_AGAIN = auto()
    RECORDING_DAMAGED = auto()
    RECORDING_KEPT = auto()


class Kind(StrEnum):
    """Type of an event."""

    CORE = "core"
    MODE = "mode"
    STOP = "stop"
    REQUEST = "request"
    DRIVE = "drive"
    EMERGENCY = "emergency"
    INPUT = "input"
    NOTE = "note"


class Priority(StrEnum):
    """Urgency of an event."""

    HIGH = "high"
    MEDIUM = "medium"
    LOW = "low"
    INFO = "info"


class CyclePart(StrEnum):
    """Parts of a cycle that can cause an overrun."""

    WAKE_UP = auto()
    """Before SYNC: the process was not scheduled in time, or work between two windows took long."""
    WINDOW = auto()
    """Receiving the drives' answers."""
    WORK = auto()
    """From the samples to the commands on the bus."""
    PUBLISH = auto()
    """Writing the record into the ring, the state file, and notifying systemd."""
