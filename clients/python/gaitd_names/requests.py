"""Requests of clients: kinds, roles, outcomes, and why one is refused."""

from enum import StrEnum, auto


class RequestKind(StrEnum):
    """Request of a client to the core, one outstanding at a time. A stop is a counter instead."""

    NONE = auto()
    ENABLE = auto()
    DISABLE = auto()
    RESET = auto()
    MODE = auto()


class Role(StrEnum):
    """Role of a client, as its credentials show it; rights in `daemon/wire/roles.py`."""

    UNRESTRICTED = auto()
    """The service has no keys: clients cannot be distinguished."""
    DISPLAY = auto()
    CONTROLLER = auto()
    SESSION = auto()
    OPERATOR = auto()
    SERVICE = auto()


class Outcome(StrEnum):
    """Outcome of a request."""

    PENDING = auto()
    DONE = auto()
    REFUSED = auto()


class RefusalCode(StrEnum):
    """Why a request is refused."""

    # the mode
    NO_SUCH_MODE = auto()
    NOT_IN_THIS_MODE = auto()
    NOT_HOLDING_YET = auto()
    GUIDANCE_BY_POSITION = auto()
    SELF_TEST_DUE = auto()
    # the machine
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
    """A stop came before the request was done."""
    # the client
    ROLE_MAY_NOT = auto()
    ROLE_MAY_NOT_MODE = auto()
    NO_PLAN = auto()
    CADENCE_ABOVE_PLAN = auto()
    AMPLITUDE_ABOVE_PLAN = auto()
    DURATION_ABOVE_PLAN = auto()
    LEASE_NEEDED = auto()
    LEASE_HELD = auto()
    """An artificial disturbance would mislead the controller that holds the lease."""
    # the request
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
    """The homing or sign test could not begin."""
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
    TOO_MANY_MARKS = auto()
    PLAN_MAY_RETURN = auto()
    """The plan is in force, but its file could not be removed."""
    PLAN_MAY_BE_LOST = auto()
    """The plan is in force, but its file could not be written."""


class SelfTestDue(StrEnum):
    """Why a self-test must come before any motion."""

    NONE = auto()
    NOT_PASSED_TODAY = auto()
    FAILED = auto()
    OTHER_ROBOT_FILE = auto()
    TOO_OLD = auto()
    OTHER_AXES = auto()
    OTHER_DRIVE = auto()


class Untested(StrEnum):
    """State of an input that the daily test has not seen yet."""

    HAND_SWITCH_OPEN = auto()
    HAND_SWITCH_CLOSED = auto()
    STO_ACTIVE = auto()
    STO_RELEASED = auto()


class SetpointRefusal(StrEnum):
    """Reason for refusing a setpoint."""

    TOO_LARGE = auto()
    MALFORMED = auto()
    UNKNOWN_LEG = auto()
    UNLEASED = auto()
    WRONG_LEASE = auto()
    REPEATED = auto()
    REORDERED = auto()
    STALE = auto()
    AHEAD = auto()
    NON_FINITE = auto()
    OUT_OF_RANGE = auto()
    GUIDANCE_IS_POSITION = auto()
    WRONG_MODE = auto()
    FLOOD = auto()


class Lapse(StrEnum):
    """Why assist has lapsed."""

    NONE = auto()
    NO_SETPOINT = auto()
    LEASE_ENDED = auto()
    STALE = auto()
    """Its setpoints are too old."""
