"""A CAN frame, as every bus of this project returns it."""

from typing import NamedTuple


class Frame(NamedTuple):
    """One classic CAN frame with an 11-bit identifier, or an error frame of the controller."""

    can_id: int
    data: bytes
    time_ns: int = 0
    """Time of arrival, by the wall clock (of this machine's kernel, or simulated); 0 if unknown. A
    world of virtual drives gives the time at which the frame was sent, by its own clock."""
    is_error: bool = False
    """An error frame (`drives/canopen/bus_state.py`): `can_id` holds the error class."""
