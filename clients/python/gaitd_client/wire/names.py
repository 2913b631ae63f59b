"""Names on the wire, as enums whose members are the strings of the messages.

A field of a message is a plain string, because a later version of the service may send a name that
this client does not know. So compare (`estimate.mode == Mode.TORQUE`), and expect other names.
"""

from enum import StrEnum, auto


class Mode(StrEnum):
    """Mode of the service. From HOLD on the drives move or hold the legs."""

    OFF = auto()
    BRINGING_UP = auto()
    READY = auto()
    STOPPING = auto()
    FAULT = auto()
    HOLD = auto()
    GAIT = auto()
    TORQUE = auto()
    EXCITE = auto()
    REFERENCE = auto()
    """One axis homes; the others have no power."""
    COMMISSION = auto()
    """The sign of one axis is being proven; the others have no power."""
    HAND_GUIDING = auto()
    """No stiffness; the drives carry the load and damp the motion."""
    SELF_TEST = auto()
    """Each axis in turn moves a little and back."""


class Stage(StrEnum):
    """Progress of an exercise; a stage may be left out, and the order never reverses."""

    PREPARING = auto()
    """Nothing moves: drives are brought up, enabled, or change their mode of operation."""
    ANNOUNCING = auto()
    """Nothing moves yet; the person in the machine is warned."""
    APPROACHING = auto()
    """The leg is moved to the pose in which the exercise begins."""
    PLAYING = auto()
    """The requested exercise runs."""
    ENDING = auto()
    """The leg comes to the pose, or to rest, in which the exercise ends."""
    OVER = auto()


class StopCategory(StrEnum):
    """Way of stopping, in rising severity."""

    NONE = "none"
    S2 = "S2"
    """Assist fades; brake and hold position with the drives enabled."""
    S1 = "S1"
    """Quick stop of both axes, held in quick stop active (or brake, then off)."""
    S0 = "S0"
    """Disable voltage."""


class Cause(StrEnum):
    """Cause of a stop or of a refused start; `gaitd_client.texts` has its text and remedy."""

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


class Outcome(StrEnum):
    """Outcome of a request."""

    PENDING = auto()
    """Not answered in time: the result is unknown."""
    DONE = auto()
    REFUSED = auto()


class StatusBit(StrEnum):
    """What the observer says about an estimate: `status` in each message that holds one."""

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


class Validity(StrEnum):
    """Validity of one axis' estimate."""

    OK = auto()
    SPLIT_UNOBSERVABLE = auto()
    """At rest only patient minus friction is observable: both are null, the net value is given."""
    BAD = auto()
    """All values of the axis are null."""


class Priority(StrEnum):
    """Urgency of an event."""

    HIGH = "high"
    MEDIUM = "medium"
    LOW = "low"
    INFO = "info"


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


class EventCode(StrEnum):
    """What has happened: `code` of an event."""

    BRING_UP_BEGUN = auto()
    DRIVES_UP = auto()
    NOT_REFERENCED = auto()
    BRING_UP_FAILED = auto()
    DRIVE_HOLDS = auto()
    FOUND_WITH_ERROR = auto()
    EMCY_IN_BRING_UP = auto()
    BUS_LOAD = auto()
    MODE_CHANGED = auto()
    STAGE_CHANGED = auto()
    STOPPED = auto()
    FURTHER_CAUSE = auto()
    CAUSE_FOUND = auto()
    STILL_LATCHED = auto()
    REQUEST_RECEIVED = auto()
    REQUEST_REFUSED = auto()
    REQUEST_DONE = auto()
    LEASE_DROPPED = auto()
    RELOAD_REFUSED = auto()
    REFERENCE_LOST = auto()
    TEMPERATURE_OVERDUE = auto()
    TEMPERATURE_BACK = auto()
    CLONUS_BEGUN = auto()
    CALIBRATION_ADVISED = auto()
    TESTS_FORGOTTEN = auto()
    CLOCK_SET_BACK = auto()
    SELF_TEST_PASSED = auto()
    SELF_TEST_FAILED = auto()
    SIGN_TESTED = auto()
    SIGN_PROVEN = auto()
    HOMED = auto()
    SINGLE_AXIS_BEGUN = auto()
    SINGLE_AXIS_FAILED = auto()
    CYCLES_MISSED = auto()
    MEMORY_NOT_LOCKED = auto()
    PROCESSORS_REFUSED = auto()
    PRIORITY_REFUSED = auto()
    STATES_REFUSED = auto()
    RECORDS_SHORTENED = auto()
    STATES_CROWDED = auto()
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
    CONFIG_REFUSED = auto()
    CONFIG_RELOADED = auto()
    GATEWAY_KILLED = auto()
    POWER_FAILED = auto()
    FILE_NOT_WRITTEN = auto()
    FILE_WRITTEN_AGAIN = auto()
    RECORDING_DAMAGED = auto()
    RECORDING_KEPT = auto()


class RefusalCode(StrEnum):
    """Why a request is refused, or not known to be done: `code` of a refusal."""

    NO_SUCH_MODE = auto()
    NOT_IN_THIS_MODE = auto()
    NOT_HOLDING_YET = auto()
    GUIDANCE_BY_POSITION = auto()
    SELF_TEST_DUE = auto()
    GATEWAY_SILENT = auto()
    HAND_SWITCH_OPEN = auto()
    HAND_SWITCH_UNKNOWN = auto()
    STO_ACTIVE = auto()
    SIGN_NOT_PROVEN = auto()
    NOT_REFERENCED = auto()
    INPUT_UNTESTED = auto()
    NO_SAMPLE = auto()
    LEG_MOVES = auto()
    OUTSIDE_RANGE = auto()
    PATIENT_CONFIGURED = auto()
    NO_CLEAR_WAY = auto()
    NO_ROOM = auto()
    STOPPED = auto()
    ROLE_MAY_NOT = auto()
    ROLE_MAY_NOT_MODE = auto()
    NO_PLAN = auto()
    CADENCE_ABOVE_PLAN = auto()
    AMPLITUDE_ABOVE_PLAN = auto()
    DURATION_ABOVE_PLAN = auto()
    LEASE_NEEDED = auto()
    LEASE_HELD = auto()
    BUSY = auto()
    OLD = auto()
    STOP_REQUESTED = auto()
    CADENCE_OUT_OF_RANGE = auto()
    AMPLITUDE_OUT_OF_RANGE = auto()
    DURATION_OUT_OF_RANGE = auto()
    NO_SUCH_SCENARIO = auto()
    NO_SUCH_AXIS = auto()
    NOT_TESTED = auto()
    NO_HOMING = auto()
    FAILED = auto()
    # of the gateway
    CORE_SILENT = auto()
    CORE_STARTING = auto()
    CORE_RESTARTED = auto()
    OUTCOME_UNKNOWN = auto()
    """No answer in time: the request may have taken effect."""
    STOP_UNCONFIRMED = auto()
    NO_SUCH_REQUEST = auto()
    CLIENT_UNNAMED = auto()
    BAD_PAYLOAD = auto()
    GATEWAY_RESTARTS = auto()
    GATEWAY_ENDS = auto()
    GATEWAY_FAILED = auto()
    WOULD_STOP = auto()
    ANSWER_OUTSTANDING = auto()
    KEYS_UNUSABLE = auto()
    LEASE_OVER = auto()
    LEASE_TAKEN = auto()
    LEASE_NUMBER_WRONG = auto()
    """The lease is held under this name, with another number."""
    LEASE_NOT_HELD = auto()
    HOLDER_UNNAMED = auto()
    MACHINE_STOPPED = auto()
    UNKNOWN_LEG = auto()
    RECORDING_PLAYED = auto()
    """The gateway publishes a recording, of which nothing can be requested."""
    PLAN_MAY_RETURN = auto()
    """The plan is in force, but its file could not be removed."""
    PLAN_MAY_BE_LOST = auto()
    """The plan is in force, but its file could not be written."""


class Untested(StrEnum):
    """State of an input that the daily test has still to see: `untested` of a refusal."""

    HAND_SWITCH_OPEN = auto()
    HAND_SWITCH_CLOSED = auto()
    STO_ACTIVE = auto()
    STO_RELEASED = auto()


class ProgressCode(StrEnum):
    """What the machine does now, within its mode and stage: `code` of a progress."""

    SETTING_UP = auto()
    COMPARING_LOAD = auto()
    EXERCISING = auto()
    GUIDED_BY_HAND = auto()
    TESTING = auto()
    ONE_AXIS = auto()
    # of the gateway
    CORE_STARTING = auto()
