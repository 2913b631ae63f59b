"""A second station on the bus of a lock-step session: a tool that reads beside the service."""

from drives.canopen.bus import Frame
from gaitd_lab.lockstep import WorldClock


class SecondStation:
    """One more station on the wire of a lock-step run; while it waits, the service works on."""

    def __init__(self, session, turn=None):
        self.turn = turn or session.loop.turn
        self.clock = WorldClock(session.bus)
        self.heard = []
        self.sent = []
        self._world = world = session.machine.world
        self._receive, self._advance = world.receive, world.advance_to
        world.receive, world.advance_to = self._from_service, self._from_drives

    def _from_service(self, frame):
        self.heard.append(Frame(frame.can_id, frame.data))
        self._receive(frame)

    def _from_drives(self, time_ns):
        frames = self._advance(time_ns)
        self.heard += [Frame(frame.can_id, frame.data) for frame in frames]
        return frames

    def send(self, frames):
        for frame in frames:
            self.sent.append(frame)
            self._receive(Frame(frame.can_id, frame.data))
        return 0

    def send_urgent(self, frames, deadline_ns, clock):
        return self.send(frames)

    def drain(self):
        traffic, self.heard = self.heard, []
        return traffic

    def receive_until(self, deadline_ns, clock):
        while not self.heard and self.clock.now_ns() < deadline_ns:
            self.turn()
        return self.drain()

    def close(self):
        pass

    def leave(self):
        """Taken off the wire."""
        self._world.receive, self._world.advance_to = self._receive, self._advance


def finished(steps):
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value
