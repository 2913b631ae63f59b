"""Everything that passes over the wire of a lock-step session, in the order of time."""

from candump import TraceLine

from drives.canopen.bus import Frame
from sim_drives.world import World


class Wiretap:
    """Listens to a world from now on; T is what the master sends, R what the drives send."""

    def __init__(self, world: World) -> None:
        self.lines: list[TraceLine] = []
        self._world = world
        self._receive, self._advance_to = world.receive, world.advance_to
        world.receive, world.advance_to = self._hear_master, self._hear_drives

    def _hear_master(self, frame: Frame) -> None:
        self.lines.append(TraceLine(self._world.now_ns, Frame(*frame), sent=True))
        self._receive(frame)

    def _hear_drives(self, time_ns: int) -> list[Frame]:
        frames = self._advance_to(time_ns)
        for timed in frames:
            traffic = Frame(timed.can_id, timed.data)
            self.lines.append(TraceLine(timed.time_ns, traffic, sent=False))
        return frames
