"""A trainer file whose virtual drives run in real time on a bus inside the test's own process."""

import contextlib
import threading
import uuid

import can
from drive_bench import booted_bench
from sessions import changed_configs

from sim_drives.time.wall_clock import RealTime


class Machine:
    """Drives on a bus, and the trainer file that leads to them."""

    def __init__(self, folder, *changes):
        self.channel = uuid.uuid4().hex
        demo = ("demo.toml", 'interface = "simulated"', 'interface = "virtual"')
        address = ("demo.toml", "/dev/shm/gaitd-demo.bus", self.channel)
        self.config = changed_configs(folder, demo, address, *changes) / "demo.toml"
        self.bench = booted_bench()

    @contextlib.contextmanager
    def running(self):
        over = threading.Event()
        with can.Bus(interface="virtual", channel=self.channel) as station:
            drives = RealTime(self.bench.world, station)
            thread = threading.Thread(target=drives.run, args=(over.is_set,))
            thread.start()
            try:
                yield self
            finally:
                over.set()
                thread.join()
