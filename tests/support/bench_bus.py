"""A trainer file whose virtual drives are on a bus in the test's own process, in simulated time."""

import contextlib

from drive_bench import Bench
from sessions import changed_configs

from drives.canopen.frame import Frame
from gaitd_lab.lockstep import WorldBus, WorldClock

LATER_NS = 50_000_000


class Machine:
    """The trainer file, its booted drives, and another station on their bus."""

    def __init__(self, folder, *changes):
        self.config = changed_configs(folder, *changes) / "demo.toml"
        self.drives = Bench()
        self.drives.boot()
        self._bus = WorldBus(self.drives.world)
        self._other = self._bus.conductor.join("other", in_step=False)

    @contextlib.contextmanager
    def opened(self, _place):
        """In place of `bus_choice.opened`."""
        yield self._bus, WorldClock(self._bus)

    def send_later(self, can_id, data):
        """Let the other station send a frame while a command listens."""
        bus, frames = self._bus.conductor, (Frame(can_id, data),)
        bus.at(bus.world.now_ns + LATER_NS, lambda: bus.send(self._other, frames))
