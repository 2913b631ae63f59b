"""The objects of CiA 301 and CiA 402 that the service reads, writes or maps, by their index.

The objects of one make (torque, temperature, homing) are in its profile (`cia402/profile.py`). The
virtual drives have a table of their own: see `sim_drives/canopen/objects.py`.
"""

from enum import IntEnum


class Object(IntEnum):
    """Index of an object; a comment names its sub-indices."""

    # CiA 301, 7.5.2: communication
    DEVICE_TYPE = 0x1000
    ERROR_REGISTER = 0x1001
    ERROR_HISTORY = 0x1003  # sub 0: count, then newest first
    SYNC_WINDOW = 0x1007
    DEVICE_NAME = 0x1008
    HARDWARE_VERSION = 0x1009
    SOFTWARE_VERSION = 0x100A
    STORE = 0x1010  # sub 1: all parameters
    RESTORE = 0x1011  # sub 1: all parameters
    HEARTBEAT_CONSUMER = 0x1016  # sub n: node id << 16 | ms
    HEARTBEAT_PRODUCER = 0x1017
    IDENTITY = 0x1018  # sub 1: vendor, 2: product, 3: revision, 4: serial number
    SYNC_COUNTER = 0x1019
    ERROR_BEHAVIOUR = 0x1029  # sub 1: NMT state after a communication error
    RPDO = 0x1400  # the first of its parameters; sub 1: COB-ID, 2: type, 5: timeout
    RPDO_MAPPING = 0x1600  # the first of the mappings; sub 0: count
    TPDO = 0x1800  # sub 1: COB-ID, 2: type, 3: inhibit time, 5: event timer
    TPDO_MAPPING = 0x1A00  # the first of the mappings; sub 0: count

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
    POSITION = 0x6064
    FOLLOWING_WINDOW = 0x6065
    FOLLOWING_TIME = 0x6066
    TARGET_TORQUE = 0x6071
    TARGET_POSITION = 0x607A
    POSITION_LIMITS = 0x607D  # sub 1: minimum, 2: maximum
    POLARITY = 0x607E
    SPEED_LIMIT = 0x6080
    QUICK_STOP_DECELERATION = 0x6085
    HOMING_METHOD = 0x6098
    HOMING_SPEEDS = 0x6099  # sub 1: search for the switch, 2: search for zero
    HOMING_ACCELERATION = 0x609A
    POSITION_OFFSET = 0x60B0
    VELOCITY_OFFSET = 0x60B1
    TORQUE_OFFSET = 0x60B2
    INTERPOLATION_TIME = 0x60C2  # sub 1: value, 2: power of ten of a second
    INPUTS = 0x60FD
    SUPPORTED_MODES = 0x6502
