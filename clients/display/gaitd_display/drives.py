"""What the drives say together about the leg. One that is silent, or stale, says nothing."""

from collections.abc import Collection
from typing import NamedTuple

from gaitd_client import DriveState, NotValid
from gaitd_session.session import WITHOUT_POWER
from gaitd_texts import HOLDING


class Drives(NamedTuple):
    """What is sure of all drives."""

    are_holding: bool
    """Each of them can hold the leg."""
    may_have_power: bool
    """One may exert torque, or has not said."""
    is_switch_held: bool
    """Each of them reads the hand switch as closed."""


def together(messages: Collection[DriveState | NotValid]) -> Drives:
    """Return what is sure of all drives, by the newest message of each."""
    heard = [one for one in messages if isinstance(one, DriveState) and one.fresh]
    are_all_heard = bool(messages) and len(heard) == len(messages)
    return Drives(
        are_all_heard and all(drive.power_state in HOLDING for drive in heard),
        not are_all_heard or any(drive.power_state not in WITHOUT_POWER for drive in heard),
        are_all_heard and all(drive.hand_switch_closed is True for drive in heard),
    )
