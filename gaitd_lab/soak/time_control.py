"""The time of a soak: simulated, passing in `turn` only; or the computer's."""

import time
from pathlib import Path
from typing import Final

from simtime.clock import PageClock
from simtime.link import LinkLostError, SocketLink
from simtime.wire import Role

SERVED_WITHIN_S: Final = 300.0
"""Time limit: the first start of the virtual drives compiles their plant."""
_POLL_S: Final = 0.05


class TimeControl:
    """Controls the time of the virtual drives (`sim_drives/time/server.py`)."""

    def __init__(self, channel: Path, *, wall_clock: bool) -> None:
        """Time passes by itself until `hold`.

        Args:
            channel: socket of the virtual drives.
            wall_clock: time is the computer's.
        """
        self._channel, self.is_wall_clock = channel, wall_clock
        self._link = SocketLink(channel, Role.HAND, "soak")
        self._clock = PageClock(channel)

    def hold(self) -> None:
        """Hold simulated time from now on, except in `turn`; waits for the virtual drives.

        Raises:
            LinkLostError: they do not answer.
        """
        end_s = time.monotonic() + SERVED_WITHIN_S
        while True:
            try:
                self._link.open()
                break
            except LinkLostError:
                if time.monotonic() > end_s:
                    raise
                time.sleep(_POLL_S)
        if not self.is_wall_clock:
            self._link.command("hold")

    def now_s(self) -> float:
        """Time of the core's clock."""
        return self._clock.now_ns() * 1e-9

    def turn(self, duration_s: float, *, in_haste: bool) -> None:
        """Let time pass.

        Args:
            duration_s: the time that passes.
            in_haste: as fast as it can where it is simulated; else no faster than the computer's,
                because something that uses the computer's time must keep up.

        Raises:
            LinkLostError: the virtual drives have ended.
        """
        begun_s = time.monotonic()
        if not self.is_wall_clock:
            self._link.command(f"run {duration_s:.6f}")
        if self.is_wall_clock or not in_haste:
            time.sleep(max(duration_s - (time.monotonic() - begun_s), 0.0))

    def command_drives(self, words: str) -> None:
        """Send commands to the virtual drives, one a line, at this instant.

        Raises:
            LinkLostError: they have ended.
            ValueError: they refuse one.
        """
        for line in words.splitlines():
            self._link.command(line)

    def close(self) -> None:
        """Let time pass by itself again."""
        self._link.close()
