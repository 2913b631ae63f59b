"""What the core reports: events as codes with a subject and numbers.

Rules:
1. A program reads code, subject and values; `daemon/wire/report_fields.py` names the values of
   each code. A sentence is made where a person reads it (`gaitd_client/texts`).
2. `said` is the only free text: what a drive, the kernel or a library has said. Nothing is decided
   by it.
"""

from enum import IntEnum
from typing import Final

import msgspec

EVENTS_MAX: Final = 8
"""Most events of one record; the others are put into the next one."""
SAID_BYTES_MAX: Final = 160
"""Maximum size of `said`: the slot of a record has a fixed size."""


class Trigger(IntEnum):
    """What may change the mode; `daemon/core/modes/table.py` has the transitions."""

    BRING_UP_BEGUN = 1
    BRING_UP_DONE = 2
    STILL_LATCHED = 3
    """A stop is latched since an earlier start."""
    DRIVES_LOST = 4
    """A drive or the bus was lost while no drive was enabled."""
    DRIVE_FAULTY = 5
    ENABLE = 6
    DISABLE = 7
    RESET = 8
    TO_HOLD = 9
    TO_GAIT = 10
    TO_TORQUE = 11
    TO_EXCITE = 12
    TO_HAND_GUIDING = 13
    TO_SELF_TEST = 14
    TO_REFERENCE = 15
    TO_COMMISSION = 16
    BRING_UP_RESTARTED = 17
    """The drives need other limits."""
    EXERCISE_OVER = 18
    LEASE_LAPSED = 19
    """The lease of the assist in force has ended, or its setpoints are stale."""
    STOP = 20
    AT_REST_WELL = 21
    """At rest, as requested."""
    AT_REST_STOPPED = 22
    """At rest, by a verdict."""


class Doubt(IntEnum):
    """Why the position of an axis is not known."""

    NONE = 0
    NOT_HOMED = 1
    REBOOTED = 2
    ENCODER_ERROR = 3
    ENCODER_JUMPED = 4
    NO_POSE_STORED = 5
    POSE_UNREADABLE = 6
    LEFT_ELSEWHERE = 7
    """The encoder does not agree with the pose in which the axis was left."""


class Failure(IntEnum):
    """Why an exercise, a homing or a sign test has ended without its result."""

    NONE = 0
    NO_REST = 1
    """No rest came, which a change to torque mode needs."""
    NOT_READY = 2
    """Drives and leg were not ready in time."""
    STOP_REQUESTED = 3
    DISABLE_REQUESTED = 4
    HOMING_ERROR = 5
    HOME_NOT_FOUND = 6
    DOES_NOT_HOME = 7
    MOVES_AGAINST_TORQUE = 8
    DOES_NOT_MOVE = 9
    KEEPS_MOVING = 10


class Finding(IntEnum):
    """What a verdict was found by, where its cause, value and limit do not tell."""

    NONE = 0
    # what value and limit are
    CYCLES = 1
    MISSED_CYCLES = 2
    CYCLES_WITHOUT_SAMPLE = 3
    CYCLES_NOT_ALL_SENT = 4
    CYCLES_WITHOUT_ESTIMATE = 5
    HEARTBEAT_AGE_MS = 6
    TEMPERATURE_DEGC = 7
    STRIDE_ENERGY_J = 8
    MODE_DISPLAY = 9
    """Modes of operation: shown and commanded."""
    NMT_STATE = 10
    """The value is the drive's NMT state (CiA 301)."""
    POWER_STATE = 11
    """The value is the drive's power state (`drives.signals.PowerState`)."""
    EMCY = 12
    """The value is the code of the drive's message."""
    ANGLE_OF_SHOE = 13
    """Sine of the angle between shank and shoe."""
    ANGLE_ON_WAY_TO_REST = 14
    # drives and bus
    NO_EMCY = 20
    BOOT_UP_MESSAGE = 21
    NOT_FOLLOWING_BIT = 22
    HELD_AWAY = 23
    IMPOSSIBLE_BITS = 24
    NEGATIVE_SWITCH = 25
    POSITIVE_SWITCH = 26
    CONTROLLER_OFF = 27
    # encoders and efforts
    POSITION_NOT_FINITE = 30
    EFFORT_NOT_FINITE = 31
    EFFORT_IMPOSSIBLE = 32
    STEP_BETWEEN_SAMPLES = 33
    SPEED_LOST = 34
    EFFORT_WITHOUT_MOTION = 35
    EFFORT_WITHOUT_POWER = 36
    EFFORT_NOT_AS_SENT = 37
    EFFORT_UNCHANGED = 38
    EFFORT_AGAINST_MOTION = 39
    PUSHED_BACK = 40
    MEAN_OF_STRIDE = 41
    RISE_AGAINST_MOTION = 42
    SWINGS = 43
    NOT_MEASURED = 44
    # places
    BELOW = 50
    ABOVE = 51
    RESTS_BELOW = 52
    RESTS_ABOVE = 53
    # the self-test of an axis
    NOT_MOVED_FORTH = 60
    NOT_MOVED_BACK = 61
    ACTS_AGAINST_MOTION = 62
    LOAD_OF_ANOTHER_LEG = 63
    FRICTION_LESS = 64
    FRICTION_MORE = 65
    NO_SAMPLE = 66
    NOT_BEGUN = 67
    # an earlier run of the service
    ENDED_WHILE_ENABLED = 70
    NOTES_UNREADABLE = 71
    NOTES_TORN = 72
    NOTES_OF_OTHER_VERSION = 73
    # a stop that is not obeyed
    NOT_HELD = 80
    NOT_STOPPED = 81
    """Quick stop without effect."""
    NOT_DISABLED = 82
    NOT_STOPPED_BY_NMT = 83


class Untested(IntEnum):
    """State of an input that the daily test has not seen yet."""

    HAND_SWITCH_OPEN = 1
    HAND_SWITCH_CLOSED = 2
    STO_ACTIVE = 3
    STO_RELEASED = 4


class SelfTestDue(IntEnum):
    """Why a self-test must come before any motion."""

    NONE = 0
    NOT_PASSED_TODAY = 1
    FAILED = 2
    OTHER_ROBOT_FILE = 3
    TOO_OLD = 4
    OTHER_AXES = 5
    OTHER_DRIVE = 6


class RefusalCode(IntEnum):
    """Why a request is refused."""

    # the mode
    NO_SUCH_MODE = 1
    NOT_IN_THIS_MODE = 2
    NOT_HOLDING_YET = 3
    GUIDANCE_BY_POSITION = 4
    SELF_TEST_DUE = 5
    # the machine
    GATEWAY_SILENT = 10
    HAND_SWITCH_OPEN = 11
    HAND_SWITCH_UNKNOWN = 12
    STO_ACTIVE = 13
    SIGN_NOT_PROVEN = 14
    NOT_REFERENCED = 15
    INPUT_UNTESTED = 16
    NO_SAMPLE = 17
    LEG_MOVES = 18
    OUTSIDE_RANGE = 19
    PATIENT_CONFIGURED = 20
    NO_CLEAR_WAY = 21
    NO_ROOM = 22
    STOPPED = 23
    """A stop came before the request was done."""
    # the client
    ROLE_MAY_NOT = 30
    ROLE_MAY_NOT_MODE = 31
    NO_PLAN = 32
    CADENCE_ABOVE_PLAN = 33
    AMPLITUDE_ABOVE_PLAN = 34
    DURATION_ABOVE_PLAN = 35
    LEASE_NEEDED = 36
    LEASE_HELD = 37
    """An artificial disturbance would mislead the controller that holds the lease."""
    # the request
    BUSY = 40
    OLD = 41
    STOP_REQUESTED = 42
    CADENCE_OUT_OF_RANGE = 43
    AMPLITUDE_OUT_OF_RANGE = 44
    DURATION_OUT_OF_RANGE = 45
    NO_SUCH_SCENARIO = 46
    NO_SUCH_AXIS = 47
    NOT_TESTED = 48
    NO_HOMING = 49
    FAILED = 50
    """The homing or sign test could not begin."""


class EventCode(IntEnum):
    """What has happened; `daemon/wire/report_fields.py` names the values of each."""

    # bring-up
    BRING_UP_BEGUN = 1
    DRIVES_UP = 2
    NOT_REFERENCED = 3
    BRING_UP_FAILED = 4
    DRIVE_HOLDS = 5
    """A drive holds the leg already: it is left alone until a reset."""
    FOUND_WITH_ERROR = 6
    EMCY_IN_BRING_UP = 7
    BUS_LOAD = 8
    # modes and stops
    MODE_CHANGED = 10
    STAGE_CHANGED = 11
    STOPPED = 12
    FURTHER_CAUSE = 13
    """Another cause during a stop."""
    CAUSE_FOUND = 14
    """A cause without a new stop: at rest, or while a stop is not obeyed."""
    STILL_LATCHED = 15
    # requests
    REQUEST_RECEIVED = 20
    REQUEST_REFUSED = 21
    REQUEST_DONE = 22
    LEASE_DROPPED = 23
    RELOAD_REFUSED = 24
    # axes
    REFERENCE_LOST = 30
    TEMPERATURE_OVERDUE = 31
    TEMPERATURE_BACK = 32
    CLONUS_BEGUN = 33
    CALIBRATION_ADVISED = 34
    TESTS_FORGOTTEN = 35
    """The drive has no serial number: it may be another one than that which was tested."""
    CLOCK_SET_BACK = 36
    # outcomes of tests
    SELF_TEST_PASSED = 40
    SELF_TEST_FAILED = 41
    SIGN_TESTED = 42
    SIGN_PROVEN = 43
    HOMED = 44
    SINGLE_AXIS_BEGUN = 45
    SINGLE_AXIS_FAILED = 46
    # the process
    CYCLES_MISSED = 50
    MEMORY_NOT_LOCKED = 51
    PROCESSORS_REFUSED = 52
    PRIORITY_REFUSED = 53
    STATES_REFUSED = 54
    RECORDS_SHORTENED = 55
    STATES_CROWDED = 56
    # the CAN controller
    CAN_ACTIVE = 60
    CAN_WARNING = 61
    CAN_PASSIVE = 62
    CAN_OFF = 63
    CAN_ALONE = 64
    CAN_FRAMES_LOST = 65
    CAN_FOREIGN_MASTER = 66


class Lapse(IntEnum):
    """Why assist has lapsed."""

    NONE = 0
    NO_SETPOINT = 1
    LEASE_ENDED = 2
    STALE = 3
    """Its setpoints are too old."""


class MotionPhase(IntEnum):
    """Phase of the motion of one axis in a self-test."""

    REST = 0
    FORTH = 1
    TURN = 2
    BACK = 3
    DONE = 4


class AxisStep(IntEnum):
    """Step of a homing or sign test."""

    WAITING = 0
    """The drives get their limits for it."""
    ENABLING = 1
    SEARCHING = 2
    FORTH = 3
    RESTING = 4
    BACK = 5
    ENDING = 6
    """At rest again."""
    DONE = 7
    FAILED = 8


class ProgressCode(IntEnum):
    """What the machine does now, within its mode and stage."""

    SETTING_UP = 1
    """A bring-up; the subject is the drive."""
    COMPARING_LOAD = 2
    EXERCISING = 3
    GUIDED_BY_HAND = 4
    TESTING = 5
    """A self-test; the subject is the axis."""
    ONE_AXIS = 6
    """Homing or a sign test; the subject is the axis."""


class Progress(msgspec.Struct, frozen=True, array_like=True):
    """The present step of a bring-up or an exercise."""

    code: ProgressCode
    subject: str = ""
    values: tuple[float, ...] = ()
    """As in an event."""


class Refusal(msgspec.Struct, frozen=True, array_like=True):
    """Why a request is refused."""

    code: RefusalCode
    subject: str = ""
    """The leg or the axis it is about, the first of several; empty if none."""
    values: tuple[float, ...] = ()
    """As in an event."""
    said: str = ""
    """A name that the client has sent, or what the configuration knows in its place."""


class Event(msgspec.Struct, frozen=True, array_like=True):
    """One event of the core."""

    code: EventCode
    subject: str = ""
    """The leg or the axis it is about, `right` or `right/hip`; empty if none."""
    values: tuple[float, ...] = ()
    """Numbers in SI units, and numbers of members of enums; their order belongs to the code."""
    said: str = ""
