"""`gaitd scan` against devices that we did not write: durand and python-canopen, on one bus."""

import threading
from importlib.metadata import version

import can
import canopen
import pytest
from canopen.objectdictionary import ODVariable, datatypes
from drive_files import FOLDER, drive
from durand import CANBusNetwork, MinimalNode
from durand.scheduler import SyncScheduler, get_scheduler, set_scheduler

from daemon.system.clock import MonotonicClock
from drives.bringup.configurator import Configurator
from drives.canopen.bus import CanBus
from drives.service.dump import read_objects, readable
from drives.service.eds import load_eds
from drives.service.inventory import FindingKind, inventory_of
from drives.service.scan import survey
from drives.service.stations import Expected

DRIVES = (drive("hip_epos4"), drive("slide_epos4"))
PRODUCTS = {one.node_id: one.axis.identity.product_code for one in DRIVES}
"""The EDS has no default for it."""
MBIT = 1_000_000


@pytest.fixture
def channel(request):
    return request.node.name


@pytest.fixture
def durand_at_42(channel):
    before = get_scheduler()
    scheduler = SyncScheduler()
    set_scheduler(scheduler)
    timers = threading.Thread(target=scheduler.run)
    timers.start()
    bus = can.Bus(interface="virtual", channel=channel)
    network = CANBusNetwork(bus)
    network._notifier.timeout = 0.02  # it is waited for when it stops
    node = MinimalNode(network, 42)
    node.object_dictionary.write(0x1000, 0, 0x0001_0191)
    for sub, value in enumerate((0x9A, 0x30923, 0x103F6, 77), start=1):
        node.object_dictionary.write(0x1018, sub, value)
    yield node
    network.stop()
    bus.shutdown()
    scheduler.stop()
    timers.join()
    set_scheduler(before)


def local_node(channel, node_id, serial):
    """python-canopen's LocalNode with our EDS, which answers SDO and no more."""
    network = canopen.Network()
    network.NOTIFIER_CYCLE = 0.02
    network.connect(interface="virtual", channel=channel)
    node = network.create_node(node_id, str(FOLDER / "epos4.eds"))
    node.sdo[0x1018][2].raw = PRODUCTS[node_id]
    node.sdo[0x1018][4].raw = serial
    name = node.object_dictionary[0x1008]
    assert isinstance(name, ODVariable)
    assert name.data_type == datatypes.VISIBLE_STRING
    node.set_data(0x1008, 0, b"EPOS4 Compact 50/5 CAN")
    return network


@pytest.fixture
def foreign_drives(channel):
    networks = [local_node(channel, node_id, 1000 + node_id) for node_id in (5, 6)]
    yield networks
    for network in networks:
        network.disconnect()


def scan(channel, expected):
    bus = CanBus.open("virtual", channel, MBIT)
    found = finished(survey(bus, MonotonicClock(), MBIT))
    bus.close()
    return inventory_of(found, expected)


def finished(steps):
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def test_the_other_stacks_are_the_versions_that_these_tests_know():
    assert (version("durand"), version("canopen")) == ("0.5.0", "2.4.1")


@pytest.mark.usefixtures("durand_at_42", "foreign_drives")
def test_devices_of_two_other_stacks_are_listed_with_their_identity(channel):
    found = scan(channel, Expected(DRIVES, master_node_id=1))

    hip, slide, stranger = found.stations
    assert (hip.device_name, hip.serial) == ("EPOS4 Compact 50/5 CAN", 1005)
    assert (slide.vendor, slide.serial, slide.drive) == ("maxon", 1006, "right/slide")
    assert (stranger.node_id, stranger.vendor, stranger.profile_number) == (42, "Elmo", 401)
    assert (stranger.product_code, stranger.revision, stranger.serial) == (0x30923, 0x103F6, 77)
    assert not found.is_wrong


@pytest.mark.usefixtures("foreign_drives")
def test_two_devices_of_another_stack_with_one_node_id_are_told(channel):
    twin = local_node(channel, 5, 4711)

    found = scan(channel, Expected(DRIVES, master_node_id=1))
    twin.disconnect()

    twice = [f.node_id for f in found.findings if f.kind is FindingKind.DUPLICATE_NODE]
    assert twice == [5]


@pytest.mark.usefixtures("durand_at_42")
def test_a_reset_by_another_master_and_the_boot_up_after_it_are_heard(channel):
    bus = CanBus.open("virtual", channel, MBIT)
    with can.Bus(interface="virtual", channel=channel) as master:
        steps = survey(bus, MonotonicClock(), MBIT)
        next(steps)
        master.send(can.Message(arbitration_id=0, data=b"\x82\x2a", is_extended_id=False))
        found = inventory_of(finished(steps), Expected())
    bus.close()

    assert [f.kind for f in found.findings] == [FindingKind.FOREIGN_MASTER, FindingKind.BOOTED]


@pytest.mark.usefixtures("foreign_drives")
def test_a_dump_of_another_stack_s_device_is_what_its_own_client_reads(channel):
    description = drive("hip_epos4")
    dictionary = load_eds(description.eds, 5)
    theirs = canopen.Network()
    theirs.NOTIFIER_CYCLE = 0.02
    theirs.connect(interface="virtual", channel=channel)
    node = theirs.add_node(5, description.eds)
    bus = CanBus.open("virtual", channel, MBIT)

    entries = finished(read_objects(5, readable(dictionary), Configurator(bus, MonotonicClock())))
    for entry in entries:
        variable = node.sdo[entry.index]
        if not isinstance(variable, canopen.sdo.SdoVariable):
            variable = variable[entry.sub]
        if entry.trouble:
            with pytest.raises(canopen.SdoAbortedError):
                _ = variable.raw
        else:
            assert entry.value == variable.raw, entry
    bus.close()
    theirs.disconnect()

    assert any(entry.value == "EPOS4 Compact 50/5 CAN" for entry in entries)
    assert len(entries) == len(readable(dictionary))
