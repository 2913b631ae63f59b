"""CAN frames of the virtual drives: identifier and data, with or without their send time."""

from typing import NamedTuple


class Frame(NamedTuple):
    """One classic CAN data frame with an 11-bit identifier and 0 to 8 bytes."""

    can_id: int
    data: bytes


class TimedFrame(NamedTuple):
    """A frame that a virtual drive has put on the bus at `time_ns` of the world's clock."""

    time_ns: int
    can_id: int
    data: bytes
