"""A server of `clients/display` in the act's time: the process behind each page of a demonstration.

`gaitd-display` has the computer's clock. Here silence, rests and blocks are measured in the act's
time, and the server has a seat in step, like the core: time passes only after it has received what
was published until then. So neither a busy computer nor a fast act makes its messages old; both
stretch the act. The servers know nothing of it: they are handed a `Clock`, as in their tests.

A login is of a person, and keeps the computer's clock.
"""

import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

from gaitd_client import NotValid

from daemon.system.clock import AgeClock
from simtime.clock import PageClock
from simtime.link import Link, LinkLostError, SocketLink
from simtime.wire import Role

if TYPE_CHECKING:
    from collections.abc import Callable

    from gaitd_client.wire import Estimate

TURN_NS: Final = 30_000_000
"""Time that may pass beyond what was received; with the 100 ms between two messages of a drive less
than the 200 ms after which a client calls a trainer silent."""
CYCLE_DONE_NS: Final = 20_000_000
"""Largest time from a SYNC to the record of its cycle."""
CATCH_UP_S: Final = 2.0
"""Longest wait for a message that is due, by the computer's clock: the service may have ended."""
POLL_S: Final = 0.002
RETRY_S: Final = 0.1


class Seat:
    """Lets time pass turn by turn, each after the messages of the turn before."""

    def __init__(
        self, link: Link, clock: AgeClock, newest: "Callable[[], Estimate | NotValid]"
    ) -> None:
        """Prepare.

        Args:
            link: seat in step on the bus.
            clock: of the page.
            newest: returns the newest message of a leg, which has one each cycle.
        """
        self._link, self._clock, self._newest = link, clock, newest

    def run(self) -> None:
        """Take part until the process ends."""
        while True:
            if not self.turn():
                time.sleep(RETRY_S)

    def turn(self) -> bool:
        """Let a turn pass, and wait for its messages; False without virtual drives."""
        try:
            self._link.open()
            self._link.wait(self._link.now_ns() + TURN_NS, for_frame=False)
        except LinkLostError:
            return False
        self._link.take()
        due_utc_ns = self._clock.utc_ns() - CYCLE_DONE_NS
        end_s = time.monotonic() + CATCH_UP_S
        while not self._has_come(due_utc_ns) and time.monotonic() < end_s:
            time.sleep(POLL_S)
        return True

    def _has_come(self, due_utc_ns: int) -> bool:
        """Return whether messages are complete up to a time, or there are none at all."""
        newest = self._newest()
        return isinstance(newest, NotValid) or newest.sample_time_ns >= due_utc_ns


def main(kind: str, file: Path, channel: Path, leg: str) -> None:
    """Serve until SIGTERM.

    Args:
        kind: of the page.
        file: settings of its server.
        channel: socket of the act's simulated bus.
        leg: a leg of the trainer.
    """
    from gaitd_display.__main__ import server_of
    from gaitd_display.web import serve

    clock = PageClock(channel)
    made = server_of(kind, file, clock, clock.utc_ahead_ns)
    link = SocketLink(channel, Role.IN_STEP, f"{kind}'s page")
    seat = Seat(link, clock, made.trainer.estimate(leg).newest)
    threading.Thread(target=seat.run, name="seat", daemon=True).start()
    serve(made.app, made.web)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]), sys.argv[4])
