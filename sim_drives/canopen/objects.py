"""The objects of CiA 301, CiA 402 and EPOS4 that a virtual drive acts on, by their index.

The service has a table of its own, `drives/canopen/objects.py`. This one is written from the
standards again on purpose: a wrong number in a shared table would be wrong on both sides of the
bus, and no test with virtual drives would show it.
"""

from enum import IntEnum


class Object(IntEnum):
    """Index of an object; a comment names its sub-indices."""

    # CiA 301, 7.5.2: communication
    ERROR_REGISTER = 0x1001
    ERROR_HISTORY = 0x1003  # sub 0: count, then newest first
    DEVICE_TYPE = 0x1000
    SYNC_COB_ID = 0x1005
    SYNC_PERIOD = 0x1006
    SYNC_WINDOW = 0x1007
    STORE = 0x1010  # sub 1: all parameters
    RESTORE = 0x1011  # sub 1: all parameters
    EMCY_COB_ID = 0x1014
    EMCY_INHIBIT_TIME = 0x1015
    HEARTBEAT_CONSUMER = 0x1016  # sub n: node id << 16 | ms
    HEARTBEAT_PRODUCER = 0x1017
    IDENTITY = 0x1018  # sub 1: vendor, 2: product, 3: revision, 4: serial number
    SYNC_COUNTER = 0x1019
    ERROR_BEHAVIOUR = 0x1029  # sub 1: NMT state after a communication error
    RPDO = 0x1400  # the first of its parameters; sub 1: COB-ID, 2: type, 5: timeout
    TPDO = 0x1800  # sub 1: COB-ID, 2: type, 3: inhibit time, 5: event timer

    # EPOS4: objects of the maker
    EPOS4_MOTOR_DATA = 0x3001  # sub 1: rated mA, 2: largest mA, 5: torque constant
    EPOS4_HOME_POSITION = 0x30B0
    EPOS4_HOME_DISTANCE = 0x30B1
    EPOS4_HOME_CURRENT = 0x30B2
    EPOS4_CURRENT = 0x30D1  # sub 1: mean, 2: instant; mA

    # CiA 402-2: device profile
    ABORT_CONNECTION = 0x6007  # option code
    ERROR_CODE = 0x603F
    CONTROLWORD = 0x6040
    STATUSWORD = 0x6041
    QUICK_STOP = 0x605A  # option code
    SHUTDOWN = 0x605B  # option code
    DISABLE = 0x605C  # option code
    HALT = 0x605D  # option code
    FAULT_REACTION = 0x605E  # option code
    MODE = 0x6060
    MODE_DISPLAY = 0x6061
    POSITION_DEMAND = 0x6062
    POSITION = 0x6064
    FOLLOWING_WINDOW = 0x6065
    FOLLOWING_TIME = 0x6066
    VELOCITY = 0x606C
    TARGET_TORQUE = 0x6071
    TORQUE_MAX = 0x6072
    CURRENT_MAX = 0x6073
    RATED_CURRENT = 0x6075
    RATED_TORQUE = 0x6076
    TORQUE = 0x6077
    CURRENT = 0x6078
    TARGET_POSITION = 0x607A
    HOME_OFFSET = 0x607C
    POSITION_LIMITS = 0x607D  # sub 1: minimum, 2: maximum
    POLARITY = 0x607E
    SPEED_LIMIT = 0x6080
    DECELERATION = 0x6084
    QUICK_STOP_DECELERATION = 0x6085
    ENCODER_RESOLUTION = 0x608F  # sub 1: counts, 2: motor turns
    GEAR_RATIO = 0x6091  # sub 1: motor turns, 2: shaft turns
    FEED_CONSTANT = 0x6092  # sub 1: feed, 2: shaft turns
    HOMING_METHOD = 0x6098
    HOMING_SPEEDS = 0x6099  # sub 1: search for the switch, 2: search for zero
    HOMING_ACCELERATION = 0x609A
    POSITION_OFFSET = 0x60B0
    VELOCITY_OFFSET = 0x60B1
    TORQUE_OFFSET = 0x60B2
    INTERPOLATION_TIME = 0x60C2  # sub 1: value, 2: power of ten of a second
    FOLLOWING_ERROR = 0x60F4
    INPUTS = 0x60FD
    TARGET_VELOCITY = 0x60FF
    SUPPORTED_MODES = 0x6502
