"""Two scripted drives on a bus in memory, and the bring-up of both."""

import dataclasses

import msgspec
import pytest
from drive_files import CYCLE, HIP_LIMITS, SLIDE_LIMITS, drive
from memory_bus import ManualClock, MemoryBus, scripted

from drives.bringup.bringup import DriveReport, Progress, bring_up
from drives.bringup.configurator import Configurator
from drives.bringup.plan import plan
from drives.errors import BringUpRefused, DriveSilent

START = b"\x01"
RESET_COMMUNICATION = b"\x82"


class Bench:
    """Two drives of one kind on a bus in memory, and the plans for them."""

    def __init__(self, kind="epos4", hip=None, slide=None, serial=None):
        self.clock = ManualClock()
        self.hip = scripted(drive(f"hip_{kind}"), **(hip or {}))
        self.slide = scripted(drive(f"slide_{kind}"), **(slide or {}))
        self.bus = MemoryBus(self.clock, [self.hip, self.slide])
        self.port = Configurator(self.bus, self.clock)
        self.plans = (
            plan(_numbered(drive(f"hip_{kind}"), serial), HIP_LIMITS, CYCLE),
            plan(drive(f"slide_{kind}"), SLIDE_LIMITS, CYCLE),
        )
        self.progress: list[Progress] = []

    def run(self, *, may_switch_off=False) -> tuple[DriveReport, ...]:
        steps = bring_up(self.plans, self.port, CYCLE, may_switch_off=may_switch_off)
        while True:
            try:
                self.progress.append(next(steps))
            except StopIteration as end:
                return end.value

    def sent(self, can_id):
        return [frame.data for frame in self.bus.sent if frame.can_id == can_id]

    def touched_power(self):
        """Whether anything could have moved the power state of a drive."""
        rpdo = [f for f in self.bus.sent if f.can_id & 0x780 in (0x200, 0x300, 0x400, 0x500)]
        return rpdo or [w for n in self.bus.nodes for w in n.written if w[0] == 0x6040]


def _numbered(description, serial):
    """The hip's file with a serial number in it, where one is given."""
    identity = msgspec.structs.replace(description.axis.identity, serial=serial)
    axis = msgspec.structs.replace(description.axis, identity=identity)
    return dataclasses.replace(description, axis=axis)


def refused(bench) -> BringUpRefused:
    with pytest.raises(BringUpRefused) as caught:
        bench.run()
    assert START not in [data[:1] for data in bench.sent(0)]
    assert not bench.touched_power()
    return caught.value


def silent(bench) -> DriveSilent:
    with pytest.raises(DriveSilent) as caught:
        bench.run()
    assert not bench.touched_power()
    return caught.value
