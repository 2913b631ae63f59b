"""The master's parts against a CANopen slave that we did not write: durand 0.5.0, in lock-step.

What durand lacks is listed in `durand_slave.py`, with what stands in for it.
"""

import threading
from importlib.metadata import version

import pytest
from drive_files import CYCLE, HIP_LIMITS, SLIDE_LIMITS, drive
from durand import Variable
from durand.datatypes import DatatypeEnum
from durand.scheduler import get_scheduler, set_scheduler
from durand_slave import DurandWorld
from memory_bus import MS

from drives.bringup.bringup import bring_up
from drives.bringup.configurator import Configurator
from drives.bringup.plan import plan
from drives.canopen.bus import Frame
from drives.canopen.nmt import SYNC_FRAME, NmtCommand, nmt_frame
from drives.cia402.drive import Drive, DriveGroup
from drives.cia402.pdo import layouts
from drives.errors import SdoAborted
from drives.signals import DriveCommand, OperationMode, PowerRequest, PowerState
from gaitd_lab.lockstep import WorldBus, WorldClock


@pytest.fixture
def bench():
    before = get_scheduler()
    world = DurandWorld([drive(name) for name in ("hip_generic", "slide_generic")])
    bus = WorldBus(world)
    yield world.drives, bus, WorldClock(bus)
    set_scheduler(before)


PLANS = (
    plan(drive("hip_generic"), HIP_LIMITS, CYCLE),
    plan(drive("slide_generic"), SLIDE_LIMITS, CYCLE),
)


def brought_up(bus, clock):
    steps = bring_up(PLANS, Configurator(bus, clock), CYCLE)
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def test_durand_is_the_version_that_these_tests_know():
    assert version("durand") == "0.5.0"


def test_both_slaves_are_brought_up_without_any_thread_of_ours(bench):
    slaves, bus, clock = bench
    slaves[0].dictionary.write(0x6041, 0, 0x0240)
    slaves[0].dictionary.write(0x6064, 0, 4321)
    before = threading.active_count()

    hip, slide = brought_up(bus, clock)

    assert threading.active_count() == before
    assert (hip.name, slide.name) == ("right/hip", "right/slide")
    assert hip.power_state is PowerState.SWITCH_ON_DISABLED
    assert hip.position_counts == 4321
    assert slaves[1].dictionary.read(0x607D, 1) == -12288
    assert slaves[0].node.nmt.state == 5


def test_what_the_group_sends_and_reads_is_what_durand_maps(bench):
    slaves, bus, clock = bench
    brought_up(bus, clock)
    group = DriveGroup([Drive(p.description, clock.now_ns()) for p in PLANS])
    slaves[1].dictionary.write(0x6041, 0, 0x1637)
    slaves[1].dictionary.write(0x6064, 0, -777)
    slaves[1].dictionary.write(0x6077, 0, -55)
    slaves[1].dictionary.write(0x60FD, 0, 0x00030000)
    bus.drain()

    bus.send([SYNC_FRAME])
    deadline_ns = clock.now_ns() + 500 * MS
    missing = set(group.cyclic_ids)
    while missing and clock.now_ns() < deadline_ns:
        frames = bus.receive_until(deadline_ns, clock)
        group.feed(frames, clock.now_ns())
        missing -= {frame.can_id for frame in frames}
    _, slide = group.end_of_window(1, clock.now_ns())
    command = DriveCommand(PowerRequest.ENABLE, OperationMode.CYCLIC_SYNC_TORQUE, -777, -123)
    bus.send(group.frames([command, command]))
    bus.send([SYNC_FRAME])

    assert slide.fresh
    assert (slide.position_counts, slide.torque_raw) == (-777, -55)
    assert slaves[1].dictionary.read(0x6071, 0) == -123
    assert slaves[1].dictionary.read(0x6040, 0) == 0x000F
    assert slaves[1].dictionary.read(0x607A, 0) == -777


def test_nmt_commands_move_durand(bench):
    slaves, bus, _ = bench

    for command, state in ((NmtCommand.START, 5), (NmtCommand.STOP, 4), (0x80, 127)):
        bus.send([nmt_frame(NmtCommand(command), 5)])

        assert slaves[0].node.nmt.state == state
    assert slaves[1].node.nmt.state == 127


def test_durand_s_aborts_carry_their_code(bench):
    _, bus, clock = bench
    port = Configurator(bus, clock)

    for index, sub, code in ((0x5FFF, 0, 0x06020000), (0x1018, 9, 0x06090011)):
        with pytest.raises(SdoAborted) as caught:
            port.read(5, index, sub)
        assert (caught.value.index, caught.value.sub, caught.value.code) == (index, sub, code)
    with pytest.raises(SdoAborted) as caught:
        port.write(5, 0x6041, 0, b"\x00\x00")
    assert caught.value.code == 0x06010002


def test_a_text_longer_than_four_bytes_is_transferred_in_segments(bench):
    slaves, bus, clock = bench
    name = b"a name that is longer than four bytes"
    slaves[0].dictionary[0x2F00] = Variable(DatatypeEnum.VISIBLE_STRING, "rw", b"")
    port = Configurator(bus, clock)

    port.write(5, 0x2F00, 0, name)

    assert port.read(5, 0x2F00, 0) == name


def test_a_short_rpdo_is_what_durand_calls_8210(bench):
    # Ours have the mapped length: the slave objects to a frame that has not.
    slaves, bus, clock = bench
    brought_up(bus, clock)
    size = layouts(drive("hip_generic").profile, 5).control.size
    bus.drain()

    bus.send([Frame(0x205, bytes(size)), SYNC_FRAME])
    bus.send([Frame(0x206, bytes(size - 1)), SYNC_FRAME])

    answers = [frame for frame in bus.drain() if frame.can_id & 0x780 == 0x080]
    assert [(frame.can_id, frame.data[:2]) for frame in answers] == [(0x086, b"\x10\x82")]
    assert slaves[0].node.nmt.state == 5
