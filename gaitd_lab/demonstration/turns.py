"""Turns of a seat in step: time passes, and waits until what was published in it was received.

The demonstration and each of its clients has such a seat. So neither a busy computer nor a fast act
makes messages old; both stretch the act.
"""

import time
from collections.abc import Callable
from typing import Final

from simtime.link import Link

CYCLE_DONE_NS: Final = 20_000_000
"""Largest time from a SYNC to the record of its cycle."""
CATCH_UP_S: Final = 1.0
"""Longest wait for a message that is due, by the computer's clock: the service may have ended."""
POLL_S: Final = 0.002


def pass_turn(link: Link, turn_ns: int, newest_ns: Callable[[], int | None]) -> None:
    """Let a turn pass, and wait for its messages.

    Args:
        link: seat in step on the bus; opened here.
        turn_ns: time that passes.
        newest_ns: returns the monotonic time of the SYNC of the newest message received, from a
            leg, which has one each cycle; None: the leg is silent, and nothing is waited for.

    Raises:
        LinkLostError: there are no virtual drives.
    """
    link.open()
    link.wait(link.now_ns() + turn_ns, for_frame=False)
    link.take()
    due_ns = link.now_ns() - CYCLE_DONE_NS
    end_s = time.monotonic() + CATCH_UP_S
    while (newest := newest_ns()) is not None and newest < due_ns and time.monotonic() < end_s:
        time.sleep(POLL_S)
