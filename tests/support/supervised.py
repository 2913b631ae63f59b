"""What systemd and the journal are told in a session of lock-step, with the simulated time."""

import itertools


class Systemd:
    """Keeps everything."""

    def __init__(self, clock):
        self._clock = clock
        self.forget()
        self.told = []
        self.is_busy = False
        """It has no room for a message."""

    def forget(self):
        self.lines, self.fed_ns = [], []

    def send(self, *lines):
        if self.is_busy:
            return False
        self.lines += lines
        if "WATCHDOG=1" in lines:
            self.fed_ns.append(self._clock.now_ns())
        return True

    def write(self, text, priority, fields):
        self.told.append((text, priority, dict(fields)))

    @property
    def status(self):
        return [line.removeprefix("STATUS=") for line in self.lines if line.startswith("STATUS=")]

    def longest_pause_ms(self):
        return max(late - early for early, late in itertools.pairwise(self.fed_ns)) * 1e-6


def watched(session):
    """The session, told to a Systemd from now on."""
    session.systemd = Systemd(session.clock)
    supervision = session.loop._supervision
    supervision._supervisor = supervision._log = session.systemd
    return session
